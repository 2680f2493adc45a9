"""One tile of a level of the height volume: what it reads, and its heights.

Strategy: tiles lie on a fixed grid of their level with a fixed halo, so that the tile size of the project changes nothing. A tile
reads the photographs chosen for it, on the pyramid level that its cells need, and the heights of the next coarser level, which
narrow its ranges and say which photographs do not see a cell.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from orthomill.schemas.memory import MIB, array_bytes
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import Tile, Window, tiles_of
from orthomill.tasks.densification.volume.levels import HALO, SIDE, VolumeLevel, VolumeScene, coarser_window, level_grid
from orthomill.tasks.densification.volume.photograph_choice import PLACE, places, preferred, sight
from orthomill.tasks.densification.volume.quality import Band, quality_bands
from orthomill.tasks.densification.volume.terrain import SPACING, at_cells, places_around, terrain_grid
from orthomill.tasks.geometry.footprint import photo_window
from orthomill.tasks.geometry.photograph_part import PhotoPart, level_window, photo_level
from orthomill.tasks.geometry.view import View, block_view
from orthomill.tasks.imagery.pyramid import level_shape
from orthomill.tasks.imagery.radiometry import grey
from orthomill.tasks.matching.volume.candidates import CellRanges, all_planes, bounded, narrowed
from orthomill.tasks.matching.volume.costs import Choice, PhotographStack
from orthomill.tasks.matching.volume.height_volume import OptimisedCells, optimised, ranges_of, scratch_bytes
from orthomill.tasks.matching.volume.rectified_photograph import (
    CellFrame,
    PhotographPixels,
    RectifiedPhotograph,
    rectified,
    rectified_pixels,
)
from orthomill.tasks.matching.volume.signatures import signatures
from orthomill.tasks.matching.volume.volume_settings import HeightVolume
from orthomill.tasks.matching.volume.wall_sides import HALF, LEAST, Lookouts, decided, wall_sides
from orthomill.tasks.matching.volume.wall_sides import SPACING as SMALL_SPACING
from orthomill.tasks.matching.volume.winners import coherence
from orthomill.tasks.visibility.height_model import HeightModel, Targets, visible_targets

HIDING = 4.0
"""Heights of a level by which something must stand above the ray to a photograph to hide the cell from it."""

MOST_MEMORY = 800 * MIB
"""of a tile with its photographs, so that one worker of the usual memory solves it beside what its process takes"""

_OUTSIDE = -1e6
"""px; places behind a camera are outside its frame by this, a number that can be interpolated"""


@dataclass(frozen=True)
class VolumeTile:
    """A tile of a level: its own cells `window`, the cells `work` that are optimised, the photographs, the window of the coarser
    level (None: there is none), and the places of the terrain around it."""

    level: VolumeLevel
    row: int
    col: int
    window: Window
    work: Window
    photos: tuple[PhotoPart, ...]
    coarser: Window | None
    places: Window


class SolvedVolume(NamedTuple):
    """A solved tile: `height` (rows, cols) float32 m, NaN where fewer than two photographs show the cell; `quality` (rows, cols, 5)
    uint8, see `Band`."""

    height: np.ndarray
    quality: np.ndarray


def volume_tiles(level: VolumeLevel, scene: VolumeScene) -> tuple[VolumeTile, ...]:
    """The tiles of a level with the photographs chosen for them; fewer than two photographs: none."""
    return tuple(_tile(level, tile, scene) for tile in tiles_of(level.grid.shape, SIDE))


def _tile(level: VolumeLevel, tile: Tile, scene: VolumeScene) -> VolumeTile:
    work = tile.window.grown(HALO).clipped(level.grid.shape)
    chosen = [(_part(view, level, work, scene), needed) for view, needed in _chosen(level, work, scene)]
    coarsest = level.number == scene.levels[0].number
    coarser = None if coarsest else coarser_window(work, scene.settings.reach, level_grid(level.grid, 1).shape)
    terrain = places_around(work, 2**level.number, terrain_grid(scene.surface.grid).shape)
    found = VolumeTile(
        level=level, row=tile.row, col=tile.col, window=tile.window, work=work, photos=(), coarser=coarser, places=terrain
    )
    used = _fitting(found, {part: needed for part, needed in chosen if not part.window.empty}, scene)
    return (
        found if len(used) < 2 else replace(found, photos=tuple(sorted(used, key=lambda part: scene.block.names.index(part.name))))
    )


def _fitting(tile: VolumeTile, needed: dict[PhotoPart, int], scene: VolumeScene) -> list[PhotoPart]:
    """The photographs that a worker holds together, of those that a tile needs at so many places.

    Photographs that look along the ground show a deep tile in very many pixels: the first that stay out of it are those with the
    fewest places for their pixels.
    """
    used = list(needed)
    pixels = {part: _rectified_pixels(tile, part, scene) for part in used}
    used.sort(key=lambda part: (-needed[part] / max(pixels[part], 1), scene.block.names.index(part.name)))
    while (
        len(used) > 2 and sum(_tile_memory(replace(tile, photos=tuple(used)), [pixels[part] for part in used], scene)) > MOST_MEMORY
    ):
        used.pop()
    return used


def _chosen(level: VolumeLevel, work: Window, scene: VolumeScene) -> list[tuple[View, int]]:
    """The photographs that are preferred at any place of a tile, at the lowest or the highest ground of the block, and at how many
    places."""
    x, y = places(level.grid, work)
    views = [
        view for view, bounds in zip(scene.views, scene.bounds, strict=True) if _overlap(bounds, x, y, level.grid.cell * PLACE)
    ]
    if not views:
        return []
    heights = [scene.block.ground_low, scene.block.ground_high]
    points = np.stack(np.meshgrid(x, y, heights), axis=-1).reshape(-1, 3)
    numbers = preferred(sight(views, points, 0.75 * PLACE * level.grid.cell), scene.settings.photographs)
    needed = np.bincount(numbers[numbers >= 0], minlength=len(views))
    return [(view, int(count)) for view, count in zip(views, needed, strict=True) if count]


def _overlap(bounds: tuple[float, float, float, float], x: np.ndarray, y: np.ndarray, spare: float) -> bool:
    west, south, east, north = bounds
    return west <= x[-1] + spare and east >= x[0] - spare and south <= y[0] + spare and north >= y[-1] - spare


def _part(view: View, level: VolumeLevel, work: Window, scene: VolumeScene) -> PhotoPart:
    photo, heights = scene.photos[view.name], level.heights
    ground_pixel = max(view.centre[2] - scene.block.ground_mean, 1e-6) / view.camera.c
    number = photo_level(level.grid.cell / scene.settings.oversampling, ground_pixel, photo.levels)
    full = photo_window(view, level.grid, work, heights[0], heights[-1], _margin(number))
    return PhotoPart(view.name, number, level_window(full, number, level_shape((photo.height, photo.width), number)))


def _margin(level: int) -> int:
    """Pixels of the full photograph around what a tile shows: for the interpolation, and for the window of the signature."""
    return 8 * 2**level


def solve_volume(
    tile: VolumeTile,
    settings: HeightVolume,
    block: Block,
    photos: tuple[np.ndarray, ...] = (),
    terrain: np.ndarray | None = None,
    coarser: np.ndarray | None = None,
    reach: np.ndarray | None = None,
) -> SolvedVolume:
    """The heights of a tile. photos: pixels (rows, cols, bands) of `tile.photos`; terrain: heights (rows, cols) of `tile.places`;
    coarser: heights (rows, cols) of `tile.coarser`; reach (rows, cols, 2): how far below and above the terrain heights can lie,
    None: anywhere."""
    if terrain is None or len(photos) < 2:
        return nothing(tile.window.shape)
    views = [block_view(block, part.name) for part in tile.photos]
    candidates = _candidates(tile, settings, coarser)
    if reach is not None:
        candidates = _near_guide(candidates, tile, terrain, reach)
    candidates = candidates.only(_shown_twice(tile, views, terrain))
    # Planning allows for the lowest and the highest ground of the block; at the ground of the tile fewer photographs are compared.
    preferred = _preferred(tile, views, settings, block, coarser)
    used = np.unique(preferred[preferred >= 0])
    if candidates.offset[-1] == 0 or len(used) < 2:
        return nothing(tile.window.shape)
    tile = replace(tile, photos=tuple(tile.photos[number] for number in used))
    views, photos = [views[number] for number in used], tuple(photos[number] for number in used)
    preferred = np.where(preferred >= 0, np.searchsorted(used, preferred), -1)
    candidates, planes = candidates.trimmed()
    heights = tile.level.heights[planes]
    parts = zip(tile.photos, views, photos, strict=True)
    # One after the other: a tile of a dense block has dozens of photographs, and only their signatures are needed together.
    images = (_rectified(tile, part, view, pixels, heights, settings) for part, view, pixels in parts)
    pixels = sum(rectified_pixels(view, _cell_frame(tile), heights, settings.oversampling) for view in views)
    choice = Choice(PLACE, preferred, _hidden(tile, views, coarser))
    cells = optimised(images, pixels, choice, candidates, settings)
    height = (float(heights[0]) + cells.plane.astype(np.float64) * tile.level.step).astype(np.float32)
    # What a coarser level says of an edge is looked at again by the next one anyway.
    sides = wall_sides(height, LEAST * tile.level.step) if tile.level.number == 0 else None
    if sides is None or not sides.near.any():
        return _solved(tile, cells, height, settings)
    small = settings.model_copy(update={"window": 2 * HALF + 1, "spacing": SMALL_SPACING})
    parts = zip(tile.photos, views, photos, strict=True)
    stack = PhotographStack.of((_rectified(tile, *part, heights, small) for part in parts), pixels, HALF)
    upper = decided(height, sides, stack, choice, candidates, heights, _lookouts(tile, views))
    moved = sides.contradicted(height, upper)
    # Where the two looks contradict each other nothing is distinct.
    cells = cells._replace(margin=np.where(moved, np.float32(0), cells.margin))
    return _solved(tile, cells, np.where(moved, np.where(upper, sides.upper, sides.lower), height), settings)


def _lookouts(tile: VolumeTile, views: list[View]) -> Lookouts:
    frame, centres = _cell_frame(tile), np.array([view.centre for view in views])
    col, row = (centres[:, 0] - frame.x) / frame.cell, (frame.y - centres[:, 1]) / frame.cell
    return Lookouts(col, row, centres[:, 2], LEAST / 2 * tile.level.step)


def _shown_twice(tile: VolumeTile, views: list[View], terrain: np.ndarray) -> np.ndarray:
    """(rows, cols) bool: the cells whose terrain two photographs or more show."""
    factor = 2**tile.level.number
    x, y = terrain_grid(tile.level.grid, SPACING / factor).centres(tile.places)
    points = np.column_stack([*(values.ravel() for values in np.meshgrid(x, y)), terrain.ravel()])
    photographs = np.zeros(tile.work.shape, np.int32)
    for view in views:
        within = np.maximum(view.within(view.project(points)), _OUTSIDE).reshape(terrain.shape)
        photographs += at_cells(within, tile.places, tile.work, factor) >= 0
    return photographs >= 2


def _hidden(tile: VolumeTile, views: list[View], coarser: np.ndarray | None) -> np.ndarray:
    """(photographs, rows, cols) bool: the cells that the coarser heights hide from each photograph."""
    if coarser is None or tile.coarser is None:
        return np.zeros((len(views), *tile.work.shape), bool)
    window = tile.coarser
    model = HeightModel(coarser, level_grid(tile.level.grid, 1), window)
    rows, cols = np.arange(window.row, window.row + window.height), np.arange(window.col, window.col + window.width)
    targets = Targets(rows.astype(float), cols.astype(float), coarser, np.zeros_like(coarser))
    at, known = np.ix_(*_coarser_cells(tile, 1)), np.isfinite(coarser)
    # Coarse heights are good to about a step, and a wrong verdict costs a photograph.
    seen = (visible_targets(model, view, targets, HIDING * tile.level.step) for view in views)
    return np.stack([((visible == 0) & known)[at] for visible in seen])


def _preferred(tile: VolumeTile, views: list[View], settings: HeightVolume, block: Block, coarser: np.ndarray | None) -> np.ndarray:
    """Numbers (places, places, photographs) of the tile's photographs at each of its places, the best first."""
    x, y = places(tile.level.grid, tile.work)
    z = np.full((len(y), len(x)), block.ground_mean)
    if coarser is not None and tile.coarser is not None:
        z = _known(coarser[np.ix_(*_coarser_cells(tile, PLACE))], z)
    points = np.column_stack([*(values.ravel() for values in np.meshgrid(x, y)), z.ravel()])
    numbers = preferred(sight(views, points, 0.75 * PLACE * tile.level.grid.cell), settings.photographs)
    return numbers.reshape(len(y), len(x), -1)


def _candidates(tile: VolumeTile, settings: HeightVolume, coarser: np.ndarray | None) -> CellRanges:
    if coarser is None or tile.coarser is None:
        return all_planes(np.ones(tile.work.shape, bool), tile.level.count)
    planes = coarser / tile.level.step - tile.level.first
    return narrowed(planes, _coarser_cells(tile, 1), tile.level.count, ranges_of(settings))


def _near_guide(candidates: CellRanges, tile: VolumeTile, terrain: np.ndarray, reach: np.ndarray) -> CellRanges:
    """The candidates that lie within reach of the guide."""
    level = tile.level
    heights, below, above = (
        at_cells(values, tile.places, tile.work, 2**level.number).astype(np.float64)
        for values in (terrain, reach[..., 0], reach[..., 1])
    )
    first = np.floor((heights - below) / level.step) - level.first
    last = np.ceil((heights + above) / level.step) - level.first
    first, last = (np.clip(planes, -1, level.count).astype(np.int64) for planes in (first, last))
    return bounded(candidates, first, last)


def _coarser_cells(tile: VolumeTile, spacing: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns, in the window of the coarser level, of every `spacing`-th cell of a tile, from half of it on."""
    assert tile.coarser is not None
    work, coarser = tile.work, tile.coarser
    rows = np.minimum(np.arange(spacing // 2, work.height + spacing // 2, spacing), work.height - 1)
    cols = np.minimum(np.arange(spacing // 2, work.width + spacing // 2, spacing), work.width - 1)
    return (work.row + rows) // 2 - coarser.row, (work.col + cols) // 2 - coarser.col


def _known(heights: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(heights), heights, otherwise)


def _cell_frame(tile: VolumeTile) -> CellFrame:
    x, y = tile.level.grid.centres(Window(tile.work.row, tile.work.col, 1, 1))
    return CellFrame(float(x[0]), float(y[0]), tile.level.grid.cell, tile.work.height, tile.work.width)


def _rectified(
    tile: VolumeTile, part: PhotoPart, view: View, pixels: np.ndarray, heights: np.ndarray, settings: HeightVolume
) -> RectifiedPhotograph:
    work = tile.work
    needed = level_window(
        photo_window(view, tile.level.grid, work, heights[0], heights[-1], _margin(part.level)), part.level, (10**9, 10**9)
    )
    inside = needed.within(part.window).clipped(part.window.shape)
    # Cropped before it is converted: the heights that planning had to allow for are far more than a tile turns out to have.
    level = PhotographPixels(grey(pixels[inside.slices]), part.level, part.window.col + inside.col, part.window.row + inside.row)
    image, planes = rectified(level, view, _cell_frame(tile), heights, settings.oversampling)
    return RectifiedPhotograph(signatures(image, settings.half, settings.spacing), planes, _pixel(tile, part, view))


def _pixel(tile: VolumeTile, part: PhotoPart, view: View) -> float:
    """Side of a pixel of the photograph in the middle of a tile, in cells: of the square as large as the ground that it shows."""
    x, y = tile.level.grid.centres(tile.work)
    away = view.centre - np.array([x.mean(), y.mean(), tile.level.heights.mean()])
    distance, down = float(np.linalg.norm(away)), max(float(away[2]), 1e-6)
    return distance / view.camera.c * 2**part.level * np.sqrt(distance / down) / tile.level.grid.cell


def _solved(tile: VolumeTile, cells: OptimisedCells, height: np.ndarray, settings: HeightVolume) -> SolvedVolume:
    step = tile.level.step
    slope = settings.coherence_slope * tile.level.grid.cell
    agreeing = coherence(height, np.float32(settings.coherence * step) * cells.stretch, slope)
    height = np.where(cells.shown < 2, np.float32(np.nan), height)
    quality = quality_bands(cells.margin, agreeing, cells.seen, cells.spread, cells.stretch)
    inner = tile.window.within(tile.work).slices
    return SolvedVolume(np.ascontiguousarray(height[inner]), np.ascontiguousarray(quality[inner]))


def nothing(shape: tuple[int, int]) -> SolvedVolume:
    """What is found where fewer than two photographs look."""
    return SolvedVolume(np.full(shape, np.nan, np.float32), np.zeros((*shape, len(Band)), np.uint8))


class TileMemory(NamedTuple):
    """Bytes: working memory of `solve_volume`, and the pixels that it is given."""

    scratch: int
    pixels: int


def tile_memory(tile: VolumeTile, scene: VolumeScene) -> TileMemory:
    """What a tile takes."""
    return _tile_memory(tile, [_rectified_pixels(tile, part, scene) for part in tile.photos], scene)


def _tile_memory(tile: VolumeTile, pixels: list[int], scene: VolumeScene) -> TileMemory:
    """`pixels`: those of the rectified photographs."""
    return TileMemory(_scratch(tile, pixels, scene), sum(array_bytes(3, part.window) for part in tile.photos))


def _scratch(tile: VolumeTile, pixels: list[int], scene: VolumeScene) -> int:
    settings, cells = scene.settings, tile.work.cells
    candidates = cells * (settings.mean_heights if tile.coarser else tile.level.count)
    # Photographs are converted and rectified one after the other: grey values and their products, image, border and signatures.
    greatest = max((part.window.cells for part in tile.photos), default=0)
    one = array_bytes(12, greatest) + array_bytes(24, max(pixels, default=0))
    return scratch_bytes(candidates, cells, sum(pixels), settings) + one


def _rectified_pixels(tile: VolumeTile, part: PhotoPart, scene: VolumeScene) -> int:
    return rectified_pixels(block_view(scene.block, part.name), _cell_frame(tile), tile.level.heights, scene.settings.oversampling)
