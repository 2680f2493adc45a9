"""Region growing: the published order, growth over what can be matched and nothing else, and parts that fit the whole."""

import numpy as np
import pytest

from benchmarks.matching.dissertation_pair import PairCrop, ground_texture, pair_crop
from benchmarks.matching.dissertation_surface import true_matches
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import Window
from orthomill.tasks.matching.strategies.coarse_to_fine import SearchRange
from orthomill.tasks.matching.strategies.growing_settings import RegionGrowing
from orthomill.tasks.matching.strategies.growth_queue import pop_each, push, push_neighbours, queues_for
from orthomill.tasks.matching.strategies.node_grid import ImagePart, NodeGrid
from orthomill.tasks.matching.strategies.pyramid_settings import PyramidMatching
from orthomill.tasks.matching.strategies.region_growing import Seeds, found_seeds, grow, halo, region_cover

ONE = RegionGrowing(region=0)
PARTS = RegionGrowing(region=6, crossings=1, seeds=1)
UNIT = np.array([1.0, 0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def parts() -> tuple[ImagePart, ImagePart]:
    crop: PairCrop = pair_crop(ground_texture(), Window(5200, 6000, 640, 600), 32)
    cut = [-value % 8 for value in crop.right_origin]
    right = ImagePart(crop.right[cut[1] :, cut[0] :], crop.right_origin[0] + cut[0], crop.right_origin[1] + cut[1])
    return ImagePart(crop.left, *crop.left_origin), right


def seeds_at(points: list[list[float]]) -> Seeds:
    points = np.array(points, dtype=np.float64)
    return Seeds(points, true_matches(points) + np.array([0.8, -0.5]))


def pushed_order(levels: int) -> list[int]:
    """Nodes of a 7 x 7 grid in the order in which the neighbours of the central one come up."""
    queues = queues_for(np.zeros(49, np.int32))
    queues.waiting[24] = 255
    push_neighbours(queues, 7, 1.0, levels, np.array([24]), np.zeros((1, 2)), UNIT[None], False)
    order, out = [], np.empty(1, np.int64)
    while pop_each(queues, np.zeros(1, np.int64), out):
        order.append(int(out[0]))
    return order


def test_priorities_are_the_published_ones():
    along_column, along_row = 7, 1
    expected = [24 + sign * step * level for level in (1, 2, 3) for step in (along_column, along_row) for sign in (1, -1)]
    assert pushed_order(3) == expected
    assert pushed_order(1) == expected[:4]


def test_a_waiting_prediction_never_gets_worse_and_a_tried_node_never_returns():
    queues, out = queues_for(np.zeros(4, np.int32)), np.empty(1, np.int64)
    push(queues, 2, 5, 10.0, 0.0, UNIT)
    push(queues, 2, 6, 20.0, 0.0, UNIT)
    assert queues.start[2, 0] == 10.0
    push(queues, 2, 5, 25.0, 0.0, UNIT)
    assert queues.start[2, 0] == 10.0
    push(queues, 2, 3, 30.0, 0.0, UNIT)
    assert queues.start[2, 0] == 30.0
    assert pop_each(queues, np.zeros(1, np.int64), out) == 1 and out[0] == 2
    push(queues, 2, 1, 40.0, 0.0, UNIT)
    assert pop_each(queues, np.zeros(1, np.int64), out) == 0


def test_regions_take_turns_and_keep_to_themselves():
    queues, out = queues_for(np.array([0, 0, 1, 1], np.int32)), np.empty(2, np.int64)
    for node in (1, 0, 3):
        push(queues, node, 2, 0.0, 0.0, UNIT)
    active = np.arange(2)
    assert pop_each(queues, active, out) == 2 and out.tolist() == [1, 3]
    push_neighbours(queues, 4, 1.0, 1, np.array([1]), np.zeros((1, 2)), UNIT[None], False)
    assert queues.waiting[2] == 0
    push_neighbours(queues, 4, 1.0, 1, np.array([1]), np.zeros((1, 2)), UNIT[None], True)
    assert queues.waiting[2] == 3


def test_one_rough_seed_is_enough_for_connected_ground(parts):
    left, right = parts
    grid = NodeGrid.within(left, 15, margin=20)
    found = grow(left, right, grid, seeds_at([[6290.0, 5520.0]]), ONE)
    error = np.abs(found.position - true_matches(grid.points()))[found.converged]
    assert found.converged.mean() > 0.98
    assert np.median(error[:, 0]) < 0.03 and (error[:, 0] > 0.5).mean() < 0.002


def test_growth_omits_what_cannot_be_matched_and_surrounds_it(parts):
    left, right = parts
    pixels = left.pixels.copy()
    pixels[200:440, 150:460] = 120
    grid = NodeGrid.within(left, 15, margin=20)
    found = grow(ImagePart(pixels, left.col, left.row), right, grid, seeds_at([[6050.0, 5230.0]]), ONE)
    inside = ((grid.points() - left.origin >= [165, 215]) & (grid.points() - left.origin < [445, 425])).all(axis=1)
    assert not found.converged[inside].any()
    assert set(found.outcome[inside]) == {Outcome.LOW_TEXTURE, Outcome.NOT_TRIED}
    assert np.isnan(found.position[inside]).all()
    below = grid.points()[:, 1] > left.row + 470
    assert found.converged[below].mean() > 0.95


def test_seeds_found_by_the_pyramid_reach_everything(parts):
    left, right = parts
    grid = NodeGrid.within(left, 10, margin=20)
    offsets = true_matches(grid.points()) - grid.points()
    search = SearchRange(offsets[:, 0].min() - 12, offsets[:, 0].max() + 12, -12, 12)
    seeds = found_seeds(left, right, grid, search, PARTS, PyramidMatching(levels=3))
    assert len(seeds.points) >= 0.95 * (grid.rows // 6) * (grid.cols // 6)
    assert np.abs(seeds.right - true_matches(seeds.points)).max(axis=1).mean() < 1.0
    assert grow(left, right, grid, seeds, PARTS).converged.mean() > 0.98


def test_a_part_with_its_halo_gives_what_the_whole_gives(parts):
    left, right = parts
    seeds = seeds_at([[6230.0, 5480.0], [6400.0, 5700.0], [6100.0, 5300.0], [6300.0, 5420.0]])
    whole_grid = region_cover(NodeGrid.within(left, 10, margin=20), PARTS)
    core = NodeGrid(546, 621, 8, 7, 10)
    reach = halo(PARTS, 10)
    top, side = core.row * 10 - reach - left.row, core.col * 10 - reach - left.col
    bottom, end = (core.row + core.rows) * 10 + reach - left.row, (core.col + core.cols) * 10 + reach - left.col
    first_row, first_col = max(top, 0), max(side, 0)
    cut = ImagePart(left.pixels[first_row:bottom, first_col:end], left.col + first_col, left.row + first_row)
    assert cut.pixels.size < 0.8 * left.pixels.size
    part_grid = region_cover(core, PARTS)
    whole, alone = grow(left, right, whole_grid, seeds, PARTS), grow(cut, right, part_grid, seeds, PARTS)

    def of_core(table, grid):
        at = table.reshape(*grid.shape, *table.shape[1:])
        return at[core.row - grid.row : core.row - grid.row + core.rows, core.col - grid.col : core.col - grid.col + core.cols]

    assert of_core(whole.converged, whole_grid).mean() > 0.4
    for name in ("col", "row", "affine", "covariance", "outcome"):
        expected, got = of_core(getattr(whole, name), whole_grid), of_core(getattr(alone, name), part_grid)
        assert np.array_equal(got, expected, equal_nan=True), name


def test_more_crossings_reach_farther(parts):
    left, right = parts
    grid = NodeGrid.within(left, 10, margin=20)
    seeds = seeds_at([[6290.0, 5520.0]])
    reached = [grow(left, right, grid, seeds, PARTS.model_copy(update={"crossings": n})).converged.sum() for n in (0, 1, 3)]
    assert 30 <= reached[0] <= 36 < reached[1] <= 36 * 9 < reached[2]


def test_no_seeds_and_no_nodes_give_an_empty_answer(parts):
    none = Seeds(np.empty((0, 2)), np.empty((0, 2)))
    assert not grow(*parts, NodeGrid(350, 401, 3, 3, 15), none, ONE).converged.any()
    assert len(grow(*parts, NodeGrid(350, 401, 0, 0, 15), none, ONE)) == 0


def test_a_seed_that_is_nan_or_outside_the_grid_is_ignored(parts):
    seeds = Seeds(np.array([[6000.0, 5200.0], [90.0, 90.0]]), np.array([[np.nan, 1.0], [0.0, 0.0]]))
    found = grow(*parts, NodeGrid(350, 401, 4, 4, 15), seeds, ONE)
    assert not found.converged.any()


def test_one_region_has_no_halo():
    with pytest.raises(ValueError, match="region"):
        halo(ONE, 10)
