"""Small kernels of matching against plain NumPy: paraboloids, interpolation, smoothing, correlated residuals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.tasks.matching.gaussian_reach import reach_of
from orthomill.tasks.matching.least_squares.grey_values import cubic_weights, leaves, nearest_pixel, on_lattice
from orthomill.tasks.matching.least_squares.shift_precision import residual_correlation
from orthomill.tasks.matching.points.sub_pixel import paraboloid_peaks
from orthomill.tasks.matching.smoothing import gaussian_weights, smoothed, with_gaps


@settings(max_examples=40, deadline=None)
@given(x=st.floats(-0.6, 0.6), y=st.floats(-0.6, 0.6), xx=st.floats(0.5, 3), yy=st.floats(0.5, 3), xy=st.floats(-0.4, 0.4))
def test_the_peak_of_a_paraboloid_is_exact(x, y, xx, yy, xy):
    row, col = np.mgrid[-1:2, -1:2].astype(float)
    values = -(xx * (col - x) ** 2 + yy * (row - y) ** 2 + 2 * xy * (col - x) * (row - y))
    assert paraboloid_peaks(values[None])[0] == pytest.approx([x, y], abs=1e-9)


@pytest.mark.parametrize("values", [np.ones((3, 3)), np.full((3, 3), np.nan), [[0, 1, 0], [1, 0, 1], [0, 1, 0]]])
def test_without_a_peak_the_pixel_itself_is_kept(values):
    assert paraboloid_peaks(np.array([values], dtype=float)).tolist() == [[0.0, 0.0]]


@settings(max_examples=40, deadline=None)
@given(st.floats(0.0, 1.0, exclude_max=True, width=32))
def test_cubic_weights_sum_to_one_and_reproduce_a_parabola(f):
    weights = np.array(cubic_weights(np.float32(f)))
    at = np.array([-1.0, 0.0, 1.0, 2.0])
    assert weights.sum() == pytest.approx(1.0, abs=1e-6)
    assert weights @ at == pytest.approx(f, abs=1e-6) and weights @ at**2 == pytest.approx(f * f, abs=2e-6)


@settings(max_examples=40, deadline=None)
@given(place=st.floats(-8, 8), offset=st.integers(0, 60000))
def test_places_on_the_lattice_move_exactly_with_any_integer(place, offset):
    assert (on_lattice(place) + offset) - offset == on_lattice(place)
    assert on_lattice(place) == pytest.approx(place, abs=2**-32)


def test_halves_round_up_on_both_sides_of_zero():
    assert [nearest_pixel(x) for x in (-1.5, -0.5, 0.5, 1.5, 2.49)] == [-1, 0, 1, 2, 2]


@pytest.mark.parametrize(
    ("centre", "outside"),
    [((10.0, 10.0), False), ((4.0, 10.0), True), ((10.0, 4.0), True), ((15.1, 10.0), True), ((np.nan, 10.0), True)],
)
def test_a_window_with_its_interpolation_stays_in_the_image(centre, outside):
    assert leaves((20, 20), *centre, 3.0, 3.0) == outside


@pytest.mark.parametrize("sigma", [0.8, 1.5])
def test_smoothed_white_noise_has_the_correlation_of_the_covariance_model(sigma):
    noise = np.random.default_rng(0).normal(size=(400, 400)).astype(np.float32)
    grey = smoothed(noise, sigma)[10:-10, 10:-10].astype(float)
    near, far = residual_correlation(sigma)
    for distance, expected in ((1, near), (2, far)):
        assert np.corrcoef(grey[:, distance:].ravel(), grey[:, :-distance].ravel())[0, 1] == pytest.approx(expected, abs=0.04)


@pytest.mark.parametrize("sigma", [0.0, 0.3, 0.8, 2.0])
def test_gaussian_weights_are_symmetric_and_sum_to_one(sigma):
    weights = gaussian_weights(sigma)
    assert len(weights) == 2 * reach_of(sigma) + 1 and weights.sum() == pytest.approx(1.0, abs=1e-6)
    assert np.array_equal(weights, weights[::-1])


def test_a_constant_image_stays_constant_around_gaps():
    grey = with_gaps(np.full((12, 12), 70, np.uint8))
    grey[4:6, 5:9] = np.nan
    out = smoothed(grey, 1.0)
    assert np.array_equal(np.isnan(out), np.isnan(grey)) and np.nanmax(np.abs(out - 70.0)) < 1e-4


def test_no_data_is_zero_infinite_or_masked():
    image = np.array([[1.0, 0.0, np.inf], [2.0, np.nan, 3.0]])
    mask = np.array([[True, True, True], [False, True, True]])
    assert np.array_equal(np.isnan(with_gaps(image, mask)), [[False, True, True], [True, True, False]])
