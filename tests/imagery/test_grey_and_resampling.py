"""Grey values and resampling against answers worked out by hand."""

import numpy as np
import pytest

from orthomill.tasks.imagery.radiometry import grey, grey_bytes, grey_range
from orthomill.tasks.imagery.resampling import sample_bilinear, sample_cubic


def test_grey_is_the_weighted_sum_and_keeps_neutral_colours():
    pixels = np.array([[[10, 10, 10], [255, 0, 0]]], dtype=np.uint8)
    assert grey(pixels) == pytest.approx(np.array([[10.0, 0.299 * 255]]), abs=1e-4)
    assert np.array_equal(grey(pixels[:, :, :1]), grey(pixels[:, :, 0]))


def test_sixteen_bits_are_stretched_over_what_the_photograph_uses():
    dark = np.linspace(200, 1200, 10000).astype(np.uint16).reshape(100, 100, 1)
    stretched = grey_bytes(dark, grey_range(dark))
    assert stretched.min() == 0 and stretched.max() == 255
    assert grey_range(np.zeros((4, 4, 1), dtype=np.uint8)) == (0.0, 255.0)
    flat = np.full((8, 8, 1), 700, dtype=np.uint16)
    assert np.isfinite(grey_bytes(flat, grey_range(flat)).astype(float)).all()


@pytest.mark.parametrize(("sample", "power"), [(sample_bilinear, 1), (sample_cubic, 2)])
def test_resampling_reproduces_polynomials(sample, power):
    row, col = np.mgrid[0:20, 0:30].astype(float)
    image = 3.0 + 0.5 * col**power - 0.25 * row**power
    at = np.random.default_rng(0).uniform(3, 15, (50, 2))
    assert sample(image, at) == pytest.approx(3.0 + 0.5 * at[:, 0] ** power - 0.25 * at[:, 1] ** power, abs=1e-9)


@pytest.mark.parametrize("sample", [sample_bilinear, sample_cubic])
def test_whole_pixels_are_kept_and_the_outside_is_nan(sample):
    image = np.random.default_rng(1).uniform(0, 255, (6, 5, 3))
    corners = np.array([[0.0, 0.0], [4.0, 5.0], [2.0, 3.0]])
    assert sample(image, corners) == pytest.approx(image[[0, 5, 3], [0, 4, 2]])
    assert np.isnan(sample(image, np.array([[-0.01, 2.0], [2.0, 5.01], [np.nan, 1.0]]))).all()
