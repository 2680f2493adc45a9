"""One tile of the orthoimage from its heights and photographs, and one tile of samples for the radiometric balance.

A tile is worked in strips of rows, so that the colours of all photographs are held for a strip only. Everything is counted in the
whole grid's rows and columns: a tile gives, pixel by pixel, what one huge tile would give.
"""

from dataclasses import dataclass, replace

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.geometry.view import View, block_view
from orthomill.tasks.texture.blending import Blend, Blended, blend
from orthomill.tasks.texture.extent import TileExtent
from orthomill.tasks.texture.radiometric_balance import Radiometry, Samples, balance_block, corrected
from orthomill.tasks.texture.sampling import Ground, PhotoPixelsAt, Sampled, ground_of, sample_photo
from orthomill.tasks.visibility.height_model import HeightModel, Targets, bridge_holes, visible_targets, widening_factor

STRIP = 64
"""Ortho rows that are blended at a time."""
RESERVED_WORTH = 1e-3
"""Weight factor beside an occlusion: such a colour serves only where no photo has a better one."""

NO_HEIGHT, MEASURED, DRAPED = 0, 1, 2
"""Codes of the raster `texture/height_source`."""


@dataclass(frozen=True)
class TextureRules:
    """How a tile is made. Lengths in DSM cells where not said otherwise."""

    tolerance: float
    """m"""
    bridge: int
    drape_gap: int
    """0: no texture in holes"""
    widening_margin: float
    widening_ramp: float
    feather: float
    """share of the photo's shorter side"""
    blend: Blend

    @property
    def rim(self) -> int:
        """Cells around the tile whose visibility matters."""
        return int(np.ceil(self.widening_margin + self.widening_ramp)) + 2

    @property
    def halo(self) -> int:
        """Cells of heights that are needed around what the rays cross."""
        return max(self.bridge, self.drape_gap) + self.rim + 1


class TileTexture(BaseModel):
    """What became of one tile of the orthoimage."""

    model_config = ConfigDict(frozen=True)

    pixels: int
    seen: tuple[int, int, int, int]
    """pixels seen by 0, 1, 2, 3 or more photos"""
    no_height: int
    draped: int
    most: int
    values: int
    rejected: int
    difference_sum: float
    difference_count: int
    """mean absolute difference of photos at pixels where two or more were blended"""
    photo_seen: dict[str, int]
    photo_share: dict[str, float]


def _views(block: Block, extent: TileExtent) -> list[View]:
    return [block_view(block, part.name) for part in extent.photos]


@dataclass(frozen=True)
class _Scene:
    """A tile's ground, and each photo's weight factor on it: 0 hidden, small beside an occlusion, 1 in the open."""

    ground: Ground
    factors: tuple[np.ndarray, ...]


def _targets(ground: Ground, dsm: MapGrid) -> Targets:
    x, y = ground.grid.centres(ground.window)
    cols, rows = dsm.pixel(x, y)
    return Targets(rows, cols, ground.z, np.hypot(ground.dx, ground.dy))


def _scene(heights: np.ndarray, extent: TileExtent, views: list[View], rules: TextureRules) -> _Scene:
    bridged = bridge_holes(heights, rules.bridge)
    draped = bridge_holes(heights, rules.drape_gap) if rules.drape_gap else heights
    model = HeightModel(np.where(np.isnan(bridged), draped, bridged), extent.dsm, extent.heights)
    rim = extent.window.grown(rules.rim * extent.divisor).clipped(extent.ortho.shape)
    ground = ground_of(draped, extent.heights, extent.dsm, extent.ortho, rim)
    targets, core = _targets(ground, extent.dsm), extent.window
    inner = Window(core.row - rim.row, core.col - rim.col, core.height, core.width).slices
    seen = (visible_targets(model, view, targets, rules.tolerance) for view in views)
    factors = tuple(_factor(visible, ground.z, rules, extent.divisor)[inner] for visible in seen)
    return _Scene(ground.part(core), factors)


def _factor(visible: np.ndarray, z: np.ndarray, rules: TextureRules, divisor: int) -> np.ndarray:
    if rules.widening_margin + rules.widening_ramp <= 0:
        return visible.astype(np.float32)
    hidden = (visible == 0) & np.isfinite(z)
    widened = widening_factor(hidden, rules.widening_margin * divisor, rules.widening_ramp * divisor)
    return np.where(visible > 0, np.maximum(widened, RESERVED_WORTH), 0).astype(np.float32)


def _to_ortho(cells: np.ndarray, core: Window, divisor: int, window: Window) -> np.ndarray:
    """Values of the DSM cells under the ortho pixels `window`."""
    rows = np.arange(window.row, window.row + window.height) // divisor - core.row
    cols = np.arange(window.col, window.col + window.width) // divisor - core.col
    return cells[np.ix_(rows, cols)]


def _feather(view: View, rules: TextureRules) -> float:
    return rules.feather * min(view.camera.width, view.camera.height)


def _bands(pixels: tuple[np.ndarray, ...]) -> int:
    return max((array.shape[2] for array in pixels), default=1)


def _photo_on(ground: Ground, part: PhotoPixelsAt, view: View, factor: np.ndarray, rules: TextureRules) -> Sampled:
    sampled = sample_photo(view, part, ground, (factor > 0).astype(np.uint8), _feather(view, rules))
    return replace(sampled, worth=sampled.worth * factor)


def _strip(
    ground: Ground, scene: _Scene, parts: list[PhotoPixelsAt], views: list[View], balance: Radiometry, rules: TextureRules, top: int
) -> tuple[Blended, np.ndarray]:
    """The blended strip, and which photos (photos, rows, cols) see it. Colours are in the block's radiometry."""
    bands = _bands(tuple(part.pixels for part in parts))
    colours = np.zeros((len(parts), *ground.z.shape, bands), np.float32)
    weights = np.zeros((len(parts), *ground.z.shape), np.float32)
    for i, (part, view) in enumerate(zip(parts, views, strict=True)):
        factor = scene.factors[i][top : top + len(ground.z)]
        sampled = _photo_on(ground, part, view, factor, rules)
        colours[i] = corrected(sampled.colour, sampled.r2, balance.of(view.name)) * (255.0 / balance.white)
        weights[i] = sampled.worth
    return blend(colours, weights, rules.blend), weights > 0


def _rgba(blended: Blended) -> np.ndarray:
    """uint8 (rows, cols, 4); transparent black where no photo sees the ground."""
    alpha = np.where(blended.used > 0, 255, 0).astype(np.uint8)
    colour = np.clip(np.floor(blended.colour + 0.5), 0, 255).astype(np.uint8)
    colour = np.broadcast_to(colour, (*colour.shape[:2], 3))
    return np.dstack([colour * (alpha[..., None] > 0), alpha])


def _statistics(outputs: dict[str, np.ndarray], names: list[str], tally: dict[str, np.ndarray | float]) -> TileTexture:
    coverage = outputs["coverage"]
    seen = np.bincount(np.minimum(coverage, 3).ravel(), minlength=4)
    return TileTexture(
        pixels=coverage.size,
        seen=tuple(int(n) for n in seen),
        most=int(coverage.max()),
        no_height=int((outputs["height_source"] == NO_HEIGHT).sum()),
        draped=int((outputs["height_source"] == DRAPED).sum()),
        values=int(coverage.sum(dtype=np.int64)),
        rejected=int(outputs["rejected"].sum(dtype=np.int64)),
        difference_sum=float(tally["difference_sum"]),
        difference_count=int(tally["difference_count"]),
        photo_seen={name: int(n) for name, n in zip(names, tally["seen"], strict=True)},
        photo_share={name: float(n) for name, n in zip(names, tally["share"], strict=True)},
    )


def texture_tile(
    heights: np.ndarray,
    block: Block,
    radiometry: Radiometry,
    photos: tuple[np.ndarray, ...],
    extent: TileExtent,
    rules: TextureRules,
) -> dict[str, object]:
    """One tile of the orthoimage.

    heights (rows, cols) m at `extent.heights`, NaN in holes; photos: pixels (rows, cols, bands) of `extent.photos`. Returns "ortho"
    uint8 (rows, cols, 4), "coverage", "rejected" and "height_source" uint8 (rows, cols), and "statistics".
    """
    views = _views(block, extent)
    scene = _scene(heights, extent, views, rules)
    parts = [PhotoPixelsAt(pixels, part.window, part.level) for pixels, part in zip(photos, extent.photos, strict=True)]
    height, width = extent.window.shape
    outputs = {name: np.zeros((height, width), np.uint8) for name in ("coverage", "rejected", "height_source")}
    outputs["ortho"] = np.zeros((height, width, 4), np.uint8)
    tally = {"difference_sum": 0.0, "difference_count": 0, "seen": np.zeros(len(parts)), "share": np.zeros(len(parts))}
    for top in range(0, height, STRIP):
        window = Window(extent.window.row + top, extent.window.col, min(STRIP, height - top), width)
        ground = scene.ground.part(window)
        blended, seeing = _strip(ground, scene, parts, views, radiometry, rules, top)
        rows = slice(top, top + window.height)
        outputs["ortho"][rows] = _rgba(blended)
        outputs["coverage"][rows] = seeing.sum(axis=0)
        outputs["rejected"][rows] = blended.rejected
        measured = _to_ortho(~np.isnan(heights), extent.heights, extent.divisor, window)
        outputs["height_source"][rows] = np.where(np.isnan(ground.z), NO_HEIGHT, np.where(measured, MEASURED, DRAPED))
        tally["difference_sum"] += float(np.nansum(blended.difference, dtype=np.float64))
        tally["difference_count"] += int(np.isfinite(blended.difference).sum())
        tally["seen"] += seeing.sum(axis=(1, 2))
        tally["share"] += blended.share
    return {**outputs, "statistics": _statistics(outputs, [view.name for view in views], tally)}


def _every(ground: Ground, spacing: int) -> Ground:
    """Every `spacing`-th pixel of the whole grid, as a ground with larger cells around the same centres."""
    grid, window = ground.grid, ground.window
    row, col = -(-window.row // spacing), -(-window.col // spacing)
    take = slice(row * spacing - window.row, None, spacing), slice(col * spacing - window.col, None, spacing)
    cell = grid.cell * spacing
    coarse = MapGrid(
        west=grid.west + 0.5 * (grid.cell - cell),
        north=grid.north - 0.5 * (grid.cell - cell),
        cell=cell,
        rows=-(-grid.rows // spacing),
        cols=-(-grid.cols // spacing),
    )
    z, dx, dy = (np.ascontiguousarray(values[take]) for values in (ground.z, ground.dx, ground.dy))
    return Ground(coarse, Window(row, col, *z.shape), z, dx, dy)


def sample_tile(
    heights: np.ndarray, block: Block, photos: tuple[np.ndarray, ...], extent: TileExtent, rules: TextureRules, spacing: int
) -> Samples:
    """Grey values of every `spacing`-th ortho pixel of a tile in all photos that see it; only points seen twice or more.

    Inputs as for `texture_tile`, the photos at a coarser pyramid level so that noise and small mismatches are averaged out.
    """
    views = _views(block, extent)
    ground = _every(ground_of(heights, extent.heights, extent.dsm, extent.ortho, extent.window), spacing)
    model = HeightModel(bridge_holes(heights, rules.bridge), extent.dsm, extent.heights)
    targets = _targets(ground, extent.dsm)
    number = (ground.window.row + np.arange(ground.window.height))[:, None] * ground.grid.cols + (
        ground.window.col + np.arange(ground.window.width)
    )
    rows = []
    for pixels, part, view in zip(photos, extent.photos, views, strict=True):
        seen = visible_targets(model, view, targets, rules.tolerance)
        sampled = sample_photo(view, PhotoPixelsAt(pixels, part.window, part.level), ground, seen, 0.0)
        mask = sampled.worth > 0
        grey = np.broadcast_to(sampled.colour[mask], (int(mask.sum()), 3))
        rows.append((number[mask], np.full(len(grey), block.names.index(view.name)), sampled.r2[mask], *grey.T))
    return _seen_twice(rows)


def _seen_twice(rows: list[tuple[np.ndarray, ...]]) -> Samples:
    columns = [np.concatenate(column) for column in zip(*rows, strict=True)] if rows else [np.zeros(0)] * 6
    point, photo = columns[0].astype(np.int64), columns[1].astype(np.int32)
    r2, first, second, third = (column.astype(np.float32) for column in columns[2:])
    samples = Samples(point, photo, r2, first, second, third)
    if not len(samples):
        return samples
    _, group, counts = np.unique(point, return_inverse=True, return_counts=True)
    order = np.lexsort((photo, point))
    return samples.take(order[counts[group][order] >= 2])


def balance(samples: tuple[Samples, ...], block: Block, deep: bool, method: str, vignetting: bool) -> Radiometry:
    """The radiometry of the block from the samples of all tiles.

    `deep`: the photos have 16 bits; 0 to 255 then stretches from 0 to a little above the brightest thousandth of the samples.
    `method` "none" leaves the photos' grey values as they are (the stretch remains).
    """
    merged = Samples(**{name: np.concatenate([getattr(part, name) for part in samples]) for name in Samples.__dataclass_fields__})
    white = 255.0
    if deep:
        white = float(min(1.05 * np.quantile(merged.grey, 0.999), 65535.0)) if len(merged) else 65535.0
    identity = balance_block(block.names, merged.take(np.zeros(len(merged), bool)), white, vignetting)
    return identity if method == "none" else balance_block(block.names, merged, white, vignetting)
