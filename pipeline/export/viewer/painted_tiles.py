"""Rasters painted tile by tile for a map: the same colours everywhere, whatever the tile shows.

The limits of colours and the exaggeration of relief are those of an overview of the whole raster.
"""

from collections.abc import Callable
from dataclasses import dataclass

import matplotlib
import numpy as np

from orthomill.pipeline.painting.map_colours import BLUE_WHITE_RED, RELIEF, UNKNOWN_CODE, exaggeration, limits, palette, shade
from orthomill.pipeline.painting.overview import overview
from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.schemas.raster import RasterSpec, Window
from orthomill.schemas.stage_report import Picture

OVERVIEW = 1000
"""px along the longer side of the overview from which limits are taken"""
STEPS = 256


@dataclass(frozen=True)
class MapLegend:
    """What the colours of a layer mean: classes (colour, meaning), or a ramp of colours from low to high."""

    classes: tuple[tuple[str, str], ...] = ()
    colours: tuple[str, ...] = ()
    low: float | None = None
    high: float | None = None
    unit: str = ""


@dataclass(frozen=True)
class PaintedRaster:
    """A raster of the store with its paint."""

    picture: Picture
    spec: RasterSpec
    legend: MapLegend
    paint: Callable[[np.ndarray], np.ndarray]
    """(rows, cols) or (rows, cols, bands) values to (rows, cols, 4) uint8; relief gets a pixel more on every side, and loses it"""
    rim: int = 0

    def tile(self, store: ReadableStore, window: Window) -> np.ndarray:
        """(height, width, 4) uint8 of a window inside the raster."""
        wide = window.grown(self.rim).clipped(self.spec.shape)
        return self.paint(store.read(self.spec.name, wide))[window.within(wide).slices]


def painted(store: ReadableStore, picture: Picture) -> PaintedRaster:
    """The raster of a picture, ready to be painted. Raises StoreError when it does not exist."""
    spec = store.spec(picture.raster)
    if picture.style == "rgb":
        return PaintedRaster(picture, spec, MapLegend(), _rgb if spec.dtype == "uint8" else _stretched(store, picture))
    if picture.style == "classes":
        known = tuple((colour, meaning) for code, colour, meaning in picture.classes if code != spec.nodata)
        return PaintedRaster(picture, spec, MapLegend(classes=known), _classes(picture, spec))
    seen = overview(store, picture.raster, OVERVIEW, nearest=False)
    values = seen.values if seen.values.ndim == 2 else seen.values[..., 0]
    low, high = limits(values, picture)
    colours: tuple[str, ...] = RELIEF
    if picture.style == "diverging":
        high = max(abs(low), abs(high))
        low, colours = -high, BLUE_WHITE_RED
    elif picture.style == "ramp":
        colours = tuple(matplotlib.colors.to_hex(c) for c in matplotlib.colormaps[picture.colours](np.linspace(0, 1, 17)))
    legend = MapLegend(colours=colours, low=low, high=high, unit=picture.unit or spec.unit)
    table = np.concatenate([palette(colours, STEPS), np.full((STEPS, 1), 255, np.uint8)], axis=1)
    if picture.style != "hillshade":
        return PaintedRaster(picture, spec, legend, lambda v: _ramp(v, low, high, table))
    cell = abs(spec.transform[0]) if spec.transform else 1.0
    # On cells of its own an overview is flatter than the raster: its slopes only tell how hilly the land is.
    steep = exaggeration(values, cell * seen.factor)
    return PaintedRaster(picture, spec, legend, lambda v: _relief(v, (low, high), table, cell, steep), rim=1)


def _plane(values: np.ndarray) -> np.ndarray:
    return values if values.ndim == 2 else values[..., 0]


def _rgb(values: np.ndarray) -> np.ndarray:
    if values.shape[2] == 4:
        return values
    return np.concatenate([values[..., :3], np.full((*values.shape[:2], 1), 255, np.uint8)], axis=2)


def _stretched(store: ReadableStore, picture: Picture) -> Callable[[np.ndarray], np.ndarray]:
    """Colours of more than 8 bits, from their 1st to their 99th percentile."""
    seen = overview(store, picture.raster, OVERVIEW, nearest=False).values[..., :3]
    low, high = np.nanpercentile(seen, (1, 99)) if np.isfinite(seen).any() else (0.0, 1.0)

    def paint(values: np.ndarray) -> np.ndarray:
        colours = (values[..., :3].astype(np.float64) - low) / max(high - low, 1e-12) * 255
        opaque = values[..., 3:] > 0 if values.shape[2] == 4 else np.ones((*values.shape[:2], 1), bool)
        return np.concatenate([np.rint(np.clip(colours, 0, 255)), 255 * opaque], axis=2).astype(np.uint8)

    return paint


def _classes(picture: Picture, spec: RasterSpec) -> Callable[[np.ndarray], np.ndarray]:
    table = np.zeros((256, 4), np.uint8)
    table[:, :3], table[:, 3] = palette((UNKNOWN_CODE,), 1)[0], 255
    for known, colour, _ in picture.classes:
        table[known, :3] = palette((colour,), 1)[0]
    # Code 0 is no value in every raster of codes that has an empty class.
    empty = next((code for code, _, meaning in picture.classes if code == 0 and meaning.startswith(("empty", "no "))), None)
    for code in (empty, None if spec.nodata is None or spec.nodata != spec.nodata else int(spec.nodata)):
        if code is not None:
            table[code] = 0
    narrow = spec.dtype == "uint8"
    return lambda values: table[_plane(values) if narrow else np.clip(_plane(values), 0, 255).astype(np.uint8)]


def _ramp(values: np.ndarray, low: float, high: float, table: np.ndarray) -> np.ndarray:
    plane = _plane(values)
    known = np.isfinite(plane)
    step = np.where(known, plane, low).astype(np.float32) - np.float32(low)
    out = table[np.rint(np.clip(step * np.float32((STEPS - 1) / (high - low)), 0, STEPS - 1)).astype(np.uint8)]
    out[~known] = 0
    return out


def _relief(values: np.ndarray, bounds: tuple[float, float], table: np.ndarray, cell: float, steep: float) -> np.ndarray:
    tinted = _ramp(values, *bounds, table).astype(np.float64)
    tinted[..., :3] *= shade(_plane(values).astype(np.float64), cell, steep)[..., None]
    return np.rint(np.clip(tinted, 0, 255)).astype(np.uint8)
