"""Ground where none was measured: what is exact, how far it reaches, and what its error is said to be."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.tasks.terrain.ground.bridges import anchors_of, bridge
from orthomill.tasks.terrain.ground.learned_errors import CLASSES, LEAST_CELLS, HiddenGround, hidden_ground, learned_errors
from orthomill.tasks.terrain.ground.mean_value_fill import DIRECTIONS, HALF, fill_gaps

ROW, COL = np.mgrid[:60, :70].astype(np.float64)


def plane(slope: tuple[float, float] = (0.2, -0.1)) -> np.ndarray:
    return 50.0 + slope[0] * ROW + slope[1] * COL


def gap() -> np.ndarray:
    return (ROW - 30) ** 2 / 100 + (COL - 35) ** 2 / 225 < 1


@settings(deadline=None, max_examples=8)
@given(st.floats(-1, 1), st.floats(-1, 1))
def test_a_plane_is_continued_through_a_round_gap(down, right):
    z = plane((down, right))
    fill = fill_gaps(z[..., None], ~gap(), gap(), 40)
    # Rays end at cells and not at the outline of the gap: a part of a cell is what they may be off.
    assert np.abs(fill.values[..., 0] - z)[gap()].max() < 0.2 * (abs(down) + abs(right)) + 1e-4
    assert fill.enclosed.all() and (fill.distance[gap()] >= 1).all() and (fill.distance[~gap()] == 0).all()


def test_values_stay_between_those_around():
    z = np.where(gap(), np.nan, np.sin(ROW / 5) + np.cos(COL / 7))
    filled = fill_gaps(z[..., None], ~gap(), gap(), 40).values[..., 0]
    assert np.nanmin(z) - 1e-6 <= filled.min() and filled.max() <= np.nanmax(z) + 1e-6


def test_nothing_beyond_the_reach_counts():
    known = COL < 10
    fill = fill_gaps(plane()[..., None], known, ~known, 5)
    assert np.isfinite(fill.values[30, 14, 0]) and np.isnan(fill.values[30, 15, 0]) and np.isinf(fill.distance[30, 20])
    assert fill.open_side[30, 12] >= HALF and not fill.enclosed[30, 12] and fill.open_side[30, 40] == DIRECTIONS


def test_the_error_grows_with_the_distance_as_hidden_ground_told():
    cells, squares = [0] * CLASSES, [0.0] * CLASSES
    for k, error in ((1, 0.05), (2, 0.1), (4, 0.4)):
        cells[k], squares[k] = 1000, 1000 * error**2
    curve = learned_errors((HiddenGround(cells=(tuple(cells), (0,) * CLASSES), squares=(tuple(squares), (0.0,) * CLASSES)),), 2.0)
    assert curve.enclosed[1:5] == pytest.approx((0.05, 0.1, 0.25, 0.4))
    assert curve.enclosed[0] == pytest.approx(0.025) and curve.enclosed[5] == pytest.approx(0.8)
    assert all(o >= e for o, e in zip(curve.one_sided, curve.enclosed, strict=True))
    fill = fill_gaps(plane()[..., None], ~gap(), gap(), 40)
    errors = curve.at(fill)
    assert (np.diff(errors[30, 35:49]) <= 0).all(), "less towards the border of the gap"


def test_without_hidden_ground_the_error_is_that_of_hilly_land():
    none = HiddenGround(cells=((LEAST_CELLS - 1,) * CLASSES, (0,) * CLASSES), squares=((0.0,) * CLASSES, (0.0,) * CLASSES))
    curve = learned_errors((none,), 2.0)
    assert curve.enclosed == pytest.approx([0.2 * d for d in curve.distance])


def test_hidden_ground_is_judged_by_what_was_measured():
    z = (plane() + np.where(gap(), 0.5, 0.0)).astype(np.float32)
    everywhere = np.ones(z.shape, bool)
    part = hidden_ground(z, everywhere, ~gap(), (slice(None), slice(None)), 40)
    assert sum(part.cells[0]) == gap().sum() and sum(part.cells[1]) == 0
    assert sum(part.squares[0]) / gap().sum() == pytest.approx(0.25, abs=0.02)


def test_ground_beside_a_wall_is_corrected_by_the_ground_farther_away_and_a_bank_is_kept():
    z, sigma = plane(), np.full(ROW.shape, 0.02)
    wall = (abs(ROW - 30) < 5) & (abs(COL - 20) < 6)
    beside = ~anchors_of(~wall, 4) & ~wall
    high = z + np.where(beside, 0.3, 0.0)
    high[27:33, 60:66] += 3.0
    bank = np.zeros(z.shape, bool)
    bank[27:33, 60:66] = True
    sigma[beside | bank] = 0.25
    blocks = np.stack([high, sigma, np.full(z.shape, 0.01)], axis=-1).astype(np.float32)
    cells = tuple([1000] * CLASSES)
    squares = tuple(1000 * (0.01 * 2**k) ** 2 for k in range(CLASSES))
    curve = learned_errors((HiddenGround(cells=(cells, cells), squares=(squares, squares)),), 1.0)
    found = bridge(blocks, ~wall, ~wall & ~beside & ~bank, curve, 40)
    off = found.bare[..., 0] - z
    assert np.abs(off[beside]).max() < 0.15 and np.sqrt((off[beside] ** 2).mean()) < 0.08
    assert np.sqrt((off[wall] ** 2).mean()) < 0.08 and (np.abs(off[wall]) < 3 * found.bare[..., 1][wall]).all()
    assert off[bank] == pytest.approx(3.0, abs=1e-3), "what contradicts the ground around by far is no bias"
    assert found.bare[..., 3][~beside & ~wall] == pytest.approx(0.0)
