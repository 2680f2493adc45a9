"""One tile of the surface model: the pairs' nodes to cells, one pair after the other, fusion near the volume, completion by the
volume, removal of spikes, and estimates for what is left."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.raster import Window
from orthomill.schemas.surface import MEASURED, Provenance, Surface, SurfacePoints
from orthomill.tasks.densification.completion import VolumeWindow, completed
from orthomill.tasks.densification.filling import fill, without
from orthomill.tasks.densification.fusion import FusedCells, fuse
from orthomill.tasks.densification.gridding import HeightCells, TargetCells, grid_nodes
from orthomill.tasks.densification.ground_intersection import NodesOnGround, nodes_on_ground
from orthomill.tasks.densification.height_differences import EVEN_REACH
from orthomill.tasks.densification.height_stack import REACH as STACK_REACH
from orthomill.tasks.densification.height_stack import SLOTS, HeightStack
from orthomill.tasks.densification.points import PointCollector
from orthomill.tasks.densification.precision.datum_precision import datum_precision
from orthomill.tasks.densification.precision.estimate_errors import GUESS_REACH, groundless, with_shown, with_surroundings
from orthomill.tasks.densification.precision.matched_ground import matched_ground
from orthomill.tasks.densification.precision.pair_differences import NO_DIFFERENCES, MatchingDifferences
from orthomill.tasks.densification.precision.standard_errors import REACH, matched_error, relative_precision
from orthomill.tasks.densification.precision.wall_blind_errors import wall_blind_precision
from orthomill.tasks.densification.settings.surface_settings import (
    Completion,
    EstimateGaps,
    Fusion,
    Gridding,
    MeasuredOnly,
    PointThinning,
    SpikeFilter,
)
from orthomill.tasks.densification.spike_filter import spikes
from orthomill.tasks.densification.surface_grid import ground_pixel
from orthomill.tasks.densification.wall_foot import volume_share, with_volume
from orthomill.tasks.densification.water.water_levels import NO_WATER, WaterLevels, levelled

CLASSES = 20
"""classes of the precision histogram, each a tenth of a cell wide; the last is open"""


@dataclass(frozen=True)
class SurfaceRules:
    """From the matched pairs to the surface model."""

    gridding: Gridding
    fusion: Fusion
    completion: Completion
    spikes: SpikeFilter
    fill: MeasuredOnly | EstimateGaps
    points: PointThinning

    @property
    def halo(self) -> int:
        """Cells around a tile that influence it."""
        # One cell more than filters, surroundings and filling look at: gridding takes cell centres on the edge of a triangle.
        return STACK_REACH + self.spikes.halo + EVEN_REACH + max(REACH + self.fill.reach, GUESS_REACH) + 1


class SurfaceStatistics(BaseModel):
    """Counts of cells of a tile or of the whole surface."""

    model_config = ConfigDict(frozen=True)

    provenance: tuple[int, ...] = (0,) * len(Provenance)
    """cells by code of Provenance"""
    precision: tuple[int, ...] = (0,) * CLASSES
    """measured cells by class of their standard error among neighbours"""
    datum: tuple[int, ...] = (0,) * CLASSES
    """measured cells by class of what the orientation adds"""
    spikes: int = 0
    lowest: float | None = None
    highest: float | None = None
    """m"""


@dataclass(frozen=True)
class PairPiece:
    """What a tile reads of a pair: the window of its grid of nodes."""

    number: int
    """of the pair in the list of all pairs"""
    pair: EpipolarPair
    nodes: Window
    step: int


@dataclass(frozen=True)
class SurfaceTile:
    """A tile of the surface: its own cells `window`, and the cells `work` that are computed (with halo, clipped to the grid).

    pieces: the pairs that can show it.
    """

    surface: Surface
    window: Window
    work: Window
    pieces: tuple[PairPiece, ...]
    ground: float
    """mean height of the ground, m"""
    step: float
    """between the heights of the volume, m"""
    window_cells: int = 0
    """cells along the side of windows that know no walls; 0: windows keep to one surface"""


class SurfaceCells(NamedTuple):
    """A finished tile (rows, cols): height and standard errors (total, among neighbours, of the datum) float32 m, NaN where empty;
    number of agreeing pairs and provenance uint8."""

    height: np.ndarray
    precision: np.ndarray
    relative: np.ndarray
    datum: np.ndarray
    pairs: np.ndarray
    provenance: np.ndarray
    statistics: SurfaceStatistics
    points: SurfacePoints


def surface_scratch(pieces: tuple[PairPiece, ...], work: Window) -> int:
    """Working memory of `make_surface`, bytes."""
    # The pairs come one by one. Per node x, y, z, column and row in float64, sigma and parallax in float32 with their copies; per
    # cell the slots (float64 and float32), one pair's heights, and some twenty float64 arrays of filters and standard errors.
    largest = max((array_bytes(60, piece.nodes) for piece in pieces), default=0)
    return largest + array_bytes(12 * SLOTS + 200, work)


def make_surface(
    tile: SurfaceTile,
    rules: SurfaceRules,
    height: np.ndarray,
    judgement: np.ndarray,
    confidence: np.ndarray,
    nodes: Iterator[np.ndarray],
    differences: MatchingDifferences = NO_DIFFERENCES,
    water: WaterLevels = NO_WATER,
) -> SurfaceCells:
    """The cells of a tile with their statistics.

    height, judgement, confidence: the volume over `tile.work`, see `VolumeWindow`; nodes: one array (rows, cols, 3) float32 per
    piece, in their order; differences: of the pairs of the block; water: what is outlined.
    """
    grid, volume = tile.surface.grid, VolumeWindow(height, judgement, confidence)
    cell = grid.cell
    stack = empty_stack(volume, rules, cell)
    photos = tuple(dict.fromkeys(name for piece in tile.pieces for name in (piece.pair.left, piece.pair.right)))
    collector = PointCollector(grid, tile.window, photos, rules.points)
    for piece, array in zip(tile.pieces, nodes, strict=True):
        ground = nodes_on_ground(piece.pair, array, piece.nodes, piece.step)
        stack.add(gridded(ground, piece, tile, rules.gridding))
        collector.add(piece.number, piece.pair, ground, _accepted(ground, tile, stack))
    fused = fuse(stack, cell, rules.fusion)
    # After fusion, not before: a single pair cannot distinguish a chimney from a wrong match, two that agree can.
    spiky = spikes(fused.height, cell, rules.spikes)
    measured = completed(without(fused, spiky), volume, cell)
    cells, datum, statistics = finished_cells(measured, volume, spiky, tile, rules, differences, water)
    points = collector.points(cells.provenance)
    return surface_cells(cells, datum, statistics, points)


def empty_stack(volume: VolumeWindow, rules: SurfaceRules, cell: float) -> HeightStack:
    """What the pairs of a tile are added to; cell: its side, m."""
    # A height of a coarser level stands for all that its cells hold.
    return HeightStack.over(volume.height, np.float32(rules.completion.nearness * cell) * volume.size)


def gridded(ground: NodesOnGround, piece: PairPiece, tile: SurfaceTile, gridding: Gridding) -> HeightCells:
    """The heights of one pair in the cells `tile.work`."""
    target = TargetCells(tile.surface.grid, tile.work, (tile.surface.height_low, tile.surface.height_high))
    return grid_nodes(ground, ground_pixel(piece.pair) * piece.step, target, gridding)


def finished_cells(
    measured: FusedCells,
    volume: VolumeWindow,
    spiky: np.ndarray,
    tile: SurfaceTile,
    rules: SurfaceRules,
    differences: MatchingDifferences = NO_DIFFERENCES,
    water: WaterLevels = NO_WATER,
) -> tuple[FusedCells, np.ndarray, SurfaceStatistics]:
    """The tile's own cells with standard errors and estimates, the standard error of the datum (rows, cols) m, and their counts.

    measured: the cells `tile.work` with what matching found; spiky (rows, cols) bool: those that were removed as spikes.
    """
    grid = tile.surface.grid
    rated = _rated(measured, volume, tile, differences)
    incoherent = rated.provenance == Provenance.INCOHERENT
    whole = fill(rated, volume.stray & incoherent, groundless(rated, grid.cell) & incoherent, rules.fill)
    cells = _cropped(with_surroundings(whole, volume.alone, grid.cell), tile)
    cells = levelled(cells, water, grid, tile.window)
    # Last of all: what lies outside is neighbourhood of what lies inside.
    cells = without(cells, ~tile.surface.wanted.cells(grid, tile.window))
    datum = datum_precision([piece.pair for piece in tile.pieces], grid, tile.window, tile.ground)
    datum = np.where(np.isfinite(cells.height), datum, np.float32(np.nan))
    return cells, datum, _statistics(cells, datum, int(spiky[_inner(tile)].sum()), grid.cell)


def _rated(measured: FusedCells, volume: VolumeWindow, tile: SurfaceTile, differences: MatchingDifferences) -> FusedCells:
    """The cells with their standard errors among neighbours, and with the volume at the foot of walls."""
    if tile.window_cells:
        relative = wall_blind_precision(measured, volume, tile.window_cells)
        return FusedCells(measured.height, relative, measured.count, measured.provenance)
    ground = matched_ground(measured, tile.step, tile.surface.grid.cell)
    matched = matched_error(measured, volume, ground, differences)
    share = volume_share(measured, volume, ground, matched)
    relative = relative_precision(measured, volume, ground, matched * np.sqrt(1 - share))
    height = with_volume(measured.height, volume, share)
    return with_shown(FusedCells(height, relative, measured.count, measured.provenance), volume, ground)


def surface_cells(cells: FusedCells, datum: np.ndarray, statistics: SurfaceStatistics, points: SurfacePoints) -> SurfaceCells:
    """A finished tile: its total standard error is that among neighbours and that of the datum."""
    precision = np.hypot(cells.precision, datum)
    return SurfaceCells(
        height=cells.height,
        precision=precision,
        relative=cells.precision,
        datum=datum,
        pairs=cells.count,
        provenance=cells.provenance,
        statistics=statistics,
        points=points,
    )


def _accepted(ground: NodesOnGround, tile: SurfaceTile, stack: HeightStack) -> np.ndarray:
    """(rows, cols) bool: nodes near the volume in their own cell."""
    col, row = tile.surface.grid.pixel(ground.x, ground.y)
    inside = np.isfinite(ground.z)
    row, col = (
        np.rint(np.where(inside, at, 0.0)).astype(np.int64) - first for at, first in ((row, tile.work.row), (col, tile.work.col))
    )
    inside &= (row >= 0) & (col >= 0) & (row < tile.work.height) & (col < tile.work.width)
    row, col = np.where(inside, row, 0), np.where(inside, col, 0)
    return inside & stack.near(row, col, ground.z)


def _inner(tile: SurfaceTile) -> tuple[slice, slice]:
    """The tile's own cells in the computed ones."""
    return tile.window.within(tile.work).slices


def _cropped(cells: FusedCells, tile: SurfaceTile) -> FusedCells:
    inner = _inner(tile)
    return FusedCells(cells.height[inner], cells.precision[inner], cells.count[inner], cells.provenance[inner])


def _classes(sigma: np.ndarray, cell: float) -> tuple[int, ...]:
    # Classes are relative to the cell, so one histogram serves a drone block and an aerial block alike.
    classes = np.minimum(sigma / (0.1 * cell), CLASSES - 1).astype(int)
    return tuple(np.bincount(classes, minlength=CLASSES).tolist())


def _statistics(cells: FusedCells, datum: np.ndarray, spiky: int, cell: float) -> SurfaceStatistics:
    known, measured = np.isfinite(cells.height), np.isin(cells.provenance, MEASURED)
    return SurfaceStatistics(
        provenance=tuple(np.bincount(cells.provenance.ravel(), minlength=len(Provenance)).tolist()),
        precision=_classes(cells.precision[measured], cell),
        datum=_classes(datum[measured], cell),
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
        datum=tuple(map(sum, zip(*(part.datum for part in parts), strict=True))),
        spikes=sum(part.spikes for part in parts),
        lowest=min(lows, default=None),
        highest=max(highs, default=None),
    )
