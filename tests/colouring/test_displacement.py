"""Which photographs count where a height is unsure: by what an error of the height displaces their colours."""

import numpy as np
import pytest

from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.colouring.blending.displacement import less_displaced
from orthomill.tasks.colouring.sampling.ground_sampling import Ground

CELL, HEIGHT = 0.1, 100.0
GRID = MapGrid(west=0.0, north=4.0, cell=CELL, rows=40, cols=400)
CENTRES = np.array([[5.0, 2.0, HEIGHT], [35.0, 2.0, HEIGHT], [20.0, 62.0, HEIGHT]])
"""m: above the ground on the left and on the right, and far to the side"""


def set_back(sigma: float, worth: tuple[float, ...] = (1.0, 1.0, 1.0), centres: np.ndarray = CENTRES) -> np.ndarray:
    """Weights (3, rows, cols) on flat ground after those of colours that lie farther off are set back."""
    window = Window(0, 0, GRID.rows, GRID.cols)
    flat = np.zeros(GRID.shape, np.float32)
    weights = np.ones((len(centres), *GRID.shape), np.float32) * np.array(worth, np.float32)[:, None, None]
    less_displaced(weights, Ground(GRID, window, flat, flat, flat), np.full(GRID.shape, sigma, np.float32), centres)
    return weights


def test_where_heights_are_sure_all_colours_count():
    assert set_back(0.01) == pytest.approx(np.ones((3, *GRID.shape)), rel=0.003)


def test_where_heights_are_guesses_the_steepest_photograph_counts():
    left, right, side = set_back(5.0)
    at, beyond = 60, 340
    assert (left[:, at] == 1.0).all() and (right[:, at] < 1e-4).all()
    assert (right[:, beyond] == 1.0).all() and (left[:, beyond] < 1e-4).all()
    assert side.max() < 1e-4


def test_factor_is_that_of_a_normal_distribution_of_one_pixel():
    weights = set_back(0.5)
    x, y = GRID.centres(Window(0, 0, GRID.rows, GRID.cols))
    off = np.hypot(x[None, :] - CENTRES[:, 0, None], y[20] - CENTRES[:, 1, None]) / HEIGHT * 0.5 / CELL
    wanted = np.maximum(np.exp(-0.5 * (off**2 - off.min(axis=0) ** 2)), 1e-6)
    assert weights[:, 20] == pytest.approx(wanted, rel=1e-4)


def test_photographs_that_look_equally_steeply_are_blended_in_a_narrow_seam():
    left, right, _ = set_back(5.0)
    both = np.minimum(left, right)[20] > 0.1
    assert 0 < both.sum() * CELL < 1.0 and both[199:201].all()


def test_what_hardly_sees_a_place_does_not_choose():
    """The left photograph sees the place at the border of its frame only, or behind an estimate."""
    left, right, _ = set_back(5.0, worth=(0.05, 1.0, 1.0))
    assert (right[:, 60] == 1.0).all() and (left[:, 60] == np.float32(0.05)).all()


def test_what_is_not_seen_stays_unseen_and_what_is_seen_keeps_a_weight():
    weights = set_back(np.inf, worth=(0.0, 1.0, 1.0))
    assert not weights[0].any() and weights[1:].all()


def test_without_photographs_nothing_happens():
    assert set_back(5.0, worth=(), centres=np.zeros((0, 3))).shape == (0, *GRID.shape)
