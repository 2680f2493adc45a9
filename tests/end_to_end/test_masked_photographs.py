"""Photographs with an alpha channel through all stages: what is transparent in them is in no tie point, surface or orthoimage.

In the transparent part, which has the same place in every frame as a landing gear has, stands a texture in a colour that the ground
does not have: it would be matched with itself and would be seen in the orthoimage.
"""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import rasterio
from PIL import Image
from small_site import SHIPPED, start_command

import orthomill
from orthomill.schemas.observations import TIE_POINTS
from orthomill.schemas.orientation import Block

pytestmark = pytest.mark.slow

WORKFLOW = Path(__file__).parents[2] / "workflows" / "brighton.yaml"
STRIP = ("DJI_0030", "DJI_0031", "DJI_0032", "DJI_0033")
HIDDEN = np.s_[180:400, 300:700]
"""rows and columns that are transparent"""


def with_gear(name: str, target: Path, alpha: bool) -> None:
    with Image.open(SHIPPED / f"{name}.JPG") as image:
        pixels = np.asarray(image.resize((1000, 562), Image.Resampling.LANCZOS)).copy()
        exif = image.getexif()
    spots = np.kron(np.random.default_rng(7).integers(0, 2, (55, 100)), np.ones((4, 4)))
    pixels[HIDDEN] = np.stack([200 + 55 * spots, 60 * spots, 200 + 55 * spots], axis=-1)
    opaque = np.full((562, 1000, 1), 255, np.uint8)
    opaque[HIDDEN] = 0
    Image.fromarray(np.concatenate([pixels, opaque], axis=2) if alpha else pixels).save(target, exif=exif)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The run's folder."""
    return run_of(tmp_path_factory.mktemp("masked"), alpha=True)


def run_of(root: Path, alpha: bool) -> Path:
    photographs = root / "workflows" / "photographs" / "brighton"
    photographs.mkdir(parents=True)
    shutil.copy(WORKFLOW, root / "workflows")
    for name in STRIP:
        with_gear(name, photographs / f"{name}.png", alpha)
    out, errors = (process := start_command(root, "run", "brighton", "--workers", "2")).communicate(timeout=500)
    assert process.returncode == 0, errors
    assert "0 failed" in out
    return root / "runs" / "brighton"


def magenta(pixels: np.ndarray) -> np.ndarray:
    """bool of (bands, rows, cols): the colour of what is transparent, which reaches 140 in red and blue over green."""
    red, green, blue = pixels[:3].astype(int)
    return np.minimum(red, blue) - green > 60


def test_the_strip_is_oriented_by_what_is_picture(run):
    block = Block.model_validate_json((run / "products" / "cameras.json").read_bytes())
    assert block.names == STRIP
    points = orthomill.open(run).table(TIE_POINTS)
    row, col = (np.rint(axis).astype(int) for axis in (points.row, points.col))
    hidden = np.zeros((562, 1000), bool)
    hidden[HIDDEN] = True
    assert len(row) > 500 and not hidden[row, col].any()


def test_no_transparent_pixel_is_in_the_orthoimage(run):
    with rasterio.open(run / "products" / "ortho.tif") as picture:
        pixels = picture.read()
    assert (pixels[3] > 0).mean() > 0.2
    assert not (magenta(pixels) & (pixels[3] > 0)).any()


def test_the_report_says_what_was_not_used(run):
    assert "marks as transparent is not used" in " ".join((run / "report.html").read_text().split())
    figures = {name: figure["value"] for name, figure in json.loads((run / "summary.json").read_text()).items()}
    assert figures["orientation.sigma0_px"] < 0.5
