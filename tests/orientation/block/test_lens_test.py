"""A given distortion that does not fit is told, with what would fit; one that fits is not."""

import numpy as np
import pytest
from orienting import orient
from simulated_block import block_of, looking

from orthomill.schemas.camera import BrownLens, Camera, DivisionLens, FisheyeLens
from orthomill.schemas.findings.camera_findings import LensContradicted
from orthomill.tasks.geometry.view import View

LENSES = {"brown": BrownLens(k1=-0.12, k2=0.03), "fisheye": FisheyeLens(k1=0.02, k2=-0.004), "division": DivisionLens(k1=-0.08)}


def found(lens, given, seed=1):
    """What is told of the lens of two strips of three photographs, 40 m above 3 m of relief, taken with `lens`."""
    rng = np.random.default_rng(seed)
    camera = Camera(name="cam", width=1000, height=1000, c=700.0, lens=lens, source="given")
    views = [
        View(f"p{i}", camera, looking((0.0, 1e-3, -1.0)), np.array([12.0 * (i % 3), 14.0 * (i // 3), 40.0]) + rng.normal(0, 0.5, 3))
        for i in range(6)
    ]
    ground = rng.uniform((-35, -35), (60, 50), (1500, 2))
    points = np.column_stack([ground, 1.5 * np.sin(ground[:, 0] / 9.0) + np.cos(ground[:, 1] / 7.0)])
    block = block_of(views, points, rng, sigma=0.2, gnss=0.02, camera=camera.model_copy(update={"lens": given}))
    return [one for one in orient(block)["precision"].findings if isinstance(one, LensContradicted)]


@pytest.mark.parametrize("kind", LENSES)
def test_a_distortion_that_fits_is_not_contradicted(kind):
    assert found(LENSES[kind], LENSES[kind]) == []


# With its single coefficient a wrong division model looks like a wrong camera constant, and is told as that.
@pytest.mark.parametrize("kind", ["brown", "fisheye"])
def test_a_wrong_distortion_is_told_with_the_one_that_fits(kind):
    lens = LENSES[kind]
    (one,) = found(lens, lens.model_copy(update={"k1": lens.k1 + 0.03}))
    assert one.camera == "cam" and one.border_px > 0.5 and one.ratio > 5
    assert abs(one.fits[0] - lens.k1) < 0.01 and one.given[0] == lens.k1 + 0.03
    assert len(one.fits) == 2


def test_what_lenses_change_from_day_to_day_is_not_told():
    lens = LENSES["brown"]
    assert found(lens, lens.model_copy(update={"k1": lens.k1 + 0.0005})) == []
