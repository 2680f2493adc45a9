"""Correlation within a band: against plain NumPy, known shifts, what is refused, and parts of images."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.guided.band_correlation import BandPlaces, band_places, column_sigmas, window_norms
from orthomill.tasks.matching.guided.guided_settings import BandCorrelation

RULES = BandCorrelation(template=11)


def texture(seed: int, shape: tuple[int, int] = (70, 110), sigma: float = 1.5) -> np.ndarray:
    noise = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=shape), sigma)
    return np.rint(np.clip(120 + 40 * noise / noise.std(), 1, 255)).astype(np.float32)


def places(left, right, points, columns, shift=0, beside=1, rules=RULES) -> BandPlaces:
    return band_places(left, right, np.array(points, np.int64), np.array(columns, np.int64), shift, beside, rules)


def plain_best(left, right, point, columns, shift, beside, half):
    """The place of the greatest correlation by numpy.corrcoef, one pixel beyond the columns as well."""
    col, row = point
    template = left[row - half : row + half + 1, col - half : col + half + 1].ravel()
    best = (-2.0, 0, 0)
    for r in range(row + shift - beside, row + shift + beside + 1):
        for c in range(columns[0] - 1, columns[1] + 2):
            window = right[r - half : r + half + 1, c - half : c + half + 1].ravel()
            best = max(best, (float(np.corrcoef(template.astype(float), window.astype(float))[0, 1]), r, c))
    return best


@given(st.integers(0, 10**6), st.sampled_from([5, 9, 11]))
@settings(max_examples=15, deadline=None)
def test_the_kernel_agrees_with_plain_numpy(seed, side):
    left, right = texture(seed), texture(seed + 1)
    found = places(left, right, [(40, 30)], [(30, 60)], 2, 2, BandCorrelation(template=side, min_correlation=-1.0, sub_pixel=False))
    value, row, col = plain_best(left, right, (40, 30), (30, 60), 2, 2, side // 2)
    assert found.correlation[0] == pytest.approx(value, abs=2e-5)
    assert (found.col[0], found.row[0]) == (col, row) and found.places[0] == 33 * 5


def test_a_shift_between_pixels_is_found():
    left = texture(4)
    right = (0.8 * ndimage.shift(left, (1.0, 6.3), order=3, mode="reflect") + 20).astype(np.float32)
    points = [(c, r) for r in range(20, 50, 6) for c in range(25, 80, 6)]
    columns = [(c - 3, c + 15) for c, _ in points]
    fine, whole = (places(left, right, points, columns, rules=BandCorrelation(template=11, sub_pixel=s)) for s in (True, False))
    assert (fine.outcome == Outcome.CONVERGED).all() and (fine.row - np.array(points)[:, 1] == 1).all()
    off = fine.col - np.array(points)[:, 0] - 6.3
    assert np.abs(off).max() < 0.2
    assert (whole.col - np.array(points)[:, 0] == 6).all()
    assert (column_sigmas(fine, 121) < 0.2).all()


@pytest.mark.parametrize(
    ("columns", "asked", "outcome"),
    [
        ((42, 50), {}, Outcome.CONVERGED),
        ((47, 60), {}, Outcome.MOVED_TOO_FAR),
        ((60, 70), {}, Outcome.LOW_CORRELATION),
        ((60, 50), {}, Outcome.OUTSIDE),
        ((42, 50), {"min_deviation": 90.0}, Outcome.LOW_TEXTURE),
    ],
)
def test_outcomes(columns, asked, outcome):
    left = texture(9)
    right = np.roll(left, 6, axis=1)
    assert places(left, right, [(40, 30)], [columns], rules=BandCorrelation(template=11, **asked)).outcome[0] == outcome


def test_missing_data_and_borders_are_no_place():
    left = texture(9)
    right = np.roll(left, 6, axis=1)
    right[28, 46] = np.nan
    assert places(left, right, [(40, 30)], [(46, 46)]).outcome[0] == Outcome.OUTSIDE
    assert places(left, right, [(3, 30)], [(46, 46)]).outcome[0] == Outcome.OUTSIDE
    assert places(left[:8], right, [(40, 4)], [(46, 46)]).outcome[0] == Outcome.OUTSIDE


@given(st.integers(0, 30), st.integers(0, 20), st.integers(0, 10**6))
@settings(max_examples=10, deadline=None)
def test_a_part_gives_the_bits_of_the_whole(col, row, seed):
    image = texture(seed) + np.float32(0.25)
    whole = window_norms(image, 5)
    part = window_norms(image[row : row + 40, col : col + 60], 5)
    inner = slice(5, 35), slice(5, 55)
    for one, other in zip(whole, part, strict=True):
        assert np.array_equal(one[row : row + 40, col : col + 60][inner], other[inner])


def test_the_standard_errors_follow_the_noise():
    rng, spreads = np.random.default_rng(8), []
    for noise in (2.0, 8.0):
        left = texture(4, (200, 260))
        right = ndimage.shift(left, (0.0, 6.3), order=3, mode="reflect")
        left, right = (np.rint(image + rng.normal(0, noise, image.shape)).astype(np.float32) for image in (left, right))
        points = [(c, r) for r in range(20, 180, 6) for c in range(25, 225, 6)]
        found = places(left, right, points, [(c, c + 12) for c, _ in points])
        good = found.outcome == Outcome.CONVERGED
        error, sigma = (found.col - np.array(points)[:, 0] - 6.3)[good], column_sigmas(found, 121)[good]
        spreads.append(1.4826 * np.median(np.abs(error)))
        assert 0.4 < 1.4826 * np.median(np.abs(error / sigma)) < 1.5
    assert spreads[1] > 2 * spreads[0]
