"""Region growing: from a few seeds over all ground that can be matched, and over nothing else.

Strategy
- The best waiting node of a region is matched from the prediction of a solved neighbour (position and affine); if that succeeds,
  its own neighbours are entered (growth_queue.py: published priorities, one to three levels of distance).
- A region is a square of the grid on an absolute lattice and grows independently, so that all regions take a step together and one
  call matches a node of each. When all have stopped, ground without seeds is entered from solved nodes of the adjacent regions,
  again in each of a fixed number of `crossings`. A node therefore depends on a bounded neighbourhood: a part with its `halo` gives
  what the whole gives. With `region` 0 the whole grid is one region, as published: for seeds measured by hand.
- Seeds need not be given: `found_seeds` takes them from the coarse levels of the pyramid, on a lattice in every region.

Compared with the pyramid, growing omits what cannot be matched instead of trying it on every level, and starts from the full affine
of a neighbour; it needs seeds, and the nodes of a region are matched one after the other.

Source: Otto & Chau 1989; Skarlatos (sources/matching.md#region-growing).
"""

from dataclasses import dataclass

import numpy as np

from orthomill.tasks.matching.gaussian_reach import reach_of
from orthomill.tasks.matching.least_squares.matching import Matches, chosen_windows
from orthomill.tasks.matching.strategies.coarse_to_fine import SearchRange, coarse_field
from orthomill.tasks.matching.strategies.coarse_to_fine import halo as pyramid_halo
from orthomill.tasks.matching.strategies.growing_settings import RegionGrowing
from orthomill.tasks.matching.strategies.growth_queue import SEED, Queues, pop_each, push, push_neighbours, queues_for
from orthomill.tasks.matching.strategies.node_grid import ImagePart, NodeGrid, PreparedPair, agreeing
from orthomill.tasks.matching.strategies.pyramid_settings import PyramidMatching


@dataclass(frozen=True, eq=False)
class Seeds:
    """Where growth begins."""

    points: np.ndarray
    """(M, 2) left positions (col, row), px; each stands for its nearest node"""
    right: np.ndarray
    """(M, 2) right positions, px; an accuracy of a pixel or two is enough"""
    affine: np.ndarray | None = None
    """(M, 4) as in `Matches.affine`, None for identity"""


def halo(settings: RegionGrowing, step: int, pyramid: PyramidMatching | None = None) -> int:
    """Pixels around its nodes that a part of the left photograph needs to give what the whole gives.

    pyramid: the settings of `found_seeds`; None when seeds are given. Raises ValueError for one region, which has no such bound.
    """
    if settings.region == 0:
        raise ValueError("one region for the whole grid: every node depends on the whole photograph; set `region` to work in parts")
    # Growth crosses at most one region per crossing; the last node is that of the neighbour test.
    nodes = settings.region * (settings.crossings + 1) + 1
    window = settings.matching.reach + reach_of(settings.matching.smoothing) + 2
    return nodes * step + (window if pyramid is None else max(window, pyramid_halo(pyramid, step) + 2 * step))


def grow(left: ImagePart, right: ImagePart, grid: NodeGrid, seeds: Seeds, settings: RegionGrowing) -> Matches:
    """Match the nodes of a grid that growth reaches: one row per node, row by row; positions in pixels of the photographs.

    For work in parts the grid must cover whole regions, `region_cover` of the nodes that are wanted. Nodes that are never reached
    are NOT_TRIED; seeds outside the grid are ignored.
    """
    pair = PreparedPair.of(left, right, settings.matching)
    points, queues = grid.points(), queues_for(_regions(grid, settings))
    half = chosen_windows(pair.left.grey, points - pair.left_origin, settings.matching).half.astype(np.int64)
    found = pair.match(points, np.full_like(points, np.nan))
    _plant(queues, grid, seeds)
    found = _grown(pair, points, half, queues, grid, found, settings)
    # All nodes solved so far are entered again: a neighbour region may have grown up to the border since.
    for _ in range(settings.crossings if settings.region and len(points) else 0):
        solved = np.flatnonzero(found.converged)
        push_neighbours(
            queues,
            grid.cols,
            float(grid.step),
            settings.levels,
            solved,
            found.position[solved],
            found.affine[solved].astype(np.float64),
            True,
        )
        found = _grown(pair, points, half, queues, grid, found, settings)
    return agreeing(found, grid, settings.min_neighbours, settings.neighbour_tolerance)


def found_seeds(
    left: ImagePart, right: ImagePart, grid: NodeGrid, search: SearchRange, settings: RegionGrowing, pyramid: PyramidMatching
) -> Seeds:
    """Seeds on a lattice of the grid, `settings.seeds` along each side of every region, from the coarse levels of a pyramid."""
    nodes = grid.points()[_seed_nodes(grid, settings)]
    if len(nodes) == 0:
        return Seeds(np.empty((0, 2)), np.empty((0, 2)))
    predicted, affine = coarse_field(left, right, nodes, search, pyramid).below(nodes)
    # Where the coarse level found nothing there is no seed; growth enters such ground from its neighbours.
    known = np.isfinite(predicted).all(axis=1)
    return Seeds(nodes[known], predicted[known], affine[known])


def region_cover(grid: NodeGrid, settings: RegionGrowing) -> NodeGrid:
    """The grid that `grow` needs to give the nodes of `grid` as it would give them in the whole: whole regions around it."""
    side, around = settings.region, settings.crossings + 1
    if side == 0:
        return grid
    (row, rows), (col, cols) = (
        ((first // side - around) * side, ((first + count - 1) // side - first // side + 1 + 2 * around) * side)
        for first, count in ((grid.row, grid.rows), (grid.col, grid.cols))
    )
    return NodeGrid(row, col, rows, cols, grid.step)


def _regions(grid: NodeGrid, settings: RegionGrowing) -> np.ndarray:
    """(rows * cols,) number of the region of every node."""
    if settings.region == 0:
        return np.zeros(grid.rows * grid.cols, np.int32)
    # Regions count from node 0 of the photograph, so that every part is divided alike.
    rows, cols = (
        (first + np.arange(count)) // settings.region - first // settings.region
        for first, count in ((grid.row, grid.rows), (grid.col, grid.cols))
    )
    return (rows[:, None] * (cols.max(initial=0) + 1) + cols).ravel()


def _seed_nodes(grid: NodeGrid, settings: RegionGrowing) -> np.ndarray:
    """(rows * cols,) bool: the nodes of the lattice of seeds."""

    def of_line(first: int, count: int) -> np.ndarray:
        side = settings.region or max(count, 1)
        place = (first * bool(settings.region) + np.arange(count)) % side
        return np.isin(place, side * (2 * np.arange(settings.seeds) + 1) // (2 * settings.seeds))

    return (of_line(grid.row, grid.rows)[:, None] & of_line(grid.col, grid.cols)).ravel()


def _plant(queues: Queues, grid: NodeGrid, seeds: Seeds) -> None:
    """Enter the nodes nearest to the seeds, with the positions of the seeds transferred to them."""
    affine = np.tile([1.0, 0.0, 0.0, 1.0], (len(seeds.points), 1)) if seeds.affine is None else np.asarray(seeds.affine, np.float64)
    # A seed is moved to a node by its affine, for nodes alone are matched.
    nearest = np.floor(seeds.points / grid.step + 0.5).astype(np.int64)
    for (x, y), (dx, dy), right, a in zip(nearest, nearest * grid.step - seeds.points, seeds.right, affine, strict=True):
        row, col = y - grid.row, x - grid.col
        if 0 <= row < grid.rows and 0 <= col < grid.cols:
            moved_col, moved_row = right[0] + a[0] * dx + a[1] * dy, right[1] + a[2] * dx + a[3] * dy
            push(queues, row * grid.cols + col, SEED, moved_col, moved_row, a)


def _grown(
    pair: PreparedPair,
    points: np.ndarray,
    half: np.ndarray,
    queues: Queues,
    grid: NodeGrid,
    found: Matches,
    settings: RegionGrowing,
) -> Matches:
    """Grow all regions until no node waits; `found` is filled in place."""
    active = np.arange(len(queues.first))
    popped = np.empty(len(active), np.int64)
    # One node of every region per call: regions are independent, and the kernel is called with many points.
    while count := pop_each(queues, active, popped):
        active, nodes = active[:count], popped[:count].copy()
        new = pair.match(points[nodes], queues.start[nodes], queues.affine[nodes], half[nodes])
        for name, table in found.__dict__.items():
            table[nodes] = new.__dict__[name]
        solved = new.converged
        push_neighbours(
            queues,
            grid.cols,
            float(grid.step),
            settings.levels,
            nodes[solved],
            new.position[solved],
            new.affine[solved].astype(np.float64),
            False,
        )
    return found
