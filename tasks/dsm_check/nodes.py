"""The check of one tile of one pair: homologous points of its two orthoimages, turned into height corrections at nodes.

Strategy. Nodes lie every few cells of the surface model. At each: a coarse search along the base, least-squares matching from
there, the tests (correlation, shift across the base, search back), the rays through both places, and the difference of
the point so found and the model under it. Its standard error comes from that of the shift, through base over height, and from
the slope of the model, which a plan error turns into height. A node that looks at something hidden is not tried.

Source: Skarlatos, PhD thesis, 3.4 (methods/matching_and_dsm_check.md, 1.7).
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from orthomill.schemas.orientation import ExteriorOrientation
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.dsm_check.height_correction import Centres, PlanCorrection, RayCorrection, correct
from orthomill.tasks.dsm_check.search import OrthoPair, ShiftSearch, distance_back, ortho_pair, shifts
from orthomill.tasks.dsm_check.working_orthoimage import height_at
from orthomill.tasks.matching.least_squares.matching import Matches, match_points
from orthomill.tasks.matching.least_squares.model import LeastSquaresMatching
from orthomill.tasks.matching.smoothing import reach_of

BANDS = ("dh", "east", "south", "sigma", "correlation", "outcome")
"""of a raster of nodes, float32: correction (m), place of the corrected point against the node (cells), standard error (m), ..."""
DH, EAST, SOUTH, SIGMA, CORRELATION, OUTCOME = range(6)
_OUTSIDE, _OCCLUDED = int(Outcome.OUTSIDE), int(Outcome.OCCLUDED)


class NodeMatching(Settings):
    """How the orthoimages are compared."""

    search: ShiftSearch = setting(ShiftSearch(), "The search for a start.")
    least_squares: LeastSquaresMatching = setting(
        LeastSquaresMatching(window=11, max_shift=3.0, min_correlation=0.7), "Matching by least squares from that start."
    )
    least_sigma: float = setting(
        0.1, "Least standard error of a shift: what resampling leaves, whatever the matching says.", "orthoimage pixels", gt=0
    )
    hidden: float = setting(1.5, "A node is hidden when the model rises above its ray by more than this.", "cells", gt=0)

    @property
    def halo(self) -> int:
        """Pixels around a tile of orthoimage that its nodes look at; even, so that half-size pixels keep their places."""
        lsm = self.least_squares
        window = int(np.ceil(lsm.reach * 1.5 + lsm.max_shift)) + reach_of(lsm.smoothing) + 3
        correlation = 2 * (self.search.window // 2) + 4
        return 2 * int(np.ceil((2 * self.search.reach + 4 + max(window, correlation)) / 2))


@dataclass(frozen=True)
class NodeTile:
    """Which nodes of which pair. Windows lie on the grid of the surface model."""

    left: ExteriorOrientation
    right: ExteriorOrientation
    grid: MapGrid
    window: Window
    """the cells whose nodes are asked for"""
    seen: Window
    """the cells that the orthoimages and heights show: the window and its halo"""
    pixels_per_cell: int
    step: int
    """cells from node to node"""

    @property
    def centres(self) -> Centres:
        return Centres(np.array(self.left.centre), np.array(self.right.centre))

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols) of nodes"""
        return -(-self.window.height // self.step), -(-self.window.width // self.step)

    def pixels(self) -> np.ndarray:
        """(N, 2) int64 (col, row): the nodes in the orthoimages given, row by row."""
        factor, offset = self.pixels_per_cell, (self.step * self.pixels_per_cell) // 2
        row = (self.window.row - self.seen.row) * factor + offset + np.arange(self.shape[0]) * self.step * factor
        col = (self.window.col - self.seen.col) * factor + offset + np.arange(self.shape[1]) * self.step * factor
        return np.stack(np.meshgrid(col, row), axis=-1).reshape(-1, 2)


def node_offset(step: int, pixels_per_cell: int) -> float:
    """Place of a node in its square of `step` cells: cells from the centre of the first one."""
    return ((step * pixels_per_cell) // 2 + 0.5) / pixels_per_cell - 0.5


def check_nodes(
    tile: NodeTile,
    matching: NodeMatching,
    correction: RayCorrection | PlanCorrection,
    left: np.ndarray,
    right: np.ndarray,
    heights: np.ndarray,
) -> np.ndarray:
    """Corrections at the nodes of a tile: (rows, cols, len(BANDS)) float32, NaN where there is none; `outcome` says why.

    left, right: orthoimages of `tile.seen`, uint8. heights: (tile.seen.shape) m, NaN where there is none.
    """
    heights = heights.astype(np.float64)
    pixels = tile.pixels()
    outcome = _known(tile, matching, heights, pixels)
    tried = np.flatnonzero(outcome == Outcome.CONVERGED)
    images = ortho_pair(left, right, matching.search)
    matches, back = _match(images, pixels[tried], base_direction(tile), matching)
    values = np.full((len(pixels), len(BANDS)), np.nan, np.float32)
    outcome[tried] = matches.outcome
    values[tried, CORRELATION] = matches.correlation
    _correct(tile, matching, correction, _MatchedNodes(pixels, tried, matches, back), heights, values, outcome)
    values[:, OUTCOME] = outcome
    return values.reshape(*tile.shape, len(BANDS))


@dataclass(frozen=True)
class _MatchedNodes:
    """Nodes (N, 2), which of them were tried, and what came of it."""

    pixels: np.ndarray
    tried: np.ndarray
    matches: Matches
    back: np.ndarray


@dataclass(frozen=True)
class _Shift:
    """Covariances (N, 2, 2) px^2 of shifts, and the places (N, 2) they lead to, in cells of the whole surface."""

    covariance: np.ndarray
    places: np.ndarray


def base_direction(tile: NodeTile) -> np.ndarray:
    """Unit vector (col, row) of the base in the orthoimages; zero for photographs above one another."""
    base = (tile.centres.right - tile.centres.left)[:2] * (1, -1)
    return base / max(np.linalg.norm(base), 1e-9)


def _known(tile: NodeTile, matching: NodeMatching, heights: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """(N,) uint8: CONVERGED stands for worth trying."""
    outcome = np.full(len(pixels), Outcome.CONVERGED, np.uint8)
    reach = matching.halo // tile.pixels_per_cell
    for centre in (tile.centres.left, tile.centres.right):
        col, row = tile.grid.pixel(centre[0], centre[1])
        place = np.array([col, row, centre[2] / tile.grid.cell, tile.seen.col, tile.seen.row])
        _hide(heights, _to_cells(tile, pixels), place, (tile.grid.cell, matching.hidden, reach), outcome)
    return outcome


@njit(cache=True)
def _hide(heights, cells, centre, numbers, outcome):
    """Mark nodes without height (OUTSIDE) and nodes whose ray to the centre the model cuts (OCCLUDED); all lengths in cells."""
    cell, tolerance, reach = numbers
    for i in range(cells.shape[0]):
        z = height_at(heights, cells[i, 1] - centre[4], cells[i, 0] - centre[3])
        if not np.isfinite(z):
            outcome[i] = _OUTSIDE
            continue
        dx, dy = centre[0] - cells[i, 0], centre[1] - cells[i, 1]
        distance = np.hypot(dx, dy)
        if distance < 1.0:
            continue
        rise = (centre[2] - z / cell) / distance
        for k in range(1, int(min(reach, distance)) + 1):
            col = int(np.rint(cells[i, 0] + dx / distance * k) - centre[3])
            row = int(np.rint(cells[i, 1] + dy / distance * k) - centre[4])
            if row < 0 or col < 0 or row >= heights.shape[0] or col >= heights.shape[1]:
                break
            if heights[row, col] > z + (rise * k + tolerance) * cell:
                outcome[i] = _OCCLUDED
                break


def _match(images: OrthoPair, points: np.ndarray, direction: np.ndarray, matching: NodeMatching) -> tuple[Matches, np.ndarray]:
    """Matches of points (N, 2) and how far from them the search back ends (N,) px."""
    search = matching.search
    starts = points + shifts(images, points, direction, search, search.gain)
    matches = match_points(images.left, images.right, points, starts, matching.least_squares)
    return matches, distance_back(images, points, matches.position, direction, search)


def _correct(
    tile: NodeTile,
    matching: NodeMatching,
    correction: RayCorrection | PlanCorrection,
    found: _MatchedNodes,
    heights: np.ndarray,
    values: np.ndarray,
    outcome: np.ndarray,
) -> None:
    """Fill dh, place and sigma of the nodes that pass every test into `values` (N, 6); `outcome` (N,) tells of the others."""
    at, matches, search = found.pixels[found.tried], found.matches, matching.search
    moved = _snapped(matches.position - at)
    left, right = _to_cells(tile, at), _to_cells(tile, at + moved)
    points = correct(
        _ground(tile, left, heights), _ground(tile, right, heights), tile.centres, correction, tile.grid.cell / tile.pixels_per_cell
    )
    places = _snapped(np.column_stack(tile.grid.pixel(points.points[:, 0], points.points[:, 1])))
    dh = points.points[:, 2] - _heights(tile, places, heights)
    across = np.abs(moved @ (-base_direction(tile)[1], base_direction(tile)[0]))
    right_place = (across <= search.across) & (found.back <= search.back) & points.accepted & np.isfinite(dh)
    outcome[found.tried[matches.converged & ~right_place]] = Outcome.INCONSISTENT
    good = matches.converged & right_place
    kept = found.tried[good]
    values[kept, DH] = dh[good]
    values[kept, EAST:SIGMA] = (places - left)[good]
    shift = _Shift(matches.covariance[good], places[good])
    values[kept, SIGMA] = _sigma(tile, matching, shift, heights)


def _snapped(values: np.ndarray) -> np.ndarray:
    """Coordinates rounded to 2^-20: what remains is exact in every tile, wherever its pixels are counted from."""
    return np.rint(values * 2**20) / 2**20


def _to_cells(tile: NodeTile, pixels: np.ndarray) -> np.ndarray:
    """Orthoimage pixels (N, 2) of the arrays given to cells (col, row) of the whole surface."""
    return (pixels + 0.5) / tile.pixels_per_cell - 0.5 + (tile.seen.col, tile.seen.row)


def _ground(tile: NodeTile, cells: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """Ground points (N, 3) m of cells (N, 2) of the whole surface, on the model."""
    x = tile.grid.west + (cells[:, 0] + 0.5) * tile.grid.cell
    y = tile.grid.north - (cells[:, 1] + 0.5) * tile.grid.cell
    return np.column_stack([x, y, _heights(tile, cells, heights)])


def _heights(tile: NodeTile, cells: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """Heights (N,) m of the model at cells (N, 2) of the whole surface; NaN outside and where it has none."""
    out = np.empty(len(cells))
    _heights_at(heights, cells - (tile.seen.col, tile.seen.row), out)
    return out


@njit(cache=True)
def _heights_at(heights, cells, out):
    for i in range(cells.shape[0]):
        known = np.isfinite(cells[i, 0]) and np.isfinite(cells[i, 1])
        out[i] = height_at(heights, cells[i, 1], cells[i, 0]) if known else np.nan


def _sigma(tile: NodeTile, matching: NodeMatching, shift: _Shift, heights: np.ndarray) -> np.ndarray:
    """Standard error (m) of dh: that of the shift times height over base, and that of the place times the slope of the model."""
    cell, direction = tile.grid.cell, base_direction(tile)
    along = np.maximum(np.einsum("i,nij,j->n", direction, shift.covariance, direction), 0.0)
    of_shift = np.sqrt(along + matching.least_sigma**2) * cell / tile.pixels_per_cell
    depth = (tile.left.centre[2] + tile.right.centre[2]) / 2 - _heights(tile, shift.places, heights)
    base = np.linalg.norm(tile.centres.right - tile.centres.left)
    slope = _steepness(shift.places - (tile.seen.col, tile.seen.row), heights) / cell
    return np.hypot(of_shift * depth / base, slope * (of_shift + 0.25 * cell))


def _steepness(places: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """(N,) m: greatest height difference between the cell at `places` (N, 2) and its four neighbours; 0 where none is known."""
    col = np.clip(np.rint(places[:, 0]).astype(int), 1, heights.shape[1] - 2)
    row = np.clip(np.rint(places[:, 1]).astype(int), 1, heights.shape[0] - 2)
    centre = heights[row, col]
    around = [np.abs(heights[row + r, col + c] - centre) for r, c in ((0, 1), (1, 0), (0, -1), (-1, 0))]
    return np.fmax.reduce([*around, np.zeros(len(places))])
