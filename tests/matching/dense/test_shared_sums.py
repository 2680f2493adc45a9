"""Windows solved from sums that neighbours share, against the same windows cut one by one."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.dense.node_surfaces import NodeLattice
from orthomill.tasks.matching.dense.shared_sums import RUN, columns_of, fill_sums, is_whole, off_plane, shared_sums_for
from orthomill.tasks.matching.dense.surface_warp import WarpedPair, warp
from orthomill.tasks.matching.dense.window_solution import cut_block, lay_out, scratch_for, solved, solved_whole

PLANE = np.array([12.0, 0.02, -0.03])
CORRELATION = (0.37, 0.02)
ROW, COL, STEP = 40, 40, 2


@pytest.fixture(scope="module")
def pair() -> WarpedPair:
    """A pair with noise, seen along a plane with slopes of which every node departs a little."""
    random = np.random.default_rng(8)
    right = (120.0 + 160.0 * gaussian_filter(random.standard_normal((80, 240)), 1.2)).astype(np.float32)
    left = np.roll(right, -6, axis=1)[:, :200] + random.normal(0, 2, (80, 200)).astype(np.float32)
    lattice = NodeLattice(0, 0, 40, 100, STEP)
    planes = np.empty((40, 100, 3), np.float32)
    rows, cols = lattice.pixels
    planes[..., 0] = 12.0 + 0.02 * (cols - COL) - 0.03 * (rows[:, None] - ROW) + random.normal(0, 0.05, (40, 100))
    planes[..., 1], planes[..., 2] = 0.02, -0.03
    seen = WarpedPair.of(left.astype(np.float32), 17)
    warp(seen, right, 18, lattice, planes)
    return seen


def place(pair: WarpedPair, node: int) -> int:
    return (ROW + pair.margin) * pair.cols + COL + node * STEP + pair.margin


def plane_of(node: int) -> np.ndarray:
    """The plane of a node, its slopes a little other than those of the first."""
    return PLANE + np.array([0.02 * node * STEP + 0.1 * np.sin(node), 0.004 * np.cos(node), 0.003 * np.sin(2.0 * node)])


@pytest.mark.parametrize("half", [4, 5, 6, 7, 11, 15])
@pytest.mark.parametrize("flat", [False, True])
def test_shared_sums_solve_windows_as_their_own_do(pair, half, flat):
    shared, scratch, nodes = shared_sums_for(half, STEP), scratch_for(half), 20
    fill_sums(pair, place(pair, 0), half, columns_of(nodes - 1, STEP, half), plane_of(0), flat, CORRELATION, shared)
    lay_out(half, scratch.block)
    for node in range(nodes):
        plane, own, found = plane_of(node), np.full(10, np.nan), np.full(10, np.nan)
        size = cut_block(pair, place(pair, node), half, plane, 2.0, flat, scratch.block)
        outcome = solved(scratch, half, size, CORRELATION, plane[1], own)
        off = off_plane(plane_of(0), plane, node * STEP) if flat else (0.0, 0.0, 0.0)
        assert solved_whole(shared, node * STEP, half, off, plane[1], scratch.sums, found) == outcome == Outcome.CONVERGED
        # Where a row of the block ends with one column off the window, it counts a pair across the end, of little weight.
        assert np.allclose(found, own, rtol=5e-3, atol=1e-4)
        assert np.abs(found[:3] - own[:3]).max() < 1e-4


@pytest.mark.parametrize("spoiled", [(0, 0), (7, 7), (-7, 7), (7, -7)])
def test_a_window_is_whole_when_all_its_pixels_lie_on_the_plane(pair, spoiled):
    ramp, centre = shared_sums_for(7, STEP).ramp, place(pair, 3)
    at = centre + spoiled[0] * pair.cols + spoiled[1]
    kept = pair.field[at]
    assert is_whole(pair, centre, 7, plane_of(3), 2.0, ramp)
    for value in (kept + 2.5, np.nan):
        pair.field[at] = value
        assert not is_whole(pair, centre, 7, plane_of(3), 2.0, ramp)
    pair.field[at] = kept


@pytest.mark.parametrize("spoiled", [(8, 0), (0, 8), (-8, 0), (0, -8)])
def test_pixels_beside_a_window_do_not_matter(pair, spoiled):
    ramp, centre = shared_sums_for(7, STEP).ramp, place(pair, 3)
    at = centre + spoiled[0] * pair.cols + spoiled[1]
    kept, pair.field[at] = pair.field[at], np.nan
    assert is_whole(pair, centre, 7, plane_of(3), 2.0, ramp)
    pair.field[at] = kept


def test_a_run_has_room_for_all_its_columns():
    for half in (4, 15):
        assert shared_sums_for(half, STEP).ramp.size >= (RUN - 1) * STEP + 2 * half + 1
