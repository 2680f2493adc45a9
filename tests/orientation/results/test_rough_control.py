"""Control as people have it without a survey: coordinates from a web map, stated as if surveyed, and marks set by eye."""

from dataclasses import replace

import numpy as np
import pytest
from orienting import orient, standardised_orientation
from photographed_layouts import layout
from simulated_block import photo_of

from orthomill.schemas.observations import Control
from orthomill.schemas.photo import Photos

STATED = 0.03
"""m: the standard error that people leave as it is"""


def from_a_web_map(block, count, rng):
    """The block with `count` control points that are 0.5 to 1 m wrong, and the ratio of their errors to those stated."""
    chosen = [point for point in block.control.points if point.role == "control"][:count]
    away = rng.standard_normal((count, 3))
    error = away * (rng.uniform(0.5, 1.0, count) / np.linalg.norm(away, axis=1))[:, None]
    points = tuple(
        point.model_copy(update={"xyz": tuple(np.array(point.xyz) + e), "sigma": (STATED,) * 3})
        for point, e in zip(chosen, error, strict=True)
    )
    return replace(block, control=Control(points=points)), float(np.sqrt((error**2).mean())) / STATED


def with_marks(block, count, size, rng):
    """The block with `count` control points whose measurements are good to `size` px, but stated to 1 px."""

    def mark(measured):
        return (*(float(value + size * rng.standard_normal()) for value in measured[:2]), 1.0)

    points = tuple(
        point.model_copy(update={"measurements": {photo: mark(one) for photo, one in point.measurements.items()}})
        for point in block.control.points[:count]
    )
    return replace(block, control=Control(points=points))


def with_positions(block, sigma, rng):
    photos = tuple(photo_of(view, view.centre + sigma * rng.standard_normal(3), sigma) for view in block.views)
    return replace(block, photos=Photos(photos=photos))


def codes(out):
    return [finding.code for finding in out["precision"].findings]


@pytest.mark.parametrize(("shape", "gnss"), [("crossed_block", None), ("crossed_block", 3.0), ("kite", None)])
def test_control_from_a_web_map_takes_part_as_it_is_good_and_none_of_it_is_called_wrong(shape, gnss):
    block, ratio = from_a_web_map(layout(shape, "control"), 5, np.random.default_rng(0))
    out = orient(with_positions(block, gnss, np.random.default_rng(0)) if gnss else block)
    assert ratio / 2 < out["precision"].control_factor < 2 * ratio
    assert out["precision"].blunders == () and "measurements_rejected" not in codes(out)
    measured = {point.name: len(point.measurements) for point in block.control.points}
    rows = {row.name: row.photos for row in out["ground_residuals"].points if row.role == "control"}
    assert rows == measured, "neither points nor their measurements are left out"
    assert "defined by 5 ground control points" in out["block"].datum


@pytest.mark.parametrize(("shape", "count"), [("crossed_block", 8), ("facade", 4)])
def test_marks_of_twenty_pixels_are_no_contradiction_between_control_and_block(shape, count):
    block = layout(shape, "control")
    out = orient(with_marks(block, count, 20.0, np.random.default_rng(0)))
    (factor,) = [group.factor for group in out["precision"].groups if group.name == "surveyed points in photographs"]
    assert 10.0 < factor < 40.0 and out["precision"].control_factor == 1.0
    assert "datum_misfit" not in codes(out) and out["precision"].blunders == ()
    assert sum(row.photos > 0 for row in out["ground_residuals"].points) == count
    assert np.abs(standardised_orientation(block, out["block"])).max() < 4.5


def test_rough_marks_of_check_points_are_not_called_wrong():
    block = with_marks(layout("crossed_block", "control"), 8, 20.0, np.random.default_rng(1))
    roles = ["control"] * 5 + ["check"] * 3
    points = tuple(point.model_copy(update={"role": role}) for point, role in zip(block.control.points, roles, strict=True))
    assert "check_measurements_apart" not in codes(orient(replace(block, control=Control(points=points))))
