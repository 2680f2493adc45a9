"""The original method's start: the whole interior orientation from the conic, and the pose from the horizon."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.calibration.horizon_pose import pose_by_horizon
from orthomill.tasks.calibration.solving.conic_start import interior_from_conic
from orthomill.tasks.calibration.solving.initial_pose import pose_of_projection
from orthomill.tasks.geometry.rotation import rotation_matrix

POSES = [(0.4, 0.1, 0.3), (-0.2, 0.5, 1.9), (0.3, -0.4, -2.5), (-0.5, -0.2, 0.9)]


def homography(angles, interior=(4000.0, 4000.0, 0.0, 0.0, 0.0), centre=(0.3, -0.2, 1.4)) -> np.ndarray:
    """Of the plane Z = 0, with the image y up; interior: cx, cy, skew, x0, y0."""
    cx, cy, skew, x0, y0 = interior
    R = rotation_matrix(*angles)
    K = np.array([[-cx, -skew, x0], [0.0, -cy, y0], [0.0, 0.0, 1.0]])
    return 2.5 * K @ np.column_stack([R[:, :2], -R @ np.array(centre)])


@pytest.mark.parametrize(("photos", "skew", "known"), [(2, False, True), (3, False, True), (3, True, True), (2, True, False)])
def test_exact_photographs_give_the_whole_interior_orientation(photos, skew, known):
    true = (4100.0, 3950.0, 12.0 if skew else 0.0, 25.0, -40.0)
    found = interior_from_conic([homography(angles, true) for angles in POSES[:photos]], 5000.0, skew)
    if known:
        assert found == pytest.approx(true, abs=1e-4) and found.c == pytest.approx(4025.0, abs=1e-4)
    else:
        assert np.isnan(found).all(), "two photographs have four equations for five unknowns"


def test_one_photograph_is_not_enough_and_parallel_ones_count_once():
    assert np.isnan(interior_from_conic([homography(POSES[0])], 5000.0)).all()
    shifted = [homography(POSES[0], centre=(x, 0.0, 1.4)) for x in (0.0, 0.3, 0.6)]
    assert np.isnan(interior_from_conic(shifted, 5000.0)).all()


@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_neither_units_of_the_plane_nor_of_homographies_matter(unit):
    scaled = [homography(angles) @ np.diag([1.0 / unit, 1.0 / unit, 1.0]) * 7.0 for angles in POSES]
    assert interior_from_conic(scaled, 5000.0).c == pytest.approx(4000.0, abs=1e-4)


tilts = st.floats(0.02, 0.7) | st.floats(-0.7, -0.02)


@settings(deadline=None, max_examples=40)
@given(omega=tilts, phi=tilts, kappa=st.floats(-3.1, 3.1), x=st.floats(-1, 1), y=st.floats(-1, 1), z=st.floats(0.5, 3.0))
def test_the_horizon_gives_the_pose_that_the_decomposition_gives(omega, phi, kappa, x, y, z):
    H = homography((omega, phi, kappa), centre=(x, y, z))
    R, centre = pose_by_horizon(H, 4000.0)
    assert pytest.approx(rotation_matrix(omega, phi, kappa), abs=1e-6) == R
    assert centre == pytest.approx([x, y, z], abs=1e-6) and centre[2] > 0
    other, there = pose_of_projection(np.insert(H, 2, 0.0, axis=1), 4000.0)
    assert other == pytest.approx(R, abs=1e-6) and there == pytest.approx(centre, abs=1e-6)
