"""Heights of narrow bases, averaged with those around that are the same."""

import numpy as np
import pytest

from orthomill.tasks.densification.volume.evened_heights import WIDEST, evened

STEP = 0.05
SHAPE = (40, 50)


def found(height: np.ndarray, stretch: float, where: np.ndarray | None = None) -> np.ndarray:
    everywhere = np.ones(height.shape, bool) if where is None else where
    return evened(height.astype(np.float32), np.full(height.shape, stretch, np.float32), STEP, everywhere)


def hatched() -> np.ndarray:
    """Level ground whose cells differ by chance within four steps."""
    return 100 + np.random.default_rng(3).uniform(-2 * STEP, 2 * STEP, SHAPE)


def test_chance_from_cell_to_cell_is_averaged():
    height = hatched()
    inner = (slice(WIDEST, -WIDEST),) * 2
    assert found(height, 4.0)[inner].std() < 0.2 * height[inner].std()


def test_heights_of_wide_bases_stay_bit_for_bit():
    height = hatched().astype(np.float32)
    assert (found(height, 1.2) == height).all()


def test_a_wall_stays_where_it_is():
    height = hatched() + np.where(np.arange(SHAPE[1]) < 25, 0.0, 1.0)
    even = found(height, 4.0)
    assert np.abs(even[:, :25] - 100).max() < 2 * STEP and np.abs(even[:, 25:] - 101).max() < 2 * STEP


def test_a_slope_is_not_bent():
    row, col = np.indices(SHAPE)
    height = 100 + 0.01 * row + 0.02 * col
    inner = (slice(WIDEST, -WIDEST),) * 2
    assert found(height, 4.0)[inner] == pytest.approx(height[inner], abs=2e-5)


def test_only_what_is_asked_for_changes_and_holes_stay():
    height = hatched()
    height[5:10, 5:10] = np.nan
    where = np.zeros(SHAPE, bool)
    where[:, :25] = True
    even = found(height, 4.0, where)
    assert (even[:, 25:] == height[:, 25:].astype(np.float32)).all() and (even[:, :25] != height[:, :25].astype(np.float32)).any()
    assert (np.isnan(even) == np.isnan(height)).all()
