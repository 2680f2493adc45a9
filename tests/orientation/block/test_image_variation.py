"""Interior orientations that vary from photograph to photograph, against a truth that does."""

from dataclasses import replace

import numpy as np
import pytest
from orienting import orient, standardised_orientation
from simulated_block import TRUE_CAMERA, calibrated, simulate, view

from orthomill.schemas.camera import INTERIOR
from orthomill.tasks.adjustment.model.image_variation import FrameMotion, variation_of
from orthomill.tasks.adjustment.model.interior_settings import NoVariation, RollingShutter, Stabilised, Zoomed
from orthomill.tasks.orientation.block.frame_motion import _velocities

CAMERA = TRUE_CAMERA.model_copy(update={"pixel_um": None})
SPEED, READOUT = np.array([12.0, 0.0, 0.0]), 0.03


def strips(changed=lambda rng: {}, seed=0, turn=0.0, **options):
    """Ten photographs in two strips at 100 m, flown there and back and turned by `turn` degrees more each; `changed`: parameters of
    each photograph's own camera."""
    rng = np.random.default_rng([5, seed])
    views = []
    for number in range(10):
        strip, i = divmod(number, 5)
        place = (407000 + 25 * (i if strip == 0 else 4 - i), 4357000 + 45 * strip, 200 + rng.normal(0, 2))
        attitude = (*rng.uniform(-3, 3, 2), rng.uniform(-3, 3) + 180 * strip + turn * number)
        own = CAMERA.changed(**{name: CAMERA.value(name) + value for name, value in changed(rng).items()})
        views.append(view(f"v{number}", own, place, attitude))
    return simulate(views, calibrated(CAMERA, rng), seed, **({"tracks": 250, "gnss": 0.05, "control": 6, "check": 20} | options))


def check_ratios(out):
    return np.concatenate([np.array(p.difference) / p.predicted for p in out["ground_residuals"].of_role("check")])


def zoomed(rng):
    return {"c": 8.0 * rng.standard_normal()}


def stabilised(rng):
    x, y = 6.0 * rng.standard_normal(2)
    return {"x0": x, "y0": y}


@pytest.mark.parametrize(
    ("changed", "choice", "parameters"),
    [(zoomed, Zoomed(kind="zoom", sigma=0.005), ("c",)), (stabilised, Stabilised(kind="stabilised", sigma=6.0), ("x0", "y0"))],
    ids=["zoom", "stabilised"],
)
def test_each_photograph_finds_its_own_camera(changed, choice, parameters):
    block = strips(changed)
    out = orient(block, variation=choice)
    table = out["block"]
    assert len(set(table.of_photo.values())) == len(block.views) and table.sigma0_px == pytest.approx(0.3, rel=0.05)
    ratios = []
    for name in parameters:
        at = INTERIOR.index(name)
        for one in block.views:
            camera = table.camera_of(one.name)
            ratios.append((camera.value(name) - one.camera.value(name)) / np.sqrt(camera.covariance[at][at]))
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1.0, abs=0.5)
    assert np.abs(ratios).max() < 4 and np.abs(standardised_orientation(block, table)).max() < 4.5
    assert (np.abs(check_ratios(out)) < 3).mean() > 0.97


def test_one_camera_for_photographs_that_zoomed_contradicts_their_positions():
    block = strips(zoomed)
    one = orient(block, variation=NoVariation(kind="none"))["precision"]
    own = orient(block, variation=Zoomed(kind="zoom", sigma=0.005))["precision"]
    assert one.position_factor > 3 and own.position_factor < 1.5


def with_rolling_shutter(block):
    """The measurements as rows that are read one after another see them, from the top."""
    ties, rows = block.tie_points, []
    for t, p, col, row in zip(ties.track, ties.photo, ties.col, ties.row, strict=True):
        rows.append(_seen(block.views[p], block.ground[t], (col, row)))
    points = tuple(
        point.model_copy(
            update={
                "measurements": {
                    name: (*_seen(next(v for v in block.views if v.name == name), np.array(point.xyz), value[:2]), value[2])
                    for name, value in point.measurements.items()
                }
            }
        )
        for point in block.control.points
    )
    col, row = np.array(rows).T
    control = block.control.model_copy(update={"points": points})
    return replace(block, tie_points=replace(ties, col=col, row=row), control=control)


def _seen(one, point, pixel):
    """The measured pixel, moved by what the platform flies between the middle of the motion and the reading of its row."""
    late = READOUT * (pixel[1] / (one.camera.height - 1) - 0.5)
    moved = replace(one, centre=one.centre + SPEED * late)
    return tuple(map(float, np.array(pixel) + (moved.project(point[None]) - one.project(point[None]))[0]))


def test_a_rolling_shutter_costs_accuracy_and_its_model_gives_it_back():
    block = with_rolling_shutter(strips(seed=1, turn=60.0))
    plain = orient(block)
    model = orient(block, variation=RollingShutter(kind="rolling_shutter", readout=READOUT, speed_sigma=10.0))
    assert model["block"].sigma0_px < 0.33 < 0.5 < plain["block"].sigma0_px
    error = [np.std([p.difference for p in out["ground_residuals"].of_role("check")], axis=0) for out in (plain, model)]
    assert (error[1] < 0.5 * error[0]).all()
    assert (np.abs(check_ratios(model)) < 3).mean() > 0.95


def test_a_known_speed_gives_the_expected_shear_and_scale():
    still, moving = np.full((1, 3), np.nan), np.array([[10.0, 4.0, 0.0]])
    motion = FrameMotion(np.array([2000.0]), np.array([1500.0]), np.array([80.0]), moving)
    choice = RollingShutter(kind="rolling_shutter", readout=0.03, turning_sigma=0.01)
    told = variation_of(choice, motion)
    assert [INTERIOR[k] for k in told.parameters] == ["c", "affinity", "skew"]
    per_speed = 0.03 * 2000 / (80 * 1500)
    assert told.expected[0] == pytest.approx([2000 * 4 * per_speed, -4 * per_speed, 10 * per_speed])
    unknown = variation_of(choice, replace(motion, velocity=still))
    assert (unknown.expected == 0).all()
    sigma = np.sqrt(np.diag(np.linalg.inv(unknown.weight[0])))
    assert sigma[2] == pytest.approx(choice.speed_sigma * per_speed, rel=1e-3)
    assert sigma[0] / 2000 == pytest.approx(sigma[1], rel=1e-3), "the scale is one unknown, shared by c and the affinity"


def test_speeds_come_from_the_neighbours_in_time():
    position = np.array([[0.0, 0, 0], [20, 0, 0], [40, 0, 0], [900, 0, 0]])
    found = _velocities(position, np.array([0.0, 2.0, 4.0, 400.0]))
    assert np.allclose(found[:3, 0], 10.0) and np.isnan(found[3]).all()
