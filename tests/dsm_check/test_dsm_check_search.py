"""The search for a start: right shifts, the benefit of the doubt, and the search back."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, shift

from orthomill.tasks.dsm_check.comparison_settings import ShiftSearch
from orthomill.tasks.dsm_check.search import distance_back, ortho_pair, shifts, window_sums

EAST = np.array([1.0, 0.0])
SEARCH = ShiftSearch()


def picture(seed=1, size=160):
    random = np.random.default_rng(seed)
    values = gaussian_filter(random.standard_normal((size, size)), 1.5)
    return np.clip(np.rint(120 + 40 * values / values.std()), 1, 255).astype(np.uint8)


def moved(image, dcol, drow):
    return np.clip(np.rint(shift(image.astype(float), (drow, dcol), order=3, mode="nearest")), 1, 255).astype(np.uint8)


def points():
    col, row = np.meshgrid(np.arange(40, 120, 9), np.arange(40, 120, 9))
    return np.column_stack([col.ravel(), row.ravel()])


@pytest.mark.parametrize(("angle", "size"), [(0, 8), (0, -9), (90, 7), (40, 9), (160, -6)])
def test_shifts_along_the_base_are_found(angle, size):
    direction = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    true = size * direction
    pair = ortho_pair(picture(), moved(picture(), *true), SEARCH)
    found = shifts(pair, points(), direction, SEARCH, SEARCH.gain)
    assert (np.hypot(*(found - true).T) < 1.5).mean() > 0.98
    back = distance_back(pair, points(), points() + true, direction, SEARCH)
    assert (back <= SEARCH.back).mean() > 0.95


def test_equal_images_do_not_move():
    pair = ortho_pair(picture(), picture(), SEARCH)
    assert not shifts(pair, points(), EAST, SEARCH, SEARCH.gain).any()
    assert (distance_back(pair, points(), points().astype(float), EAST, SEARCH) == 0).all()


def test_no_shift_has_the_benefit_of_the_doubt():
    """On unrelated images hardly a shift beats none by much when a high gain is asked for."""
    pair = ortho_pair(picture(1), picture(2), SEARCH)
    easy, hard = (shifts(pair, points(), EAST, SEARCH, gain).any(axis=1).mean() for gain in (0.01, 0.9))
    assert hard < 0.05 < 0.5 < easy


def test_a_wrong_match_does_not_return():
    pair = ortho_pair(picture(), picture(), SEARCH)
    wrong = points() + np.array([7.0, 0.0])
    assert (distance_back(pair, points(), wrong, EAST, SEARCH) > SEARCH.back).mean() > 0.95
    assert np.isnan(distance_back(pair, points(), np.full(points().shape, np.nan), EAST, SEARCH)).all()


def test_no_data_is_never_matched():
    image = picture()
    image[:, 60:] = 0
    pair = ortho_pair(image, picture(), SEARCH)
    near = points()[points()[:, 0] > 60]
    assert not shifts(pair, near, EAST, SEARCH, SEARCH.gain).any()


def test_window_sums_against_numpy():
    values = np.random.default_rng(0).integers(0, 1000, (30, 40)) / 4
    out = window_sums(values, 3)
    assert out[10, 17] == values[7:14, 14:21].sum() and np.isnan(out[2, 17]) and np.isfinite(out[3, 3])
    assert np.isnan(window_sums(values[:5], 3)).all()


def test_best_shift_against_numpy():
    """The coarse correlation agrees with numpy's correlation coefficient for every shift of a line."""
    search = ShiftSearch(gain=0.0, reach=6)
    left, right = picture(3), moved(picture(3), 4, 0)
    at = np.array([[80, 80]])
    halves = [im.astype(float).reshape(80, 2, 80, 2).mean(axis=(1, 3)) for im in (left, right)]
    template = halves[0][34:47, 34:47].ravel()
    steps = [(c, r) for c in range(-4, 5) for r in (-1, 0, 1)]
    best = max(steps, key=lambda s: np.corrcoef(template, halves[1][34 + s[1] : 47 + s[1], 34 + s[0] : 47 + s[0]].ravel())[0, 1])
    found = shifts(ortho_pair(left, right, search), at, EAST, search, 0.0)[0]
    assert np.abs(found - 2 * np.array(best)).max() <= 1
    assert found.tolist() == [4, 0]
