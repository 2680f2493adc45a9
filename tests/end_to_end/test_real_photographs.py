"""Real drone photographs through all stages, from EXIF and GPS alone; a photograph that does not join is named with its reason."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import rasterio
from PIL import Image, ImageFilter
from small_site import SHIPPED, command_in

from orthomill.schemas.orientation import Block

pytestmark = pytest.mark.slow

WORKFLOW = Path(__file__).parents[2] / "workflows" / "brighton.yaml"
STRIP = ("DJI_0030", "DJI_0031", "DJI_0032", "DJI_0033")
STRANGER = "DJI_0099"
"""A photograph of something else, with the tags of the last of the strip."""


def reduced(name: str, target: Path) -> None:
    with Image.open(SHIPPED / f"{name}.JPG") as image:
        image.resize((1000, 562), Image.Resampling.LANCZOS).save(target, quality=92, exif=image.getexif())


def strange(target: Path) -> None:
    with Image.open(SHIPPED / f"{STRIP[-1]}.JPG") as image:
        pixels = np.random.default_rng(5).integers(0, 255, (562, 1000, 3), dtype=np.uint8)
        Image.fromarray(pixels).filter(ImageFilter.GaussianBlur(2)).save(target, quality=92, exif=image.getexif())


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The run's folder of one strip and a stranger, and what the command said."""
    root = tmp_path_factory.mktemp("real")
    photographs = root / "workflows" / "photographs" / "brighton"
    photographs.mkdir(parents=True)
    shutil.copy(WORKFLOW, root / "workflows")
    for name in STRIP:
        reduced(name, photographs / f"{name}.JPG")
    strange(photographs / f"{STRANGER}.JPG")
    assert " 0 failed" in command_in(root, "run", "brighton", "--sequential")
    return root / "runs" / "brighton"


@pytest.fixture(scope="module")
def figures(run):
    return {name: figure["value"] for name, figure in json.loads((run / "summary.json").read_text()).items()}


def test_the_strip_is_oriented(run, figures):
    block = Block.model_validate_json((run / "products" / "cameras.json").read_bytes())
    assert block.names == STRIP
    assert block.datum.startswith("GNSS")
    assert figures["orientation.sigma0_px"] < 0.5 and figures["orientation.gnss_by_predicted"] < 2


def test_the_photograph_that_does_not_join_is_named_with_its_reason(run, figures):
    block = Block.model_validate_json((run / "products" / "cameras.json").read_bytes())
    (stranger,) = block.unoriented
    assert stranger.photo == STRANGER and len(stranger.reason) > 20
    assert figures["orientation.photos_unoriented"] == 1
    page = (run / "report.html").read_text()
    assert STRANGER in page and stranger.reason in page


def test_surface_check_and_orthoimage_are_there(run, figures):
    assert figures["run.complete"] is True
    with rasterio.open(run / "products" / "dsm.tif") as surface:
        assert surface.crs.to_epsg() == 32615
        heights = surface.read(1)
    assert np.isfinite(heights).mean() > 0.2
    assert np.nanpercentile(heights, 98) - np.nanpercentile(heights, 2) < 40, "a shore with trees, not mountains"
    with rasterio.open(run / "products" / "ortho.tif") as picture:
        assert (picture.read(4) > 0).mean() > 0.2
    assert (run / "products" / "dsm_check.tif").exists() and figures["dsm_check.checked"] > 20
