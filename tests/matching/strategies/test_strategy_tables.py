"""Tables of matches, grids of nodes, predictions and the queue of growth: against plain twins and exact affine fields."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.least_squares.matching import Matches
from orthomill.tasks.matching.strategies.coarse_to_fine import Field, SearchRange, halo
from orthomill.tasks.matching.strategies.growing_settings import RegionGrowing
from orthomill.tasks.matching.strategies.growth_queue import PRIORITIES, pop_each, push, push_neighbours, queues_for
from orthomill.tasks.matching.strategies.match_tables import merged, moved, rejected, taken
from orthomill.tasks.matching.strategies.node_grid import GridMatches, ImagePart, NodeGrid, agreeing, agreement, from_neighbours
from orthomill.tasks.matching.strategies.pyramid_settings import PyramidMatching
from orthomill.tasks.matching.strategies.region_growing import region_cover

AFFINE, ORIGIN = np.array([[1.02, -0.03], [0.04, 0.97]]), np.array([12.5, -3.25])
UNIT = np.array([1.0, 0.0, 0.0, 1.0])


def right_of(points: np.ndarray) -> np.ndarray:
    """The exact affine field of these tests."""
    return points @ AFFINE.T + ORIGIN


def matches(points: np.ndarray, outcome: int = Outcome.CONVERGED) -> Matches:
    """Exact matches of points (N, 2) in the affine field."""
    count, right = len(points), right_of(points)
    return Matches(
        col=right[:, 0],
        row=right[:, 1],
        reference=points.copy(),
        covariance=np.tile(np.eye(2, dtype=np.float32) * 0.01, (count, 1, 1)),
        sigma0=np.full(count, 2.0, np.float32),
        correlation=np.linspace(0.7, 0.9, count).astype(np.float32),
        affine=np.tile(AFFINE.ravel(), (count, 1)).astype(np.float32),
        radiometry=np.tile([1.0, 0.0], (count, 1)).astype(np.float32),
        half=np.full(count, 10, np.uint8),
        iterations=np.arange(count, dtype=np.uint8),
        outcome=np.full(count, outcome, np.uint8),
    )


def test_rows_are_taken_and_put_back():
    table = matches(np.arange(20.0).reshape(10, 2))
    rows = np.array([1, 4, 7])
    part = taken(table, rows)
    assert len(part) == 3 and np.array_equal(part.col, table.col[rows])
    other = moved(part, np.array([100.0, 0.0]), np.array([0.0, 50.0]))
    back = merged(table, other, rows)
    assert np.array_equal(back.row[rows], table.row[rows] + 50.0) and np.array_equal(
        back.reference[rows, 0], part.reference[:, 0] + 100
    )
    untouched = np.setdiff1d(np.arange(10), rows)
    assert np.array_equal(back.position[untouched], table.position[untouched])
    assert np.array_equal(table.row, right_of(table.reference)[:, 1]), "the old table must not change"


def test_a_rejected_match_has_no_position_and_no_precision_but_its_correlation():
    table = matches(np.arange(8.0).reshape(4, 2))
    refused = rejected(table, np.array([False, True, False, False]), Outcome.INCONSISTENT)
    assert refused.outcome.tolist() == [1, Outcome.INCONSISTENT, 1, 1]
    assert np.isnan(refused.position[1]).all() and np.isnan(refused.covariance[1]).all()
    assert refused.correlation[1] == table.correlation[1]
    assert table.converged.all(), "the old table must not change"


@settings(max_examples=50, deadline=None)
@given(
    col=st.integers(-50, 50),
    row=st.integers(-50, 50),
    shape=st.tuples(st.integers(1, 60), st.integers(1, 60)),
    step=st.integers(1, 9),
    margin=st.integers(0, 12),
)
def test_the_nodes_within_a_part_are_all_multiples_of_the_step_inside_its_margin(col, row, shape, step, margin):
    grid = NodeGrid.within(ImagePart(np.zeros(shape), col, row), step, margin)
    expected = [
        (x, y)
        for y in range(row, row + shape[0])
        for x in range(col, col + shape[1])
        if x % step == y % step == 0 and min(x - col, col + shape[1] - 1 - x, y - row, row + shape[0] - 1 - y) >= margin
    ]
    assert [tuple(point) for point in grid.points().astype(int)] == expected


def test_a_grown_grid_surrounds_the_grid():
    grid = NodeGrid(3, 5, 4, 6, 8)
    wide = grid.grown(2)
    inner = wide.points().reshape(*wide.shape, 2)[2:-2, 2:-2].reshape(-1, 2)
    assert np.array_equal(inner, grid.points())


def grid_of(seed: int, noise: float, share: float = 0.7) -> tuple[NodeGrid, GridMatches]:
    """A grid of 7 x 8 nodes of the affine field, some unsolved, with noise of the positions."""
    random, grid = np.random.default_rng(seed), NodeGrid(2, 3, 7, 8, 10)
    right = right_of(grid.points()) + random.normal(0, noise, (56, 2))
    affine = np.tile(AFFINE.ravel(), (56, 1))
    return grid, GridMatches.of(grid, random.random(56) < share, right, affine)


def neighbours(nodes: GridMatches, row: int, col: int) -> list[np.ndarray]:
    """Predictions of the solved neighbours of a node, by the definition."""
    rows, cols = nodes.solved.shape
    return [
        nodes.right[y, x] + nodes.affine[y, x].reshape(2, 2) @ (10.0 * np.array([col - x, row - y]))
        for y in range(max(row - 1, 0), min(row + 2, rows))
        for x in range(max(col - 1, 0), min(col + 2, cols))
        if (y, x) != (row, col) and nodes.solved[y, x]
    ]


@pytest.mark.parametrize("seed", range(4))
def test_agreement_counts_the_neighbours_that_predict_a_node(seed):
    _, nodes = grid_of(seed, 0.5)
    counted = agreement(nodes, 10.0, 0.75)
    for row in range(7):
        for col in range(8):
            near = [np.abs(place - nodes.right[row, col]).max() <= 0.75 for place in neighbours(nodes, row, col)]
            assert counted[row, col] == (sum(near) if nodes.solved[row, col] else 0)


@pytest.mark.parametrize("seed", range(4))
def test_an_unsolved_node_takes_the_mean_prediction_of_its_neighbours(seed):
    grid, nodes = grid_of(seed, 0.5, share=0.3)
    starts, affine = np.full((56, 2), np.nan), np.zeros((56, 4))
    wanted = GridMatches.of(grid, ~nodes.solved.ravel(), starts, affine)
    given_one = from_neighbours(nodes, 10.0, wanted)
    for row in range(7):
        for col in range(8):
            predictions = neighbours(nodes, row, col)
            expected = bool(predictions) and not nodes.solved[row, col]
            assert given_one[row, col] == expected
            if expected:
                assert wanted.right[row, col] == pytest.approx(np.mean(predictions, axis=0))
                assert wanted.affine[row, col] == pytest.approx(AFFINE.ravel())
            else:
                assert np.isnan(wanted.right[row, col]).all()


def test_a_node_off_the_prediction_of_its_neighbours_is_rejected():
    grid = NodeGrid(0, 0, 5, 5, 10)
    table = matches(grid.points())
    table.col[12] += 2.0
    found = agreeing(table, grid, 3, 0.75)
    assert found.outcome[12] == Outcome.INCONSISTENT and found.converged.sum() == 24


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 999), hidden=st.floats(0.0, 0.6))
def test_a_field_of_exact_affines_predicts_exactly_whatever_is_missing(seed, hidden):
    random, grid = np.random.default_rng(seed), NodeGrid(-1, 2, 6, 5, 8)
    right, affine = right_of(grid.points()), np.tile(AFFINE.ravel(), (30, 1))
    right[random.random(30) < hidden] = np.nan
    points = random.uniform([16, -8], [48, 32], (25, 2))
    places, affines = Field(grid, right, affine, random.random(30) < 0.5).predicted(points)
    known = np.isfinite(places).all(axis=1)
    assert places[known] == pytest.approx(right_of(points)[known]) and affines[known] == pytest.approx(
        np.tile(AFFINE.ravel(), (known.sum(), 1))
    )
    assert (affines[~known] == UNIT).all()
    assert known.any() or hidden > 0.3


def test_unsolved_nodes_count_only_where_no_solved_one_is_near():
    grid = NodeGrid(0, 0, 1, 3, 10)
    right = np.array([[0.0, 0.0], [30.0, 0.0], [20.0, 0.0]])
    field = Field(grid, right, np.tile(UNIT, (3, 1)), np.array([True, False, True]))
    places, _ = field.predicted(np.array([[5.0, 0.0], [10.0, 0.0]]))
    assert places[0, 0] == pytest.approx(5.0, abs=0.05) and places[1, 0] == pytest.approx(30.0)


def test_a_finer_level_has_twice_the_pixels():
    grid = NodeGrid(0, 0, 3, 3, 4)
    field = Field(grid, grid.points() + 1.0, np.tile(UNIT, (9, 1)), np.ones(9, bool))
    finer = np.array([[4.5, 6.5]])
    assert field.below(finer)[0] == pytest.approx(finer + 2.0)


@settings(max_examples=40, deadline=None)
@given(low=st.floats(-50, 50), width=st.floats(0, 60), spacing=st.floats(0.5, 20))
def test_the_starts_cover_the_search_range(low, width, spacing):
    offsets = SearchRange(low, low + width).offsets(spacing)[:, 0]
    assert np.abs(np.linspace(low, low + width, 50)[:, None] - offsets).min(axis=1).max() <= spacing / 2 + 1e-9
    assert len(offsets) <= width / spacing + 1 + 1e-9


def test_the_halo_of_the_pyramid_grows_with_everything_that_reaches_further():
    base = halo(PyramidMatching(levels=2), 8)
    for changed, step in (
        (PyramidMatching(levels=3), 8),
        (PyramidMatching(levels=2, coarse_step=6), 8),
        (PyramidMatching(levels=2, wide_window=61), 8),
        (PyramidMatching(levels=2), 12),
    ):
        assert halo(changed, step) > base


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 11), st.integers(1, PRIORITIES - 1)), max_size=40))
def test_nodes_come_up_by_priority_and_then_by_age(entries):
    queues = queues_for(np.zeros(12, np.int32))
    waiting: dict[int, tuple[int, int]] = {}
    for age, (node, priority) in enumerate(entries):
        push(queues, node, priority, float(age), 0.0, UNIT)
        if node not in waiting or priority < waiting[node][0]:
            waiting[node] = (priority, age)
    order, out = [], np.empty(1, np.int64)
    while pop_each(queues, np.zeros(1, np.int64), out):
        node = int(out[0])
        assert queues.start[node, 0] == waiting[node][1], "the prediction of the best entry is kept"
        order.append(node)
    assert order == sorted(waiting, key=lambda node: waiting[node])


@pytest.mark.parametrize("node", [0, 6, 42, 48])
def test_neighbours_beyond_the_grid_are_not_entered(node):
    queues, out = queues_for(np.zeros(49, np.int32)), np.empty(1, np.int64)
    queues.waiting[node] = 255
    push_neighbours(queues, 7, 1.0, 3, np.array([node]), np.zeros((1, 2)), UNIT[None], False)
    count = 0
    while pop_each(queues, np.zeros(1, np.int64), out):
        same_row, same_col = out[0] // 7 == node // 7, out[0] % 7 == node % 7
        assert same_row != same_col
        count += 1
    assert count == 6


def test_neighbours_are_predicted_by_the_affine_of_the_solved_node():
    queues = queues_for(np.zeros(25, np.int32))
    push_neighbours(queues, 5, 10.0, 1, np.array([12]), np.array([[100.0, 50.0]]), AFFINE.reshape(1, 4), False)
    assert queues.start[13] == pytest.approx([100.0 + 10 * AFFINE[0, 0], 50.0 + 10 * AFFINE[1, 0]])
    assert queues.start[7] == pytest.approx([100.0 - 10 * AFFINE[0, 1], 50.0 - 10 * AFFINE[1, 1]])
    assert queues.affine[13] == pytest.approx(AFFINE.ravel())


@pytest.mark.parametrize("crossings", [0, 2])
def test_a_cover_consists_of_whole_regions_around_the_nodes(crossings):
    chosen = RegionGrowing(region=6, crossings=crossings)
    grid = NodeGrid(-4, 13, 5, 9, 8)
    cover = region_cover(grid, chosen)
    assert all(value % 6 == 0 for value in (cover.row, cover.col, cover.rows, cover.cols))
    around = 6 * (crossings + 1)
    assert cover.row <= grid.row - around and cover.row + cover.rows >= grid.row + grid.rows + around
    assert cover.col <= grid.col - around and cover.col + cover.cols >= grid.col + grid.cols + around
    assert region_cover(grid, RegionGrowing(region=0)) == grid
