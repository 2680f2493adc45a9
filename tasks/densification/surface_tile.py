"""One tile of the surface model: the pairs' nodes to cells, the pairs fused, spikes out, gaps filled if that is asked for."""

from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.raster import Window
from orthomill.schemas.surface import PROVENANCE_CODES, Surface
from orthomill.tasks.densification.filling import Filling, fill
from orthomill.tasks.densification.fusion import EMPTY, FusedCells, Fusion, fuse
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
        """Cells around a tile that can change it; cell: m."""
        return self.spikes.halo + self.fill.reach(cell) + 1


class SurfaceStatistics(BaseModel):
    """Counts of cells of a tile or of the whole surface."""

    model_config = ConfigDict(frozen=True)

    provenance: tuple[int, ...] = (0,) * len(PROVENANCE_CODES)
    precision: tuple[int, ...] = (0,) * CLASSES
    spikes: int = 0
    lowest: float | None = None
    highest: float | None = None


@dataclass(frozen=True)
class PairPiece:
    """What a tile reads of a pair: the window of its grid of nodes."""

    pair: EpipolarPair
    nodes: Window
    step: int


@dataclass(frozen=True)
class SurfaceTile:
    """A tile of the surface: its own cells `window`, and `work`, the cells that are computed (with halo, clipped)."""

    surface: Surface
    window: Window
    work: Window
    pieces: tuple[PairPiece, ...]


def surface_scratch(pieces: tuple[PairPiece, ...], work: Window) -> int:
    """Working memory of `make_surface`, bytes."""
    return sum(60 * piece.nodes.height * piece.nodes.width for piece in pieces) + (40 + 24 * len(pieces)) * work.height * work.width


def make_surface(tile: SurfaceTile, rules: SurfaceRules, nodes: tuple[np.ndarray, ...] = ()) -> dict:
    """Height, precision, count and provenance of a tile, and its statistics; nodes: one array per piece."""
    cell = tile.surface.grid.cell
    pairs = tuple(_pair_cells(tile, piece, array, rules) for piece, array in zip(tile.pieces, nodes, strict=True))
    fused = _with_orientation(fuse(pairs, tile.work.shape, cell, rules.fusion), pairs, tile)
    spiky = spikes(fused.height, cell, rules.spikes)
    cells = _cropped(fill(_without(fused, spiky), cell, rules.fill), tile)
    inner = _inner(tile)
    return {
        "height": cells.height,
        "precision": cells.precision,
        "count": cells.count,
        "provenance": cells.provenance,
        "statistics": _statistics(cells, int(spiky[inner].sum()), cell),
    }


def _pair_cells(tile: SurfaceTile, piece: PairPiece, nodes: np.ndarray, rules: SurfaceRules) -> HeightCells:
    ground = nodes_on_ground(piece.pair, nodes, piece.nodes, piece.step)
    target = TargetCells(tile.surface.grid, tile.work, (tile.surface.height_low, tile.surface.height_high))
    return grid_nodes(ground, ground_pixel(piece.pair) * piece.step, target, rules.gridding)


def _with_orientation(cells: FusedCells, pairs: tuple[HeightCells, ...], tile: SurfaceTile) -> FusedCells:
    """The cells with the part of their standard errors that the orientation brings: mean variance of the pairs that see them."""
    x, y = np.meshgrid(*tile.surface.grid.centres(tile.work))
    total, count = np.zeros(tile.work.shape), np.zeros(tile.work.shape)
    for piece, pair in zip(tile.pieces, pairs, strict=True):
        seen = np.isfinite(pair.height)
        total[seen] += orientation_sigma(piece.pair, x[seen], y[seen], cells.height[seen]) ** 2
        count += seen
    precision = np.sqrt(cells.precision**2 + total / np.maximum(count, 1.0)).astype(np.float32)
    return FusedCells(cells.height, precision, cells.count, cells.provenance)


def _without(cells: FusedCells, spiky: np.ndarray) -> FusedCells:
    empty = np.float32(np.nan)
    return FusedCells(
        np.where(spiky, empty, cells.height),
        np.where(spiky, empty, cells.precision),
        np.where(spiky, np.uint8(0), cells.count),
        np.where(spiky, np.uint8(EMPTY), cells.provenance),
    )


def _inner(tile: SurfaceTile) -> tuple[slice, slice]:
    row, col = tile.window.row - tile.work.row, tile.window.col - tile.work.col
    return slice(row, row + tile.window.height), slice(col, col + tile.window.width)


def _cropped(cells: FusedCells, tile: SurfaceTile) -> FusedCells:
    inner = _inner(tile)
    return FusedCells(cells.height[inner], cells.precision[inner], cells.count[inner], cells.provenance[inner])


def _statistics(cells: FusedCells, spiky: int, cell: float) -> SurfaceStatistics:
    known = np.isfinite(cells.height)
    classes = np.minimum(cells.precision[known] / (0.1 * cell), CLASSES - 1).astype(int)
    return SurfaceStatistics(
        provenance=tuple(np.bincount(cells.provenance.ravel(), minlength=len(PROVENANCE_CODES)).tolist()),
        precision=tuple(np.bincount(classes, minlength=CLASSES).tolist()),
        spikes=spiky,
        lowest=float(cells.height[known].min()) if known.any() else None,
        highest=float(cells.height[known].max()) if known.any() else None,
    )


def sum_surface(parts: tuple[SurfaceStatistics, ...]) -> SurfaceStatistics:
    """The statistics of all tiles together."""
    lows, highs = [p.lowest for p in parts if p.lowest is not None], [p.highest for p in parts if p.highest is not None]
    return SurfaceStatistics(
        provenance=tuple(map(sum, zip(*(part.provenance for part in parts), strict=True))),
        precision=tuple(map(sum, zip(*(part.precision for part in parts), strict=True))),
        spikes=sum(part.spikes for part in parts),
        lowest=min(lows, default=None),
        highest=max(highs, default=None),
    )
