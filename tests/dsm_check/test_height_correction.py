"""The deterministic correction: exact for errors of any size, with a test for wrong matches; Norvelle's formula is not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.tasks.dsm_check.height_correction import (
    Centres,
    NorvelleCorrection,
    PlanCorrection,
    RayCorrection,
    correct,
    nadir_angle,
    plan_intersection,
    ray_intersection,
)

CENTRES = Centres(np.array([10000.0, 10000.0, 1900.0]), np.array([11104.0, 10000.0, 1912.0]))
"""The published synthetic pair, one centre a little higher."""


def true_surface(x, y):
    u, v = x - 10552, y - 10000
    return 100 + 0.01 * u - 0.01 * v + 15 * np.sin(np.pi * u / 400) + 6 * np.sin(np.pi * v / 90)


def seen_on(model, truth, centre):
    """Where the orthoimage made with `model` shows the true points (N, 3): the ray through them meets the model, by bisection."""
    low, high = np.full(len(truth), 0.9), np.full(len(truth), 1.1)
    for _ in range(80):
        t = (low + high) / 2
        p = centre + t[:, None] * (truth - centre)
        above = p[:, 2] > model(p[:, 0], p[:, 1])
        low, high = np.where(above, t, low), np.where(above, high, t)
    p = centre + low[:, None] * (truth - centre)
    return np.column_stack([p[:, :2], model(p[:, 0], p[:, 1])])


def grid_points(step=53.0):
    x, y = np.meshgrid(np.arange(9900, 11200, step), np.arange(9000, 11000, step) + 7)
    return np.column_stack([x.ravel(), y.ravel(), true_surface(x.ravel(), y.ravel())])


def deformed(x, y):
    """Published deformation (4.19): up to +-41 m."""
    return true_surface(x, y) - 0.02 * (x - 10552) + 0.02 * (y - 10000)


def homologous(model=deformed):
    truth = grid_points()
    return truth, seen_on(model, truth, CENTRES.left), seen_on(model, truth, CENTRES.right)


def test_rays_recover_the_true_point():
    truth, left, right = homologous()
    found = ray_intersection(left, right, CENTRES, 0.1)
    assert np.abs(left[:, 2] - true_surface(left[:, 0], left[:, 1])).max() > 20
    assert np.abs(found.points - truth).max() < 1e-6
    assert found.accepted.all() and found.gap.max() < 1e-6


def test_the_plan_construction_recovers_it_where_it_may():
    truth, left, right = homologous()
    found = plan_intersection(left, right, CENTRES, PlanCorrection())
    assert 0.9 < found.accepted.mean() < 0.99
    assert np.abs(found.points - truth)[found.accepted].max() < 1e-6


def test_points_near_the_nadir_line_are_refused():
    """On the base line, on its extensions and at the nadirs the plan construction is singular; the rays are not."""
    truth = np.array([[10552.0, 10000.5, 0], [9000.0, 10000.5, 0], [10000.3, 10000.1, 0], [10552.0, 10600.0, 0]])
    truth[:, 2] = true_surface(truth[:, 0], truth[:, 1])
    left, right = (seen_on(deformed, truth, centre) for centre in (CENTRES.left, CENTRES.right))
    found = correct(left, right, CENTRES, PlanCorrection(), 0.25)
    assert found.accepted.tolist() == [False, False, False, True]
    assert np.abs(correct(left, right, CENTRES, RayCorrection(), 0.25).points - truth).max() < 1e-6


def test_better_than_norvelle():
    """dx H / B leaves metres where the rays leave nothing (2.4 m published for +-41 m)."""
    truth, left, right = homologous()
    shift = right[:, 0] - left[:, 0]
    norvelle = left[:, 2] - shift * (1900 - 100) / 1104
    plain = norvelle - true_surface(left[:, 0], left[:, 1])
    assert 0.5 < np.sqrt((plain**2).mean()) < 30
    exact = ray_intersection(left, right, CENTRES).points
    assert np.sqrt(((exact[:, 2] - truth[:, 2]) ** 2).mean()) < 1e-6


@settings(max_examples=50, deadline=None)
@given(st.floats(-40, 40), st.floats(-500, 500), st.floats(-900, 900))
def test_sign_and_size(error, u, v):
    """A surface that is `error` too high asks for -error, anywhere."""
    truth = np.array([[10552.0 + u, 10000.0 + v, 100.0]])
    left, right = (seen_on(lambda x, y: np.full(np.shape(x), 100.0 + error), truth, c) for c in (CENTRES.left, CENTRES.right))
    found = ray_intersection(left, right, CENTRES, 0.1)
    assert found.points[0, 2] - (100.0 + error) == pytest.approx(-error, abs=1e-6)


def test_wrong_matches_leave_a_gap():
    truth, left, right = homologous()
    moved = right + np.array([0.0, 0.6, 0.0])
    found = correct(left, moved, CENTRES, RayCorrection(parallax=0.5), 1.0)
    assert not found.accepted[np.abs(truth[:, 1] - 10000) < 500].any()
    assert correct(left, right + np.array([0.0, 0.1, 0.0]), CENTRES, RayCorrection(parallax=0.5), 1.0).accepted.all()


def test_unknown_heights_stay_unknown():
    _, left, right = homologous()
    left[0, 2] = np.nan
    for correction in (RayCorrection(), PlanCorrection()):
        found = correct(left, right, CENTRES, correction, 1.0)
        assert np.isnan(found.points[0, 2])
        assert correction.kind == "plan" or not found.accepted[0]
        assert np.isfinite(found.points[1:]).all()


def test_nadir_angle():
    centres = Centres(np.array([0.0, 0, 10]), np.array([2.0, 0, 10]))
    assert nadir_angle(np.array([[1.0, 1.0], [1.0, 0.0], [5.0, 0.0]]), centres) == pytest.approx([90, 180, 0])


@pytest.mark.parametrize("size", [0.1, 1.0, 10.0, 41.0])
def test_norvelle_needs_rounds_where_the_rays_need_one(size):
    """Without noise: one pass of the rays is exact, a pass of dx H / B leaves a share of the error, however small it was."""

    def model(x, y):
        return true_surface(x, y) + size / 41.0 * (deformed(x, y) - true_surface(x, y))

    truth, left, right = homologous(model)
    found = correct(left, right, CENTRES, NorvelleCorrection(parallax=1e9), 1.0)
    error = found.points[:, 2] - true_surface(found.points[:, 0], found.points[:, 1])
    before = model(found.points[:, 0], found.points[:, 1]) - true_surface(found.points[:, 0], found.points[:, 1])
    left_over = np.sqrt((error**2).mean()) / np.sqrt((before**2).mean())
    assert 0.02 < left_over < 0.3
    assert np.abs(ray_intersection(left, right, CENTRES, 0.1).points - truth).max() < 1e-6


def test_a_shift_across_the_base_is_no_height_for_norvelle():
    at = np.array([[10500.0, 10000.0, 100.0]])
    moved = at + np.array([0.0, 0.3, 0.0])
    found = correct(at, moved, CENTRES, NorvelleCorrection(parallax=1.0), 0.25)
    assert not found.accepted[0] and correct(at, moved, CENTRES, NorvelleCorrection(parallax=2.0), 0.25).accepted[0]
    assert found.points[0, 2] == pytest.approx(100.0)
