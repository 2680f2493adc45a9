"""Gridding and filling against plain twins, and the effect of each of their settings."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import Provenance
from orthomill.tasks.densification.filling import fill
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.gridding import HeightCells, TargetCells, grid_nodes
from orthomill.tasks.densification.ground_intersection import NodesOnGround
from orthomill.tasks.densification.settings.surface_settings import EstimateGaps, Gridding, MeasuredOnly

GRID = MapGrid(west=0.0, north=12.0, cell=1.0, rows=12, cols=12)
WHOLE = Window(0, 0, 12, 12)


def nodes_from(x, y, z, parallax=None) -> NodesOnGround:
    p = np.full(x.shape, 700.0) if parallax is None else parallax
    return NodesOnGround(x, y, z, np.full(x.shape, 0.2, np.float32), p.astype(np.float32))


def scattered_nodes(seed: int, jumps: bool = True) -> NodesOnGround:
    """A jittered grid of nodes with random heights, some of them without a match, with parallax discontinuities."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(9) * 1.4 + 0.3, 11.7 - np.arange(9) * 1.4)
    p = 700 + 2.0 * (rng.random(x.shape) < 0.2) * jumps
    p[rng.random(x.shape) < 0.1] = np.nan
    x, y = x + rng.normal(0, 0.15, x.shape), y + rng.normal(0, 0.15, x.shape)
    return nodes_from(x, y, np.where(np.isnan(p), np.nan, rng.normal(10, 2, x.shape)), p)


def gridded(nodes, rules=None, heights=(-100.0, 100.0), grid=GRID, window=WHOLE) -> HeightCells:
    return grid_nodes(nodes, 1.4, TargetCells(grid, window, heights), rules or Gridding())


def plain_gridding(nodes: NodesOnGround, reach: float, jump: float) -> np.ndarray:
    """Triangles by barycentric coordinates and single nodes by distance, cell by cell."""
    col, row = GRID.pixel(nodes.x, nodes.y)
    height, alone, met = np.full(WHOLE.shape, np.nan), np.full(WHOLE.shape, np.nan), np.zeros(nodes.z.shape, int)
    r, c = np.mgrid[:12, :12]
    for i in range(nodes.z.shape[0] - 1):
        for j in range(nodes.z.shape[1] - 1):
            for corner in ((i, j), (i + 1, j + 1)):
                three = (corner, (i, j + 1), (i + 1, j))
                p = np.array([nodes.parallax[at] for at in three])
                if not np.ptp(p) <= jump:
                    continue
                for at in three:
                    met[at] += 1
                xy = np.array([[col[at], row[at], 1.0] for at in three]).T
                weights = np.linalg.solve(xy, np.stack([c.ravel(), r.ravel(), np.ones(c.size)]))
                z = (np.array([nodes.z[at] for at in three]) @ weights).reshape(c.shape)
                inside = (weights >= -1e-9).all(axis=0).reshape(c.shape)
                height = np.where(inside, np.fmax(height, z), height)
    for at in zip(*np.nonzero(met < 6), strict=True):
        if np.isfinite(nodes.z[at]):
            near = (np.abs(r - row[at]) <= reach) & (np.abs(c - col[at]) <= reach)
            alone = np.where(near, np.fmax(alone, nodes.z[at]), alone)
    return np.where(np.isnan(height), alone, height)


@pytest.mark.parametrize("seed", range(6))
def test_gridding_agrees_with_its_plain_twin(seed):
    nodes = scattered_nodes(seed)
    expected = plain_gridding(nodes, 0.5 * 1.4, 1.5)
    assert np.allclose(gridded(nodes).height, expected, atol=1e-7, equal_nan=True)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), east=st.integers(-3, 3), south=st.integers(-3, 3))
def test_nodes_moved_by_whole_cells_move_the_heights(seed, east, south):
    nodes = scattered_nodes(seed)
    moved = NodesOnGround(nodes.x + east, nodes.y - south, nodes.z, nodes.sigma, nodes.parallax)
    before, after = gridded(nodes).height, gridded(moved, window=Window(south, east, 12, 12)).height
    assert np.allclose(before, after, atol=1e-6, equal_nan=True)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), row=st.integers(0, 8), col=st.integers(0, 8))
def test_any_window_is_cut_from_the_whole(seed, row, col):
    nodes, window = scattered_nodes(seed), Window(row, col, 4, 4)
    part, whole = gridded(nodes, window=window), gridded(nodes)
    assert np.array_equal(part.height, whole.height[window.slices], equal_nan=True)
    assert np.array_equal(part.sigma, whole.sigma[window.slices], equal_nan=True)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_heights_stay_between_those_of_the_nodes(seed):
    nodes = scattered_nodes(seed)
    height = gridded(nodes).height
    assert np.nanmin(nodes.z) - 1e-6 <= np.nanmin(height) and np.nanmax(height) <= np.nanmax(nodes.z) + 1e-6


def test_the_visible_height_wins():
    """Two sheets over the same cells: the upper one is what is seen from above."""
    x, y = np.meshgrid(np.arange(12.0), 11.5 - np.arange(12.0))
    both = np.concatenate([np.full(x.shape, 5.0), np.full(x.shape, 9.0)])
    p = np.concatenate([np.full(x.shape, 700.0), np.full(x.shape, 720.0)])
    found = gridded(nodes_from(np.vstack([x, x]), np.vstack([y, y]), both, p))
    assert (found.height[1:-1, 1:-1] == 9.0).all()


def step_nodes() -> NodesOnGround:
    """A step of 3 px of parallax and 6 m between columns 5 and 6."""
    x, y = np.meshgrid(np.arange(12.0), 11.5 - np.arange(12.0))
    high = x >= 6
    return nodes_from(x, y, 10.0 + 6.0 * high, 700.0 + 3.0 * high)


@pytest.mark.parametrize(("max_jump", "ramp"), [(1.5, False), (3.5, True)])
def test_max_jump_decides_whether_a_step_becomes_a_ramp(max_jump, ramp):
    height = gridded(step_nodes(), Gridding(max_jump=max_jump)).height
    between = (np.abs(height - 10.0) > 0.1) & (np.abs(height - 16.0) > 0.1) & np.isfinite(height)
    assert between.any() == ramp


def test_node_reach_is_how_far_a_node_at_a_step_covers():
    x, y = np.meshgrid(np.arange(3) * 4.0 + 1.5, 10.5 - np.arange(3) * 4.0)
    alone = nodes_from(x, y, np.full(x.shape, 10.0), 700.0 + 10.0 * np.arange(9).reshape(3, 3))
    covered = [np.isfinite(gridded(alone, Gridding(node_reach=reach)).height).sum() for reach in (0.0, 1.0, 2.0)]
    assert covered[0] < covered[1] < covered[2]
    assert covered[1] == 9 * 9, "1.4 cells to every side are three by three cells around a cell's centre"


def test_heights_beyond_the_bounds_make_no_triangle():
    height = gridded(step_nodes(), heights=(0.0, 12.0)).height
    assert np.nanmax(height) == 10.0 and np.isnan(height[:, 8:]).all()


NONE = np.zeros((1, 1), bool)
"""no height stands alone"""


def cells_of(height: np.ndarray, precision: float = 0.1) -> FusedCells:
    known = np.isfinite(height)
    code = known.astype(np.uint8)
    return FusedCells(height.astype(np.float32), np.where(known, precision, np.nan).astype(np.float32), code, code)


def plain_filling(height: np.ndarray, reach: int) -> np.ndarray:
    """The nearest measured cell in eight directions, weighted with 1 / distance^2; opposite sides must be measured."""
    out, steps = height.copy(), [(0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1)]
    for r, c in np.argwhere(np.isnan(height)):
        hits = {}
        for k, (dr, dc) in enumerate(steps):
            for i in range(1, int(reach / np.hypot(dr, dc)) + 1):
                y, x = r + i * dr, c + i * dc
                if 0 <= y < height.shape[0] and 0 <= x < height.shape[1] and np.isfinite(height[y, x]):
                    hits[k] = height[y, x], (i * np.hypot(dr, dc)) ** -2.0
                    break
        if any(k in hits and k + 4 in hits for k in range(4)):
            z, w = np.array(list(hits.values())).T
            out[r, c] = (z * w).sum() / w.sum()
    return out


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), gap=st.integers(1, 6))
def test_filling_agrees_with_its_plain_twin(seed, gap):
    rng = np.random.default_rng(seed)
    height = rng.normal(50, 3, (10, 11))
    height[rng.random(height.shape) < 0.5] = np.nan
    filled = fill(cells_of(height), NONE, np.zeros(height.shape, bool), EstimateGaps(max_gap=gap))
    assert np.allclose(filled.height, plain_filling(height.astype(np.float32), gap), atol=1e-4, equal_nan=True)


def test_filled_cells_are_never_more_precise_than_their_neighbours():
    height = np.tile(np.arange(9.0), (9, 1))
    height[4, 4] = np.nan
    filled = fill(cells_of(height, 0.25), NONE, np.zeros(height.shape, bool), EstimateGaps(max_gap=3))
    assert filled.provenance[4, 4] == Provenance.INTERPOLATED and filled.count[4, 4] == 0
    assert filled.precision[4, 4] > 0.25 and filled.height[4, 4] == pytest.approx(4.0)


def test_a_wrong_height_takes_that_of_one_side_and_a_gap_does_not():
    height = np.tile(np.where(np.arange(9) < 4, 10.0, np.nan), (9, 1))
    height[4, 6] = -30.0
    none = np.zeros(height.shape, bool)
    filled = fill(cells_of(height), none, height == -30.0, EstimateGaps(max_gap=5))
    assert filled.height[4, 6] == 10.0 and filled.provenance[4, 6] == Provenance.INTERPOLATED
    assert np.isnan(np.delete(filled.height[:, 4:].ravel(), 4 * 5 + 2)).all()


def test_max_gap_is_in_cells():
    height = np.full((1, 21), 5.0)
    height[0, 6:15] = np.nan
    for gap, whole in ((9, True), (8, False)):
        assert (
            np.isfinite(fill(cells_of(height), NONE, np.zeros(height.shape, bool), EstimateGaps(max_gap=gap)).height).all() == whole
        ), gap


def test_nothing_is_extrapolated():
    height = np.full((9, 9), np.nan)
    height[:, :4] = 3.0
    assert np.isnan(fill(cells_of(height), NONE, np.zeros(height.shape, bool), EstimateGaps(max_gap=5)).height[:, 4:]).all()


def test_measured_only_leaves_every_estimate_out():
    cells = cells_of(np.full((1, 7), 5.0))
    codes = np.arange(7, dtype=np.uint8)[None]
    kept = fill(FusedCells(cells.height, cells.precision, cells.count, codes), NONE, NONE, MeasuredOnly(kind="none"))
    assert kept.provenance.tolist() == [[0, 1, 2, 3, 0, 5, 0]]
    assert (np.isnan(kept.height[0]) == [False, False, False, False, True, False, True]).all()


def test_heights_that_stand_alone_give_way_to_what_surrounds_them():
    height = np.full((9, 9), 5.0)
    height[4, 4], height[0, 0] = 40.0, 30.0
    filled = fill(cells_of(height), height > 10, np.zeros(height.shape, bool), EstimateGaps(max_gap=3))
    assert filled.height[4, 4] == pytest.approx(5.0) and filled.provenance[4, 4] == Provenance.INTERPOLATED
    assert filled.count[4, 4] == 0
    assert filled.height[0, 0] == 30.0, "nothing encloses a corner, so it keeps what it has"
