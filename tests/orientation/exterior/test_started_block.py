"""Approximate orientations as a start: rough ones, wrong ones, and those of a file."""

import numpy as np
import pytest
from orienting import orient, standardised_orientation
from simulated_block import two_strips

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.model.interior_settings import FixedInterior
from orthomill.tasks.geometry.rotation import angles
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector
from orthomill.tasks.orientation.exterior.block_choices import BlockChoices
from orthomill.tasks.orientation.exterior.started_block import orient_from
from orthomill.tasks.orientation.interchange.foreign_block import ForeignPose
from orthomill.tasks.orientation.orientation_settings import FromAngles
from orthomill.tasks.orientation.relative.pairs import relate_pairs

FIXED = FixedInterior(kind="fixed")


@pytest.mark.parametrize("datum", ["control", "free"])
def test_approximate_orientations_are_a_start(datum):
    block = two_strips(22) if datum == "control" else two_strips(22, control=0, check=0, gnss=None)
    rng = np.random.default_rng(3)
    rough = {
        v.name: ForeignPose(
            rotation_of_vector(np.radians(1.0) * rng.standard_normal(3)) @ v.rotation, v.centre + 10 * rng.standard_normal(3)
        )
        for v in block.views
    }
    out = orient(block, given=rough, interior=FIXED)
    assert len(out["block"].photos) == 6
    if datum == "control":
        found = np.array([out["block"].of(v.name).centre for v in block.views])
        assert np.abs(found - [v.centre for v in block.views]).max() < 2.0
    else:
        assert "given orientation" in out["block"].datum
        shift = np.array([out["block"].of(v.name).centre for v in block.views]) - [v.centre for v in block.views]
        assert np.abs(shift).max() < 60.0


def test_a_rough_start_with_one_photograph_elsewhere_still_orients_all():
    block, rng = two_strips(25), np.random.default_rng(5)
    rough = {
        v.name: ForeignPose(
            rotation_of_vector(np.radians(1.0) * rng.standard_normal(3)) @ v.rotation, v.centre + 10 * rng.standard_normal(3)
        )
        for v in block.views
    }
    rough["s0_1"] = ForeignPose(rough["s1_1"].rotation, rough["s0_1"].centre + np.array([0.0, 0.0, 500.0]))
    out = orient(block, given=rough)
    assert len(out["block"].photos) == 6
    assert np.abs(standardised_orientation(block, out["block"])).max() < 4.5


def test_a_start_in_another_convention_of_angles_is_refused():
    block = two_strips(26)
    upside_down = {v.name: ForeignPose(np.diag([1.0, -1.0, -1.0]) @ v.rotation, v.centre) for v in block.views}
    with pytest.raises(GeometryError, match="another convention of angles"):
        orient(block, given=upside_down)


def test_a_table_of_angles_is_a_start():
    block = two_strips(27)
    rng = np.random.default_rng(6)
    lines = ["photo,x,y,z,omega,phi,kappa"]
    for v in block.views:
        numbers = [*(v.centre + 8 * rng.standard_normal(3)), *(np.degrees(angles(v.rotation)) + rng.standard_normal(3))]
        lines.append(",".join([v.name, *map(str, numbers)]))
    source = FromAngles(kind="csv", path="ori.csv", use="start")
    relative = relate_pairs(block.photos, block.cameras, block.tie_points, 15)
    choices = BlockChoices(interior=FIXED, gnss_shift="none", vertical_sigma=5.0, rejection=4.0)
    texts = ("\n".join(lines[:-1]),)
    out = orient_from(block.photos, block.cameras, block.tie_points, block.control, relative, texts, "EPSG:2100", choices, source)
    assert len(out.block.photos) == 6 and out.block.sigma0_px == pytest.approx(0.3, rel=0.1)
    assert out.block.datum.startswith("Control")
