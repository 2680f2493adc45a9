"""Photographs with an alpha channel, or a mask beside them, through all stages: what these hide is in no tie point, surface or
orthoimage.

In the transparent part, which has the same place in every frame as a landing gear has, stands a texture in a colour that the ground
does not have: it would be matched with itself and would be seen in the orthoimage.
"""

import json
from pathlib import Path

import numpy as np
import pytest
import rasterio
from PIL import Image
from small_site import SHIPPED, command_in, write_workflow

import orthomill
from orthomill.schemas.observations import TIE_POINTS
from orthomill.schemas.orientation import Block

pytestmark = pytest.mark.slow

STAGES = ["photos", "calibration", "tie_points", "orientation", "epipolar", "densification", "texture"]
SIZE = (640, 360)
HIDDEN = np.s_[110:250, 200:440]
"""rows and columns that are transparent"""


def with_gear(source: Path, target: Path, mask: Path | None = None) -> None:
    """mask: where it is written; without, it is the alpha channel of the photograph."""
    with Image.open(source) as image:
        pixels = np.asarray(image.resize(SIZE, Image.Resampling.LANCZOS)).copy()
        exif = image.getexif()
    spots = np.kron(np.random.default_rng(7).integers(0, 2, (35, 60)), np.ones((4, 4)))
    pixels[HIDDEN] = np.stack([200 + 55 * spots, 60 * spots, 200 + 55 * spots], axis=-1)
    opaque = np.full((*pixels.shape[:2], 1), 255, np.uint8)
    opaque[HIDDEN] = 0
    if mask:
        Image.fromarray(opaque[..., 0]).save(mask)
        Image.fromarray(pixels).save(target, exif=exif)
    else:
        Image.fromarray(np.concatenate([pixels, opaque], axis=2)).save(target, exif=exif)


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """The run's folder."""
    root = tmp_path_factory.mktemp("masked")
    (root / "photos").mkdir()
    (root / "workflows").mkdir()
    for number, source in enumerate(sorted(SHIPPED.glob("*.JPG"))[:3]):
        mask = root / "photos" / f"{source.stem}_mask.png" if number == 1 else None
        with_gear(source, root / "photos" / f"{source.stem}.png", mask)
    write_workflow(root, stages=STAGES, photographs={"kind": "folder", "path": "photos", "masks": "photos"})
    assert " 0 failed" in command_in(root, "run", "site", "--sequential")
    return root / "runs" / "site"


def test_the_photographs_are_oriented_by_what_is_picture(run):
    block = Block.model_validate_json((run / "products" / "cameras.json").read_bytes())
    assert len(block.names) == 3
    points = orthomill.open(run).table(TIE_POINTS)
    row, col = (np.rint(axis).astype(int) for axis in (points.row, points.col))
    hidden = np.zeros(SIZE[::-1], bool)
    hidden[HIDDEN] = True
    assert len(row) > 200 and not hidden[row, col].any()
    assert json.loads((run / "summary.json").read_text())["orientation.sigma0_px"]["value"] < 0.5


def test_no_transparent_pixel_is_in_the_orthoimage(run):
    with rasterio.open(run / "products" / "ortho.tif") as picture:
        *colours, opacity = picture.read().astype(int)
    red, green, blue = colours
    # The colour of what is transparent reaches 140 in red and blue over green.
    assert (opacity > 0).mean() > 0.2
    assert not ((np.minimum(red, blue) - green > 60) & (opacity > 0)).any()


def test_the_report_says_what_was_not_used(run):
    report = " ".join((run / "report.html").read_text().split())
    assert "marks as transparent is not used" in report and "What is black in the masks of 1 photograph" in report
