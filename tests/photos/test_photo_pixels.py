"""Pixels upright, strip by strip, through the stage's own jobs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageOps

from orthomill.pipeline.engine.graph import check_memory
from orthomill.pipeline.engine.runner import SequentialRunner
from orthomill.pipeline.engine.session import Session
from orthomill.pipeline.storage.photographs.folder_listing import image_files
from orthomill.schemas.errors import ResourceError
from orthomill.schemas.photo import PHOTOS, photo_raster
from orthomill.schemas.project import Project
from orthomill.schemas.raster import Window
from orthomill.schemas.stage_report import report_table
from orthomill.tasks.imagery.pyramid import halved
from orthomill.tasks.imagery.upright import file_window, upright, upright_shape
from orthomill.tasks.photos.pixels import exposure, upright_strip
from orthomill.tasks.photos.stage import PhotosStage


class _Silence:
    def planned(self, key): ...

    def skipped(self, key): ...

    def finished(self, finished, seconds): ...


def _run(root, stage: PhotosStage | None = None, **project) -> Session:
    base = {
        "project": "p",
        "crs": "EPSG:2100",
        "photographs": {"kind": "folder", "path": "in"},
        "positions": {"kind": "none"},
        "tile": 128,
    }
    stages = (stage or PhotosStage(),)
    session = Session(Project.model_validate({**base, **project}), stages, root, lambda source: image_files(root, source))
    session.run(SequentialRunner(2**30), _Silence())
    return session


def _picture(rows: int, cols: int, bands: int = 3) -> np.ndarray:
    return np.random.default_rng(5).integers(0, 256, (rows, cols, bands), dtype=np.uint8)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_the_flag_is_obeyed_as_another_reader_obeys_it(orientation):
    pixels = _picture(7, 11)
    image = Image.fromarray(pixels)
    image.getexif()[0x0112] = orientation
    assert np.array_equal(upright(pixels, orientation), np.asarray(ImageOps.exif_transpose(image)))


@settings(max_examples=60, deadline=None)
@given(
    orientation=st.integers(1, 8), row=st.integers(0, 8), col=st.integers(0, 8), height=st.integers(1, 9), width=st.integers(1, 9)
)
def test_a_window_of_the_file_gives_the_window_of_the_upright_photograph(orientation, row, col, height, width):
    pixels = _picture(13, 17)
    window = Window(row, col, height, width).clipped(upright_shape(orientation, 13, 17))
    part = pixels[file_window(window, orientation, 13, 17).slices]
    assert np.array_equal(upright_strip(part, orientation), upright(pixels, orientation)[window.slices])


@pytest.mark.parametrize("orientation", [1, 6, 8])
def test_files_become_rasters_with_pyramids(tmp_path, orientation):
    (tmp_path / "in").mkdir()
    exif = Image.Exif()
    exif[0x0112] = orientation
    Image.fromarray(_picture(300, 700)[:, :, 0]).save(tmp_path / "in" / "one.jpg", exif=exif)
    pixels = np.asarray(Image.open(tmp_path / "in" / "one.jpg"))[:, :, None]
    session = _run(tmp_path)
    assert not session.failures
    photo = session.store.table(PHOTOS)["one"]
    expected = upright(pixels, photo.exif_orientation)
    assert photo.exif_orientation == orientation and photo.levels == 2
    for level in range(photo.levels):
        spec = session.store.spec(photo_raster("one", level))
        assert np.array_equal(session.store.read(spec.name, spec.full), expected)
        expected = halved(expected)


def test_sixteen_bit_grey_keeps_its_values_and_the_report_warns(tmp_path):
    (tmp_path / "in").mkdir()
    pixels = np.arange(200 * 150, dtype=np.uint16).reshape(150, 200) * 2
    Image.fromarray(pixels).save(tmp_path / "in" / "deep.png")
    Image.fromarray(_picture(150, 200)).save(tmp_path / "in" / "shallow.jpg")
    session = _run(tmp_path, positions={"kind": "exif"})
    assert not session.failures
    assert np.array_equal(session.store.read(photo_raster("deep"), Window(0, 0, 150, 200))[:, :, 0], pixels)
    said = " ".join(session.store.table(report_table("photos")).warnings)
    assert "2 photographs (deep, shallow) without a position" in said and "Grey and colour photographs are mixed" in said


def test_exposure_counts_the_ends_of_the_range():
    overview = np.full((10, 10, 1), 128, dtype=np.uint8)
    overview[:2], overview[2:3] = 255, 0
    found = exposure(overview, "a")
    assert (found.white, found.black) == (pytest.approx(0.2), pytest.approx(0.1))


def test_the_limit_of_megapixels_is_that_of_the_setting(tmp_path):
    (tmp_path / "in").mkdir()
    Image.fromarray(_picture(150, 200)).save(tmp_path / "in" / "one.jpg")
    (sentence,) = _run(tmp_path, stage=PhotosStage(max_megapixels=0.02)).failures.values()
    assert "one.jpg has 0.0 megapixels (200 x 150), more than the 0.02 that are allowed" in sentence
    assert not _run(tmp_path, stage=PhotosStage(max_megapixels=0.04)).failures


@pytest.mark.parametrize("orientation", [1, 6])
def test_a_photograph_that_is_decoded_in_order_is_read_in_strips_that_memory_allows(tmp_path, monkeypatch, orientation):
    (tmp_path / "in").mkdir()
    exif = Image.Exif()
    exif[0x0112] = orientation
    Image.fromarray(_picture(600, 300)).save(tmp_path / "in" / "one.jpg", exif=exif)
    whole = _run(tmp_path)
    monkeypatch.setattr("orthomill.tasks.photos.plan.photo_jobs.AT_ONCE", 300 * 3 * 300)
    cut = _run(tmp_path, project="cut")
    strips = [sum(key[1] == "one strip" for key in session.graph.jobs) for session in (whole, cut)]
    assert strips == [1, 3], "600 rows of the file, at most 300 at a time, in whole tiles of 128"
    stored = [session.store.read(photo_raster("one"), session.store.spec(photo_raster("one")).full) for session in (whole, cut)]
    assert np.array_equal(stored[0], stored[1])
    assert stored[0].shape == (*upright_shape(orientation, 600, 300), 3) and stored[0].std() > 20


def test_a_progressive_jpeg_asks_for_the_memory_of_its_decoder_and_names_the_way_out(tmp_path):
    (tmp_path / "in").mkdir()
    for name, progressive in (("plain", False), ("progressive", True)):
        Image.fromarray(_picture(300, 200)).save(tmp_path / "in" / f"{name}.jpg", progressive=progressive)
    jobs = _run(tmp_path).graph.jobs
    memory = {name: jobs["photos", f"{name} strip", 0, 0].memory for name in ("plain", "progressive")}
    assert memory["progressive"] == 600 * 2**20 + (3 + 3 + 6) * 300 * 200
    with pytest.raises(ResourceError, match=r"with --memory or save in/progressive\.jpg as a tiled TIFF"):
        check_memory(jobs["photos", "progressive strip", 0, 0], 600 * 2**20)


def test_twelve_bits_in_sixteen_are_judged_by_their_own_range():
    values = np.random.default_rng(1).integers(200, 3900, (64, 64, 1)).astype(np.uint16)
    found = exposure(values, "a")
    assert found.mean == pytest.approx(values.mean() / 4095, abs=1e-3) and found.contrast > 0.2 and found.black == 0.0
