"""A block of nodes: which photographs it reads, where its first node lies, and its heights.

Strategy: blocks lie on a fixed grid of the surface and each is a chain of its own, entered at the node next to the tie point that
is nearest to its middle. So blocks run side by side, a wrong height is handed on within one block only, and neither the tiles of
the project nor the number of workers change anything.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.errors import GeometryError
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.observations import GroundPoints
from orthomill.schemas.orientation import Block
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.photo import Photos
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import Surface
from orthomill.tasks.densification.line_locus.node_markers import marked_picture
from orthomill.tasks.densification.settings.line_locus_settings import LineLocus
from orthomill.tasks.densification.volume.photograph_choice import base_height, preferred, sight
from orthomill.tasks.densification.volume.terrain import at_cells, places_around, terrain_grid
from orthomill.tasks.geometry.footprint import photo_window
from orthomill.tasks.geometry.photograph_part import PhotoPart, level_window
from orthomill.tasks.geometry.view import View, block_view
from orthomill.tasks.imagery.pyramid import level_shape
from orthomill.tasks.imagery.radiometry import grey
from orthomill.tasks.matching.line_locus.ground_windows import NodeArea, as_taken, to_plane
from orthomill.tasks.matching.line_locus.line_locus import FoundHeights, NodeLines, found_heights
from orthomill.tasks.matching.line_locus.node_order import visits
from orthomill.tasks.matching.line_locus.window_correlation import GreyImages
from orthomill.tasks.matching.volume.rectified_photograph import PhotographPixels

CORRELATION_CLASSES = 20
"""classes of the absolute value of a correlation, from 0 to 1"""
_TYPICAL = 0.25
"""share of the reach within which four of five heights lie: a first round that covers all of it has so many heights that some
window is alike by chance, and the threshold then rejects twice as many nodes"""
_SAMPLES = 5
"""places along each side of a block at which photographs are compared"""


@dataclass(frozen=True, eq=False)
class LocusScene:
    """What all blocks are planned from."""

    block: Block
    photos: Photos
    surface: Surface
    asked: LineLocus

    @cached_property
    def settings(self) -> LineLocus:
        """What was asked for, with windows of a known size."""
        return self.asked.sized(self.base)

    @cached_property
    def views(self) -> tuple[View, ...]:
        """The oriented photographs that are there on the pyramid level, in the order of the block."""
        views = (block_view(self.block, name) for name in self.block.names)
        return tuple(view for view in views if self.photos[view.name].levels > self.asked.level)

    @cached_property
    def pixel(self) -> float:
        """Ground pixel of the level at the mean height of the ground, m: the median of the photographs."""
        above = [max(view.centre[2] - self.block.ground_mean, 1e-6) / view.camera.c for view in self.views]
        return float(np.median(above)) * 2**self.asked.level if above else self.surface.grid.cell

    @cached_property
    def base(self) -> float:
        """Widest base over height of the photographs that are compared."""
        return base_height(self.views, self.surface.grid, self.block.ground_mean, self.asked.photographs)

    @property
    def metres_per_pixel(self) -> float:
        """Height that a pixel of parallax stands for, m."""
        return self.pixel / self.base

    @property
    def window_cells(self) -> float:
        """Side of a window in cells of the surface."""
        return (2 * self.settings.half + 1) * self.pixel / self.surface.grid.cell


def check_search(scene: LocusScene) -> None:
    """Raise GeometryError for a pyramid level that no photograph has, a first step that spans all heights at once, and windows that
    no photograph can hold."""
    if not scene.views:
        coarsest = max(scene.photos[name].levels for name in scene.block.names) - 1
        raise GeometryError(f"No photograph has pyramid level {scene.asked.level}, the coarsest is {coarsest}; set a finer level.")
    settings, surface = scene.settings, scene.surface
    step, relief = float(settings.spacings(scene.metres_per_pixel)[0]), surface.height_high - surface.height_low
    if step > relief:
        raise GeometryError(
            f"The first step of vertical line locus is {step:.2f} m, but the heights of the surface span only {relief:.2f} m; set "
            "a smaller step, or leave it to the photographs (step: auto)."
        )
    sizes = [min(view.camera.width, view.camera.height) // 2**settings.level for view in scene.views]
    if sizes and settings.window >= max(sizes):
        raise GeometryError(
            f"Windows of {settings.window} px do not fit into the photographs, whose shorter side is {max(sizes)} px on pyramid "
            f"level {settings.level}; set a smaller window or a finer level."
        )


@dataclass(frozen=True)
class LocusBlock:
    """A block of nodes: its cells, its photographs, the best ones first, and the ground pixel and the height of a parallax."""

    surface: Surface
    row: int
    col: int
    window: Window
    photos: tuple[PhotoPart, ...]
    pixel: float
    metres_per_pixel: float

    @property
    def area(self) -> NodeArea:
        """The rectangle of the nodes' centres, m, with the heights that are possible."""
        x, y = self.surface.grid.centres(self.window)
        bounds = float(x[0]), float(y[-1]), float(x[-1]), float(y[0])
        return NodeArea(bounds, self.surface.height_low, self.surface.height_high)


class LineStatistics(BaseModel):
    """Counts of the nodes of a block or of all blocks."""

    model_config = ConfigDict(frozen=True)

    outcomes: tuple[int, ...] = (0,) * len(Outcome)
    """nodes by code of Outcome"""
    accepted: tuple[int, ...] = (0,) * CORRELATION_CLASSES
    rejected: tuple[int, ...] = (0,) * CORRELATION_CLASSES
    """nodes by class of the absolute value of their correlation"""
    limits: tuple[int, ...] = (0,) * CORRELATION_CLASSES
    """nodes by class of the correlation from which on they counted as found"""


class SolvedLines(NamedTuple):
    """A block: `nodes` (rows, cols, 4) float32: height m and standard error m, NaN unless accepted; correlation and its limit, NaN
    where no height could be compared; `photographs` uint8; `outcome` uint8 codes of Outcome; `markers` uint8, the picture of
    `marked_picture`."""

    nodes: np.ndarray
    photographs: np.ndarray
    outcome: np.ndarray
    markers: np.ndarray
    statistics: LineStatistics


def locus_block(scene: LocusScene, row: int, col: int, window: Window) -> LocusBlock:
    """A block with the photographs that show it best."""
    x, y = _sampled(scene.surface.grid, window)
    z = [scene.block.ground_low, scene.block.ground_high]
    points = np.stack(np.meshgrid(x, y, z), axis=-1).reshape(-1, 3)
    seen = sight(scene.views, points, scene.surface.grid.cell * max(window.shape) / 2)
    numbers = preferred(seen, scene.settings.photographs)
    # Those of the middle come first, for they serve most nodes; others follow for the corners.
    order = [*numbers[len(points) // 2], *numbers.T.ravel()]
    views = [scene.views[k] for k in dict.fromkeys(k for k in order if k >= 0)]
    parts = [_part(view, window, scene) for view in views]
    used = tuple(part for part in parts if not part.window.empty)
    return LocusBlock(
        surface=scene.surface,
        row=row,
        col=col,
        window=window,
        photos=used,
        pixel=scene.pixel,
        metres_per_pixel=scene.metres_per_pixel,
    )


def _sampled(grid: MapGrid, window: Window) -> tuple[np.ndarray, np.ndarray]:
    x, y = grid.centres(window)
    return tuple(axis[np.linspace(0, len(axis) - 1, _SAMPLES).astype(int)] for axis in (x, y))


def _part(view: View, window: Window, scene: LocusScene) -> PhotoPart:
    level, photo, surface = scene.settings.level, scene.photos[view.name], scene.surface
    # Half a diagonal: windows with the axes of the map are turned in the photograph.
    margin = (int(1.5 * scene.settings.half) + 8) * 2**level
    full = photo_window(view, surface.grid, window, surface.height_low, surface.height_high, margin)
    return PhotoPart(view.name, level, level_window(full, level, level_shape((photo.height, photo.width), level)))


def solve_lines(
    block: LocusBlock,
    settings: LineLocus,
    orientation: Block,
    photos: tuple[np.ndarray, ...] = (),
    points: GroundPoints | None = None,
    terrain: np.ndarray | None = None,
    reach: np.ndarray | None = None,
    factor: int = 1,
) -> SolvedLines:
    """The heights of a block. photos: pixels (rows, cols, bands) of `block.photos`; points: the tie points, for lines that are
    entered at the height of the node before; terrain: heights (rows, cols) of the places around the block, for those entered on it;
    reach (rows, cols, 2): how far from an existing model heights may lie there; the first round covers what is usual of it;
    factor: pixels of the picture of markers along the side of a cell."""
    views = [block_view(orientation, part.name) for part in block.photos]
    parts = [
        (PhotographPixels(grey(pixels), part.level, part.window.col, part.window.row), view)
        for part, view, pixels in zip(block.photos, views, photos, strict=True)
    ]
    if settings.alignment == "ground":
        images = to_plane(parts, block.area, block.pixel, settings.half)
    else:
        images = [as_taken(pixels, view) for pixels, view in parts]
    first, start = _entered(block, settings, orientation, points, terrain)
    x, y = block.surface.grid.centres(block.window)
    lines = NodeLines(x, y, start, block.surface.height_low, block.surface.height_high)
    order = visits(*block.window.shape, first, settings.order)
    beside = None if reach is None else settings.first_points(_TYPICAL * float(np.median(reach)), block.metres_per_pixel)
    found = found_heights(GreyImages.of(images), lines, order, settings, block.metres_per_pixel, beside)
    markers = marked_picture(images, lines, block.surface.grid.cell, found, factor)
    accepted = found.outcome == Outcome.CONVERGED
    height, sigma = (np.where(accepted, values, np.float32(np.nan)) for values in (found.height, found.sigma))
    nodes = np.stack([height, sigma, found.correlation, found.limit], axis=-1)
    return SolvedLines(nodes, found.photographs, found.outcome, markers, _statistics(found))


def _entered(
    block: LocusBlock, settings: LineLocus, orientation: Block, points: GroundPoints | None, terrain: np.ndarray | None
) -> tuple[tuple[int, int], np.ndarray]:
    """The first node, and the heights (rows, cols) at which lines are entered, NaN for that of the node before."""
    window, grid = block.window, block.surface.grid
    if settings.start == "terrain":
        assert terrain is not None
        places = terrain_window(block)
        return (0, 0), at_cells(terrain, places, window, 1).astype(np.float64)
    start = np.full(window.shape, np.nan)
    row, col, height = window.height // 2, window.width // 2, orientation.ground_mean
    if points is not None and len(points):
        at_col, at_row = grid.pixel(points.x, points.y)
        away = np.hypot(at_col - (window.col + col), at_row - (window.row + row))
        nearest = int(np.argmin(np.where(np.isfinite(points.z), away, np.inf)))
        height = float(points.z[nearest])
        row = int(np.clip(np.rint(at_row[nearest]) - window.row, 0, window.height - 1))
        col = int(np.clip(np.rint(at_col[nearest]) - window.col, 0, window.width - 1))
    start[row, col] = np.clip(height, block.surface.height_low, block.surface.height_high)
    return (row, col), start


def terrain_window(block: LocusBlock) -> Window:
    """The places of the terrain between which the nodes of a block lie."""
    return places_around(block.window, 1, terrain_grid(block.surface.grid).shape)


def _classes(correlation: np.ndarray) -> tuple[int, ...]:
    classes = np.minimum(np.abs(correlation) * CORRELATION_CLASSES, CORRELATION_CLASSES - 1).astype(int)
    return tuple(np.bincount(classes, minlength=CORRELATION_CLASSES).tolist())


def _statistics(found: FoundHeights) -> LineStatistics:
    accepted, rejected = found.outcome == Outcome.CONVERGED, found.outcome == Outcome.LOW_CORRELATION
    return LineStatistics(
        outcomes=tuple(np.bincount(found.outcome.ravel(), minlength=len(Outcome)).tolist()),
        accepted=_classes(found.correlation[accepted]),
        rejected=_classes(found.correlation[rejected]),
        limits=_classes(found.limit[accepted | rejected]),
    )


def sum_lines(parts: tuple[LineStatistics, ...]) -> LineStatistics:
    """The statistics of all blocks together."""
    return LineStatistics(
        **{
            name: tuple(map(sum, zip(*(getattr(part, name) for part in parts), strict=True)))
            for name in LineStatistics.model_fields
        }
    )


def lines_scratch(block: LocusBlock, settings: LineLocus, factor: int) -> int:
    """Working memory of `solve_lines`, bytes."""
    # Grey values of every photograph, its image on the plane and the row of all pixels; the search per node, the picture of
    # markers.
    pixels = sum(part.window.cells for part in block.photos)
    markers = array_bytes(16, 256, 48)
    return array_bytes(20, pixels) + array_bytes(64 + 12 * factor**2, block.window) + array_bytes(8, settings.pixels) + markers
