"""A nominal camera whose principal point and k3 are far off: its block demands them and does not bend; a sound one is left so."""

from dataclasses import replace

import numpy as np
import pytest
from orienting import orient
from simulated_block import block_of, view
from small_network import more_control, small_network

from orthomill.schemas.camera import INTERIOR, BrownLens, Camera
from orthomill.schemas.findings.camera_findings import InteriorDemanded
from orthomill.schemas.findings.datum_findings import BlockBent
from orthomill.tasks.adjustment.bundle import BlunderTest, adjust
from orthomill.tasks.adjustment.model.interior_settings import FixedInterior, WeightedInterior
from orthomill.tasks.orientation.block.demanded_parameters import demanding
from orthomill.tasks.orientation.block.self_calibration import all_fixed

NOMINAL = Camera(name="cam", width=1600, height=1300, c=1900.0, source="exif")
TRUE = NOMINAL.model_copy(update={"c": 1955.0, "x0": -13.0, "y0": -14.0, "lens": BrownLens(k1=-0.40, k2=0.30, k3=-0.25)})
SOUND = NOMINAL.model_copy(update={"c": 1920.0, "x0": 1.0, "y0": -1.0, "lens": BrownLens(k1=-0.05, k2=0.02)})


def flight(camera, gnss=3.0, seed=1):
    """Two strips of ten photographs 45 m above ground that is flat to 0.3 m, there and back."""
    rng = np.random.default_rng(seed)
    views = [
        view(
            f"p{strip}{i}",
            camera,
            (4.0 * (i if strip == 0 else 9 - i), 14.0 * strip, 45.0 + rng.normal(0, 0.1)),
            (*rng.normal(0, 0.3, 2), 90.0 - 180.0 * strip),
        )
        for strip in range(2)
        for i in range(10)
    ]
    xy = rng.uniform((-20, -15), (56, 30), (600, 2))
    points = np.column_stack([xy, 0.3 * np.sin(xy[:, 0] / 5.0) * np.cos(xy[:, 1] / 4.0)])
    return block_of(views, points, rng, sigma=0.12, gnss=gnss, camera=NOMINAL)


def bend(block, tables):
    """m by which the ground bends from the middle to 20 m away along the strips."""
    points = tables["points"]
    truth = block.ground[points.track]
    t = points.x - points.x.mean()
    near = np.abs(points.y - points.y.mean()) < 12
    off = (points.z - truth[:, 2])[near]
    return float(np.polyfit(t[near], off, 2)[0] * 20.0**2)


def of_kind(tables, kind):
    return [one for one in tables["precision"].findings if isinstance(one, kind)]


@pytest.mark.slow
@pytest.mark.parametrize("gnss", [3.0, 0.015])
def test_a_block_demands_what_keeps_it_from_bending(gnss):
    block = flight(TRUE, gnss)
    tables = orient(block)
    (one,) = of_kind(tables, InteriorDemanded)
    assert one.x0_px == pytest.approx(-13.0, abs=4.0) and one.y0_px == pytest.approx(-14.0, abs=4.0)
    assert one.sigma0_px[1] < one.sigma0_px[0] and tables["block"].sigma0_px == pytest.approx(0.12, rel=0.1)
    assert abs(bend(block, tables)) < 0.03
    assert not [found for found in of_kind(tables, BlockBent) if found.grave]


@pytest.mark.slow
def test_without_them_the_bend_is_named():
    block = flight(TRUE, 0.5)
    tables = orient(block, interior=WeightedInterior(kind="weighted", parameters=("c", "k1", "k2", "p1", "p2")))
    assert of_kind(tables, InteriorDemanded) == []
    assert abs(bend(block, tables)) > 0.05


@pytest.mark.slow
def test_a_sound_camera_is_left_alone():
    block = flight(SOUND)
    tables = orient(block)
    assert of_kind(tables, InteriorDemanded) == [] and of_kind(tables, BlockBent) == []
    camera = tables["block"].cameras["cam"]
    assert (camera.x0, camera.y0, camera.lens.k3) == (0.0, 0.0, 0.0)


@pytest.mark.slow
def test_an_interior_orientation_that_the_workflow_fixes_is_not_touched():
    assert of_kind(orient(flight(TRUE), interior=FixedInterior(kind="fixed")), InteriorDemanded) == []


def test_a_camera_that_had_to_be_kept_as_it_is_demands_nothing():
    network, state, rays = small_network(3, points=60, noise=1.0, interior_free=(0, 3))
    found = adjust(more_control(network, 20), state, rays, BlunderTest(limit=4.0))
    kept, _ = all_fixed(found.network, ("cam",))
    held = np.isin(INTERIOR, ("x0", "y0", "k3"))[None]
    assert not demanding(replace(found, network=kept), held).any()
