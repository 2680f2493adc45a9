"""One tile of the orthoimage from its heights and photographs, and one tile of samples for the radiometric balance.

A tile is processed in strips of rows, so that the colours of all photographs are held for one strip only. Everything is counted in
rows and columns of the whole grid: a tile gives, pixel by pixel, what one tile of the whole orthoimage would give.
"""

from dataclasses import dataclass, field, replace
from math import ceil, isfinite
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.maps.wanted_area import WantedArea
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import MEASURED, HeightSource
from orthomill.tasks.colouring.balance.photo_radiometry import Radiometry
from orthomill.tasks.colouring.balance.shared_ground import Samples, sample_rows, seen_twice
from orthomill.tasks.colouring.blending.blending import Blended, blend
from orthomill.tasks.colouring.blending.colour_rules import ColourRules
from orthomill.tasks.colouring.blending.colour_sums import ColourSums, ColourTally
from orthomill.tasks.colouring.blending.displacement import less_displaced
from orthomill.tasks.colouring.blending.painting import rgba
from orthomill.tasks.colouring.edges.sharpened_ground import AROUND, SharpenedGround, sharpened
from orthomill.tasks.colouring.edges.sharpened_ground import HALO as WALL_HALO
from orthomill.tasks.colouring.sampling.balanced_photograph import BalancedPhotograph, bands_of
from orthomill.tasks.colouring.sampling.ground_sampling import Ground, Sampled, ground_of, sample_photo, shown
from orthomill.tasks.colouring.sampling.photograph_colours import PhotoPixelsAt
from orthomill.tasks.colouring.widening.occlusion_factor import occlusion_factor
from orthomill.tasks.geometry.footprint import photo_window
from orthomill.tasks.geometry.view import View, block_view
from orthomill.tasks.texture.edges.drawn_edges import DrawnEdges, drawn_edges
from orthomill.tasks.texture.edges.edge_places import HALO as EDGE_HALO
from orthomill.tasks.texture.edges.measured_edges import MeasuredEdges, measured_edges
from orthomill.tasks.texture.ground.draping import HALO, drape, far_from_heights, height_sources
from orthomill.tasks.texture.ground.extent import TileExtent
from orthomill.tasks.texture.ground.gentle_ground import calmed, guessed
from orthomill.tasks.visibility.height_model import HeightModel, Targets, bridge_holes, visible_targets
from orthomill.tasks.visibility.lines_of_sight import HeightPlaces
from orthomill.tasks.visibility.sight import PlaceSight, SurfacePlaces

STRIP = 64
"""Ortho rows that are blended at a time."""
MAY_WELL = 2.0
"""Standard errors by which a height may well be higher or lower."""


@dataclass(frozen=True)
class TextureRules:
    """How a tile is made. Lengths in DSM cells unless stated otherwise."""

    tolerance: float
    """m"""
    bridge: int
    drape_reach: float
    """how far from a height holes are draped; 0: no texture in holes, inf: all of them"""
    widening_margin: float
    widening_ramp: float
    sharpen: bool
    """whether photographs choose the surface of pixels near walls"""
    colours: ColourRules
    bits: int = 8
    """of a colour of the orthoimage"""
    wanted: WantedArea = field(default_factory=WantedArea)
    """where the orthoimage is wanted"""

    @property
    def rim(self) -> int:
        """Cells around the tile whose visibility matters: the widening reaches in from there, and edges take their direction."""
        widening = int(np.ceil(self.widening_margin + self.widening_ramp)) + 2
        return max(widening, EDGE_HALO) if self.sharpen else widening

    @property
    def halo(self) -> int:
        """Cells of heights that are needed around what the rays cross."""
        # The reach is measured in the same window that is draped; without a limit nothing is measured.
        reach = ceil(self.drape_reach) if isfinite(self.drape_reach) else 0
        return max(self.bridge, reach, HALO) + self.rim + 1 + (WALL_HALO if self.sharpen else 0)

    @property
    def around(self) -> int:
        """Cells around the tile whose colours take part."""
        return self.rim + AROUND if self.sharpen else 0


class TileTexture(BaseModel):
    """Statistics of one tile of the orthoimage."""

    model_config = ConfigDict(frozen=True)

    pixels: int
    colours: ColourSums
    heights: tuple[int, ...]
    """pixels by code of HeightSource"""
    outside: int
    hidden: int
    missed: int
    """pixels without colour: in the frame of no photo or beyond the area that is wanted, hidden from every photo that shows the
    place, seen by some photo"""
    most: int
    """the greatest number of photos that see a pixel"""
    photo_seen: dict[str, int]
    """photo -> pixels that it sees"""
    drawn: DrawnEdges
    """straight edges of the photographs in the orthoimage"""


class OrthoTile(NamedTuple):
    """One tile of the orthoimage: `ortho` uint8 or uint16 (rows, cols, 4); `coverage`, `rejected` and `height_source`
    uint8, `source` uint16 (rows, cols): the number of the heaviest photograph in the block, from 1, 0 without colour; `edges`
    near walls."""

    ortho: np.ndarray
    coverage: np.ndarray
    rejected: np.ndarray
    height_source: np.ndarray
    source: np.ndarray
    statistics: TileTexture
    edges: MeasuredEdges


def _views(block: Block, extent: TileExtent) -> list[View]:
    return [block_view(block, part.name) for part in extent.photos]


@dataclass(frozen=True)
class _Scene:
    """A tile's ground, and each photo's weight factor on it: 0 hidden, small behind an estimate or at an occlusion, 1 elsewhere;
    and where it sees the ground next to a break of its depth, if the rules ask. `chosen` (rows, cols) bool: pixels whose surface
    the photographs chose; `edges` where the upper surfaces end."""

    ground: Ground
    factors: tuple[np.ndarray, ...]
    breaks: tuple[np.ndarray, ...]
    chosen: np.ndarray
    edges: MeasuredEdges


def _targets(ground: Ground, dsm: MapGrid) -> Targets:
    """The ground's pixels as targets of the visibility test."""
    x, y = ground.grid.centres(ground.window)
    cols, rows = dsm.pixel(x, y)
    return Targets(rows, cols, ground.z, np.sqrt(ground.dx * ground.dx + ground.dy * ground.dy))


def painted_heights(
    heights: np.ndarray, precision: np.ndarray, extent: TileExtent, rules: TextureRules, ground: np.ndarray | None
) -> np.ndarray:
    """The heights (rows, cols) that the texture is put on: those of the surface model, guesses on the gentle ground, holes draped
    as far as the rules say."""
    if ground is None or rules.drape_reach <= 0:
        return heights
    if guessed(precision, extent.dsm.cell).any():
        nothing = np.full(heights.shape, np.nan, np.float32)
        heights = calmed(heights, precision, drape(nothing, extent.heights, ground, extent.ground), extent.dsm.cell)
    painted = drape(heights, extent.heights, ground, extent.ground)
    if isfinite(rules.drape_reach):
        painted = np.where(far_from_heights(heights, rules.drape_reach), np.float32(np.nan), painted)
    if rules.wanted.polygons:
        painted = np.where(rules.wanted.cells(extent.dsm, extent.heights), painted, np.float32(np.nan))
    return painted


def _showing(painted: np.ndarray, extent: TileExtent, photos: list[BalancedPhotograph]) -> list[int]:
    """Numbers of the photographs that show some of the tile at its own heights; the plan had to allow for all heights."""
    near = extent.core.grown(2).clipped(extent.dsm.shape)
    here = painted[near.within(extent.heights).clipped(painted.shape).slices]
    if np.isnan(here).all():
        return list(range(len(photos)))
    bounds = float(np.nanmin(here)), float(np.nanmax(here))
    windows = (photo_window(photo.view, extent.ortho, extent.window, *bounds) for photo in photos)
    return [number for number, window in enumerate(windows) if not window.empty]


def _scene(
    painted: np.ndarray,
    measured: np.ndarray,
    spread: np.ndarray,
    extent: TileExtent,
    photos: list[BalancedPhotograph],
    showing: list[int],
    rules: TextureRules,
) -> _Scene:
    """The ground of a tile at its `painted` heights (rows, cols) m, which are `measured` (rows, cols) bool or not and may well be
    lower by `spread` (rows, cols) m; `showing`: numbers of the photographs that show some of it."""
    # Draped heights stand in the way as well, like estimates: what is painted is a surface.
    model = HeightModel(bridge_holes(painted, rules.bridge), extent.dsm, extent.heights)
    certain = HeightModel(np.where(measured, painted, np.float32(np.nan)), extent.dsm, extent.heights)
    lowest = replace(certain, heights=certain.heights - spread)
    # Occlusions outside the tile reduce weights inside it, so visibility is computed on a larger window.
    rim = extent.window.grown(rules.rim * extent.divisor).clipped(extent.ortho.shape)
    ground = ground_of(painted, extent.heights, extent.dsm, extent.ortho, rim)
    sharp = sharpened(ground, painted, certain, photos) if rules.sharpen else None
    edges = measured_edges(sharp.parted if sharp else None, extent.ortho, rim, extent.window, photos, extent.divisor)
    ground = sharp.ground if sharp else ground
    targets, core = _targets(ground, extent.dsm), extent.window
    inner = core.within(rim).slices
    above = _at_pixels(spread, extent.heights, rim, extent.divisor)
    places: SurfacePlaces = HeightPlaces(model, lowest, targets, above, rules.tolerance)
    factors, breaks = [], []
    for k in showing:
        sight = places.sights(photos[k].view)
        sight = _at_walls(sight, sharp, k) if sharp else sight
        factors.append(occlusion_factor(sight, rules.widening_margin * extent.divisor, rules.widening_ramp * extent.divisor)[inner])
        breaks.append(sight[inner] == PlaceSight.AT_BREAK if rules.colours.breaks else np.zeros((0, 0), bool))
    chosen = sharp.chosen if sharp else np.zeros(rim.shape, bool)
    return _Scene(ground.part(core), tuple(factors), tuple(breaks), chosen[inner], edges)


def _at_walls(sight: np.ndarray, sharp: SharpenedGround, number: int) -> np.ndarray:
    """Codes of PlaceSight of a photo, corrected where the model is blurred and hides nothing for certain: there the photographs
    whose colour is that of the pixel's surface see it, and no others; where there are none the model decides."""
    codes, own = sight.ravel(), sharp.alike[number].ravel()[sharp.told]
    codes[sharp.told] = np.where(
        own, np.maximum(codes[sharp.told], np.uint8(PlaceSight.BEHIND_ESTIMATE)), np.uint8(PlaceSight.HIDDEN)
    )
    return codes.reshape(sight.shape)


def _at_pixels(cells: np.ndarray, place: Window, window: Window, divisor: int) -> np.ndarray:
    """Values of the DSM cells `place` at the ortho pixels `window`."""
    near = window.reduced(divisor)
    pixels = np.repeat(np.repeat(cells[near.within(place).slices], divisor, axis=1), divisor, axis=0)
    return pixels[window.within(near.scaled(divisor)).slices]


def _strip(
    ground: Ground, sigma: np.ndarray, scene: _Scene, photos: list[BalancedPhotograph], rules: TextureRules, top: int
) -> tuple[Blended, list[int], np.ndarray]:
    """The blended strip, whose heights have the standard errors `sigma` (rows, cols) m, the pixels that each photo sees, and which
    is the heaviest at a pixel. Colours are in the block's radiometry."""
    shape = len(photos), *ground.z.shape
    colours, weights = np.zeros((*shape, bands_of(photos)), np.float32), np.zeros(shape, np.float32)
    for i, photo in enumerate(photos):
        factor = scene.factors[i][top : top + len(ground.z)]
        # Corrected before blending: rejection compares colours, and a gain of some per cent would look like a gross error.
        found = Sampled(colours[i], weights[i], np.zeros(shape[1:], np.float32))
        photo.fill(found, ground, factor, rules.colours.border(photo.view.camera))
    less_displaced(weights, ground, sigma, np.array([photo.view.centre for photo in photos]))
    broken = np.stack([each[top : top + len(ground.z)] for each in scene.breaks]) if rules.colours.breaks and photos else None
    heaviest = weights.argmax(axis=0) if photos else np.zeros(ground.z.shape, np.int64)
    return blend(colours, weights, rules.colours.blend, broken), [int(np.count_nonzero(weight)) for weight in weights], heaviest


def _empty_pixels(
    ground: Ground, factors: list[np.ndarray], views: list[View], used: np.ndarray, wanted: np.ndarray, level: float
) -> np.ndarray:
    """Numbers (3,) of pixels without colour: in the frame of no photo or not `wanted` (rows, cols) bool, hidden from every photo
    that shows the place, missed.

    A pixel without height is tested at the height `level` (m), and missed if some photo shows the place.
    """
    if used.all():
        return np.zeros(3, np.int64)
    without = np.isnan(ground.z)
    place = replace(ground, z=np.where(without, np.float32(level), ground.z))
    empty = (used == 0).astype(np.uint8)
    shows, sees = np.zeros(used.shape, bool), np.zeros(used.shape, bool)
    for view, factor in zip(views, factors, strict=True):
        inside = shown(view, place, empty) & wanted
        shows |= inside
        sees |= inside & (without | (factor > 0))
    return np.array([(empty > 0).sum() - shows.sum(), (shows & ~sees).sum(), sees.sum()])


def texture_tile(
    heights: np.ndarray,
    precision: np.ndarray,
    provenance: np.ndarray,
    block: Block,
    radiometry: Radiometry,
    photos: tuple[np.ndarray, ...],
    extent: TileExtent,
    rules: TextureRules,
    ground: np.ndarray | None = None,
) -> OrthoTile:
    """One tile of the orthoimage.

    heights (rows, cols) m, NaN in holes, their standard errors among neighbours (m) and provenance codes at `extent.heights`;
    photos: pixels (rows, cols, bands) of `extent.photos`; ground: heights of the blocks `extent.ground` of the whole model, only
    for draping.
    """
    painted = painted_heights(heights, precision, extent, rules, ground)
    around = [
        BalancedPhotograph(view, PhotoPixelsAt.of(pixels, part.window, part.level), radiometry)
        for view, pixels, part in zip(_views(block, extent), photos, extent.photos, strict=True)
    ]
    numbers = _showing(painted, extent, around)
    showing = [around[k] for k in numbers]
    views = [photo.view for photo in showing]
    known = np.isfinite(heights)
    # The datum moves what hides and what is hidden alike: only errors among neighbours count. Draped heights are guessed.
    error = np.where(known, np.nan_to_num(precision), np.float32(np.inf))
    spread = np.float32(MAY_WELL) * error
    measured = np.isin(provenance, MEASURED) & known
    scene = _scene(painted, measured=measured, spread=spread, extent=extent, photos=around, showing=numbers, rules=rules)
    core = extent.core.within(extent.heights).slices
    sources = height_sources(heights[core], painted[core], provenance[core])
    sources = _at_pixels(sources, extent.core, extent.window, extent.divisor)
    # At walls photographs chose between two heights, in place of the one whose standard error this is.
    sigma = _at_pixels(error[core], extent.core, extent.window, extent.divisor)
    sigma = np.where(scene.chosen, np.float32(0.0), sigma)
    wanted = _at_pixels(rules.wanted.cells(extent.dsm, extent.core), extent.core, extent.window, extent.divisor)
    height, width = extent.window.shape
    coverage, rejected = np.zeros((height, width), np.uint8), np.zeros((height, width), np.uint8)
    ortho, tally = np.zeros((height, width, 4), f"uint{rules.bits}"), ColourTally(np.zeros(len(views)))
    seen, empty, level = np.zeros(len(views), np.int64), np.zeros(3, np.int64), block.ground_mean
    source = np.zeros((height, width), np.uint16)
    known_as = np.array([1 + block.names.index(view.name) for view in views] or [0], np.uint16)
    for top in range(0, height, STRIP):
        window = Window(extent.window.row + top, extent.window.col, min(STRIP, height - top), width)
        strip, rows = scene.ground.part(window), slice(top, top + window.height)
        blended, sees, heaviest = _strip(strip, sigma[rows], scene, showing, rules, top)
        ortho[rows], coverage[rows], rejected[rows] = rgba(blended, rules.bits), blended.seen, blended.rejected
        source[rows] = np.where(blended.used > 0, known_as[heaviest], 0)
        tally.add(blended)
        seen += np.array(sees, np.int64)  # also where no photograph shows the tile
        empty += _empty_pixels(strip, [factor[rows] for factor in scene.factors], views, blended.used, wanted[rows], level)
    names = [view.name for view in views]
    outside, hidden, missed = empty.tolist()
    statistics = TileTexture(
        pixels=coverage.size,
        colours=tally.sums(names, coverage),
        heights=tuple(int(np.count_nonzero(sources == code)) for code in HeightSource),
        outside=outside,
        hidden=hidden,
        missed=missed,
        most=int(coverage.max()),
        photo_seen=dict(zip(names, seen.tolist(), strict=True)),
        drawn=drawn_edges(scene.edges, extent.ortho, extent.window, ortho, around, extent.divisor),
    )
    return OrthoTile(ortho, coverage, rejected, sources, source, statistics, scene.edges)


def sample_tile(
    heights: np.ndarray, block: Block, photos: tuple[np.ndarray, ...], extent: TileExtent, rules: TextureRules, spacing: int
) -> Samples:
    """Grey values of every `spacing`-th ortho pixel of a tile in all photos that see it; only points that two or more photos see.

    Inputs as for `texture_tile`, the photos at a coarser pyramid level, so that noise and small mismatches are averaged.
    """
    views = _views(block, extent)
    ground = ground_of(heights, extent.heights, extent.dsm, extent.ortho, extent.window, spacing)
    model = HeightModel(bridge_holes(heights, rules.bridge), extent.dsm, extent.heights)
    targets = _targets(ground, extent.dsm)
    # Numbers of the whole grid: the tables of all tiles are merged without renumbering.
    number = (ground.window.row + np.arange(ground.window.height))[:, None] * ground.grid.cols + (
        ground.window.col + np.arange(ground.window.width)
    )
    rows = []
    for pixels, part, view in zip(photos, extent.photos, views, strict=True):
        seen = visible_targets(model, view, targets, rules.tolerance)
        # No feather: a sample at the border is as good as any, and vignetting is seen best there.
        sampled = sample_photo(view, PhotoPixelsAt.of(pixels, part.window, part.level), ground, seen, 0.0)
        rows.append(sample_rows(number, block.names.index(view.name), sampled.colour, sampled.weight, sampled.r2))
    return seen_twice(rows)
