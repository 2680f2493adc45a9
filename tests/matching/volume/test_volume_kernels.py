"""Kernels of the volume against plain NumPy: signatures, paths, costs, winners, coherence."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from orthomill.tasks.matching.volume.candidates import CellRanges, Ranges, all_planes, narrowed, packed
from orthomill.tasks.matching.volume.costs import (
    ALIKE,
    COST_UNIT,
    MOST_STRETCHED,
    Choice,
    Comparison,
    PhotographStack,
    photographs_at,
    stretches,
    volume_costs,
)
from orthomill.tasks.matching.volume.paths import UNIT, sweep
from orthomill.tasks.matching.volume.rectified_photograph import RectifiedPhotograph
from orthomill.tasks.matching.volume.signatures import BITS, bits_set, no_signature, signatures
from orthomill.tasks.matching.volume.winners import FARTHEST_RIVAL, coherence, rival_weights, winners

RULES = Ranges(margin=2, reach=1, most=64, mean=48)


@njit
def population(values, out):
    for i in range(values.size):
        out[i] = bits_set(values[i])


@settings(max_examples=20, deadline=None)
@given(st.lists(st.integers(0, 2**64 - 1), min_size=1, max_size=20))
def test_bits_are_counted(numbers):
    for kind in (np.uint64, np.uint32):
        values = np.array([n & int(np.iinfo(kind).max) for n in numbers], kind)
        out = np.zeros(values.size, np.int64)
        population(values, out)
        assert out.tolist() == [int(v).bit_count() for v in values]


def plain_signatures(grey: np.ndarray, half: int, stride: int) -> np.ndarray:
    rows, cols = grey.shape
    out = np.zeros(grey.shape, object)
    for r in range(rows):
        for c in range(cols):
            code = 0
            for dy in range(-half, half + 1):
                for dx in range(-half, half + 1):
                    y, x = r + dy * stride, c + dx * stride
                    if dx or dy:
                        code = code * 2 + int(0 <= y < rows and 0 <= x < cols and grey[y, x] < grey[r, c])
            out[r, c] = int(no_signature(half)) if np.isnan(grey[r, c]) else code
    return out


@pytest.mark.parametrize(("half", "stride"), [(2, 1), (2, 2), (3, 1), (3, 3)])
def test_signatures_compare_every_neighbour_with_the_centre(half, stride):
    random = np.random.default_rng(half + stride)
    grey = random.integers(0, 6, (17, 23)).astype(np.float32)
    grey[3:5, 7:9] = np.nan
    found = signatures(grey, half, stride)
    assert np.array_equal(found.astype(object), plain_signatures(grey, half, stride))
    assert found.max() == no_signature(half) and BITS[half] < 8 * found.itemsize


def test_signatures_ignore_gain_and_offset():
    grey = np.random.default_rng(1).normal(100, 20, (20, 20)).astype(np.float32)
    assert np.array_equal(signatures(grey, 2, 1), signatures(grey * np.float32(2) + np.float32(64), 2, 1))


def plain_paths(cost: dict, shape: tuple[int, int], small: int, large: int) -> dict:
    """Sums of the eight paths, cell by cell: cost[(r, c)] maps candidates to costs."""
    total = {cell: dict.fromkeys(values, 0) for cell, values in cost.items()}
    for dr, dc in ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1)):
        before: dict = {}
        order = sorted(cost, key=lambda cell, d=(dr, dc): (cell[0] * d[0], cell[1] * d[1]))
        for r, c in order:
            previous = before.get((r - dr, c - dc), {})
            least = min(previous.values(), default=0)
            now = {}
            for k, own in cost[r, c].items():
                ways = [least + large]
                ways += [previous[k + d] + (small if d else 0) for d in (-1, 0, 1) if k + d in previous]
                now[k] = own + min(ways) - least
                total[r, c][k] += now[k]
            before[r, c] = now
    return total


def test_paths_over_ranges_that_differ_from_cell_to_cell():
    random = np.random.default_rng(5)
    low = random.integers(0, 4, (6, 7)).astype(np.int32)
    count = random.integers(1, 6, (6, 7))
    candidates = packed(low, count)
    cost = random.integers(0, 200, candidates.offset[-1]).astype(np.uint8)
    total = np.zeros(cost.shape, np.int16)
    for backwards in (False, True):
        sweep(
            cost, total, candidates.low, candidates.offset, 16, np.int16(20), np.full(candidates.low.shape, 90, np.int16), backwards
        )
    cells = {}
    for r in range(6):
        for c in range(7):
            begin = candidates.offset[r * 7 + c]
            cells[r, c] = {int(low[r, c]) + k: int(cost[begin + k]) for k in range(count[r, c])}
    expected = plain_paths(cells, (6, 7), 20, 90)
    assert total.tolist() == [value for cell in sorted(expected) for _, value in sorted(expected[cell].items())]


def small_stack(seed: int, half: int = 2) -> tuple[PhotographStack, list[RectifiedPhotograph]]:
    """Three photographs of random signatures, 8 x 9 px and shifted against each other by the plane; the third ends early."""
    random = np.random.default_rng(seed)
    photographs = []
    for shift, cols in ((0.0, 40), (1.0, 40), (-0.6, 6)):
        codes = random.integers(0, 2**24, (8, cols)).astype(np.uint32)
        planes = np.array([[1.0, shift * k, 0.0] for k in range(UNIT)])
        photographs.append(RectifiedPhotograph(codes, planes))
    return PhotographStack.of(iter(photographs), sum(photo.signatures.size for photo in photographs), half), photographs


def everywhere(hidden: np.ndarray) -> Choice:
    """All photographs in their order, but for the hidden ones."""
    count, rows, cols = hidden.shape
    return Choice(4, np.broadcast_to(np.arange(count), (-(-rows // 4), -(-cols // 4), count)), hidden)


def plain_cost(photographs, cell: tuple[int, int], k: int, rules: Comparison, left_out: set[int]) -> float:
    codes = []
    for number, photo in enumerate(photographs):
        scale, col, row = photo.planes[k]
        x, y = int(np.floor(scale * cell[1] + col + 0.5)), int(np.floor(scale * cell[0] + row + 0.5))
        if number not in left_out and 0 <= y < photo.signatures.shape[0] and 0 <= x < photo.signatures.shape[1]:
            codes.append(int(photo.signatures[y, x]))
    distances = sorted((codes[a] ^ codes[b]).bit_count() for a in range(len(codes)) for b in range(a))
    if not distances:
        return rules.blank * 24 * COST_UNIT
    return COST_UNIT * np.mean(distances[: int(np.ceil(rules.share * len(distances)))])


@pytest.mark.parametrize("share", [0.3, 0.5, 1.0])
def test_costs_are_the_mean_of_the_best_share_of_the_pairs(share):
    stack, photographs = small_stack(3)
    rules = Comparison(most=3, share=share, blank=0.6)
    candidates = all_planes(np.ones((8, 9), bool), UNIT)
    hidden = np.zeros((3, 8, 9), bool)
    cost = volume_costs(stack, everywhere(hidden), candidates, 2, rules).reshape(8, 9, UNIT)
    for r in range(8):
        for c in range(9):
            for k in range(UNIT):
                assert abs(cost[r, c, k] - plain_cost(photographs, (r, c), k, rules, set())) <= 0.51


def test_hidden_photographs_are_left_out_unless_fewer_than_two_are_left():
    stack, photographs = small_stack(4)
    rules = Comparison(most=3, share=1.0, blank=0.6)
    hidden = np.zeros((3, 2, 2), bool)
    hidden[0, 0, 0] = hidden[0, 1, 1] = hidden[1, 1, 1] = True
    candidates = all_planes(np.ones((2, 2), bool), UNIT)
    cost = volume_costs(stack, everywhere(hidden), candidates, 2, rules).reshape(2, 2, UNIT)
    assert abs(cost[0, 0, 1] - plain_cost(photographs, (0, 0), 1, rules, {0})) <= 0.51
    assert abs(cost[1, 1, 1] - plain_cost(photographs, (1, 1), 1, rules, set())) <= 0.51


def test_no_more_photographs_are_compared_than_asked_for():
    stack, photographs = small_stack(6)
    candidates = all_planes(np.ones((8, 9), bool), UNIT)
    hidden = np.zeros((3, 8, 9), bool)
    cost = volume_costs(stack, everywhere(hidden), candidates, 2, Comparison(2, 1.0, 0.6)).reshape(8, 9, UNIT)
    assert abs(cost[2, 3, 1] - plain_cost(photographs, (2, 3), 1, Comparison(2, 1.0, 0.6), {2})) <= 0.51


def test_heights_are_stretched_where_the_compared_photographs_stand_close_together():
    """The photographs move by 0, 1 and -0.6 px from plane to plane; the third ends at column 6."""
    stack, _ = small_stack(5)
    hidden = np.zeros((3, 8, 9), bool)
    hidden[2, 0, 0] = True
    candidates = all_planes(np.ones((8, 9), bool), UNIT)
    stretched = stretches(stack, everywhere(hidden), candidates, 3, 6.0)
    assert stretched[4, 2] == pytest.approx(6.0 / 1.6 / ALIKE) and stretched[0, 0] == pytest.approx(6.0 / ALIKE)
    assert stretches(stack, everywhere(hidden), candidates, 2, 6.0)[4, 2] == pytest.approx(6.0 / ALIKE), (
        "only the first two are compared"
    )
    assert stretches(stack, everywhere(hidden), candidates, 3, 1.6 * ALIKE).max() == 1.6
    assert (stretches(stack, everywhere(hidden), candidates, 3, 1e3) == MOST_STRETCHED).all()
    none = all_planes(np.zeros((8, 9), bool), UNIT)
    assert (stretches(stack, everywhere(hidden), none, 3, 6.0) == 1).all()


def test_coarse_pixels_stretch_heights_as_well():
    stack, photographs = small_stack(5)
    coarse = [replace(photo, pixel=pixel) for photo, pixel in zip(photographs, (0.5, 2.0, 1.0), strict=True)]
    stack = PhotographStack.of(coarse, sum(photo.signatures.size for photo in coarse), 2)
    candidates = all_planes(np.ones((8, 9), bool), UNIT)
    # The second with the others: 1.0 / 2 and 1.6 / 2; the first and the third: 0.6, in cells that are larger than their pixels.
    assert stretches(stack, everywhere(np.zeros((3, 8, 9), bool)), candidates, 3, 6.0)[4, 2] == pytest.approx(6.0 / 0.8 / ALIKE)


def test_every_place_has_its_own_order_of_photographs():
    stack, photographs = small_stack(6)
    candidates = all_planes(np.ones((8, 8), bool), UNIT)
    order = np.array([[[0, 1], [0, 1]], [[1, 2], [2, -1]]])
    rules = Comparison(2, 1.0, 0.6)
    cost = volume_costs(stack, Choice(4, order, np.zeros((3, 8, 8), bool)), candidates, 2, rules).reshape(8, 8, UNIT)
    assert abs(cost[2, 5, 1] - plain_cost(photographs, (2, 5), 1, rules, {2})) <= 0.51
    assert abs(cost[5, 2, 1] - plain_cost(photographs, (5, 2), 1, rules, {0})) <= 0.51
    # One photograph alone cannot be compared with anything: every height is as good as the others.
    assert not cost[5, 5].any()


def test_photographs_are_counted_where_they_show_the_winner():
    stack, _ = small_stack(7)
    nearest = np.array([[0, 0, -1], [3, 15, 15]], np.int32)
    hidden = np.zeros((3, 2, 3), bool)
    hidden[1, 0, 0] = True
    assert photographs_at(stack, hidden, nearest).tolist() == [[2, 3, 0], [2, 2, 2]]


def test_a_plane_that_a_photograph_cannot_show_is_nowhere_in_it():
    stack, photographs = small_stack(8)
    photographs[0].planes[2] = np.nan
    stack = PhotographStack.of(photographs, sum(photo.signatures.size for photo in photographs), 2)
    assert photographs_at(stack, np.zeros((3, 1, 1), bool), np.full((1, 1), 2, np.int32)).tolist() == [[1]]


def test_winners_lie_at_the_bottom_of_the_parabola():
    sums = np.array([[(k - place) ** 2 for k in range(8)] for place in (3.25, 4.75, 0.0)]) * 100
    candidates = packed(np.array([[5, 6, 7, 8]]), np.array([[8, 8, 8, 0]]))
    two, costs = np.full((1, 4), 2, np.uint8), np.arange(24, dtype=np.uint8)
    packed_sums, ones = sums.ravel().astype(np.int16), np.ones((1, 4), np.float32)
    plane, nearest, cost, margin, _ = winners(
        packed_sums, costs, candidates.low, candidates.offset, two, ones, rival_weights(100.0, 8)
    )
    assert plane[0, :2] == pytest.approx([8.25, 10.75]) and plane[0, 2] == 7.0 and np.isnan(plane[0, 3])
    assert nearest.tolist() == [[8, 11, 7, -1]] and cost.tolist() == [[3, 13, 16, 0]]
    # The best that is farther than two planes away: three planes from the winner.
    assert margin[0, 0] == int(100 * 2.75**2) - int(100 * 0.25**2) and np.isinf(margin[0, 3])


def test_a_winner_without_a_rival_has_an_infinite_margin():
    candidates = packed(np.zeros((1, 1), int), np.array([[3]]))
    two, one = np.full((1, 1), 2, np.uint8), np.ones((1, 1), np.float32)
    sums, costs = np.array([4, 2, 4], np.int16), np.zeros(3, np.uint8)
    found = winners(sums, costs, candidates.low, candidates.offset, two, one, rival_weights(10.0, 8))
    assert np.isinf(found.margin[0, 0]) and found.plane[0, 0] == 1.0 and found.spread[0, 0] == 0


def winner_of(sums: list[int], photographs: int = 2, tolerance: float = 10.0, stretch: float = 1.0) -> tuple[float, float]:
    """Its margin and spread."""
    candidates, costs = packed(np.zeros((1, 1), int), np.array([[len(sums)]])), np.zeros(len(sums), np.uint8)
    seen, as_one = np.full((1, 1), photographs, np.uint8), np.full((1, 1), stretch, np.float32)
    found = winners(np.array(sums, np.int16), costs, candidates.low, candidates.offset, seen, as_one, rival_weights(tolerance, 8))
    return float(found.margin[0, 0]), float(found.spread[0, 0])


def spread_of(sums: list[int], photographs: int = 2, tolerance: float = 10.0) -> float:
    return winner_of(sums, photographs, tolerance)[1]


def test_where_planes_count_as_one_rivals_are_as_many_times_farther_away():
    """The same path sums, sampled three times as finely, give the same margin and spread."""
    sums = [40, 25, 0, 30, 55, 12, 70, 9, 50]
    finely = [value for value in sums for _ in range(3)]
    finely[7] = -1  # the middle of the lowest three
    assert winner_of([*sums[:2], -1, *sums[3:]])[0] == winner_of(finely, stretch=3.0)[0] == 10
    assert winner_of(finely, stretch=3.0)[1] == pytest.approx(winner_of(sums)[1], rel=0.05)
    assert winner_of(finely)[1] > 2.5 * winner_of(finely, stretch=3.0)[1]


def test_the_spread_is_the_distance_of_the_rivals_by_their_weight():
    assert spread_of([0, 90, 90, 90, 10, 90, 0]) == pytest.approx(np.sqrt((16 * np.exp(-1) + 36) / (2 + np.exp(-1))), rel=1e-3)


def test_neighbouring_and_much_dearer_heights_are_no_rivals():
    assert spread_of([0, 1, 2, 200, 300]) == 0


def test_rivals_beyond_the_ordinary_range_do_not_count():
    assert spread_of([0] + [90] * (FARTHEST_RIVAL - 1) + [0, 0, 0]) == pytest.approx(FARTHEST_RIVAL / np.sqrt(2), rel=1e-3)


def test_more_photographs_tell_rivals_apart_better():
    sums = [0, 90, 90, 90, 15, 90]
    assert spread_of(sums, 5) == pytest.approx(np.sqrt(16 * np.exp(-3) / (1 + np.exp(-3))), rel=1e-3)
    assert spread_of(sums, 5) < spread_of(sums, 2) < spread_of(sums, 2, tolerance=20)


def plain_coherence(heights: np.ndarray, tolerance: np.ndarray, slope: float) -> np.ndarray:
    rows, cols = heights.shape
    out = np.zeros(heights.shape)
    for r in range(rows):
        for c in range(cols):
            near = [(y, x) for y in range(r - 4, r + 5) for x in range(c - 4, c + 5) if (y, x) != (r, c)]
            near = [(y, x) for y, x in near if 0 <= y < rows and 0 <= x < cols]
            along = [abs(heights[y, x] - heights[r, c]) <= tolerance[r, c] + slope * np.hypot(y - r, x - c) for y, x in near]
            out[r, c] = np.mean(along)
    return out


def test_coherence_is_the_share_of_neighbours_that_go_along():
    heights = np.random.default_rng(2).normal(0, 1, (12, 14)).astype(np.float32)
    heights[4, 4] = np.nan
    tolerance = np.linspace(0.2, 1.5, heights.size, dtype=np.float32).reshape(heights.shape)
    assert coherence(heights, tolerance, 0.1) == pytest.approx(plain_coherence(heights, tolerance, 0.1))
    assert coherence(heights, tolerance, 0.1)[4, 4] == 0


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 1000), margin=st.integers(1, 6), reach=st.integers(1, 3))
def test_ranges_span_the_coarser_heights_around_a_cell(seed, margin, reach):
    random = np.random.default_rng(seed)
    coarser = random.uniform(20, 40, (6, 7))
    rules = Ranges(margin, reach, most=64, mean=64)
    found = narrowed(coarser, (np.arange(12) // 2, np.arange(14) // 2), 96, rules)
    assert (found.count % UNIT == 0).all()
    for r in range(12):
        for c in range(14):
            y, x = r // 2, c // 2
            near = coarser[max(y - reach, 0) : y + reach + 1, max(x - reach, 0) : x + reach + 1]
            assert found.low[r, c] <= max(np.floor(near.min()) - margin, 0)
            assert found.low[r, c] + found.count[r, c] > min(np.ceil(near.max()) + margin, 95)


def test_a_cell_takes_the_heights_of_its_neighbours_when_it_has_none():
    coarser = np.full((7, 7), np.nan)
    coarser[3, 3] = 30.0
    count = narrowed(coarser, (np.arange(7), np.arange(7)), 96, RULES).count
    assert (count[2:5, 2:5] == UNIT).all() and count.sum() == 9 * UNIT


def test_a_cut_range_lies_about_the_cells_own_height():
    coarser = np.array([[10.0, 80.0, 80.0]])
    found = narrowed(coarser, (np.arange(1), np.arange(3)), 96, Ranges(2, 1, 32, 32))
    assert found.count.tolist() == [[32, 32, 16]]
    assert found.low[0, 0] + 16 < 40 and found.low[0, 1] + 16 > 60


def test_the_budget_of_a_tile_holds_whatever_the_relief():
    coarser = np.random.default_rng(0).uniform(0, 500, (40, 40))
    cells = np.arange(40), np.arange(40)
    assert narrowed(coarser, cells, 512, Ranges(4, 1, 512, 48)).count.mean() <= 48
    assert narrowed(coarser, cells, 512, Ranges(4, 1, 32, 512)).count.max() == 32


def test_ranges_stay_within_the_planes():
    coarser = np.array([[-5.0, 0.0, 31.0, 36.0]])
    found = narrowed(coarser, (np.arange(1), np.arange(4)), 32, RULES)
    assert (found.low >= 0).all() and (found.low + found.count <= 32).all()


def test_trimmed_candidates_count_from_the_first_plane_in_use():
    found, planes = packed(np.array([[7, 9], [0, 20]]), np.array([[16, 16], [0, 16]])).trimmed()
    assert planes == slice(7, 36)
    assert found.low.tolist() == [[0, 2], [0, 13]] and found.count.tolist() == [[16, 16], [0, 16]]


def test_candidates_know_their_counts():
    assert CellRanges(np.zeros((1, 2), np.int32), np.array([0, 16, 16])).count.tolist() == [[16, 0]]
