"""One tile of the orthoimage from its heights and photographs, and one tile of samples for the radiometric balance.

A tile is processed in strips of rows, so that the colours of all photographs are held for one strip only. Everything is counted in
rows and columns of the whole grid: a tile gives, pixel by pixel, what one tile of the whole orthoimage would give.
"""

from dataclasses import dataclass, replace
from math import ceil, isfinite
from typing import NamedTuple

import numpy as np
from numba import njit
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import MEASURED, HeightSource
from orthomill.tasks.colouring.balance.balancing import balanced
from orthomill.tasks.colouring.balance.radiometric_balance import Radiometry, Samples, seen_twice
from orthomill.tasks.colouring.blending.blending import Blend, Blended, blend
from orthomill.tasks.colouring.edges.sharpened_ground import AROUND, SharpenedGround, sharpened
from orthomill.tasks.colouring.edges.sharpened_ground import HALO as WALL_HALO
from orthomill.tasks.colouring.sampling.balanced_photograph import BalancedPhotograph, most_bands
from orthomill.tasks.colouring.sampling.ground_sampling import Ground, Sampled, ground_of, sample_photo, shown
from orthomill.tasks.colouring.sampling.photograph_colours import PhotoPixelsAt
from orthomill.tasks.geometry.footprint import photo_window
from orthomill.tasks.geometry.view import View, block_view
from orthomill.tasks.texture.draping import HALO, drape, far_from_heights, height_sources
from orthomill.tasks.texture.extent import TileExtent
from orthomill.tasks.visibility.height_model import HeightModel, Targets, bridge_holes, visible_targets, widening_factor
from orthomill.tasks.visibility.lines_of_sight import HeightPlaces
from orthomill.tasks.visibility.sight import PlaceSight, SurfacePlaces

STRIP = 64
"""Ortho rows that are blended at a time."""
RESERVED_WORTH = 1e-3
"""Weight factor next to an occlusion: such a colour is used only where no photo has a better one."""
LAST_WORTH = 1e-6
"""Weight factor behind what may not be there: such a colour is used only where that stands in front of every photo."""
MAY_WELL = 2.0
"""Standard errors by which a height may well be higher or lower."""
_WORTH = np.array(
    [LAST_WORTH if code == PlaceSight.BEHIND_ESTIMATE else float(code >= PlaceSight.AT_BREAK) for code in PlaceSight], np.float32
)

# 16 bits are stretched so that the brightest thousandth of the samples keeps a margin below white: specular points may saturate.


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
    feather: float
    """share of the photo's shorter side"""
    sharpen: bool
    """whether photographs choose the surface of pixels near walls"""
    blend: Blend
    breaks: bool = False
    """of two colours that disagree the one at a break of its depth goes, instead of the lighter one"""

    @property
    def rim(self) -> int:
        """Cells around the tile whose visibility matters: the widening reaches in from there."""
        return int(np.ceil(self.widening_margin + self.widening_ramp)) + 2

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
    seen: tuple[int, int, int, int]
    """pixels seen by 0, 1, 2, 3 or more photos"""
    heights: tuple[int, ...]
    """pixels by code of HeightSource"""
    outside: int
    hidden: int
    missed: int
    """pixels without colour: in the frame of no photo, hidden from every photo that shows the place, seen by some photo"""
    most: int
    values: int
    rejected: int
    difference_sum: float
    difference_count: int
    """sum and number of the mean absolute differences at pixels where two photos or more were blended"""
    photo_seen: dict[str, int]
    photo_share: dict[str, float]


class OrthoTile(NamedTuple):
    """One tile of the orthoimage: `ortho` uint8 (rows, cols, 4); `coverage`, `rejected` and `height_source` uint8 (rows, cols)."""

    ortho: np.ndarray
    coverage: np.ndarray
    rejected: np.ndarray
    height_source: np.ndarray
    statistics: TileTexture


def _views(block: Block, extent: TileExtent) -> list[View]:
    return [block_view(block, part.name) for part in extent.photos]


@dataclass(frozen=True)
class _Scene:
    """A tile's ground, and each photo's weight factor on it: 0 hidden, small behind an estimate or at an occlusion, 1 elsewhere;
    and where it sees the ground next to a break of its depth, if the rules ask."""

    ground: Ground
    factors: tuple[np.ndarray, ...]
    breaks: tuple[np.ndarray, ...]


@dataclass
class _Tally:
    """Sums over the strips of a tile; `seen`, `share` (photos,), `empty` pixels without colour: outside, hidden, missed."""

    seen: np.ndarray
    share: np.ndarray
    empty: np.ndarray
    difference_sum: float = 0.0
    difference_count: int = 0

    def add(self, blended: Blended, seen: list[int]) -> None:
        """Counts one strip."""
        # float64: a tile sums a million float32 differences.
        self.difference_sum += float(np.nansum(blended.difference, dtype=np.float64))
        self.difference_count += int(np.isfinite(blended.difference).sum())
        self.seen += seen
        self.share += blended.share


def _targets(ground: Ground, dsm: MapGrid) -> Targets:
    """The ground's pixels as targets of the visibility test."""
    x, y = ground.grid.centres(ground.window)
    cols, rows = dsm.pixel(x, y)
    return Targets(rows, cols, ground.z, np.sqrt(ground.dx * ground.dx + ground.dy * ground.dy))


def painted_heights(heights: np.ndarray, extent: TileExtent, rules: TextureRules, ground: np.ndarray | None) -> np.ndarray:
    """The heights (rows, cols) that the texture is put on: those of the surface model, holes draped as far as the rules say."""
    if ground is None or rules.drape_reach <= 0:
        return heights
    painted = drape(heights, extent.heights, ground, extent.ground)
    return (
        np.where(far_from_heights(heights, rules.drape_reach), np.float32(np.nan), painted)
        if isfinite(rules.drape_reach)
        else painted
    )


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
    # Draped heights stand in the way as well, like estimates: what is painted is a surface.
    model = HeightModel(bridge_holes(painted, rules.bridge), extent.dsm, extent.heights)
    certain = HeightModel(np.where(measured, painted, np.float32(np.nan)), extent.dsm, extent.heights)
    lowest = replace(certain, heights=certain.heights - spread)
    # Occlusions outside the tile reduce weights inside it, so visibility is computed on a larger window.
    rim = extent.window.grown(rules.rim * extent.divisor).clipped(extent.ortho.shape)
    ground = ground_of(painted, extent.heights, extent.dsm, extent.ortho, rim)
    sharp = sharpened(ground, painted, certain, photos) if rules.sharpen else None
    ground = sharp.ground if sharp else ground
    targets, core = _targets(ground, extent.dsm), extent.window
    inner = core.within(rim).slices
    above = _at_pixels(spread, extent.heights, rim, extent.divisor)
    places: SurfacePlaces = HeightPlaces(model, lowest, targets, above, rules.tolerance)
    factors, breaks = [], []
    for k in showing:
        sight = places.sights(photos[k].view)
        sight = _at_walls(sight, sharp, k) if sharp else sight
        factors.append(_factor(sight, rules, extent.divisor)[inner])
        breaks.append(sight[inner] == PlaceSight.AT_BREAK if rules.breaks else np.zeros((0, 0), bool))
    return _Scene(ground.part(core), tuple(factors), tuple(breaks))


def _at_walls(sight: np.ndarray, sharp: SharpenedGround, number: int) -> np.ndarray:
    """Codes of PlaceSight of a photo, corrected where the model is blurred and hides nothing for certain: there the photographs
    whose colour is that of the pixel's surface see it, and no others; where there are none the model decides."""
    codes, own = sight.ravel(), sharp.alike[number].ravel()[sharp.told]
    codes[sharp.told] = np.where(
        own, np.maximum(codes[sharp.told], np.uint8(PlaceSight.BEHIND_ESTIMATE)), np.uint8(PlaceSight.HIDDEN)
    )
    return codes.reshape(sight.shape)


def _factor(sight: np.ndarray, rules: TextureRules, divisor: int) -> np.ndarray:
    """Weight factors (rows, cols) of a photo from codes of PlaceSight, reduced next to occlusions."""
    if rules.widening_margin + rules.widening_ramp <= 0:
        return np.asarray(_WORTH[sight])
    # A hole without height is no occlusion: its rim is as well visible as any other ground.
    occluded = (sight == PlaceSight.HIDDEN) | (sight == PlaceSight.BEHIND_ESTIMATE)
    widened = widening_factor(occluded, rules.widening_margin * divisor, rules.widening_ramp * divisor)
    _weigh(sight, _WORTH, widened)
    return widened


@njit(cache=True)
def _weigh(sight, worth, factor):
    """Turns factors (rows, cols) that fall towards occlusions into those of what is seen; of the rest the worth of its code."""
    least = np.float32(RESERVED_WORTH)
    for i in range(sight.shape[0]):
        for j in range(sight.shape[1]):
            code = sight[i, j]
            factor[i, j] = max(factor[i, j], least) if code >= PlaceSight.AT_BREAK else worth[code]


def _at_pixels(cells: np.ndarray, place: Window, window: Window, divisor: int) -> np.ndarray:
    """Values of the DSM cells `place` at the ortho pixels `window`."""
    near = window.reduced(divisor)
    pixels = np.repeat(np.repeat(cells[near.within(place).slices], divisor, axis=1), divisor, axis=0)
    return pixels[window.within(near.scaled(divisor)).slices]


def _feather(view: View, rules: TextureRules) -> float:
    return rules.feather * min(view.camera.width, view.camera.height)


def _strip(
    ground: Ground, scene: _Scene, photos: list[BalancedPhotograph], rules: TextureRules, top: int
) -> tuple[Blended, list[int]]:
    """The blended strip, and the pixels that each photo sees. Colours are in the block's radiometry."""
    shape = len(photos), *ground.z.shape
    colours, weights = np.zeros((*shape, most_bands(photos)), np.float32), np.zeros(shape, np.float32)
    for i, photo in enumerate(photos):
        factor = scene.factors[i][top : top + len(ground.z)]
        # Corrected before blending: rejection compares colours, and a gain of some per cent would look like a gross error.
        photo.fill(Sampled(colours[i], weights[i], np.zeros(shape[1:], np.float32)), ground, factor, _feather(photo.view, rules))
    broken = np.stack([each[top : top + len(ground.z)] for each in scene.breaks]) if rules.breaks and photos else None
    return blend(colours, weights, rules.blend, broken), [int(np.count_nonzero(weight)) for weight in weights]


@njit(cache=True)
def _paint(colour, used, out):
    bands = colour.shape[2]
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            if used[i, j]:
                for band in range(3):
                    # A grey orthoimage has three equal bands as well.
                    value = np.floor(colour[i, j, band if bands == 3 else 0] + np.float32(0.5))
                    out[i, j, band] = np.uint8(min(max(value, np.float32(0.0)), np.float32(255.0)))
                out[i, j, 3] = 255


def _rgba(blended: Blended) -> np.ndarray:
    """uint8 (rows, cols, 4); transparent black where no photo sees the ground."""
    out = np.zeros((*blended.used.shape, 4), np.uint8)
    _paint(blended.colour, blended.used, out)
    return out


def _empty_pixels(ground: Ground, factors: list[np.ndarray], views: list[View], used: np.ndarray, level: float) -> np.ndarray:
    """Numbers (3,) of pixels without colour: in the frame of no photo, hidden from every photo that shows the place, missed.

    A pixel without height is tested at the height `level` (m), and missed if some photo shows the place.
    """
    if used.all():
        return np.zeros(3, np.int64)
    without = np.isnan(ground.z)
    place = replace(ground, z=np.where(without, np.float32(level), ground.z))
    empty = (used == 0).astype(np.uint8)
    shows, sees = np.zeros(used.shape, bool), np.zeros(used.shape, bool)
    for view, factor in zip(views, factors, strict=True):
        inside = shown(view, place, empty)
        shows |= inside
        sees |= inside & (without | (factor > 0))
    return np.array([(empty > 0).sum() - shows.sum(), (shows & ~sees).sum(), sees.sum()])


def _statistics(coverage: np.ndarray, rejected: np.ndarray, sources: np.ndarray, names: list[str], tally: _Tally) -> TileTexture:
    none, one, two = (int(np.count_nonzero(coverage == count)) for count in range(3))
    outside, hidden, missed = tally.empty.tolist()
    return TileTexture(
        pixels=coverage.size,
        seen=(none, one, two, coverage.size - none - one - two),
        most=int(coverage.max()),
        heights=tuple(int(np.count_nonzero(sources == code)) for code in HeightSource),
        outside=outside,
        hidden=hidden,
        missed=missed,
        values=int(coverage.sum(dtype=np.int64)),
        rejected=int(rejected.sum(dtype=np.int64)),
        difference_sum=tally.difference_sum,
        difference_count=tally.difference_count,
        photo_seen={name: int(n) for name, n in zip(names, tally.seen, strict=True)},
        photo_share={name: float(n) for name, n in zip(names, tally.share, strict=True)},
    )


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
    painted = painted_heights(heights, extent, rules, ground)
    around = [
        BalancedPhotograph(view, PhotoPixelsAt(np.ascontiguousarray(pixels), part.window, part.level), radiometry)
        for view, pixels, part in zip(_views(block, extent), photos, extent.photos, strict=True)
    ]
    numbers = _showing(painted, extent, around)
    showing = [around[k] for k in numbers]
    views = [photo.view for photo in showing]
    known = np.isfinite(heights)
    # The datum moves what hides and what is hidden alike: only errors among neighbours count. Draped heights are guessed.
    spread = np.where(known, np.nan_to_num(np.float32(MAY_WELL) * precision), np.float32(np.inf))
    scene = _scene(painted, np.isin(provenance, MEASURED) & known, spread, extent, around, numbers, rules)
    core = extent.core.within(extent.heights).slices
    sources = height_sources(heights[core], painted[core], provenance[core])
    sources = _at_pixels(sources, extent.core, extent.window, extent.divisor)
    height, width = extent.window.shape
    coverage, rejected = np.zeros((height, width), np.uint8), np.zeros((height, width), np.uint8)
    ortho, tally = np.zeros((height, width, 4), np.uint8), _Tally(np.zeros(len(views)), np.zeros(len(views)), np.zeros(3, np.int64))
    level = block.ground_mean
    for top in range(0, height, STRIP):
        window = Window(extent.window.row + top, extent.window.col, min(STRIP, height - top), width)
        strip = scene.ground.part(window)
        blended, seen = _strip(strip, scene, showing, rules, top)
        rows = slice(top, top + window.height)
        ortho[rows], coverage[rows], rejected[rows] = _rgba(blended), blended.seen, blended.rejected
        tally.add(blended, seen)
        tally.empty += _empty_pixels(strip, [factor[rows] for factor in scene.factors], views, blended.used, level)
    return OrthoTile(
        ortho, coverage, rejected, sources, _statistics(coverage, rejected, sources, [view.name for view in views], tally)
    )


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
        sampled = sample_photo(view, PhotoPixelsAt(pixels, part.window, part.level), ground, seen, 0.0)
        mask = sampled.worth > 0
        grey = np.broadcast_to(sampled.colour[mask], (int(mask.sum()), 3))
        rows.append((number[mask], np.full(len(grey), block.names.index(view.name)), sampled.r2[mask], *grey.T))
    return seen_twice(rows)


def balance(samples: tuple[Samples, ...], block: Block, deep: bool, method: str, vignetting: bool) -> Radiometry:
    """The radiometry of the block from the samples of all tiles: see `balanced`."""
    return balanced(samples, block.names, deep, method, vignetting)
