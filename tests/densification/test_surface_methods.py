"""Intersection, gridding, fusion, spikes, filling and the grid itself, each against an answer that can be written down."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from village_pair import stack_of

from orthomill.schemas.epipolar import EpipolarPair, EpipolarPairs
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.maps.wanted_area import WantedArea
from orthomill.schemas.observations import GroundPoints
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.densification.filling import fill
from orthomill.tasks.densification.fusion import FusedCells, fuse
from orthomill.tasks.densification.gridding import HeightCells, TargetCells, grid_nodes
from orthomill.tasks.densification.ground_intersection import NodesOnGround, nodes_on_ground
from orthomill.tasks.densification.settings.surface_settings import EstimateGaps, Fusion, Gridding, MeasuredOnly, SpikeFilter
from orthomill.tasks.densification.spike_filter import spikes, stray
from orthomill.tasks.densification.surface_grid import GridWish, height_bounds, pair_bounds, round_cell_size, surface_of
from orthomill.tasks.geometry.epipolar_window import box_corners, left_pixels, node_window
from orthomill.tasks.geometry.normal_case import intersect_pair
from orthomill.tasks.geometry.rotation import rotation_matrix

PAIR = EpipolarPair(
    name="a-b",
    left="a",
    right="b",
    rotation=tuple(map(tuple, rotation_matrix(0.02, -0.015, 0.4).tolist())),
    left_centre=(4000.0, 7000.0, 1000.0),
    right_centre=(4400.0, 7200.0, 1010.0),
    base=450.0,
    c=1500.0,
    row0=600.3,
    left_col0=300.7,
    right_col0=900.1,
    rows=1200,
    left_cols=1100,
    right_cols=1100,
    parallax_low=640.0,
    parallax_high=760.0,
    base_height=0.46,
    row_sigma=0.0,
)
EMPTY = np.float32(np.nan)


def test_intersection_agrees_with_the_geometry_room():
    parallax = np.random.default_rng(0).uniform(650, 750, (6, 9)).astype(np.float32)
    parallax[2, 3] = EMPTY
    window = Window(20, 40, 6, 9)
    ground = nodes_on_ground(PAIR, np.stack([parallax, np.full_like(parallax, 0.1)], axis=-1), window, 2)
    col, row = np.meshgrid(2 * np.arange(40, 49), 2 * np.arange(20, 26))
    expected = intersect_pair(PAIR, np.column_stack([col.ravel(), row.ravel()]), parallax.ravel().astype(float)).reshape(6, 9, 3)
    assert np.allclose(np.stack([ground.x, ground.y, ground.z], axis=-1), expected, atol=1e-6, equal_nan=True)
    assert np.isnan(ground.sigma[2, 3]) and np.isfinite(ground.sigma).sum() == 53


def test_the_standard_error_of_a_height_is_that_of_many_trials():
    trials = np.random.default_rng(1).normal(700.0, 0.2, (200, 200)).astype(np.float32)
    pair = PAIR.model_copy(update={"row_sigma": 0.0})
    flat = np.stack([trials, np.full_like(trials, 0.2)], axis=-1)
    one = Window(100, 100, 1, 1)
    heights = [
        nodes_on_ground(pair, flat[r : r + 1, c : c + 1], one, 2).z[0, 0] for r in range(0, 200, 5) for c in range(0, 200, 5)
    ]
    sigma = nodes_on_ground(pair, flat[:1, :1], one, 2).sigma[0, 0]
    assert np.std(heights) == pytest.approx(sigma, rel=0.06)
    shared = nodes_on_ground(pair.model_copy(update={"row_sigma": 0.2}), flat[:1, :1], one, 2).sigma[0, 0]
    assert shared == pytest.approx(np.sqrt(2) * sigma, rel=1e-3)


@settings(max_examples=60, deadline=None)
@given(
    row=st.integers(0, 400),
    col=st.integers(0, 400),
    node=st.tuples(st.integers(0, 599), st.integers(0, 549)),
    p=st.floats(640, 760),
)
def test_no_node_over_a_map_window_lies_outside_its_node_window(row, col, node, p):
    grid, window = MapGrid(west=3900.0, north=7500.0, cell=1.0, rows=600, cols=600), Window(row, col, 60, 60)
    point = intersect_pair(PAIR, np.array([[node[1] * 2.0, node[0] * 2.0]]), np.array([p]))[0]
    at = grid.pixel(point[0], point[1])
    over = -0.5 <= at[0] - col < 59.5 and -0.5 <= at[1] - row < 59.5
    found = node_window(PAIR, 2, box_corners(grid, window, point[2] - 1, point[2] + 1))
    inside = found.row <= node[0] < found.row + found.height and found.col <= node[1] < found.col + found.width
    assert inside or not over


def test_left_pixels_undo_the_intersection():
    pixels = np.array([[10.0, 20.0], [900.5, 1100.25]])
    assert np.allclose(left_pixels(PAIR, intersect_pair(PAIR, pixels, np.array([660.0, 740.0]))), pixels)
    assert np.isnan(left_pixels(PAIR, np.array([[4000.0, 7000.0, 2000.0]]))).all()


def sloping_nodes(jump=0.0):
    """Nodes on z = 50 + 0.3 x - 0.2 y every 1.3 m; from column 20 on `jump` m higher, with a parallax to match."""
    x, y = np.meshgrid(0.4 + 1.3 * np.arange(40), 60.2 - 1.3 * np.arange(40))
    high = np.arange(40) >= 20
    z = 50 + 0.3 * x - 0.2 * y + jump * high
    return NodesOnGround(x, y, z, np.full(x.shape, np.float32(0.2)), (700 + jump * high + 0 * x).astype(np.float32))


GRID = MapGrid(west=0.0, north=60.0, cell=1.0, rows=60, cols=60)


def gridded(nodes, window=None, rules=None):
    return grid_nodes(nodes, 1.3, TargetCells(GRID, window or Window(0, 0, 60, 60), (0.0, 200.0)), rules or Gridding())


def test_a_plane_is_gridded_exactly():
    cells = gridded(sloping_nodes())
    x, y = np.meshgrid(*GRID.centres(Window(0, 0, 60, 60)))
    inner = slice(10, 40), slice(3, 48)
    assert np.allclose(cells.height[inner], (50 + 0.3 * x - 0.2 * y)[inner], atol=1e-9)
    assert np.allclose(cells.sigma[inner], 0.2)


def test_nothing_hangs_between_roof_and_ground():
    x, y = np.meshgrid(*GRID.centres(Window(0, 0, 60, 60)))
    above = (gridded(sloping_nodes(jump=10.0)).height - (50 + 0.3 * x - 0.2 * y))[10:40, 3:48]
    assert np.isfinite(above).all()
    assert ((np.abs(above) < 0.6) | (np.abs(above - 10.0) < 0.6)).all()


def test_heights_out_of_bounds_are_left_out():
    target = TargetCells(GRID, Window(0, 0, 60, 60), (0.0, 45.0))
    assert np.nanmax(grid_nodes(sloping_nodes(), 1.3, target, Gridding()).height) < 46.0


@settings(max_examples=20, deadline=None)
@given(row=st.integers(0, 40), col=st.integers(0, 40), size=st.integers(1, 20))
def test_gridding_a_window_is_a_window_of_the_whole(row, col, size):
    nodes, window = sloping_nodes(jump=6.0), Window(row, col, size, size)
    assert np.array_equal(gridded(nodes, window).height, gridded(nodes).height[window.slices], equal_nan=True)


def fused(*heights, sigma=0.1, **changes):
    pairs = tuple(HeightCells(np.array([[h]], dtype=np.float64), np.array([[sigma]], dtype=np.float32)) for h in heights)
    cells = fuse(stack_of(*pairs), 1.0, Fusion(**changes))
    return cells.height[0, 0], cells.precision[0, 0], int(cells.count[0, 0]), int(cells.provenance[0, 0])


def test_pairs_that_agree_are_averaged():
    height, precision, count, provenance = fused(10.0, 10.2)
    assert (height, count, provenance) == (pytest.approx(10.1), 2, 2)
    assert 0.0707 <= precision < 0.15
    assert fused(10.0, 10.0)[1] == pytest.approx(0.1 / np.sqrt(2))


def test_one_pair_and_none():
    assert fused(10.0) == (pytest.approx(10.0), pytest.approx(0.1), 1, 1)
    height, precision, count, provenance = fused(np.nan, np.nan)
    assert np.isnan(height) and np.isnan(precision) and (count, provenance) == (0, 0)


def test_two_that_agree_beat_one_blunder_and_a_dispute_is_named():
    assert fused(10.0, 10.1, 25.0)[2:] == (2, 2)
    assert fused(10.0, 25.0)[2:] == (1, 3)
    assert fused(10.0, 10.1, 25.0, 31.0)[2:] == (2, 3)


def test_a_lone_spike_goes_and_a_roof_stays():
    height = np.random.default_rng(2).normal(50, 0.05, (40, 40)).astype(np.float32)
    height[20:30, 5:17] += 8.0
    height[8, 8], height[9, 30] = 62.0, 41.0
    found = spikes(height, 1.0, SpikeFilter())
    assert found[8, 8] and found[9, 30]
    assert found.sum() == 2


def test_spikes_agree_with_the_plain_rule():
    height = np.random.default_rng(3).normal(0, 1, (15, 15)).astype(np.float32)
    height[np.random.default_rng(4).random(height.shape) < 0.3] = EMPTY
    rules = SpikeFilter(radius=2, rounds=1, sigmas=1.5, floor=0.0, min_support=4)
    found = spikes(height, 1.0, rules)
    for r, c in np.argwhere(np.isfinite(height)):
        circle = [(y, x) for y in range(15) for x in range(15) if 0 < (y - r) ** 2 + (x - c) ** 2 <= 4]
        near = [height[at] for at in circle if np.isfinite(height[at])]
        slopes = [abs(height[at] - height[r, c]) / np.hypot(at[0] - r, at[1] - c) for at in circle if np.isfinite(height[at])]
        lonely = sum(slope <= rules.support_slope for slope in slopes) < rules.min_support
        assert found[r, c] == (lonely or abs(height[r, c] - np.mean(near)) > 1.5 * np.std(near, ddof=1))


def test_wrong_matches_that_contradict_each_other_go():
    rng = np.random.default_rng(5)
    height = np.full((60, 60), EMPTY, np.float32)
    height[5:25, 5:25] = 50 + rng.normal(0, 0.1, (20, 20))
    wood = rng.random((60, 30)) < 0.4
    height[:, 30:][wood] = rng.uniform(40, 60, wood.sum())
    found = spikes(height, 1.0, SpikeFilter())
    assert not found[5:25, 5:25].any()
    assert found[:, 30:][wood].mean() > 0.95


def test_gaps_are_filled_only_when_asked_for_and_only_within_reach():
    x = np.arange(30, dtype=np.float32)
    height = np.tile(100 + 0.5 * x, (30, 1))
    height[10:14, 12:16] = EMPTY
    height[:, 24:] = EMPTY
    known = np.isfinite(height)
    cells = FusedCells(height, np.where(known, np.float32(0.1), EMPTY), known.astype(np.uint8), known.astype(np.uint8))
    assert np.array_equal(
        fill(cells, np.isnan(cells.height), np.zeros(cells.height.shape, bool), MeasuredOnly(kind="none")).height,
        cells.height,
        equal_nan=True,
    )
    filled = fill(cells, np.isnan(cells.height), np.zeros(cells.height.shape, bool), EstimateGaps(max_gap=6))
    hole = slice(10, 14), slice(12, 16)
    assert np.abs(filled.height[hole] - (100 + 0.5 * x[12:16])).max() < 0.3
    assert (filled.provenance[hole] == 4).all() and (filled.count[hole] == 0).all() and (filled.precision[hole] >= 0.1).all()
    assert np.isnan(filled.height[:, 26:]).all()
    assert np.array_equal(filled.height[known], height[known])


def block(low=20.0, high=60.0):
    return Block(
        crs="EPSG:2100",
        cameras={},
        of_photo={},
        photos=(),
        datum="free",
        sigma0_px=0.3,
        redundancy=9,
        iterations=1,
        ground_low=low,
        ground_high=high,
    )


def points_at(*heights: float, x: float = 4200.0) -> GroundPoints:
    """Tie points of these heights."""
    count, none = len(heights), np.zeros(len(heights), np.float32)
    places = np.full(count, x), np.full(count, 7100.0), np.array(heights, np.float64)
    return GroundPoints(np.arange(count), *places, none, none, none, np.full(count, 2, np.int16), none)


def test_the_grid_holds_what_the_pair_sees():
    surface = surface_of(block(), EpipolarPairs(pairs=(PAIR,)), points_at(40.0), GridWish())
    grid = surface.grid
    west, south, east, north = pair_bounds(PAIR, 20.0, 60.0)
    assert grid.west <= west < grid.west + grid.cell and grid.north - grid.cell < north <= grid.north
    assert grid.cols * grid.cell >= east - grid.west and grid.rows * grid.cell >= grid.north - south
    assert grid.cell == 1.0 and surface_of(block(), EpipolarPairs(pairs=(PAIR,)), points_at(), GridWish(0.4)).grid.cell == 0.4
    assert surface.height_low < 20.0 < 60.0 < surface.height_high
    assert height_bounds(EpipolarPairs(pairs=(PAIR,))) == (surface.height_low, surface.height_high)


def test_the_cell_is_that_of_most_of_the_surface():
    """Not of the middle between the highest and the lowest that may be: a mast would halve it."""
    pairs, high = EpipolarPairs(pairs=(PAIR,)), block(20.0, 1380.0)
    fine, coarse = (
        surface_of(high, pairs, points_at(z, z, 900.0, x=x), GridWish()).grid.cell for z, x in ((700.0, 4200.0), (20.0, 1.0))
    )
    assert (fine, coarse) == (0.25, 1.0)


def test_the_grid_ends_a_photograph_beyond_the_tie_points():
    """An oblique pair sees the ground for miles: nothing but tie points tells how far the block reaches."""
    pairs, (west, south, east, north) = EpipolarPairs(pairs=(PAIR,)), pair_bounds(PAIR, 20.0, 60.0)
    raised = {f"{side}_centre": (*getattr(PAIR, f"{side}_centre")[:2], 9e3) for side in ("left", "right")}
    high = PAIR.model_copy(update=raised)
    far = pairs.model_copy(update={"pairs": (PAIR, PAIR, high)})
    points = points_at(40.0, 40.0, 40.0, x=0.5 * (west + east))
    points.y[:] = 0.5 * (south + north)
    near = surface_of(block(), pairs, points, GridWish(cell=1.0)).grid
    assert (near.cols, near.rows) == (np.ceil(east) - np.floor(west), np.ceil(north) - np.floor(south)), "a flight is not cut"
    wide = surface_of(block(), far, points, GridWish(cell=1.0)).grid
    first, _, last, _ = pair_bounds(high, 20.0, 60.0)
    assert near.cols < wide.cols < 0.5 * (last - first)


def test_an_area_bounds_the_grid_and_the_points_that_set_its_cell():
    pairs, (west, south, _, north) = EpipolarPairs(pairs=(PAIR,)), pair_bounds(PAIR, 20.0, 60.0)
    area = (west + 50.0, south - 90.0, west + 150.0, north - 30.0)
    points = points_at(40.0, 700.0, 700.0, x=west + 100.0)
    points.x[1:] = west + 200.0
    grid = surface_of(block().model_copy(update={"area": area}), pairs, points, GridWish()).grid
    assert grid.cell == 1.0, "higher points beside the area have no part in it"
    assert grid.west == np.floor(west + 50.0) and grid.cols == np.ceil(west + 150.0) - grid.west
    assert grid.north == np.ceil(north - 30.0) and grid.rows == grid.north - np.floor(south)
    beside = block().model_copy(update={"area": (west - 90.0, south, west - 50.0, north)})
    with pytest.raises(GeometryError, match="no ground in the area"):
        surface_of(beside, pairs, points, GridWish())


def test_parallaxes_of_tilted_pairs_widen_the_heights_no_farther_than_the_block_asks_for():
    low, high = height_bounds(EpipolarPairs(pairs=(PAIR,)))
    assert height_bounds(EpipolarPairs(pairs=(PAIR,), heights=(low + 5.0, high + 5.0))) == (low + 5.0, high)


@pytest.mark.parametrize(("pixel", "cell"), [(0.65, 1.0), (0.02, 0.025), (0.031, 0.05), (0.1, 0.2), (1.5, 2.5)])
def test_cells_have_round_sizes(pixel, cell):
    assert round_cell_size(pixel) == pytest.approx(cell)


def test_without_pairs_there_is_one_clear_sentence():
    with pytest.raises(GeometryError, match="epipolar report"):
        surface_of(block(), EpipolarPairs(pairs=()), points_at(), GridWish())


def hill_with(radius: float, height: float, side: int = 90) -> tuple[np.ndarray, np.ndarray]:
    """A gently sloping surface (side, side) float32 with a flat-topped column in its middle, and where the column stands."""
    y, x = np.mgrid[:side, :side]
    column = np.hypot(x - side / 2, y - side / 2) < radius
    return (0.1 * x + 0.05 * y + height * column).astype(np.float32), column


@pytest.mark.parametrize(("radius", "goes"), [(4.0, True), (20.0, False)])
def test_a_patch_without_support_in_the_wider_circle_goes_and_a_building_stays(radius, goes):
    heights, column = hill_with(radius, 40.0)
    found = stray(heights, 1.0, SpikeFilter())
    assert found[column].mean() == goes and not found[~column].any()
    assert not stray(heights, 1.0, SpikeFilter(far_radius=0.0)).any()


def test_support_in_the_wider_circle_against_its_plain_twin():
    rng, settings = np.random.default_rng(4), SpikeFilter(far_radius=6.0, far_support=0.4)
    heights = rng.normal(0.0, 12.0, (24, 30)).astype(np.float32)
    heights[rng.random(heights.shape) < 0.2] = np.nan
    expected = np.zeros(heights.shape, bool)
    steps = [(r, c) for r in range(-6, 7, 2) for c in range(-6, 7, 2) if 0 < np.hypot(r, c) <= 6.0]
    for row, col in np.argwhere(np.isfinite(heights)):
        support = 0
        for r, c in steps:
            if 0 <= row + r < 24 and 0 <= col + c < 30:
                reach = np.float32(settings.far_slope * np.hypot(r, c) + settings.floor)
                support += abs(heights[row + r, col + c] - heights[row, col]) <= reach
        expected[row, col] = support < np.ceil(settings.far_support * len(steps))
    found = stray(heights, 1.0, settings)
    assert np.array_equal(found, expected) and 0 < found.sum() < np.isfinite(heights).sum()


def test_a_grid_is_the_one_that_is_asked_for():
    pairs, points = EpipolarPairs(pairs=(PAIR,)), points_at(40.0)
    seen = surface_of(block(), pairs, points, GridWish()).grid
    area = (seen.west + 10.25, seen.north - 60.0, seen.west + 50.25, seen.north - 10.0)
    found = surface_of(block(), pairs, points, GridWish(0.5, (seen.west + 0.25, seen.north), area)).grid
    assert (found.west, found.north, found.cell) == (area[0], area[3], 0.5) and (found.cols, found.rows) == (80, 100)
    outside = (seen.west - 100.0, *area[1:])
    assert surface_of(block(), pairs, points, GridWish(1.0, (0.0, 0.0), outside)).grid.west == np.floor(outside[0])
    with pytest.raises(GeometryError, match="see no ground in the area that is asked for"):
        surface_of(block(), pairs, points, GridWish(1.0, (0.0, 0.0), (0.0, 0.0, 10.0, 10.0)))
    corners = ((area[0], area[1]), (area[2], area[1]), (area[0], area[3]))
    drawn = surface_of(block(), pairs, points, GridWish(0.5, (seen.west + 0.25, seen.north)), WantedArea(polygons=((corners,),)))
    assert drawn.grid == found and drawn.wanted.polygons == ((corners,),)
