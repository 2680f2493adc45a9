"""How far the surface may lie from an existing model: learned from tie points that are left out."""

import numpy as np
import pytest

from orthomill.schemas.observations import GroundPoints
from orthomill.schemas.raster import MapGrid
from orthomill.tasks.densification.volume.guide_reach import near_tie_points, reach_of

GRID = MapGrid(west=0.0, north=0.0, cell=2.0, rows=60, cols=80)
ROW, COL = np.mgrid[:60, :80]
TRUTH = (500.0 + 0.2 * ROW + 0.1 * COL).astype(np.float32)


def cloud(col: np.ndarray, row: np.ndarray, above: np.ndarray | float = 0.0) -> GroundPoints:
    """Tie points at places, `above` the truth."""
    none = np.zeros(len(col), np.float32)
    z = 500.0 + 0.2 * row + 0.1 * col + above
    x, y = (col + 0.5) * GRID.cell, -(row + 0.5) * GRID.cell
    return GroundPoints(np.arange(len(col)), x, y, z, none, none, none, np.full(len(col), 2, np.int16), none)


def spread(number: int, until: float = 78.9, seed: int = 4) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.uniform(0, until, number), rng.uniform(0, 58.9, number)


def posts(sigma: float, every: int = 15) -> np.ndarray:
    """Errors of a model with posts `every` places apart, bilinear between them."""
    errors = np.random.default_rng(7).normal(0, sigma, (60 // every + 2, 80 // every + 2))
    r, c = np.arange(60) / every, np.arange(80) / every
    rows = np.stack([np.interp(r, np.arange(len(errors)), column) for column in errors.T], axis=1)
    return np.stack([np.interp(c, np.arange(rows.shape[1]), line) for line in rows])


def test_reach_is_twice_as_far_as_all_but_a_few_depart():
    away = np.concatenate([np.linspace(-1.0, 3.0, 998), [400.0, -400.0]])
    assert reach_of(away) == pytest.approx((2.0, 6.0), abs=0.1)
    assert reach_of(np.linspace(1.0, 2.0, 50)).below == 0.0


def test_without_tie_points_nothing_is_bounded():
    heights, reach = near_tie_points(cloud(np.empty(0), np.empty(0)), TRUTH, GRID)
    assert np.array_equal(heights, TRUTH) and reach.min() > 1e5


def test_near_tie_points_the_range_follows_them_and_far_from_them_the_model():
    """Posts 30 m apart with 2 m of noise; tie points in the western half alone."""
    model = (TRUTH + posts(2.0)).astype(np.float32)
    heights, reach = near_tie_points(cloud(*spread(3000, until=40.0)), model, GRID)
    near, far = np.s_[:, :38], np.s_[:, 60:]
    assert np.abs(heights - TRUTH)[near].max() < 0.7 < np.abs(model - TRUTH)[near].max()
    assert np.array_equal(heights[far], model[far])
    width = reach.sum(axis=-1)
    assert np.median(width[near]) < 0.2 * np.median(width[far])
    inside = (heights - reach[..., 0] <= TRUTH) & (heights + reach[..., 1] >= TRUTH)
    assert inside.mean() > 0.99


def test_a_hut_is_searched_farther_than_a_meadow():
    """A roof 6 m high of three by three places, which the model does not have; a meadow that it has wrong by metres."""
    col, row = spread(4000)
    hut = (np.abs(col - 40.0) < 1.5) & (np.abs(row - 30.0) < 1.5)
    heights, reach = near_tie_points(cloud(col, row, np.where(hut, 6.0, 0.0)), (TRUTH + posts(3.0)).astype(np.float32), GRID)
    roof = np.s_[29:32, 39:42]
    assert (heights + reach[..., 1] - TRUTH)[roof].min() > 6.0
    assert (heights - reach[..., 0] - TRUTH)[29:32, 42:44].max() < 0.0
    assert reach[roof].min() > 1.5 * np.median(reach.max(axis=-1))


def test_a_wrong_tie_point_among_thousands_leads_nowhere():
    col, row = spread(3000)
    wrong = np.zeros(3000)
    wrong[0] = 300.0
    heights, _ = near_tie_points(cloud(col, row, wrong), (TRUTH + posts(2.0)).astype(np.float32), GRID)
    assert np.abs(heights - TRUTH).max() < 1.0


def test_a_wrong_tie_point_that_is_believed_widens_what_is_searched_around_it():
    col, row = spread(1500)
    wrong = np.zeros(1500)
    wrong[0] = 3.0
    heights, reach = near_tie_points(cloud(col, row, wrong), (TRUTH + posts(2.0)).astype(np.float32), GRID)
    at = round(float(row[0])), round(float(col[0]))
    assert heights[at] - reach[at][0] <= TRUTH[at]


def test_where_neighbours_say_less_than_the_model_it_stays():
    """Tie points every twelve places on hills that the model has and their interpolation has not."""
    hills = 8.0 * np.sin(COL / 2.5) * np.cos(ROW / 3.0)
    col, row = (values.ravel().astype(float) for values in np.meshgrid(np.arange(2, 79, 12), np.arange(3, 59, 12)))
    noise = np.random.default_rng(3).normal(0, 0.5, len(col))
    above = hills[row.astype(int), col.astype(int)] + noise
    heights, reach = near_tie_points(cloud(col, row, above), (TRUTH + hills).astype(np.float32), GRID)
    assert np.array_equal(heights, (TRUTH + hills).astype(np.float32))
    assert np.ptp(reach[..., 0]) == np.ptp(reach[..., 1]) == 0
