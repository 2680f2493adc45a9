"""Several rounds: large errors by coarse orthoimages, narrow ones by a closer look, joint pairs, and what was asked for."""

import numpy as np
import pytest
from checked_ground import GRID, ground, project
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tiny_block import EAST, NORTH, surface

from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import CORRECTED, CheckCode, Surface
from orthomill.tasks.dsm_check.correction_map import CorrectionMap
from orthomill.tasks.dsm_check.joint_correction import joint
from orthomill.tasks.dsm_check.nodes import NodeMatching
from orthomill.tasks.dsm_check.rounds.coarse_levels import Proposal, level_surface, move_surface, reduced_heights
from orthomill.tasks.dsm_check.rounds.round_state import LookAgain, RoundCounts, by_block, look_again, state_table
from orthomill.tasks.dsm_check.search import ShiftSearch
from orthomill.tasks.dsm_check.stage import CloserLook, DsmCheckStage


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
    assert np.median(left[2]) < 0.5 and far[2] < 0.5 * far[0]
    assert made.tables[state_table(1).path].counts.judged > 50_000
    codes = made.rasters["dsm_check/code"]
    assert (codes[inside] == CheckCode.CORRECTED).mean() > 0.8
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


def cells(values, sigma):
    return CorrectionMap(*(np.array([[v]], np.float32) for v in (values, sigma)))


def test_pairs_that_agree_are_more_precise_than_one_but_no_independent_observations():
    found, disputed = joint([cells(0.1, 0.1), cells(0.1, 0.1)], (1, 1))
    assert found.dh[0, 0] == pytest.approx(0.1) and found.sigma[0, 0] == pytest.approx(0.1 * np.sqrt(0.75)) and not disputed.any()


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


def test_coarse_corrections_move_the_surface_only_beyond_the_finer_reach():
    heights, rule = np.zeros((8, 8), np.float32), Proposal.of(1, 5.0, 10, 2.0)
    assert rule.beyond == 5.0
    given_ = Window(0, 0, 4, 4)
    dh, sigma = np.zeros((4, 4), np.float32), np.full((4, 4), 0.1, np.float32)
    dh[1:3, 1:3] = 4.9
    assert (move_surface(Window(0, 0, 8, 8), given_, rule, heights, dh, sigma) == 0).all()
    dh[1:3, 1:3] = 20.0
    out = move_surface(Window(0, 0, 8, 8), given_, rule, heights, dh, sigma)
    assert out[3:5, 3:5] == pytest.approx(20.0) and (out[0] == 0).all()
    halves = [move_surface(Window(r, 0, 4, 8), given_, rule, heights[:4], dh, sigma) for r in (0, 4)]
    np.testing.assert_array_equal(np.concatenate(halves), out)
    assert (move_surface(Window(0, 0, 8, 8), given_, rule, heights, dh, sigma * 100) == 0).all()


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
