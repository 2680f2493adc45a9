"""What visibility must obey whatever the surface: tolerance, walls, holes, and heights above the camera."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from box_scene import DSM, view
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.raster import Window
from orthomill.tasks.visibility.height_model import HeightModel, Targets, bridge_holes, visible_targets, widening_factor

WHOLE = Window(0, 0, DSM.rows, DSM.cols)
INDEX = np.arange(120)
CAMERA = replace(view("a"), centre=np.array([20.0, 60.0, 40.0]))


def seen(z: np.ndarray, tolerance: float = 0.0, photo=CAMERA, slope: float = 0.0) -> np.ndarray:
    """Visibility of all cell centres of a model."""
    targets = Targets(INDEX, INDEX, z, np.full_like(z, slope))
    return visible_targets(HeightModel(z, DSM, WHOLE), photo, targets, tolerance) > 0


def wall(height: float, col: int = 60) -> np.ndarray:
    z = np.zeros((120, 120), np.float32)
    z[:, col : col + 2] = height
    return z


@pytest.mark.parametrize("height", [5.0, 10.0, 20.0])
def test_the_shadow_of_a_wall_is_as_long_as_its_height_says(height):
    """In the row of the centre, at x = 20: a wall of height h at x hides h (x - 20) / (40 - h) m behind it."""
    row = int(DSM.pixel(20.0, 60.0)[1])
    hidden = np.flatnonzero(~seen(wall(height))[row, 62:]) + 62
    expected = height * (61.0 - 19.5) / (40.0 - height)
    assert hidden[0] == 62 and len(hidden) == pytest.approx(min(expected, 58), abs=1.6)
    assert seen(wall(height))[row, :60].all(), "nothing is hidden before the wall"


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), tolerance=st.floats(0.0, 2.0))
def test_a_larger_tolerance_never_hides_more(seed, tolerance):
    rng = np.random.default_rng(seed)
    z = (12 * rng.random((120, 120)) * (rng.random((120, 120)) < 0.05)).astype(np.float32)
    strict, lenient = seen(z, 0.0), seen(z, tolerance)
    assert (lenient | ~strict).all()


def test_a_steep_target_has_a_larger_tolerance_up_to_a_slope_of_two():
    z = np.random.default_rng(4).normal(0, 0.6, (120, 120)).astype(np.float32)
    counts = [seen(z, 0.3, slope=slope).sum() for slope in (0.0, 1.0, 2.0, 5.0)]
    assert counts[0] < counts[1] < counts[2] == counts[3]


def test_ground_above_the_camera_is_not_seen():
    z = np.full((120, 120), 50.0, np.float32)
    assert not seen(z).any() and seen(z - 20.0).all()


def test_a_hole_hides_nothing_and_is_not_seen_itself():
    z = wall(20.0)
    row = int(DSM.pixel(20.0, 60.0)[1])
    z[row - 3 : row + 4, 60:62] = np.nan
    found = seen(z)
    assert not found[row, 60:62].any() and found[row, 62:].all()


@settings(max_examples=20, deadline=None)
@given(gap=st.integers(1, 30), seed=st.integers(0, 999), height=st.floats(-50, 500))
def test_bridging_keeps_measured_heights_and_stays_between_them(gap, seed, height):
    rng = np.random.default_rng(seed)
    z = np.where(rng.random((24, 30)) < 0.6, height + rng.random((24, 30)), np.nan).astype(np.float32)
    filled, known = bridge_holes(z, gap), ~np.isnan(z)
    assert np.array_equal(filled[known], z[known])
    new = filled[~known & ~np.isnan(filled)]
    assert not len(new) or (new.min() >= np.nanmin(z) - 1e-3 and new.max() <= np.nanmax(z) + 1e-3)


@pytest.mark.parametrize(("margin", "ramp"), [(0.0, 3.0), (2.0, 0.0), (3.0, 5.0)])
def test_the_widening_is_a_ramp_of_the_distance(margin, ramp):
    hidden = np.zeros((40, 60), bool)
    hidden[:, :20] = True
    row = widening_factor(hidden, margin, ramp)[20]
    distance = np.maximum(np.arange(60) - 19.0, 0.0)
    assert np.allclose(row, np.clip((distance - margin) / max(ramp, 1e-6), 0.0, 1.0), atol=1e-5)


@pytest.mark.parametrize(("margin", "ramp"), [(0.0, 2.0), (1.0, 2.0), (2.5, 0.0), (3.3, 4.4)])
def test_widening_agrees_with_a_distance_transform(margin, ramp):
    hidden = cv2.GaussianBlur(np.random.default_rng(4).normal(size=(60, 70)), (0, 0), 2.0) > 0.25
    square = np.ones((2, 2), np.uint8)
    opened = cv2.dilate(cv2.erode(hidden.astype(np.uint8), square, anchor=(0, 0)), square, anchor=(1, 1))
    distance = cv2.distanceTransform(1 - opened, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    expected = np.clip((distance - margin) / max(ramp, 1e-6), 0.0, 1.0)
    assert 0.02 < opened.mean() < 0.6 and (expected == 1).any()
    np.testing.assert_allclose(widening_factor(hidden, margin, ramp), expected, atol=1e-6)
