"""Least-squares matching against a warp that is known, its precision against its true errors, and every kind of bad input."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter, map_coordinates

from schemas.outcome import Outcome
from tasks.matching.least_squares import match_points
from tasks.matching.matching_model import LeastSquaresMatching
from tasks.matching.small_systems import invert
from tasks.matching.smoothing import gaussian_weights, smoothed, with_gaps

AFFINE = np.array([[0.95, -0.05], [0.03, 1.04]])
SHIFT = np.array([3.3, -4.7])


def texture(size=420, seed=5):
    random = np.random.default_rng(seed)
    layers = [gaussian_filter(random.standard_normal((size, size)), s) * s for s in (1.2, 2.5, 6.0)]
    total = sum(layers)
    return 120.0 + 35.0 * total / total.std()


def warped(image):
    """The right image: what lies at `left` is seen at AFFINE left + SHIFT."""
    row, col = np.mgrid[: image.shape[0], : image.shape[1]]
    left = np.linalg.inv(AFFINE) @ (np.stack([col.ravel(), row.ravel()]) - SHIFT[:, None])
    return map_coordinates(image, [left[1], left[0]], order=5, mode="nearest").reshape(image.shape)


def grid_points(low=60, high=350, step=6):
    """Sub-pixel points that fall on every phase."""
    col, row = np.meshgrid(np.arange(low, high, step) + 0.37, np.arange(low, high, step) - 0.21)
    return np.column_stack([col.ravel(), row.ravel()])


@pytest.fixture(scope="module")
def pair():
    left = texture()
    return left, warped(left), grid_points(), grid_points() @ AFFINE.T + SHIFT


def noisy(image, gain, offset, sigma, seed):
    noise = np.random.default_rng(seed).normal(0, sigma, image.shape)
    return np.clip(np.rint(gain * image + offset + noise), 1, 255).astype(np.uint8)


@pytest.mark.parametrize("interpolation", ["bilinear", "bicubic"])
def test_a_known_warp_is_found_with_gain_and_offset(pair, interpolation):
    left, right, points, truth = pair
    starts = truth + np.random.default_rng(2).uniform(-0.8, 0.8, truth.shape)
    matching = LeastSquaresMatching(interpolation=interpolation)
    found = match_points(left.astype(np.float32), (0.7 * right + 22).astype(np.float32), points, starts, matching)
    good = found.converged
    assert good.mean() > 0.99
    error = np.column_stack([found.col, found.row])[good] - truth[good]
    assert np.sqrt((error**2).mean()) < (0.02 if interpolation == "bicubic" else 0.05)
    assert np.abs(np.median(found.affine[good], axis=0) - AFFINE.ravel()).max() < 0.003


def test_the_standard_errors_are_those_of_the_true_errors(pair):
    left, right, points, truth = pair
    found = match_points(noisy(left, 0.5, 60, 3, 1), noisy(right, 0.45, 70, 3, 2), points, truth, LeastSquaresMatching(window=15))
    good = found.converged
    for values, sigma, true in ((found.col, found.sigma_col, truth[:, 0]), (found.row, found.sigma_row, truth[:, 1])):
        ratio = (values[good] - true[good]) / sigma[good]
        assert 0.8 < 1.4826 * np.median(np.abs(ratio)) < 1.3


def test_gain_and_offset_change_nothing(pair):
    left, right, points, truth = pair
    matching = LeastSquaresMatching()
    first = match_points(left.astype(np.float32), right.astype(np.float32), points[:50], truth[:50], matching)
    second = match_points(left.astype(np.float32), (3 * right + 500).astype(np.float32), points[:50], truth[:50], matching)
    assert np.abs(first.col - second.col).max() < 1e-3


@settings(max_examples=15, deadline=None)
@given(dc=st.integers(0, 40), dr=st.integers(0, 40))
def test_a_point_in_a_crop_moves_as_in_the_whole_image(dc, dr):
    left = np.rint(texture(200)).clip(1, 255).astype(np.uint8)
    right = np.roll(left, 2, axis=1)
    points, starts = np.array([[100.25, 110.5]]), np.array([[102.5, 110.0]])
    whole = match_points(left, right, points, starts, LeastSquaresMatching())
    part = match_points(left[dr:, dc:], right[dr:, dc:], points - [dc, dr], starts - [dc, dr], LeastSquaresMatching())
    assert whole.converged.all() and part.converged.all()
    assert abs(whole.col[0] - dc - part.col[0]) < 1e-9 and abs(whole.row[0] - dr - part.row[0]) < 1e-9


def outcome_of(left, right, point=(60.0, 60.0), start=(60.0, 60.0), **changes):
    found = match_points(left, right, np.array([point]), np.array([start]), LeastSquaresMatching(**changes))
    assert np.isfinite(found.col[0]) == (found.outcome[0] == Outcome.CONVERGED)
    return Outcome(int(found.outcome[0]))


def test_every_failure_has_its_outcome():
    left = texture(120).astype(np.float32)
    other = texture(120, seed=9).astype(np.float32)
    constant, gap, empty = np.full_like(left, 99.0), left.copy(), np.full_like(left, np.nan)
    gap[66, 66] = np.nan
    assert outcome_of(left, left) == Outcome.CONVERGED
    assert outcome_of(constant, left) == outcome_of(left, constant) == Outcome.LOW_TEXTURE
    assert outcome_of(empty, left) == outcome_of(left, empty) == Outcome.OUTSIDE
    assert outcome_of(gap, left) == outcome_of(left, gap) == Outcome.OUTSIDE
    assert outcome_of(left, left, point=(3, 60), start=(3, 60)) == Outcome.OUTSIDE
    assert outcome_of(left, left, start=(-50, 60)) == outcome_of(left, left, start=(np.nan, 60)) == Outcome.OUTSIDE
    assert outcome_of(left, left, point=(1e12, 60)) == Outcome.OUTSIDE
    assert outcome_of(left, left[:40, :50]) == Outcome.OUTSIDE
    assert outcome_of(left, np.roll(left, 2, axis=1), max_shift=1.0) == Outcome.MOVED_TOO_FAR
    assert outcome_of(left, np.roll(left, 1, axis=1), max_iterations=1) == Outcome.NOT_CONVERGED
    assert outcome_of(left, other, max_shift=50.0) != Outcome.CONVERGED


def test_a_texture_without_a_second_direction_is_not_matched():
    stripes = np.tile(100 + 30 * np.sin(np.arange(120) / 3.0), (120, 1)).astype(np.float32)
    assert outcome_of(stripes, stripes) in (Outcome.LOW_TEXTURE, Outcome.SINGULAR)


def test_no_points_and_other_depths():
    left = texture(120)
    assert len(match_points(left.astype(np.float32), left.astype(np.float32), np.empty((0, 2)), [], LeastSquaresMatching())) == 0
    assert outcome_of((left * 200).astype(np.uint16), (left * 190).astype(np.uint16)) == Outcome.CONVERGED
    assert outcome_of(left.astype(np.uint8), left.astype(np.uint8)) == Outcome.CONVERGED


def test_smoothing_agrees_with_its_twin_and_does_not_spread_gaps():
    grey = texture(60).astype(np.float32)
    weights = gaussian_weights(0.8)
    plain = np.apply_along_axis(np.convolve, 0, np.apply_along_axis(np.convolve, 1, grey, weights, "same"), weights, "same")
    inner = slice(5, -5), slice(5, -5)
    assert np.abs(smoothed(grey, 0.8) - plain)[inner].max() < 1e-3
    holed = grey.copy()
    holed[30, 30] = 0.0
    assert np.isnan(smoothed(with_gaps(holed), 0.8)).sum() == 1
    assert np.abs(smoothed(with_gaps(np.full((20, 20), 7.0)), 0.8) - 7.0).max() < 1e-5


def test_inversion_agrees_with_its_twin():
    a = np.random.default_rng(1).normal(size=(20, 6))
    normal, lower, inverse = a.T @ a, np.empty((6, 6)), np.empty((6, 6))
    assert invert(normal, 6, lower, inverse)
    assert np.allclose(inverse, np.linalg.inv(normal))
    assert not invert(np.ones((6, 6)), 6, lower, inverse)
