"""What standard errors of matching are worth: pairs without a common photograph, on ground whose errors are drawn."""

import numpy as np
import pytest

from orthomill.schemas.surface import Provenance
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.precision.matched_ground import MatchedGround, matched_ground
from orthomill.tasks.densification.precision.pair_differences import (
    CLASSES,
    NO_DIFFERENCES,
    factor_of,
    factors,
    pair_differences,
    sum_differences,
)

SHAPE = (300, 300)
SIGMA = 0.1
STEP = 1.0
PHOTOGRAPHS = [frozenset("ab"), frozenset("bc"), frozenset("cd")]


def ground(roughness: float = 0.014, rise: float = 0.0, shape: tuple[int, int] = SHAPE) -> MatchedGround:
    single = np.full(shape, SIGMA)
    return MatchedGround(single, roughness * single, np.full(shape, rise), np.zeros(shape), STEP, 1.0)


def counted(worth: float, around: MatchedGround, photographs=PHOTOGRAPHS, judged=None):
    """The counts of three pairs whose errors are `worth` of what they state."""
    draw = np.random.default_rng(4)
    heights = 10.0 + draw.normal(0, worth * SIGMA, (3, *around.single.shape))
    sigmas = np.full(heights.shape, SIGMA, np.float32)
    judged = np.ones(around.single.shape, bool) if judged is None else judged
    return pair_differences(heights, sigmas, photographs, around, judged)


@pytest.mark.parametrize("worth", [0.3, 0.8])
@pytest.mark.parametrize(("roughness", "kind"), [(0.001, 0), (0.03, 2), (5.0, 4)])
@pytest.mark.parametrize("rise", [0.0, 3.0])
def test_the_factor_of_a_class_is_what_the_errors_drawn_are_of_the_stated_ones(worth, roughness, kind, rise):
    around = ground(roughness, rise)
    found = counted(worth, around)
    assert found.cells == around.single.size
    table, before = factors(found), factors(NO_DIFFERENCES)
    mine = int(rise > 0), kind
    assert table[mine] == pytest.approx(worth, rel=0.03)
    table[mine] = before[mine]
    assert np.array_equal(table, before), "nothing was learned of the others"


def test_pairs_with_a_common_photograph_tell_nothing():
    assert counted(0.5, ground(), [frozenset("ab"), frozenset("bc"), frozenset("ca")]).cells == 0


def test_only_cells_that_are_judged_count():
    judged = np.zeros(SHAPE, bool)
    judged[:3, :5] = True
    assert counted(0.5, ground(), judged=judged).cells == 15


def test_the_two_most_precise_pairs_count():
    heights = np.stack([np.full((2, 2), z) for z in (10.0, 10.1, 13.0)])
    sigmas = np.stack([np.full((2, 2), s, np.float32) for s in (0.1, 0.1, 0.2)])
    photographs = [frozenset("ab"), frozenset("cd"), frozenset("ef")]
    found = pair_differences(heights, sigmas, photographs, ground(shape=(2, 2)), np.ones((2, 2), bool))
    # 0.1 m over 0.141 m: 0.707 of the standard error of the difference, in classes of 0.04.
    assert np.nonzero(np.array(found.counts).sum(axis=0))[0].tolist() == [17]


def test_a_few_cells_change_little():
    few, many = (np.zeros(SHAPE, bool) for _ in range(2))
    few[:5, :20], many[:] = True, True
    usual = factors(NO_DIFFERENCES)[0, 1]
    one, all_ = (factors(counted(1.0, ground(), judged=judged))[0, 1] for judged in (few, many))
    assert usual < one < usual + 0.15 * (1.0 - usual) and all_ == pytest.approx(1.0, abs=0.03)


def test_squares_add_up():
    around = ground()
    left = np.indices(SHAPE)[1] < 100
    parts = tuple(counted(0.6, around, judged=judged) for judged in (left, ~left))
    assert sum_differences(parts) == sum_differences((parts[1], NO_DIFFERENCES, parts[0])) == counted(0.6, around)
    assert sum_differences(()) == NO_DIFFERENCES


def test_between_the_classes_the_factor_is_interpolated():
    rough = np.geomspace(1e-4, 10, 400)[None]
    one = np.ones_like(rough)
    found = factor_of(MatchedGround(one, rough, 0 * one, 0 * one, STEP, 1.0), NO_DIFFERENCES)[0]
    assert found[[0, -1]].tolist() == factors(NO_DIFFERENCES)[0, [0, CLASSES - 1]].tolist()
    assert np.abs(np.diff(found)).max() < 0.01


def test_what_rises_beside_a_cell_is_a_wall_and_a_slope_is_none():
    row, col = np.indices((40, 60))
    slope = (0.3 * col - 0.2 * row).astype(np.float32)
    walled = np.where(col < 30, slope, slope + 8).astype(np.float32)
    flat, beside = (matched_ground(cells(height), STEP, 1.0) for height in (slope, walled))
    assert not flat.walled[11:-11, 11:-11].any() and flat.uneven[11:-11, 11:-11].max() < 1e-5
    middle = 20
    assert beside.rise[middle, 29] > 5 and beside.fall[middle, 29] == 0 and beside.rise[middle, 25] > 2
    assert beside.fall[middle, 30] > 5 and beside.rise[middle, 30] == 0
    assert beside.walled[middle, 25:35].all() and not beside.walled[middle, [20, 40]].any()


def test_the_standard_error_of_one_pair_follows_from_that_of_several():
    level = matched_ground(cells(np.full((20, 20), 10.0, np.float32), count=4), STEP, 1.0)
    assert level.single == pytest.approx(2 * SIGMA) and (level.roughness == 0).all()


def cells(height: np.ndarray, count: int = 1) -> FusedCells:
    sigma, counts = np.full(height.shape, SIGMA, np.float32), np.full(height.shape, count, np.uint8)
    return FusedCells(height, sigma, counts, np.full(height.shape, Provenance.AGREED, np.uint8))
