"""Codecs that are called directly read and write what zarr's own way does, bit for bit."""

import numpy as np
import pytest
import zarr
from zarr.codecs import BloscCodec, Crc32cCodec, ShardingCodec

from orthomill.pipeline.storage.direct_codecs import DirectCodecs, direct_codecs

SEALED = (BloscCodec(cname="lz4", clevel=1, shuffle="shuffle"), Crc32cCodec())


@pytest.fixture
def values() -> np.ndarray:
    values = np.random.default_rng(3).integers(0, 9, (70, 50, 3)).astype(np.float32)
    values[:32, :32] = 0  # a whole chunk of the fill value has no file
    return values


def made(folder, values, **options):
    return zarr.create_array(folder, shape=values.shape, dtype=values.dtype, fill_value=0, **options)


@pytest.mark.parametrize("compressors", [SEALED, (), (BloscCodec(),)], ids=["sealed", "plain", "blosc"])
def test_files_and_values_are_those_of_zarr(tmp_path, values, compressors):
    for folder in ("own", "direct"):
        made(tmp_path / folder, values, chunks=(32, 32, 3), compressors=compressors)
    own = zarr.open_array(tmp_path / "own", mode="r+")
    with direct_codecs():
        direct = zarr.open_array(tmp_path / "direct", mode="r+")
    assert isinstance(direct._async_array.codec_pipeline, DirectCodecs)
    own[:], direct[:] = values, values
    files = [sorted(path.relative_to(tmp_path / folder) for path in (tmp_path / folder).rglob("*")) for folder in ("own", "direct")]
    assert files[0] == files[1] and not (tmp_path / "direct" / "c" / "0" / "0" / "0").exists()
    chunks = [path for path in files[0] if (tmp_path / "own" / path).is_file() and path.name != "zarr.json"]
    assert chunks and all((tmp_path / "own" / path).read_bytes() == (tmp_path / "direct" / path).read_bytes() for path in chunks)
    np.testing.assert_array_equal(direct[5:69, 7:50], values[5:69, 7:50])


def test_a_damaged_chunk_is_noticed(tmp_path, values):
    made(tmp_path, values, chunks=(32, 32, 3), compressors=SEALED)
    with direct_codecs():
        direct = zarr.open_array(tmp_path, mode="r+")
    direct[:] = values
    chunk = tmp_path / "c" / "1" / "1" / "0"
    chunk.write_bytes(chunk.read_bytes()[:-1] + b"?")
    with pytest.raises(ValueError, match="checksum"):
        direct[40:50, 40:50]


def test_codecs_that_cannot_be_called_directly_go_the_way_of_zarr(tmp_path, values):
    made(tmp_path, values, chunks=(32, 32, 3), serializer=ShardingCodec(chunk_shape=(16, 16, 3)), compressors=())
    with direct_codecs():
        sharded = zarr.open_array(tmp_path, mode="r+")
    sharded[:] = values
    np.testing.assert_array_equal(sharded[:], values)


def test_arrays_of_others_are_not_touched(tmp_path, values):
    made(tmp_path, values, chunks=(32, 32, 3))
    assert not isinstance(zarr.open_array(tmp_path)._async_array.codec_pipeline, DirectCodecs)
