"""The check of one tile of one pair: homologous points of its two orthoimages become height corrections at nodes.

Strategy. Nodes lie every few cells of the surface model. For each follow a coarse search along the base, least-squares matching
from the place found, the tests (correlation, shift across the base, reverse search) and the intersection of the rays through both
places. The correction is the difference between the intersected point and the model below it. Its standard error follows from that
of the shift, through base over height, and from the slope of the model, which turns an error in plan into one in height. Nodes
that are hidden from one of the photographs are not tried.

Source: Skarlatos, PhD thesis, 3.4 (sources/surface_check.md#deterministic).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.orientation import ExteriorOrientation
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.dsm_check.comparison_settings import NodeMatching
from orthomill.tasks.dsm_check.height_correction import Centres, Correction, correct
from orthomill.tasks.dsm_check.search import OrthoPair, distance_back, ortho_pair, shifts
from orthomill.tasks.dsm_check.working_orthoimage import height_at
from orthomill.tasks.matching.least_squares.matching import Matches, match_points

BANDS = ("dh", "east", "south", "sigma", "correlation", "outcome")
"""bands of a raster of nodes, float32: correction m, position of the corrected point relative to the node in cells, standard error
m, correlation, code of Outcome"""
DH, EAST, SOUTH, SIGMA, CORRELATION, OUTCOME = range(6)
_OUTSIDE, _OCCLUDED = int(Outcome.OUTSIDE), int(Outcome.OCCLUDED)


@dataclass(frozen=True)
class NodeTile:
    """The nodes of a pair in a tile. Windows lie on the grid of the surface model."""

    left: ExteriorOrientation
    right: ExteriorOrientation
    grid: MapGrid
    window: Window
    """the cells whose nodes are computed"""
    seen: Window
    """the cells that orthoimages and heights cover: the window and its halo"""
    pixels_per_cell: int
    step: int
    """cells from node to node"""

    @property
    def centres(self) -> Centres:
        """Projection centres of both photographs."""
        return Centres(np.array(self.left.centre), np.array(self.right.centre))

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols) of nodes"""
        return -(-self.window.height // self.step), -(-self.window.width // self.step)

    def pixels(self) -> np.ndarray:
        """(N, 2) int64 (col, row): the nodes in the given orthoimages, row by row."""
        factor, offset = self.pixels_per_cell, (self.step * self.pixels_per_cell) // 2
        row = (self.window.row - self.seen.row) * factor + offset + np.arange(self.shape[0]) * self.step * factor
        col = (self.window.col - self.seen.col) * factor + offset + np.arange(self.shape[1]) * self.step * factor
        return np.stack(np.meshgrid(col, row), axis=-1).reshape(-1, 2)


def node_offset(step: int, pixels_per_cell: int) -> float:
    """Position of a node in its square of `step` cells: cells from the centre of the first one."""
    return ((step * pixels_per_cell) // 2 + 0.5) / pixels_per_cell - 0.5


def check_nodes(
    tile: NodeTile, matching: NodeMatching, correction: Correction, left: np.ndarray, right: np.ndarray, heights: np.ndarray
) -> np.ndarray:
    """Corrections at the nodes of a tile: (rows, cols, len(BANDS)) float32, NaN where there is none; the band `outcome`
    gives the reason.

    left, right: orthoimages of `tile.seen`, uint8. heights: (tile.seen.shape) m, NaN where there is none.
    """
    heights = heights.astype(np.float64)
    pixels = tile.pixels()
    outcome = _visible(tile, matching, heights, pixels)
    tried = np.flatnonzero(outcome == Outcome.CONVERGED)
    images = ortho_pair(left, right, matching.search)
    matches, back = _match(images, pixels[tried], base_direction(tile), matching)
    values = np.full((len(pixels), len(BANDS)), np.nan, np.float32)
    outcome[tried] = matches.outcome
    # the correlation is kept of every node that was tried: it explains why others failed
    values[tried, CORRELATION] = matches.correlation
    _correct(tile, matching, correction, _MatchedNodes(pixels, tried, matches, back), heights, _NodeValues(values, outcome))
    values[:, OUTCOME] = outcome
    return values.reshape(*tile.shape, len(BANDS))


@dataclass(frozen=True)
class _MatchedNodes:
    """Nodes (N, 2), numbers of those that were tried, their matches, and the distances (px) at which the reverse search ended."""

    pixels: np.ndarray
    tried: np.ndarray
    matches: Matches
    back: np.ndarray


@dataclass(frozen=True)
class _NodeValues:
    """What is filled: values (N, 6) float32 in the order of BANDS, outcome (N,) uint8."""

    values: np.ndarray
    outcome: np.ndarray


@dataclass(frozen=True)
class _Shift:
    """Covariances (N, 2, 2) px^2 of shifts, and the places (N, 2) to which they lead, in cells of the whole surface."""

    covariance: np.ndarray
    places: np.ndarray


def base_direction(tile: NodeTile) -> np.ndarray:
    """Unit vector (col, row) of the base in the orthoimages; zero for photographs vertically above each other."""
    # rows run south
    base = (tile.centres.right - tile.centres.left)[:2] * (1, -1)
    return base / max(np.linalg.norm(base), 1e-9)


def _visible(tile: NodeTile, matching: NodeMatching, heights: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """(N,) uint8: OUTSIDE without height, OCCLUDED behind the model, CONVERGED for nodes to be matched."""
    outcome = np.full(len(pixels), Outcome.CONVERGED, np.uint8)
    # Only the model within the halo is examined: what rises farther away rarely hides, and tiles must agree on what they know.
    reach, cell = matching.halo // tile.pixels_per_cell, tile.grid.cell
    for centre in (tile.centres.left, tile.centres.right):
        col, row = tile.grid.pixel(centre[0], centre[1])
        camera = _Camera(float(col), float(row), float(centre[2]) / cell, cell, matching.hidden, reach)
        _hide(heights, _to_cells(tile, pixels), (tile.seen.row, tile.seen.col), camera, outcome)
    return outcome


class _Camera(NamedTuple):
    """Projection centre and the limits of its rays, lengths in cells: centre in the grid and above the datum, size of a cell in m,
    height by which the model must exceed a ray to hide a node, reach along the ray."""

    col: float
    row: float
    height: float
    cell: float
    tolerance: float
    reach: int


@njit()
def _hide(heights, cells, first, camera, outcome):
    """Marks nodes without height (OUTSIDE) and nodes whose ray to the camera cuts the model (OCCLUDED).

    heights (rows, cols) m begin at `first` (row, col) of the whole surface; cells (N, 2) are (col, row) there.
    """
    for i in range(cells.shape[0]):
        z = height_at(heights, cells[i, 1] - first[0], cells[i, 0] - first[1])
        if not np.isfinite(z):
            outcome[i] = _OUTSIDE
            continue
        dx, dy = camera.col - cells[i, 0], camera.row - cells[i, 1]
        distance = np.hypot(dx, dy)
        # at the nadir the ray is vertical and nothing can hide the node
        if distance < 1.0:
            continue
        rise = (camera.height - z / camera.cell) / distance
        for k in range(1, int(min(camera.reach, distance)) + 1):
            col = int(np.rint(cells[i, 0] + dx / distance * k) - first[1])
            row = int(np.rint(cells[i, 1] + dy / distance * k) - first[0])
            if row < 0 or col < 0 or row >= heights.shape[0] or col >= heights.shape[1]:
                break
            if heights[row, col] > z + (rise * k + camera.tolerance) * camera.cell:
                outcome[i] = _OCCLUDED
                break


def _match(images: OrthoPair, points: np.ndarray, direction: np.ndarray, matching: NodeMatching) -> tuple[Matches, np.ndarray]:
    """Matches of points (N, 2), and the distances (N,) px from them at which the reverse search ends."""
    search = matching.search
    starts = points + shifts(images, points, direction, search, search.gain)
    matches = match_points(images.left, images.right, points, starts, matching.least_squares)
    return matches, distance_back(images, points, matches.position, direction, search)


def _correct(
    tile: NodeTile, matching: NodeMatching, correction: Correction, found: _MatchedNodes, heights: np.ndarray, out: _NodeValues
) -> None:
    """Fills dh, place and sigma of the nodes that pass every test; the outcome of the others becomes INCONSISTENT."""
    at, matches, search = found.pixels[found.tried], found.matches, matching.search
    moved, pixel = _snapped(matches.position - at), tile.grid.cell / tile.pixels_per_cell
    left, right = _to_cells(tile, at), _to_cells(tile, at + moved)
    points = correct(_ground(tile, left, heights), _ground(tile, right, heights), tile.centres, correction, pixel)
    places = _snapped(np.column_stack(tile.grid.pixel(points.points[:, 0], points.points[:, 1])))
    # compared below the true point, not at the node: there the model may be another roof
    dh = points.points[:, 2] - _heights(tile, places, heights)
    across = np.abs(moved @ (-base_direction(tile)[1], base_direction(tile)[0]))
    # Height errors move a point along the base only. What moved across it is another point: a vehicle, a repeated pattern.
    right_place = (across <= search.across) & (found.back <= search.back) & points.accepted & np.isfinite(dh)
    out.outcome[found.tried[matches.converged & ~right_place]] = Outcome.INCONSISTENT
    good = matches.converged & right_place
    kept = found.tried[good]
    out.values[kept, DH] = dh[good]
    out.values[kept, EAST:SIGMA] = (places - left)[good]
    shift = _Shift(matches.covariance[good], places[good])
    out.values[kept, SIGMA] = _sigma(tile, matching, shift, heights)


def _snapped(values: np.ndarray) -> np.ndarray:
    """Coordinates rounded to 2^-20: sums with integers are then exact, wherever a tile counts its pixels from."""
    return np.rint(values * 2**20) / 2**20


def _to_cells(tile: NodeTile, pixels: np.ndarray) -> np.ndarray:
    """Cells (col, row) of the whole surface of pixels (N, 2) of the given orthoimages."""
    return (pixels + 0.5) / tile.pixels_per_cell - 0.5 + (tile.seen.col, tile.seen.row)


def _ground(tile: NodeTile, cells: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """Ground points (N, 3) m on the model, at cells (N, 2) of the whole surface."""
    x = tile.grid.west + (cells[:, 0] + 0.5) * tile.grid.cell
    y = tile.grid.north - (cells[:, 1] + 0.5) * tile.grid.cell
    return np.column_stack([x, y, _heights(tile, cells, heights)])


def _heights(tile: NodeTile, cells: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """Heights (N,) m of the model at cells (N, 2) of the whole surface; NaN outside and in its gaps."""
    out = np.empty(len(cells))
    _heights_at(heights, cells - (tile.seen.col, tile.seen.row), out)
    return out


@njit()
def _heights_at(heights, cells, out):
    """Heights (m) at `cells` (n, 2) as (col, row), bilinear, into `out` (n,); NaN where a cell is unknown."""
    for i in range(cells.shape[0]):
        known = np.isfinite(cells[i, 0]) and np.isfinite(cells[i, 1])
        out[i] = height_at(heights, cells[i, 1], cells[i, 0]) if known else np.nan


def _sigma(tile: NodeTile, matching: NodeMatching, shift: _Shift, heights: np.ndarray) -> np.ndarray:
    """Standard errors (N,) m of dh: of the shift times height over base, and of the position times the slope of the model."""
    cell, direction = tile.grid.cell, base_direction(tile)
    along = np.maximum(np.einsum("i,nij,j->n", direction, shift.covariance, direction), 0.0)
    # Least squares reports what the grey values of one window say; the resampling of the orthoimages is common to all of them.
    of_shift = np.sqrt(along + matching.least_sigma**2) * cell / tile.pixels_per_cell
    depth = (tile.left.centre[2] + tile.right.centre[2]) / 2 - _heights(tile, shift.places, heights)
    base = np.linalg.norm(tile.centres.right - tile.centres.left)
    slope = _steepness(shift.places - (tile.seen.col, tile.seen.row), heights) / cell
    # a quarter of a cell: the position of an edge within a cell is not known to the model
    return np.hypot(of_shift * depth / base, slope * (of_shift + 0.25 * cell))


def _steepness(places: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """(N,) m: greatest height difference between the cell at `places` (N, 2) and its four neighbours; 0 where none is known."""
    col = np.clip(np.rint(places[:, 0]).astype(int), 1, heights.shape[1] - 2)
    row = np.clip(np.rint(places[:, 1]).astype(int), 1, heights.shape[0] - 2)
    # the greatest difference and not a gradient: at a wall the mean of both sides would halve the step
    centre = heights[row, col]
    around = [np.abs(heights[row + r, col + c] - centre) for r, c in ((0, 1), (1, 0), (0, -1), (-1, 0))]
    return np.fmax.reduce([*around, np.zeros(len(places))])
