"""Black borders beside the picture are found; what is dark inside it, or has the noise of a background, is not one."""

import cv2
import numpy as np
import pytest

from orthomill.tasks.projection.photographs.border_masks import MARGIN, border_mask
from orthomill.tasks.projection.stage import ProjectionStage
from orthomill.tasks.visibility.sight import PlaceSight
from tests.support.engine.memory_runner import MemoryProject
from tests.support.solid import wall_and_box as scene


def picture(kind=np.uint8, scale: int = 1) -> np.ndarray:
    """A bright picture with a black wedge on its left, as a rotation leaves it, and a black hole inside."""
    out = np.full((120, 160, 3), 140, np.uint8)
    row, col = np.indices((120, 160))
    out[col < 0.2 * row] = 0
    out[50:70, 90:110] = 0
    return out.astype(kind) * scale


@pytest.mark.parametrize(("kind", "scale"), [(np.uint8, 1), (np.uint16, 256)])
def test_a_wedge_at_the_frame_is_left_out_with_its_margin_and_a_dark_hole_is_not(kind, scale):
    found = border_mask(picture(kind, scale))
    row, col = np.indices((120, 160))
    wedge = col < 0.2 * row
    assert found.facts.share == pytest.approx(wedge.mean(), abs=1e-6)
    assert not found.mask[wedge].any() and found.mask[col > 0.2 * row + 2 * MARGIN].all()
    beside = (col >= 0.2 * row) & (col < 0.2 * row + MARGIN - 1)
    assert not found.mask[beside & (row > 20)].any()


def test_ripples_of_jpeg_next_to_the_border_go_with_it():
    _, data = cv2.imencode(".jpg", picture(), [cv2.IMWRITE_JPEG_QUALITY, 80])
    stored = cv2.imdecode(data, cv2.IMREAD_COLOR)
    row, col = np.indices((120, 160))
    assert stored[col < 0.2 * row].max() > 1
    dark = (stored.max(axis=2) < 8) & (col < 0.2 * row)
    assert (border_mask(stored).mask[dark, 0] > 0).mean() < 0.02


def test_neither_a_noisy_background_nor_a_speck_nor_a_bright_picture_has_a_border():
    noisy = np.random.default_rng(2).integers(0, 9, (120, 160, 3)).astype(np.uint8)
    speck = np.full((120, 160, 3), 90, np.uint8)
    speck[0, :4] = 0
    for pixels in (noisy, speck, np.full((120, 160, 1), 200, np.uint8)):
        found = border_mask(pixels)
        assert found.facts.share == 0.0 and found.mask.all()


def test_the_stage_does_not_use_borders_unless_it_is_told_to():
    pictures = {}
    for name in scene.NAMES:
        from orthomill.tasks.geometry.view import block_view

        pictures[name] = np.maximum(scene.photograph(block_view(scene.block(), name)), 5)
    pictures["b"][:, :120] = 0
    front = {
        "kind": "plane",
        "name": "front",
        "plane": {"kind": "normal", "point": (0.0, 0.0, 1.5), "normal": (0.0, -1.0, 0.0)},
        "pixel": 0.05,
        "size": (4.0, 3.0),
    }
    given = {"surface": {"kind": "mesh", "path": "mesh.ply"}, "outputs": [front], "balance": {"kind": "none"}}
    given |= {"model": {"kind": "none"}, "depth_pictures": False, "leave_one_out": {"kind": "none"}}
    masked = {}
    for kind in ("borders", "none"):
        project = scene.project_of(MemoryProject, pictures=pictures)
        project.run(ProjectionStage.model_validate({**given, "masks": {"kind": kind}}))
        sight = project.rasters["projection/front/sight"]
        masked[kind] = (sight == PlaceSight.MASKED).sum(axis=(0, 1))
    assert masked["borders"][1] > 100 and masked["borders"][[0, 2, 3]].sum() == 0
    assert masked["none"].sum() == 0
