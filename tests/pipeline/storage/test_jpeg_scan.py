"""A JPEG that was damaged in the middle is told from a sound one of any kind."""

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from orthomill.pipeline.storage.image_files import read_header, read_pixels
from orthomill.pipeline.storage.photographs.jpeg_scan import Fault, _segments, broken_jpeg
from orthomill.schemas.errors import PhotoError
from orthomill.schemas.raster import Window

SHARED = Path(__file__).parents[4] / "shared"
KINDS = (
    {},
    {"optimize": True},
    {"restart_marker_blocks": 7},
    {"restart_marker_rows": 1},
    {"subsampling": 0},
    {"subsampling": 2, "quality": 30},
    {"quality": 100},
    {"progressive": True},
)


def scene(rows: int = 480, cols: int = 643, bands: int = 3) -> Image.Image:
    """Smooth hills with fine texture, from black to white."""
    rng = np.random.default_rng(5)
    hills = np.array(Image.fromarray(rng.integers(0, 256, (9, 12), dtype=np.uint8)).resize((cols, rows), Image.Resampling.BICUBIC))
    fine = rng.normal(0.0, 12.0, (rows, cols, bands))
    return Image.fromarray(np.clip(hills[..., None] + fine, 0, 255).astype(np.uint8).squeeze())


def jpeg(image: Image.Image, **how) -> bytes:
    out = io.BytesIO()
    image.save(out, "JPEG", **how)
    return out.getvalue()


def scan(content: bytes) -> tuple[int, int]:
    """Where the data of the first scan begin, behind any thumbnail, and where the picture ends."""
    start = next(end for marker, _, end in _segments(content) if marker == 0xDA)
    return start, content.index(b"\xff\xd9", start)


def damages(content: bytes, count: int, seed: int = 3):
    """The same file with a run of zeros, of 0xFF, or a cluster of another place over a part of its scan."""
    rng = np.random.default_rng(seed)
    start, end = scan(content)
    for i in range(count):
        size = min(512 << rng.integers(0, 4), (end - start) // 3)
        at, other = rng.integers(start, end - size, 2)
        cluster = (bytes(size), b"\xff" * size, content[other : other + size])[i % 3]
        if content[at : at + size] != cluster:
            yield content[:at] + cluster + content[at + size :]


@pytest.mark.parametrize("how", KINDS, ids=str)
@pytest.mark.parametrize(("bands", "shape"), [(3, (480, 643)), (1, (75, 101)), (3, (8, 8))])
def test_sound_files_of_every_kind_pass(how, bands, shape):
    assert broken_jpeg(jpeg(scene(*shape, bands), **how)) is None


def test_several_pictures_in_one_file_pass(tmp_path):
    scene().save(tmp_path / "a.mpo", save_all=True, append_images=[scene(60, 80)])
    assert broken_jpeg((tmp_path / "a.mpo").read_bytes()) is None
    assert broken_jpeg(jpeg(scene()) + bytes(10_000)) is None, "data behind the end marker do no harm"


@pytest.mark.parametrize("how", KINDS[:-1], ids=str)
def test_damage_in_the_middle_is_found(how):
    content = jpeg(scene(), **how)
    found = [broken_jpeg(damaged) is not None for damaged in damages(content, 60)]
    # A small cluster may by chance have as many blocks as the one that it replaces, and end in step.
    assert np.mean(found) >= 0.95


def test_what_is_wrong_is_named():
    content = jpeg(scene())
    start, end = scan(content)
    middle = (start + end) // 2
    assert broken_jpeg(content[:middle] + content[end:]).fault is Fault.ENDS_EARLY
    assert broken_jpeg(content[:end] + bytes(100) + content[end:]).fault is Fault.DATA_LEFT
    marked = jpeg(scene(), restart_marker_rows=1)
    at = marked.index(b"\xff\xd1")
    assert broken_jpeg(marked[:at] + b"\xff\xd5" + marked[at + 2 :]).fault is Fault.OUT_OF_TURN


def test_a_damaged_photograph_is_refused_when_its_pixels_are_read(tmp_path):
    content = jpeg(scene())
    middle = sum(scan(content)) // 2
    path = tmp_path / "a.jpg"
    path.write_bytes(content[:middle] + bytes(2048) + content[middle + 2048 :])
    assert read_header(path).width == 643
    with pytest.raises(PhotoError, match=r"The picture in .*a\.jpg is damaged .*: it holds .*; copy the file again"):
        read_pixels(path, Window(0, 0, 128, 643))


def test_damaged_progressive_files_are_refused_by_the_decoder(tmp_path):
    refused = 0
    for damaged in damages(jpeg(scene(), progressive=True), 30):
        (tmp_path / "a.jpg").write_bytes(damaged)
        try:
            read_pixels(tmp_path / "a.jpg", Window(0, 0, 480, 643))
        except PhotoError:
            refused += 1
    assert refused >= 25


@pytest.mark.skipif(not (SHARED / "data").is_dir(), reason="real photographs are not here")
def test_real_photographs_pass_and_their_damaged_versions_do_not():
    for folder in ("brighton", "rtk_yard", "oblique_kite"):
        path = sorted(path for path in (SHARED / "data" / folder).rglob("*") if path.suffix.lower() in (".jpg", ".jpeg"))[0]
        content = path.read_bytes()
        assert broken_jpeg(content) is None
        assert sum(broken_jpeg(damaged) is not None for damaged in damages(content, 12)) >= 11, folder
