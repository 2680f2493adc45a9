"""One tile of the surface model: the pairs' nodes to cells, fusion of the pairs, spike removal, and filling of gaps on request."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.raster import Window
from orthomill.schemas.surface import Provenance, Surface
from orthomill.tasks.densification.filling import Filling, fill
from orthomill.tasks.densification.fusion import FusedCells, Fusion, fuse
from orthomill.tasks.densification.gridding import Gridding, HeightCells, TargetCells, grid_nodes
from orthomill.tasks.densification.ground_intersection import nodes_on_ground, orientation_sigma
from orthomill.tasks.densification.spike_filter import SpikeFilter, spikes
from orthomill.tasks.densification.surface_grid import ground_pixel

CLASSES = 20
"""classes of the precision histogram, each a tenth of a cell wide; the last is open"""


@dataclass(frozen=True)
class SurfaceRules:
    """From the matched pairs to the surface model."""

    gridding: Gridding
    fusion: Fusion
    spikes: SpikeFilter
    fill: Filling

    def halo(self, cell: float) -> int:
        """Cells around a tile that influence it; cell: side of a cell, m."""
        # One cell more than filters and filling look at: gridding takes cell centres on the edge of a triangle.
        return self.spikes.halo + self.fill.reach(cell) + 1


class SurfaceStatistics(BaseModel):
    """Counts of cells of a tile or of the whole surface."""

    model_config = ConfigDict(frozen=True)

    provenance: tuple[int, ...] = (0,) * len(Provenance)
    """cells by code of Provenance"""
    precision: tuple[int, ...] = (0,) * CLASSES
    """cells with a height by class of precision"""
    spikes: int = 0
    lowest: float | None = None
    highest: float | None = None
    """m"""


@dataclass(frozen=True)
class PairPiece:
    """What a tile reads of a pair: the window of its grid of nodes."""

    pair: EpipolarPair
    nodes: Window
    step: int


@dataclass(frozen=True)
class SurfaceTile:
    """A tile of the surface: its own cells `window`, and the cells `work` that are computed (with halo, clipped to the grid)."""

    surface: Surface
    window: Window
    work: Window
    pieces: tuple[PairPiece, ...]


class SurfaceCells(NamedTuple):
    """A finished tile (rows, cols): height and precision float32 m (NaN where empty), number of agreeing pairs and
    provenance uint8."""

    height: np.ndarray
    precision: np.ndarray
    pairs: np.ndarray
    provenance: np.ndarray
    statistics: SurfaceStatistics


def surface_scratch(pieces: tuple[PairPiece, ...], work: Window) -> int:
    """Working memory of `make_surface`, bytes."""
    # Per node x, y, z, column and row in float64, sigma and parallax in float32 with their copies; per cell and pair a float64
    # height and a float32 sigma, twice while they are stacked.
    return sum(60 * piece.nodes.height * piece.nodes.width for piece in pieces) + (40 + 24 * len(pieces)) * work.height * work.width


def make_surface(tile: SurfaceTile, rules: SurfaceRules, nodes: tuple[np.ndarray, ...] = ()) -> SurfaceCells:
    """The cells of a tile with their statistics; nodes: one array (rows, cols, 3) float32 per piece."""
    cell = tile.surface.grid.cell
    pairs = tuple(_pair_cells(tile, piece, array, rules) for piece, array in zip(tile.pieces, nodes, strict=True))
    fused = _with_orientation(fuse(pairs, tile.work.shape, cell, rules.fusion), pairs, tile)
    # After fusion, not before: a single pair cannot distinguish a chimney from a wrong match, two that agree can.
    spiky = spikes(fused.height, cell, rules.spikes)
    cells = _cropped(fill(_without(fused, spiky), cell, rules.fill), tile)
    inner = _inner(tile)
    statistics = _statistics(cells, int(spiky[inner].sum()), cell)
    return SurfaceCells(cells.height, cells.precision, cells.count, cells.provenance, statistics)


def _pair_cells(tile: SurfaceTile, piece: PairPiece, nodes: np.ndarray, rules: SurfaceRules) -> HeightCells:
    # The heights of the surface bound what is believed: a wrong match at the end of the parallax range can lie far above any roof.
    ground = nodes_on_ground(piece.pair, nodes, piece.nodes, piece.step)
    target = TargetCells(tile.surface.grid, tile.work, (tile.surface.height_low, tile.surface.height_high))
    return grid_nodes(ground, ground_pixel(piece.pair) * piece.step, target, rules.gridding)


def _with_orientation(cells: FusedCells, pairs: tuple[HeightCells, ...], tile: SurfaceTile) -> FusedCells:
    """The cells with the orientation part added to their standard errors: mean variance over the pairs that see a cell."""
    x, y = np.meshgrid(*tile.surface.grid.centres(tile.work))
    total, count = np.zeros(tile.work.shape), np.zeros(tile.work.shape)
    for piece, pair in zip(tile.pieces, pairs, strict=True):
        seen = np.isfinite(pair.height)
        total[seen] += orientation_sigma(piece.pair, x[seen], y[seen], cells.height[seen]) ** 2
        count += seen
    # The mean of the variances, not the variance of a mean: the datum and the camera constant move all pairs alike, and no number
    # of pairs averages that out.
    precision = np.sqrt(cells.precision**2 + total / np.maximum(count, 1.0)).astype(np.float32)
    return FusedCells(cells.height, precision, cells.count, cells.provenance)


def _without(cells: FusedCells, spiky: np.ndarray) -> FusedCells:
    """The cells with the spikes (rows, cols) bool emptied."""
    empty = np.float32(np.nan)
    return FusedCells(
        np.where(spiky, empty, cells.height),
        np.where(spiky, empty, cells.precision),
        np.where(spiky, np.uint8(0), cells.count),
        np.where(spiky, np.uint8(Provenance.EMPTY), cells.provenance),
    )


def _inner(tile: SurfaceTile) -> tuple[slice, slice]:
    """The tile's own cells in the computed ones."""
    row, col = tile.window.row - tile.work.row, tile.window.col - tile.work.col
    return slice(row, row + tile.window.height), slice(col, col + tile.window.width)


def _cropped(cells: FusedCells, tile: SurfaceTile) -> FusedCells:
    inner = _inner(tile)
    return FusedCells(cells.height[inner], cells.precision[inner], cells.count[inner], cells.provenance[inner])


def _statistics(cells: FusedCells, spiky: int, cell: float) -> SurfaceStatistics:
    known = np.isfinite(cells.height)
    # Classes are relative to the cell, so one histogram serves a drone block and an aerial block alike.
    classes = np.minimum(cells.precision[known] / (0.1 * cell), CLASSES - 1).astype(int)
    return SurfaceStatistics(
        provenance=tuple(np.bincount(cells.provenance.ravel(), minlength=len(Provenance)).tolist()),
        precision=tuple(np.bincount(classes, minlength=CLASSES).tolist()),
        spikes=spiky,
        lowest=float(cells.height[known].min()) if known.any() else None,
        highest=float(cells.height[known].max()) if known.any() else None,
    )


def sum_surface(parts: tuple[SurfaceStatistics, ...]) -> SurfaceStatistics:
    """The statistics of all tiles together."""
    # A tile without heights has no extremes; it must not enter them as zero.
    lows, highs = [p.lowest for p in parts if p.lowest is not None], [p.highest for p in parts if p.highest is not None]
    return SurfaceStatistics(
        provenance=tuple(map(sum, zip(*(part.provenance for part in parts), strict=True))),
        precision=tuple(map(sum, zip(*(part.precision for part in parts), strict=True))),
        spikes=sum(part.spikes for part in parts),
        lowest=min(lows, default=None),
        highest=max(highs, default=None),
    )
