"""Grey values and resampling against answers worked out by hand and against plain NumPy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from plain_resampling import sample_bilinear, sample_keys

from orthomill.tasks.imagery.bicubic import bicubic_at, bilinear_at
from orthomill.tasks.imagery.radiometry import LUMA, grey, grey_bytes, grey_range
from orthomill.tasks.imagery.resampling import sample_cubic


@njit
def _kernel_values(image, pixels, cubic, out):
    for i in range(len(pixels)):
        col, row = pixels[i]
        out[i] = bicubic_at(image, row, col) if cubic else bilinear_at(image, row, col)


def kernel_values(image: np.ndarray, pixels: np.ndarray, cubic: bool) -> np.ndarray:
    out = np.empty(len(pixels))
    _kernel_values(image, pixels, cubic, out)
    return out


def random_image(shape: tuple[int, ...], seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0, 255, shape)


def test_grey_is_the_weighted_sum_and_keeps_neutral_colours():
    pixels = np.array([[[10, 10, 10], [255, 0, 0]]], dtype=np.uint8)
    assert grey(pixels) == pytest.approx(np.array([[10.0, 0.299 * 255]]), abs=1e-4)
    assert np.array_equal(grey(pixels[:, :, :1]), grey(pixels[:, :, 0]))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_grey_agrees_with_a_matrix_product(dtype):
    pixels = random_image((7, 9, 3)).astype(dtype)
    assert grey(pixels).dtype == np.float32
    assert grey(pixels) == pytest.approx(pixels.astype(float) @ LUMA, rel=1e-6)
    assert LUMA.sum() == pytest.approx(1.0)


def test_sixteen_bits_are_stretched_over_what_the_photograph_uses():
    dark = np.linspace(200, 1200, 10000).astype(np.uint16).reshape(100, 100, 1)
    stretched = grey_bytes(dark, grey_range(dark))
    assert stretched.min() == 0 and stretched.max() == 255
    assert grey_range(np.zeros((4, 4, 1), dtype=np.uint8)) == (0.0, 255.0)
    flat = np.full((8, 8, 1), 700, dtype=np.uint16)
    assert np.isfinite(grey_bytes(flat, grey_range(flat)).astype(float)).all()


def test_single_saturated_pixels_do_not_take_up_the_range():
    pixels = np.linspace(1000, 2000, 10000).astype(np.uint16).reshape(100, 100, 1)
    pixels[50, 50] = 65535
    low, high = grey_range(pixels)
    assert 1000 <= low < 1010 and 1990 < high < 2010


def test_grey_bytes_round_to_the_nearest_level_and_clip():
    pixels = np.array([[90, 100, 103, 104, 200, 300]], dtype=np.uint16)
    assert grey_bytes(pixels, (100.0, 200.0)).tolist() == [[0, 0, 8, 10, 255, 255]]


def test_cubic_resampling_reproduces_quadratic_polynomials():
    row, col = np.mgrid[0:20, 0:30].astype(float)
    image = 3.0 + 0.5 * col**2 - 0.25 * row**2
    at = np.random.default_rng(0).uniform(3, 15, (50, 2))
    assert sample_cubic(image, at) == pytest.approx(3.0 + 0.5 * at[:, 0] ** 2 - 0.25 * at[:, 1] ** 2, abs=1e-9)


def test_integer_pixels_are_kept_and_the_outside_is_nan():
    image = random_image((6, 5, 3), 1)
    corners = np.array([[0.0, 0.0], [4.0, 5.0], [2.0, 3.0]])
    assert sample_cubic(image, corners) == pytest.approx(image[[0, 5, 3], [0, 4, 2]])
    assert np.isnan(sample_cubic(image, np.array([[-0.01, 2.0], [2.0, 5.01], [np.nan, 1.0]]))).all()


@settings(max_examples=25, deadline=None)
@given(rows=st.integers(4, 12), cols=st.integers(4, 12), seed=st.integers(0, 99))
def test_cubic_resampling_agrees_with_plain_numpy_up_to_the_border(rows, cols, seed):
    image = random_image((rows, cols), seed)
    pixels = np.random.default_rng(seed + 1).uniform(0, 1, (20, 2)) * [cols - 1, rows - 1]
    expected = sample_keys(image, pixels)
    assert sample_cubic(image, pixels) == pytest.approx(expected, abs=1e-9)
    assert kernel_values(image, pixels, True) == pytest.approx(expected, abs=1e-9)


@settings(max_examples=25, deadline=None)
@given(rows=st.integers(2, 12), cols=st.integers(2, 12), seed=st.integers(0, 99))
def test_bilinear_interpolation_agrees_with_plain_numpy(rows, cols, seed):
    image = random_image((rows, cols), seed)
    pixels = np.random.default_rng(seed + 1).uniform(0, 1, (20, 2)) * [cols - 1, rows - 1]
    assert kernel_values(image, pixels, False) == pytest.approx(sample_bilinear(image, pixels), abs=1e-9)


@pytest.mark.parametrize("cubic", [True, False])
def test_kernels_repeat_the_border_beyond_the_image(cubic):
    image = random_image((5, 6))
    beyond = np.array([[-3.0, 2.0], [9.0, 2.0], [2.0, -4.0], [2.0, 8.0]])
    expected = image[[2, 2, 0, 4], [0, 5, 2, 2]]
    assert kernel_values(image, beyond, cubic) == pytest.approx(expected)


def test_bands_are_resampled_each_by_itself():
    image, pixels = random_image((9, 8, 3)), np.random.default_rng(2).uniform(0, 7, (15, 2))
    together = sample_cubic(image, pixels)
    for band in range(3):
        assert together[:, band] == pytest.approx(sample_cubic(image[:, :, band], pixels), abs=1e-12)
