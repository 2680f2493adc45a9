"""`orthomill inspect`: the picture and its histogram, whatever the strips, the orientation flag and the bit depth; refusals."""

import re
import zlib

import cv2
import numpy as np
import pytest
import rasterio
from PIL import Image
from rasterio.errors import NotGeoreferencedWarning
from typer.testing import CliRunner

from orthomill.pipeline.cli.commands.application import app
from orthomill.pipeline.report import grey_png
from orthomill.pipeline.storage import image_files
from orthomill.schemas.raster import Window
from orthomill.tasks.inspections import window_size
from orthomill.tasks.inspections.window_size import Method, sizing_of
from orthomill.tasks.matching.windows.size_map import published_levels, size_map
from orthomill.tasks.matching.windows.sizes import grey_levels


def photograph() -> np.ndarray:
    """Grey, 120 x 160: texture on the left, sky on the right."""
    rng = np.random.default_rng(0)
    image = cv2.GaussianBlur(rng.normal(size=(120, 160)), (0, 0), 1.2) * 120 + 120
    image[:, 90:] = 180
    return np.clip(image, 0, 255).astype(np.uint8)


def expected(image: np.ndarray, method: str = "foerstner") -> np.ndarray:
    sizing = sizing_of(Method(method), 35)
    return published_levels(size_map(grey_levels(image), Window(0, 0, *image.shape), sizing), sizing)


def inspect(*words: str, code: int = 0) -> str:
    result = CliRunner().invoke(app, ["inspect", "window-size", *map(str, words)])
    assert result.exit_code == code, result.output
    assert code == 0 or "Traceback" not in result.output
    return " ".join(result.output.split())


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Image.fromarray(photograph()).save(tmp_path / "photo.png")
    return tmp_path


@pytest.mark.parametrize("method", list(Method))
@pytest.mark.parametrize("pixels_of_a_strip", [1, 160 * 50, 10**9])
def test_the_picture_is_the_map_in_strips_of_any_height(folder, monkeypatch, method, pixels_of_a_strip):
    monkeypatch.setattr(window_size, "_STRIP", pixels_of_a_strip)
    said = inspect("photo.png", "--method", method)
    found = cv2.imread(f"photo_window_size_{method}.png", cv2.IMREAD_UNCHANGED)
    assert found.dtype == np.uint8 and (found == expected(photograph(), method)).all()
    none = float(re.search(r"none 255 ([\d.]+) %", said)[1])
    assert none == pytest.approx(100 * (found == 255).mean(), abs=0.051)


def test_a_turned_photograph_is_mapped_upright(folder, monkeypatch):
    monkeypatch.setattr(window_size, "_STRIP", 160 * 30)
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(np.rot90(photograph(), 1)).save("turned.jpg", exif=exif)
    as_stored = np.asarray(Image.open("turned.jpg"))
    inspect("turned.jpg", "--output", "map.png")
    assert (cv2.imread("map.png", cv2.IMREAD_UNCHANGED) == expected(np.rot90(as_stored, -1))).all()


def test_16_bits_are_stretched_and_colour_is_grey(folder):
    Image.fromarray(photograph().astype(np.uint16) * 100 + 3000).save("deep.tif")
    Image.fromarray(np.dstack([photograph()] * 3)).save("colour.png")
    inspect("deep.tif", "--method", "entropy", "--output", "deep.png")
    inspect("colour.png", "--method", "entropy", "--output", "grey.png")
    deep, grey = cv2.imread("deep.png", -1), cv2.imread("grey.png", -1)
    assert (grey == expected(photograph(), "entropy")).all()
    assert ((deep < 255) == (grey < 255)).mean() > 0.95


@pytest.mark.parametrize("method", list(Method))
def test_a_share_of_the_pixels_away_from_the_border(folder, method):
    said = inspect("photo.png", "--method", method, "--assigned", 55, "--max", 13, "--output", "map.png")
    inner = cv2.imread("map.png", -1)[7:-7, 7:-7]
    reached = float(re.search(r"window to ([\d.]+) %", said)[1])
    assert 100 * (inner < 255).mean() == pytest.approx(reached, abs=0.2)
    assert reached == pytest.approx(55, abs=0.2) or (method is Method.STATISTICAL and reached > 55)


def test_a_limit_is_obeyed(folder):
    assert "min_entropy of the entropy method is 2.5 nats" in inspect("photo.png", "--method", "entropy", "--limit", 2.5)
    low = (cv2.imread("photo_window_size_entropy.png", -1) < 255).mean()
    inspect("photo.png", "--method", "entropy", "--limit", 4.4)
    assert (cv2.imread("photo_window_size_entropy.png", -1) < 255).mean() < low


def test_settings_of_a_workflow_are_obeyed(folder):
    """On the sky the entropy stalls, and a gain asked for accepts it."""
    words = "photo.png", "--method", "entropy", "--set", "min_gain=0.5", "--set", "min_stalled=0"
    inspect(*words, "--output", "stalled.png")
    inspect("photo.png", "--method", "entropy")
    stalled, plain = (cv2.imread(name, -1) < 255 for name in ("stalled.png", "photo_window_size_entropy.png"))
    assert stalled[plain].all() and stalled.sum() > plain.sum()


@pytest.mark.parametrize(
    "words, sentence",
    [
        (("none.png",), "does not exist"),
        (("photo.png", "--output", "map.jpg"), "does not end in .png"),
        (("photo.png", "--output", "nowhere/map.png"), "does not exist"),
        (("photo.png", "--output", "photo.png"), "the photograph itself"),
        (("photo.png", "--limit", "3", "--assigned", "90"), "not both"),
        (("photo.png", "--assigned", "0"), "more than 0 and at most 100"),
        (("photo.png", "--assigned", "nan"), "more than 0 and at most 100"),
        (("photo.png", "--method", "combined", "--limit", "3"), "two limits"),
        (("photo.png", "--method", "entropy", "--limit", "9"), "less than or equal to 6"),
        (("photo.png", "--method", "entropy", "--limit", "nan"), "finite number"),
        (("photo.png", "--set", "min_gain=2"), "min_gain=2 is no setting of the foerstner method"),
        (("small.png",), "too few for windows of 35 x 35 px"),
        (("text.jpg",), "not a JPEG"),
        (("broken.jpg",), "truncated"),
    ],
)
def test_refusals_are_one_sentence(folder, words, sentence):
    Image.fromarray(photograph()[:30, :40]).save("small.png")
    (folder / "text.jpg").write_text("no picture")
    Image.fromarray(photograph()).save("whole.jpg")
    (folder / "broken.jpg").write_bytes((folder / "whole.jpg").read_bytes()[:-800])
    said = inspect(*words, code=2)
    assert sentence in said and not list(folder.glob(".*.part"))
    assert (cv2.imread("photo.png", -1) == photograph()).all()


def test_huge_photographs_are_refused_unread(folder, monkeypatch):
    monkeypatch.setattr(image_files, "PIXEL_LIMIT", 1000)
    assert "refused unread" in inspect("photo.png", code=2)


def test_damage_found_on_the_way_leaves_no_picture(folder):
    """The file has its end, but its pixels are damaged in the middle."""
    content = bytearray((folder / "photo.png").read_bytes())
    content[len(content) // 2 : len(content) // 2 + 50] = bytes(50)
    (folder / "damaged.png").write_bytes(content)
    assert "cannot be decoded" in inspect("damaged.png", code=2)
    assert not list(folder.glob("damaged_*")) and not list(folder.glob(".*"))


@pytest.mark.parametrize("cuts", [(), (1, 2, 40)])
def test_the_png_is_read_by_others(tmp_path, cuts):
    image = np.random.default_rng(1).integers(0, 256, (57, 31)).astype(np.uint8)
    grey_png.write_grey_png(tmp_path / "a.png", image.shape, np.split(image, cuts))
    assert (cv2.imread(str(tmp_path / "a.png"), -1) == image).all()
    assert (np.asarray(Image.open(tmp_path / "a.png")) == image).all()
    with pytest.warns(NotGeoreferencedWarning), rasterio.open(tmp_path / "a.png") as dataset:
        assert (dataset.read(1) == image).all()


def test_a_failing_strip_leaves_no_file(tmp_path):
    def strips():
        yield np.zeros((2, 3), np.uint8)
        raise zlib.error("stop")

    with pytest.raises(zlib.error):
        grey_png.write_grey_png(tmp_path / "a.png", (4, 3), strips())
    assert not list(tmp_path.iterdir())
