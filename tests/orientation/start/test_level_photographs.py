"""Photographs that do not look down: a walk along a street with a skyline, and an oblique strip; positions on one line."""

from dataclasses import replace

import numpy as np
import pytest
from orienting import ground_errors, orient, standardised_orientation
from simulated_block import DRONE, block_of, looking, simulate, turned_upright, view

from orthomill.schemas.photo import Photos
from orthomill.tasks.adjustment.model.interior_settings import FixedInterior
from orthomill.tasks.geometry.rotation import angles
from orthomill.tasks.geometry.view import View

FIXED = FixedInterior(kind="fixed")
ORIGIN = np.array([407000.0, 4357000.0, 50.0])


def street(seed, skyline=80):
    rng = np.random.default_rng(seed)
    tilt = [0.05 * rng.standard_normal(2) for _ in range(10)]
    centres = [ORIGIN + np.array([4.0 * i, rng.normal(0, 0.3), 1.6 + rng.normal(0, 0.1)]) for i in range(10)]
    views = [View(f"w{i}", DRONE, looking((1.0, t[0], t[1])), c) for i, (t, c) in enumerate(zip(tilt, centres, strict=True))]
    side = rng.choice([-1.0, 1.0], 1500)
    houses = np.column_stack([rng.uniform(5, 130, 1500), side * rng.uniform(6, 12, 1500), rng.uniform(0, 12, 1500)])
    away = np.column_stack([np.full(skyline, 3e5), rng.uniform(-2e5, 2e5, skyline), rng.uniform(1e3, 6e4, skyline)])
    return block_of(views, ORIGIN + np.vstack([houses, away]), rng)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_walk_along_a_street_is_level_and_its_skyline_is_no_tie_point(seed):
    block = street(seed)
    out = orient(block, interior=FIXED)
    result = out["block"]
    assert len(result.photos) == 10 and "taken level and upright" in result.datum
    assert np.abs(standardised_orientation(block, result)).max() < 4.5
    assert abs(result.sigma0_px / 0.3 - 1) < 0.05
    far = block.ground[out["points"].track][:, 0] > ORIGIN[0] + 1e5
    assert not far.any() and len(far) > 800
    error, sigma = ground_errors(block, out["points"])
    assert np.median(np.abs(error / sigma)) < 1.5


@pytest.mark.slow
def test_level_photographs_may_be_held_upright_or_not():
    """Many photographs of the walk were turned upright by their EXIF flags: the sensor lay on its side, or on its head."""
    block = street(3, skyline=0)
    flags = dict(zip((v.name for v in block.views), (6, 1, 8, 1, 3) * 2, strict=True))
    out = orient(turned_upright(block, flags), interior=FIXED)
    plain = orient(block, interior=FIXED)
    assert out["block"].datum == plain["block"].datum and "taken level and upright" in plain["block"].datum
    for v in block.views:
        found = out["block"].of(v.name)
        sigma = np.sqrt(np.diag(np.array(found.covariance)))[:3]
        assert (np.abs(np.array(found.centre) - v.centre) < 4.5 * sigma).all()
        assert (np.abs(np.array(found.centre) - plain["block"].of(v.name).centre) < 0.3 * sigma).all()


@pytest.mark.slow
def test_photographs_along_one_line_that_look_aside_are_level_when_the_workflow_says_so():
    rng = np.random.default_rng(5)
    views = [
        View(f"f{i}", DRONE, looking((*(0.02 * rng.standard_normal(1)), 1.0, 0.02)), ORIGIN + np.array([3.0 * i, 0.0, 2.0]))
        for i in range(8)
    ]
    wall = np.column_stack([rng.uniform(-8, 30, 1500), rng.uniform(14, 17, 1500), rng.uniform(-4, 8, 1500)])
    block = block_of(views, ORIGIN + wall, rng, gnss=0.3)
    assert np.abs(standardised_orientation(block, orient(block, interior=FIXED, looking="level")["block"])).max() < 4.5
    assert "straight down" in orient(block, interior=FIXED)["block"].datum


def test_attitudes_hold_the_tilt_of_an_oblique_strip():
    rng = np.random.default_rng(9)
    views = [
        view(f"o{i}", DRONE, (407000 + 15 * i, 4357000 + rng.normal(0, 0.3), 180), (40 + rng.normal(0, 1), rng.normal(0, 1), 0))
        for i in range(8)
    ]
    block = simulate(views, DRONE, 9, gnss=2.0, control=0, check=0, tracks=1500)
    rough = [np.degrees(angles(v.rotation)) + rng.normal(0, 2, 3) for v in views]
    photos = zip(block.photos.photos, rough, strict=True)
    told = Photos(photos=tuple(p.model_copy(update={"attitude": tuple(map(float, a))}) for p, a in photos))
    result = orient(replace(block, photos=told), interior=FIXED)["block"]
    assert "attitudes that came with the photographs" in result.datum
    assert np.abs(standardised_orientation(block, result)).max() < 4
