"""Several rounds: large errors by coarse orthoimages, narrow ones by a closer look, joint pairs, and what was asked for."""

from dataclasses import replace

import numpy as np
import pytest
from checked_ground import GRID, ground, project
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tiny_block import EAST, NORTH, surface

from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import MapGrid, Window, tiles_of
from orthomill.schemas.surface import CORRECTED, CheckCode, Surface
from orthomill.tasks.dsm_check.comparison_settings import NodeMatching, ShiftSearch
from orthomill.tasks.dsm_check.correction_map import CorrectionMap, CorrectionNodes
from orthomill.tasks.dsm_check.joint_correction import EVERYWHERE, PairGeometry, joint, shared_noise
from orthomill.tasks.dsm_check.rounds.carried import carry
from orthomill.tasks.dsm_check.rounds.coarse_levels import (
    FINER_HALO,
    Far,
    finer_surface,
    finest_surface,
    level_surface,
    median_of_known,
    reduced_heights,
    start_surface,
)
from orthomill.tasks.dsm_check.rounds.round_state import LookAgain, MergeRule, RoundCounts, by_block, look_again, merge, state_table
from orthomill.tasks.dsm_check.rounds.second_look import Look, better_of
from orthomill.tasks.dsm_check.stage import CloserLook, DsmCheckStage
from orthomill.tasks.dsm_check.surfaces.surface_shift import SurfaceTrend, surface_trend
from orthomill.tasks.dsm_check.tile import JointNodes, NodeWindow


def bump(x, y, height=25.0, radius=40.0):
    """A raised cosine at a place that all photographs see."""
    distance = np.minimum(np.hypot(x - EAST + 40, y - NORTH + 15) / radius, 1.0)
    return height * 0.5 * (1 + np.cos(np.pi * distance))


def run(planted, **choices):
    made = project(256, planted, hole=False)
    made.run(DsmCheckStage(pairs_per_place=2, **choices))
    return made


@pytest.mark.slow
def test_an_error_beyond_the_search_is_found_by_coarse_orthoimages_and_removed_by_the_rounds():
    """25 m are 12 pixels here, six times the reach of this search: with it alone nothing good comes out."""
    x, y = ground()
    truth, inside = surface(x, y), bump(x, y) > 5
    left = {}
    for levels, rounds in ((0, 1), (2, 4)):
        made = run(bump, levels=levels, rounds=rounds, matching=NodeMatching(search=ShiftSearch(reach=2)))
        left[levels] = np.abs(made.rasters[CORRECTED] - truth)[inside]
    far = {levels: np.percentile(error, 95) for levels, error in left.items()}
    assert np.median(left[2]) < 0.1 and far[2] < 1.0 < 0.1 * far[0]
    assert made.tables[state_table(1).path].counts.judged > 50_000
    codes = made.rasters["dsm_check/code"]
    assert (codes[inside] == CheckCode.CORRECTED).mean() > 0.98
    assert (codes[bump(x, y) == 0] == CheckCode.CORRECTED).mean() < 0.02


@pytest.mark.slow
def test_rounds_with_closer_windows_recover_a_narrow_error():
    def narrow(x, y):
        return bump(x, y, 3.0, 9.0)

    x, y = ground()
    inside = narrow(x, y) > 1.0
    left = []
    for choices in ({"rounds": 1}, {"rounds": 4, "closer": CloserLook(window=7, search_window=7, step=2)}):
        error = np.abs(run(narrow, levels=0, **choices).rasters[CORRECTED] - surface(x, y))[inside]
        left.append(float(np.median(error)))
    assert left[1] < 0.5 * left[0]


@pytest.mark.slow
def test_later_rounds_judge_the_tiles_around_what_changed_and_no_others():
    made = project(64, lambda x, y: bump(x, y, 3.0, 9.0), hole=False)
    made.run(DsmCheckStage(pairs_per_place=2, levels=0, rounds=3))
    first, second = (made.tables[state_table(number).path] for number in (1, 2))
    tiles = len(list(tiles_of(GRID.shape, 64)))
    assert 1 <= len(first.judged) <= 9 < tiles / 3 and len(first.orthoimages) < tiles
    assert 0 < second.counts.judged < 0.05 * first.counts.judged


@pytest.mark.slow
def test_a_spike_narrower_than_every_window_is_found_by_the_second_surface():
    def spike(x, y):
        return bump(x, y, 15.0, 4.0)

    x, y = ground()
    made, top = run(spike, levels=2, rounds=4), spike(x, y) > 7.5
    assert np.median((made.rasters["dsm_check/dh"] + spike(x, y))[top]) == pytest.approx(0.0, abs=0.5)
    assert np.median(np.abs(made.rasters[CORRECTED] - surface(x, y))[top]) < 0.3
    assert (made.rasters["dsm_check/code"][spike(x, y) == 0] == CheckCode.CORRECTED).mean() < 1e-4


def test_what_nobody_judged_goes_along_with_the_ground_around_it_in_any_tiling():
    random = np.random.default_rng(2)
    given_ = random.normal(50, 5, (40, 60)).astype(np.float32)
    residual = np.zeros((40, 60), np.float32)
    residual[10:20, 10:22] = np.nan
    residual[:, 40:] = np.nan
    heights = np.where(np.isfinite(residual), given_ + np.float32(2.0), given_)
    whole = Window(0, 0, 40, 60)
    carried = carry(whole, whole, 6, heights, given_, residual)
    assert carried[:, :46] == pytest.approx(given_[:, :46] + 2.0, abs=1e-3)
    np.testing.assert_array_equal(carried[:, 46:], given_[:, 46:])
    part = Window(8, 8, 16, 16)
    wide = part.grown(6)
    tile = carry(part, wide, 6, heights[wide.slices], given_[wide.slices], residual[wide.slices])
    np.testing.assert_array_equal(tile, carried[part.slices])


def cells(values, sigma):
    return CorrectionMap(*(np.array([[v]], np.float32) for v in (values, sigma)))


EASTWARD, NORTHWARD = (1.0, 0.0), (0.0, 1.0)


def test_pairs_that_agree_are_more_precise_than_one_but_no_independent_observations():
    one, other = PairGeometry("a", "b", EASTWARD), PairGeometry("c", "d", EASTWARD)
    found, disputed = joint([cells(0.1, 0.1), cells(0.1, 0.1)], (1, 1), shared_noise([one, other]))
    expected = 0.1 * np.sqrt((1 + EVERYWHERE) / 2)
    assert found.dh[0, 0] == pytest.approx(0.1) and found.sigma[0, 0] == pytest.approx(expected) and not disputed.any()


def test_pairs_err_alike_as_far_as_their_bases_run_alike_from_a_common_photograph():
    """Errors of 0.1 px in every photograph, in both directions: shifts along the bases of pairs, a million times."""
    pairs = [
        PairGeometry("a", "b", EASTWARD),
        PairGeometry("a", "c", EASTWARD),
        PairGeometry("a", "d", NORTHWARD),
        PairGeometry("b", "c", EASTWARD),
    ]
    moved = {name: np.random.default_rng(number).normal(0, 0.1, (100_000, 2)) for number, name in enumerate("abcd")}
    shifts = [(moved[pair.right] - moved[pair.left]) @ np.array(pair.direction) for pair in pairs]
    alike = np.corrcoef(shifts)
    np.testing.assert_allclose(shared_noise(pairs), EVERYWHERE + (1 - EVERYWHERE) * alike, atol=0.015)


def test_the_noise_of_pairs_in_a_row_corrects_itself_and_their_bends_do_not():
    row = shared_noise([PairGeometry("a", "b", EASTWARD), PairGeometry("b", "c", EASTWARD)])
    noise, _ = joint([cells(0.1, 0.1), cells(0.1, 0.1)], (1, 1), row)
    assert noise.sigma[0, 0] == pytest.approx(0.1 * np.sqrt((1 + EVERYWHERE - (1 - EVERYWHERE) / 2) / 2))
    bent, _ = joint([cells(0.1, 1e-6), cells(0.1, 1e-6)], (1, 1), row, np.array([0.1, 0.1]))
    assert bent.sigma[0, 0] == pytest.approx(0.1 / np.sqrt(2))


def test_of_three_pairs_the_one_that_contradicts_is_left_out():
    found, disputed = joint([cells(0.0, 0.1), cells(5.0, 0.1), cells(0.02, 0.1)], (1, 1))
    assert found.dh[0, 0] == pytest.approx(0.01, abs=1e-6) and not disputed.any()


def test_two_pairs_that_contradict_each_other_are_disputed_and_their_difference_is_in_the_precision():
    found, disputed = joint([cells(0.0, 0.1), cells(5.0, 0.2)], (1, 1))
    assert disputed.all() and found.dh[0, 0] == 0.0 and found.sigma[0, 0] == pytest.approx(5.0, rel=0.01)


def test_what_one_pair_does_not_see_the_other_says():
    found, _ = joint([cells(np.nan, np.nan), cells(0.3, 0.1)], (1, 1))
    assert found.dh[0, 0] == pytest.approx(0.3) and found.sigma[0, 0] == pytest.approx(0.1)
    assert np.isnan(joint([], (1, 1))[0].dh).all()


@settings(max_examples=20, deadline=None)
@given(arrays(np.float64, 4, elements=st.floats(-3, 3)), arrays(np.float64, 4, elements=st.floats(0.05, 1)))
def test_the_order_of_pairs_does_not_matter(values, sigmas):
    maps = [cells(v, s) for v, s in zip(values, sigmas, strict=True)]
    (one, a), (other, b) = joint(maps, (1, 1)), joint(maps[::-1], (1, 1))
    assert one.dh == pytest.approx(other.dh, abs=1e-4) or a.any() or b.any() or len(set(values)) < 4
    assert one.sigma[0, 0] > 0


def test_levels_keep_the_corner_and_average_known_heights():
    surface_ = Surface(grid=MapGrid(west=10.0, north=50.0, cell=0.5, rows=5, cols=6), height_low=0, height_high=9)
    grid = level_surface(surface_, 1).grid
    assert (grid.west, grid.north, grid.cell, grid.rows, grid.cols) == (10.0, 50.0, 1.0, 3, 3)
    heights = np.arange(30, dtype=np.float32).reshape(5, 6)
    heights[0, :3] = np.nan
    coarse = reduced_heights(heights, 1)
    assert coarse.shape == (3, 3) and coarse[0, 0] == pytest.approx((6 + 7) / 2) and np.isnan(coarse[2]).sum() == 0
    assert coarse[0, 1] == pytest.approx((3 + 8 + 9) / 3)


@settings(max_examples=20, deadline=None)
@given(arrays(np.float32, (6, 7), elements=st.one_of(st.floats(-9, 9, width=32), st.just(np.nan))))
def test_the_median_of_known_heights_is_that_of_numpy(heights):
    padded, found = np.pad(heights, 1, constant_values=np.nan), median_of_known(heights, 3)
    for row, col in np.ndindex(heights.shape):
        window = padded[row : row + 3, col : col + 3]
        known = window[np.isfinite(window)]
        assert found[row, col] == pytest.approx(np.median(known), abs=1e-5) if len(known) >= 3 else np.isnan(found[row, col])


def test_the_second_surface_begins_without_spikes_and_houses():
    heights = np.full((64, 64), 10.0, np.float32)
    heights[20:32, 20:32] += 25.0
    heights[50, 50] -= 90.0
    whole = Window(0, 0, 32, 32)
    assert start_surface(whole, whole, 1, heights) == pytest.approx(10.0)
    part = Window(8, 8, 16, 16)
    given_ = part.grown(4)
    np.testing.assert_array_equal(
        start_surface(part, given_, 1, heights[given_.scaled(2).slices]), np.full((16, 16), 10, np.float32)
    )


def test_the_second_surface_goes_where_the_photographs_say_in_any_tiling():
    random = np.random.default_rng(1)
    heights = np.cumsum(random.normal(0, 0.2, (24, 24)), axis=0).astype(np.float32)
    dh = np.full((24, 24), 20.0, np.float32)
    dh[5, 5] = np.nan
    all_, fine = Window(0, 0, 24, 24), Window(0, 0, 48, 48)
    out = finer_surface(fine, all_, heights, dh)
    assert np.median(out - np.repeat(np.repeat(heights, 2, 0), 2, 1)) == pytest.approx(20.0, abs=0.1)
    part = Window(16, 16, 16, 16)
    given_ = part.reduced(2).grown(3)
    np.testing.assert_array_equal(finer_surface(part, given_, heights[given_.slices], dh[given_.slices]), out[part.slices])
    rule = Far.of(5.0, 10, 2.0)
    assert rule.beyond == 5.0
    under_test = np.repeat(np.repeat(heights, 2, 0), 2, 1)
    sigma = np.full((24, 24), 0.1, np.float32)
    assert finest_surface(fine, all_, rule, heights, dh, sigma, under_test).far.mean() > 0.99
    assert not finest_surface(fine, all_, rule, heights, dh, sigma * 50, under_test).far.any()
    assert not finest_surface(fine, all_, rule, heights, dh * 0.2, sigma, under_test).far.any()


def test_what_no_coarse_window_judged_goes_along_with_the_ground_around_it_in_any_tiling():
    heights = np.random.default_rng(3).normal(0, 0.1, (96, 80)).astype(np.float32)
    dh = np.full(heights.shape, 20.0, np.float32)
    dh[:, :12] = np.nan
    fine, all_ = Window(0, 0, 192, 160), Window(0, 0, 96, 80)
    out = finer_surface(fine, all_, heights, dh)
    assert np.abs(out - 20.0).max() < 1.0
    part = Window(64, 32, 64, 64)
    given_ = part.reduced(2).grown(FINER_HALO).clipped(heights.shape)
    np.testing.assert_array_equal(finer_surface(part, given_, heights[given_.slices], dh[given_.slices]), out[part.slices])


WIDE = Window(0, 0, 16, 16)
NODES = CorrectionNodes(step=4, pixels_per_cell=1, radius=6.0, move=10.0, window=11.0)
PAIR = NodeWindow("a-b", Window(0, 0, 4, 4), Window(0, 0, 4, 4))


def look(heights: float, dh: float, sigma: float, correlation: float, outcome: Outcome = Outcome.CONVERGED) -> Look:
    """A surface of one height, of which one pair says the same everywhere."""
    nodes = np.zeros((4, 4, 6), np.float32)
    nodes[..., 4], nodes[..., 5] = correlation, outcome
    found = CorrectionMap(*(np.full(WIDE.shape, v, np.float32) for v in (dh, sigma)))
    return Look(np.full(WIDE.shape, heights, np.float32), JointNodes(found, np.zeros(WIDE.shape, bool), (nodes,)), (nodes,))


@pytest.mark.parametrize(
    ("first", "second", "answer"),
    [
        ((10.0, 0.0, 0.05, 0.9), (12.0, 0.0, 0.05, 0.9), 0.0),  # as good: benefit of the doubt
        ((10.0, 0.0, 0.05, 0.6), (12.0, 0.1, 0.05, 0.95), 2.1),  # clearly better
        ((10.0, 0.02, 0.05, 0.6), (10.1, 0.0, 0.05, 0.95), 0.02),  # no contradiction
        ((10.0, 0.4, 0.05, 0.9), (12.0, 0.0, 0.05, 0.9), 2.0),  # the first look saw a part of it
        ((10.0, -0.4, 0.05, 0.9), (12.0, 0.0, 0.05, 0.9), -0.4),  # of another error
        ((10.0, np.nan, np.nan, 0.5), (12.0, 0.0, 0.05, 0.6), 2.0),  # the first look failed
        ((10.0, np.nan, np.nan, 0.7), (12.0, 0.0, 0.05, 0.6), np.nan),
        ((10.0, np.nan, np.nan, 0.5, Outcome.OCCLUDED), (12.0, 0.0, 0.05, 0.6), np.nan),  # hidden: no match is clear enough
        ((10.0, np.nan, np.nan, 0.5, Outcome.OCCLUDED), (12.0, 0.0, 0.05, 0.9), 2.0),  # hidden by its own error: a pit
        ((10.0, np.nan, np.nan, 0.5, Outcome.OUTSIDE), (12.0, 0.0, 0.05, 0.9), np.nan),  # nothing was compared
    ],
)
def test_the_photographs_decide_between_two_surfaces(first, second, answer):
    found, disputed, undecided = better_of(look(*first), look(*second), WIDE, (PAIR,), NODES, 5.0)
    assert undecided.all() == (first[1] == answer != 0.02), "what is contradicted and stays is to be looked at again"
    assert found.dh == pytest.approx(np.full(WIDE.shape, answer), abs=1e-5, nan_ok=True) and not disputed.any()


def test_a_step_of_the_surface_under_test_is_not_known_better_than_to_a_quarter_of_a_cell():
    first = look(10.0, np.nan, np.nan, 0.5)
    first.heights[:, 8:] += 4.0
    found = better_of(first, look(12.0, 0.0, 0.05, 0.9), WIDE, (PAIR,), NODES, 5.0).found
    assert found.sigma[8, 7] == pytest.approx(1.0, abs=0.01) == found.sigma[8, 8] and found.sigma[8, 2] == pytest.approx(0.05)


def test_single_cells_are_no_reason_to_believe_the_second_surface():
    first, second = look(10.0, 0.0, 0.05, 0.5), look(12.0, np.nan, np.nan, 0.95)
    second.says.found.dh[3, 3:9], second.says.found.sigma[3, 3:9] = 0.0, 0.05
    assert (better_of(first, second, WIDE, (PAIR,), NODES, 5.0).found.dh == 0).all()


@pytest.mark.parametrize(
    ("matched", "shown", "answer"), [(2, 2, 2.0), (2, 4, 2.0), (1, 1, 2.0), (1, 3, np.nan), (0, 1, np.nan), (0, 3, np.nan)]
)
def test_a_place_that_too_few_pairs_matched_is_not_taken_from_the_nodes_beyond_it(matched, shown, answer):
    """Four pairs; `shown` of them show the place, and `matched` of these find it."""
    outcomes = [Outcome.CONVERGED] * matched + [Outcome.MOVED_TOO_FAR] * (shown - matched) + [Outcome.OUTSIDE] * (4 - shown)
    first = look(10.0, np.nan, np.nan, 0.5)
    second = look(12.0, 0.0, 0.05, 0.9)
    nodes = tuple(look(12.0, 0.0, 0.05, 0.9, outcome).nodes[0] for outcome in outcomes)
    looks = first._replace(nodes=first.nodes * 4), Look(second.heights, replace(second.says, clean=nodes), nodes)
    found = better_of(*looks, WIDE, (PAIR,) * 4, NODES, 5.0).found
    assert found.dh == pytest.approx(np.full(WIDE.shape, answer), abs=1e-5, nan_ok=True)


RULE = MergeRule("significant", 5.0, 8, number=2, least=0.1, precise=1.0)


def merged(dh: float, sigma: float):
    """A tile of 32 x 32 cells after a closer look at all of it, where the first look still asked for 0.1 +- 0.05 m."""
    tile = Window(0, 0, 32, 32)
    height, residual, precision, found, error = (np.full(tile.shape, v, np.float32) for v in (10.0, 0.1, 0.05, dh, sigma))
    return merge(tile, (tile,), RULE, height, residual, precision, np.zeros(tile.shape, np.uint8), (found,), (error,))


@pytest.mark.parametrize(
    ("dh", "sigma", "left", "precision", "height"),
    [
        (0.3, 0.1, 0.1, 0.05, 10.0),  # it agrees and is less precise: the first look counts
        (0.08, 0.03, 0.08, 0.03, 10.0),  # it agrees and is more precise
        (0.4, 0.1, 0.4, 0.1, 10.0),  # it contradicts the first look, whose windows were wider than the error
        (1.0, 0.1, 0.0, 0.1, 11.0),  # it finds an error
    ],
)
def test_which_look_counts(dh, sigma, left, precision, height):
    found = merged(dh, sigma)
    for values, expected in ((found.residual, left), (found.precision, precision), (found.height, height)):
        assert np.allclose(values, expected, atol=1e-6)


def test_what_is_asked_for_all_over_a_surface_is_no_error_of_its_cells():
    grid = GRID
    blocks = np.zeros((grid.rows // 8, grid.cols // 8, 3), np.float32)
    row, col = np.indices(blocks.shape[:2])
    blocks[..., 0], blocks[..., 2] = 1.0, 0.05
    blocks[..., 1] = 0.04 + 0.001 * (col - col.mean()) - 0.0005 * (row - row.mean())
    trend = surface_trend(blocks, grid, 8, pixel_height=1.0)
    assert trend.middle == pytest.approx(0.04, abs=1e-4) and trend.by_col == pytest.approx(0.001 / 8, rel=1e-3)
    assert trend.by_row == pytest.approx(-0.0005 / 8, rel=1e-3)
    whole = Window(0, 0, grid.rows, grid.cols)
    part = Window(24, 40, 16, 8)
    np.testing.assert_array_equal(trend.at(whole)[part.slices], trend.at(part))
    assert trend.at(whole).mean() == pytest.approx(0.04, abs=1e-3)


def test_more_than_a_slight_tilt_is_an_error_of_the_surface():
    grid = GRID
    blocks = np.zeros((grid.rows // 8, grid.cols // 8, 3), np.float32)
    blocks[..., 0], blocks[..., 2] = 1.0, 0.05
    blocks[..., 1] = 0.3 + np.linspace(-1, 1, blocks.shape[1])
    found = surface_trend(blocks, grid, 8, 1.0)
    assert found == SurfaceTrend(middle=found.middle, centre=found.centre) and found.middle == pytest.approx(0.3, abs=1e-3)


def test_the_next_round_looks_where_something_changed_and_around_it():
    asks = np.zeros((16, 16), np.uint16)
    asks[8, 8] = 60
    where = LookAgain(8, 64, (128, 128), around=8, nodes=16, seen=24)
    found = look_again(asks, (RoundCounts(judged=5, changed=2, total=1.0, squares=0.5), RoundCounts(judged=3)), where)
    assert found.active.sum() == 9 and found.active[7:10, 7:10].all()
    assert found.state.counts.judged == 8 and found.state.counts.changed == 2
    assert set(found.state.judged) == {(0, 0), (0, 1), (1, 0), (1, 1)} == set(found.state.nodes)
    nothing = look_again(asks * 0, (), where)
    assert not nothing.active.any() and not nothing.state.judged
    asks[:] = 0
    asks[1, 1] = 3  # single cells are no reason to look again
    assert not look_again(asks, (), where).state.judged


def test_cells_are_counted_by_block():
    changed = np.zeros((10, 12), bool)
    changed[0, :9] = True
    np.testing.assert_array_equal(by_block(changed, 8), [[8, 1], [0, 0]])


def test_a_whole_surface_of_changes_is_looked_at_everywhere_by_norvelle():
    asks = np.zeros((4, 4), np.uint16)
    asks[0, 0] = 64
    where = LookAgain(8, 32, GRID.shape, 0, 0, 0, everywhere=True)
    assert look_again(asks, (), where).active.all()
