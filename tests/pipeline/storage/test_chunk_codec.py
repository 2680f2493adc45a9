"""What the store writes is zarr's own file, byte for byte, and what zarr writes is read by the store."""

from pathlib import Path

import numpy as np
import pytest
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.pipeline.storage.array_metadata import sealed
from orthomill.pipeline.storage.file_names import path_of
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.errors import StoreError
from orthomill.schemas.raster import RasterSpec, Window, tiles_of

KINDS = [("float32", float("nan")), ("float32", 0.0), ("float32", -0.0), ("float64", -9999.0), ("uint8", 0), ("uint8", None)]
KINDS += [("int16", -1), ("uint16", 65535), ("int32", 0), ("float32", None), ("float32", float("inf")), ("uint32", 7)]


def files_of(store: Store, name: str) -> dict[str, bytes]:
    place = store.depot.path / store.place(name)
    return {path.relative_to(place).as_posix(): path.read_bytes() for path in place.rglob("*") if path.is_file()}


def values_of(spec: RasterSpec, empty: int, seed: int) -> np.ndarray:
    """Values with chunks of nothing but the fill, zeros of both signs, and noise, which does not shrink when it is packed."""
    chance = np.random.default_rng(seed)
    values = chance.integers(0, 200, spec.shape).astype(spec.dtype)
    if spec.dtype.startswith("float"):
        values[chance.random(spec.shape) < 0.2] *= np.float32(-1e-3)
    fill = spec.nodata if spec.nodata is not None else 0
    for number, tile in enumerate(tiles_of(spec.shape, spec.chunk)):
        if number % 3 == empty:
            values[tile.window.slices] = fill
            if number % 2 and fill == 0 and spec.dtype.startswith("float"):
                values[tile.window.slices] = -0.0
    return values


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 70), st.integers(1, 70), st.integers(0, 4), st.integers(4, 40), st.sampled_from(KINDS), st.integers(0, 3))
def test_chunks_are_those_of_zarr_byte_for_byte(tmp_path_factory, rows, cols, bands, chunk, kind, empty):
    dtype, nodata = kind
    shape = (rows, cols, bands) if bands else (rows, cols)
    spec = RasterSpec(name="a/b c", shape=shape, dtype=dtype, chunk=chunk, nodata=nodata)
    values = values_of(spec, empty, rows)
    store, other = (Store(tmp_path_factory.mktemp(name)) for name in ("own", "zarr"))
    for one in (store, other):
        one.create(spec)
    array = zarr.open_array(other.rasters, path=path_of(spec.name).as_posix(), mode="r+")
    # Twice, the second time with other empty chunks: files of the first must go.
    for given_values in (values_of(spec, (empty + 1) % 4, cols), values):
        for tile in tiles_of(shape, 2 * chunk):
            store.write(spec.name, tile.window, given_values[tile.window.slices])
            array[tile.window.slices] = given_values[tile.window.slices]
    own, theirs = files_of(store, spec.name), files_of(other, spec.name)
    assert own.keys() == theirs.keys() and all(own[name] == theirs[name] for name in own if name != "zarr.json")
    assert store.read(spec.name, spec.full).tobytes() == values.tobytes()
    window = Window(rows // 3, cols // 2, rows - rows // 3, cols - cols // 2)
    read = other.read(spec.name, window)
    assert read.tobytes() == np.ascontiguousarray(array[window.slices]).tobytes() and read.flags.writeable


def test_a_chunk_is_packed_alike_in_every_thread(tmp_path):
    """Blosc on several threads writes the blocks of a chunk in the order in which they happen to be done."""
    spec = RasterSpec(name="a/b", shape=(1024, 1024), dtype="float32", chunk=1024, nodata=float("nan"))
    (store := Store(tmp_path)).create(spec)
    values = np.random.default_rng(1).random(spec.shape).astype(np.float32)
    seen = set()
    for _ in range(3):
        store.write("a/b", spec.full, values)
        seen.add(files_of(store, "a/b")["c/0/0"])
    assert len(seen) == 1


@pytest.mark.parametrize("at", [0, 7, 40, -5, -1])
def test_a_flipped_bit_of_a_chunk_is_found_when_it_is_read(tmp_path, at):
    spec = RasterSpec(name="a/b", shape=(40, 40), dtype="float32", chunk=32, nodata=float("nan"))
    (store := Store(tmp_path)).create(spec)
    store.write("a/b", spec.full, np.arange(1600, dtype=np.float32).reshape(40, 40))
    path = tmp_path / next(iter(store.written))
    content = bytearray(path.read_bytes())
    content[at] ^= 1
    path.write_bytes(content)
    with pytest.raises(StoreError, match="The raster a/b is damaged in"):
        store.read("a/b", spec.full)
    path.write_bytes(content[:3])
    with pytest.raises(StoreError, match="The raster a/b is damaged in"):
        store.read("a/b", spec.full)


def test_an_array_with_other_codecs_is_refused_in_a_sentence(tmp_path):
    spec = RasterSpec(name="a/b", shape=(40, 40), dtype="float32", chunk=32)
    (store := Store(tmp_path)).create(spec)
    attributes = dict(zarr.open_array(store.rasters, path="a/b").attrs)
    zarr.create_array(store.rasters, name="a/b", shape=(40, 40), dtype="float32", attributes=attributes, overwrite=True)
    name = f"{store.place('a/b')}/zarr.json"
    store.depot.put(name, sealed(store.depot.get(name)))
    with pytest.raises(StoreError, match="The raster a/b cannot be read: its chunks are stored as bytes, zstd; remove it"):
        Store(Path(tmp_path)).read("a/b", spec.full)
