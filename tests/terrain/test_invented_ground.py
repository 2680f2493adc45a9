"""Ground where none was measured: what is exact, how far it reaches, and what its error is said to be."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.tasks.terrain.ground.bridges import bridge
from orthomill.tasks.terrain.ground.evened_ground import REACH, ROUNDS, evened
from orthomill.tasks.terrain.ground.hidden_ground import told_by_ground
from orthomill.tasks.terrain.ground.learned_errors import LEAST_SAMPLES, GroundSamples, learned_errors
from orthomill.tasks.terrain.ground.mean_value_fill import _TOGETHER, _UNITS, DIRECTIONS, HALF, QUARTER, GapFill, _summed, fill_gaps
from orthomill.tasks.terrain.ground.morphological_filter import rings

ROW, COL = np.mgrid[:60, :70].astype(np.float64)

TURN = np.linspace(0.0, 2.0 * np.pi, 400)


def plane(slope: tuple[float, float] = (0.2, -0.1)) -> np.ndarray:
    return 50.0 + slope[0] * ROW + slope[1] * COL


def plane_of(rows: np.ndarray) -> np.ndarray:
    return (50.0 + 0.2 * rows).astype(np.float32)


def gap() -> np.ndarray:
    return (ROW - 30) ** 2 / 100 + (COL - 35) ** 2 / 225 < 1


@settings(deadline=None, max_examples=8)
@given(st.floats(-1, 1), st.floats(-1, 1))
def test_a_plane_is_continued_through_a_round_gap(down, right):
    z = plane((down, right))
    fill = fill_gaps(z[..., None], ~gap(), gap(), 40)
    # Rays end at cells and not at the outline of the gap: a part of a cell is what they may be off.
    assert np.abs(fill.values[..., 0] - z)[gap()].max() < 0.21 * (abs(down) + abs(right)) + 1e-4
    assert fill.enclosed.all() and (fill.distance[gap()] >= 1).all() and (fill.distance[~gap()] == 0).all()


def test_values_stay_between_those_around():
    z = np.where(gap(), np.nan, np.sin(ROW / 5) + np.cos(COL / 7))
    filled = fill_gaps(z[..., None], ~gap(), gap(), 40).values[..., 0]
    assert np.nanmin(z) - 1e-6 <= filled.min() and filled.max() <= np.nanmax(z) + 1e-6


def test_sums_over_the_known_cells_are_those_of_whole_arrays():
    draw = np.random.default_rng(4)
    known, values = draw.random((23, 31)) < 0.6, draw.normal(100, 30, (23, 31, 2)).astype(np.float32)
    row, col = np.indices(known.shape)
    whole = np.rint(values.astype(np.float64) * _UNITS).astype(np.int64)
    plain = np.stack([known, known * row, known * col, known * whole[..., 0], known * whole[..., 1]], axis=-1).astype(np.int64)
    plain = plain.cumsum(axis=0).cumsum(axis=1)
    values[~known] = np.nan
    counts, sums = _summed(values, known)
    np.testing.assert_array_equal(counts[1:, 1:], plain[..., 0])
    np.testing.assert_array_equal(sums[1:, 1:], plain[..., 1:])
    assert not any(table[0].any() or table[:, 0].any() for table in (counts, sums))


def test_a_cell_is_filled_by_itself_whatever_is_filled_with_it():
    draw = np.random.default_rng(2)
    known = draw.random((70, 90)) < 0.05
    values = draw.normal(100, 3, (*known.shape, 2)).astype(np.float32)
    together = fill_gaps(values, known, ~known, 20)
    assert (~known).sum() > _TOGETHER, "more than one batch"
    for row, col in ((0, 0), (31, 32), (32, 31), (69, 89), (40, 64)):
        alone = np.zeros_like(known)
        alone[row, col] = True
        single = fill_gaps(values, known, alone, 20)
        for one, all_of_them in zip(single, together, strict=True):
            np.testing.assert_array_equal(one[row, col], all_of_them[row, col])


@pytest.mark.parametrize("seed", range(6))
def test_a_hole_is_left_where_a_quarter_of_the_directions_finds_nothing_and_filled_as_any_other_elsewhere(seed):
    draw = np.random.default_rng(seed)
    known = np.zeros((120, 130), bool)
    for _ in range(25):
        row, col, size = (int(draw.integers(*between)) for between in ((0, 110), (0, 120), (1, 20)))
        known[row : row + size, col : col + size] = True
    values = draw.normal(0, 1, (*known.shape, 1))
    free, hole = (fill_gaps(values, known, ~known, 30, holes=holes) for holes in (None, ~known))
    left = np.isnan(hole.values[..., 0])
    np.testing.assert_array_equal(hole.values[~left], free.values[~left])
    # What ends the search runs from the east on and not around the circle: a wider angle is always found, wherever it begins.
    assert left[free.open_side >= 2 * QUARTER].all() and not left[free.open_side < QUARTER].any() and 0.1 < left.mean() < 0.9


def test_a_patch_in_a_large_gap_throws_no_spokes():
    """Rays of one cell met it from here and missed it from the next cell: ridges of a tenth of its height ran through the gap."""
    rows, cols = np.mgrid[:201, :201]
    away = np.hypot(rows - 100, cols - 100)
    known = (away > 90) | (away < 2)
    z = np.where(away < 2, 4.0, 0.0)
    filled = fill_gaps(z[..., None], known, ~known, 120).values[..., 0]
    ring = filled[100 + np.rint(50 * np.sin(TURN)).astype(int), 100 + np.rint(50 * np.cos(TURN)).astype(int)]
    assert 0.0 < ring.mean() < 0.5 and np.ptp(ring) < ring.mean(), (ring.mean(), np.ptp(ring))


def patches_in_a_gap() -> tuple[np.ndarray, np.ndarray]:
    """Heights (201, 201) of ground around a gap, and of uneven patches in it; and which are known."""
    rows, cols = np.mgrid[:201, :201]
    known = np.hypot(rows - 100, cols - 100) > 90
    for row, col, size in ((50, 60, 2), (90, 70, 1), (140, 90, 4), (110, 150, 3)):
        known |= np.hypot(rows - row, cols - col) < size
    return 0.03 * rows + np.random.default_rng(0).normal(0, 0.3, known.shape), known


def test_evened_ground_has_no_ripples_around_patches():
    z, known = patches_in_a_gap()
    filled = fill_gaps(z[..., None], known, ~known, 120).values[..., 0]
    smooth = evened(filled, known)
    ring = 140 + np.rint(25 * np.sin(TURN)).astype(int), 90 + np.rint(25 * np.cos(TURN)).astype(int)
    grain = [np.abs(np.diff(np.diff(values, axis=0), axis=1))[ring].mean() for values in (filled, smooth)]
    assert grain[1] < 0.1 * grain[0], grain
    assert (smooth[known] == filled[known]).all() and np.abs(smooth - filled).max() < 0.3


def plainly_diffused(z, fixed):
    """What the kernel of `evened` does, by whole arrays."""
    z = z.copy()
    for _ in range(ROUNDS):
        for along, held in ((z, fixed), (z.T, fixed.T)):
            bend = along[2:] - 2.0 * along[1:-1] + along[:-2]
            along[1:-1] += np.where(~held[1:-1] & np.isfinite(bend), 0.25 * bend, 0.0)
    return z


def test_evened_ground_is_the_twiced_diffusion_of_whole_arrays():
    z, known = patches_in_a_gap()
    z[:7, 180:] = np.nan
    once = plainly_diffused(z, known)
    np.testing.assert_array_equal(evened(z, known), (once + plainly_diffused(z - once, known)).astype(np.float32))


def test_evening_leaves_planes_and_nearly_all_of_a_hill():
    flat = np.where(COL > 62, np.nan, plane()).astype(np.float32)
    np.testing.assert_allclose(evened(flat, ~gap()), flat, atol=1e-4)
    hill = (50.0 - 0.002 * ((ROW - 30) ** 2 + (COL - 35) ** 2)).astype(np.float32)
    assert np.abs(evened(hill, ~gap()) - hill).max() < 0.1 * np.ptp(hill[gap()])


def test_a_window_with_its_reach_is_evened_as_the_whole():
    z, known = patches_in_a_gap()
    filled = fill_gaps(z[..., None], known, ~known, 120).values[..., 0]
    part, inner = np.s_[10 : 40 + 2 * REACH, : 60 + REACH], np.s_[10 + REACH : 40 + REACH, :60]
    own = evened(filled[part], known[part])[REACH : REACH + 30, :60]
    np.testing.assert_array_equal(own, evened(filled, known)[inner])


def test_nothing_beyond_the_reach_counts():
    known = COL < 10
    fill = fill_gaps(plane()[..., None], known, ~known, 5)
    assert np.isfinite(fill.values[30, 14, 0]) and np.isnan(fill.values[30, 15, 0]) and np.isinf(fill.distance[30, 20])
    assert fill.open_side[30, 12] >= HALF and not fill.enclosed[30, 12] and fill.open_side[30, 40] == DIRECTIONS


def samples(distance, bend, off, ring=0) -> GroundSamples:
    count = len(off)
    number = np.arange(count)
    return GroundSamples(
        row=number,
        col=number,
        ring=np.full(count, ring, np.uint8),
        distance=np.full(count, distance, np.float32),
        bend=np.asarray(bend, np.float32),
        off=np.asarray(off, np.float32),
        enclosed=np.ones(count, bool),
    )


def between(bend: float, beside: float = 0.0) -> GapFill:
    """A cell between ground (or beside it), six cells from it."""
    six, none = np.full(1, 6.0, np.float32), np.zeros(1, np.uint8)
    return GapFill(np.zeros((1, 1)), six, none, np.full(1, beside, np.float32), np.full(1, bend, np.float32))


def noise(count: int, sigma: float) -> np.ndarray:
    return np.random.default_rng(3).normal(0, sigma, count)


def test_the_error_grows_with_the_distance_as_hidden_ground_told():
    parts = tuple(samples(2.0**k - 0.1, np.zeros(2000), noise(2000, error)) for k, error in ((1, 0.05), (2, 0.1), (4, 0.4)))
    errors = learned_errors(parts, 2.0, 4)
    known = errors.enclosed.error
    assert known[1:5] == pytest.approx((0.05, 0.1, 0.25, 0.4), rel=0.06)
    assert known[0] == pytest.approx(known[1] / 2) and known[5] == pytest.approx(2 * known[4])
    assert all(o >= e for o, e in zip(errors.one_sided.error, known, strict=True))
    _, sigma = errors.at(fill_gaps(plane()[..., None], ~gap(), gap(), 40))
    assert (np.diff(sigma[30, 35:49:4]) < 0).all(), "less towards the border of the gap"


def test_the_share_of_a_bend_that_hidden_ground_shows_is_added_and_its_error_grows_with_it():
    bend = np.random.default_rng(5).normal(0, 0.5, 4000)
    errors = learned_errors((samples(6.0, bend, 0.6 * bend + noise(4000, 0.1) * (1 + 3 * np.abs(bend))),), 1.0, 4)
    assert errors.enclosed.found[3] == pytest.approx(0.6, abs=0.05)
    flat, bent, torn = (between(b) for b in (0.0, 1.0, 40.0))
    assert errors.at(bent)[0][0] == pytest.approx(0.6, abs=0.06) and errors.at(bent)[1][0] > 2 * errors.at(flat)[1][0]
    assert errors.at(torn)[0][0] < 2.0 < 30 < errors.at(torn)[1][0], "a bend beyond any that was seen is an error, not ground"


def test_ground_between_and_ground_beside_what_is_known_meet_without_a_step():
    """The widest angle without ground jumps from cell to cell where patches lie far away; terraces of half a metre followed it."""
    rows, cols = np.mgrid[:90, :120]
    shore = rows > 60
    patches = shore | ((np.hypot(rows - 20, cols - 40) < 4) & ((rows + cols) % 5 == 0))
    alone, both = (fill_gaps(plane_of(rows)[..., None], known, ~known, 120) for known in (shore, patches))
    assert alone.beside[40, 60] > 0.85 and fill_gaps(plane()[..., None], ~gap(), gap(), 40).beside[30, 35] < 0.05
    assert both.enclosed[~patches].any() and not both.enclosed[~patches].all() and np.ptp(both.beside[30:60]) > 0.5
    far = (np.hypot(rows - 20, cols - 40) > 12) & (rows < 56)
    jump = np.abs(np.diff(both.beside, axis=0))[far[1:] & far[:-1]]
    assert jump.max() < 0.3 and np.quantile(jump, 0.99) < 0.15, (jump.max(), np.quantile(jump, 0.99))
    bend = np.random.default_rng(5).normal(0, 0.5, 4000)
    errors = learned_errors((samples(6.0, bend, 0.6 * bend + noise(4000, 0.1)),), 1.0, 4)
    none, half, whole = (errors.at(between(1.0, share)) for share in (0.0, 0.5, 1.0))
    for one, middle, other in zip(none, half, whole, strict=True):
        assert middle[0] == pytest.approx((one[0] + other[0]) / 2) and one[0] != other[0]


def test_without_hidden_ground_the_error_is_that_of_hilly_land():
    errors = learned_errors((samples(3.0, np.zeros(LEAST_SAMPLES - 1), np.zeros(LEAST_SAMPLES - 1)),), 2.0, 4)
    assert errors.enclosed.error == pytest.approx([0.2 * d for d in errors.distance]) and errors.lifted == (0.0,) * 4


def test_what_samples_tell_does_not_depend_on_the_order_of_tiles():
    parts = tuple(samples(4.0, noise(300, 0.1) + k, noise(300, 0.3), ring=k).take(np.arange(300)) for k in range(3))
    shifted = tuple(GroundSamples(**{**vars(p), "row": p.row + 1000 * k}) for k, p in enumerate(parts))
    assert learned_errors(shifted, 1.0, 2) == learned_errors(shifted[::-1], 1.0, 2)


def test_hidden_ground_is_judged_by_what_was_measured():
    z = (plane() + np.where(gap(), 0.5, 0.0)).astype(np.float32)
    blocks = np.stack([z, z, z], axis=-1)
    rings = np.full(z.shape, 5, np.uint8)
    told = told_by_ground(blocks, rings, 5, ~gap(), (slice(0, 60), slice(0, 70)), (0, 0), 40)
    assert len(told.samples) == gap()[::3, ::3].sum() and told.samples.enclosed.all() and np.isnan(told.expected).all()
    assert told.samples.off == pytest.approx(0.5, abs=0.1)


def test_ground_at_the_foot_of_walls_is_as_much_too_high_as_the_block_tells():
    z, sigma = plane(), np.full(ROW.shape, 0.02)
    wall = gap()
    ring = rings(~wall, 4)
    lift = np.array([0.0, 0.3, 0.2, 0.1, 0.05, 0.0])[ring]
    sigma[(ring > 0) & (ring < 5)] = 0.25
    blocks = np.stack([z + lift, sigma, np.full(z.shape, 0.01)], axis=-1).astype(np.float32)
    core = (slice(0, 60), slice(0, 70))
    told = told_by_ground(blocks, ring, 5, np.ones(z.shape, bool), core, (0, 0), 40)
    many = GroundSamples(**{name: np.tile(values, 30) for name, values in vars(told.samples).items()})
    errors = learned_errors((many, samples(3.0, np.zeros(500), noise(500, 0.05))), 1.0, 4)
    assert errors.lifted == pytest.approx((0.3, 0.2, 0.1, 0.05), abs=0.03)
    found = bridge(blocks, ring, told.expected, errors, core, 40)
    off = found.bare[..., 0] - z
    assert np.abs(off[(ring > 0) & (ring < 5) & np.isfinite(told.expected[..., 0])]).max() < 0.1
    assert np.sqrt((off[wall] ** 2).mean()) < 0.05 and (np.abs(off[wall]) < 3 * found.bare[..., 1][wall]).all()
    assert found.bare[..., 3][ring == 5] == pytest.approx(0.0)


def test_a_hilltop_in_a_gap_is_announced_by_the_slopes_around_it_and_a_pond_is_not():
    away = np.hypot(ROW - 30, COL - 35)
    hill = 60.0 - 0.005 * away**2
    gap_here = away < 12
    fill = fill_gaps(hill[..., None], ~gap_here, gap_here, 40)
    assert hill[30, 35] - fill.values[30, 35, 0] == pytest.approx(0.5 * fill.bend[30, 35], rel=0.5) and fill.bend[30, 35] > 0.5
    pond = np.where(gap_here, 50.0, 50.0 + 0.3 * (away - 12))
    fill = fill_gaps(pond[..., None], ~gap_here, gap_here, 40)
    assert abs(fill.bend[gap_here]).max() < 0.35, "a hollow is full of water"
