"""Rasters painted tile by tile for a map: the same colours everywhere, whatever the tile shows.

The limits of colours and the exaggeration of relief are those of an overview of the whole raster, or of a sample of a large one.
"""

from collections.abc import Callable
from dataclasses import dataclass

import matplotlib
import numpy as np

from orthomill.pipeline.painting.map_colours import BLUE_WHITE_RED, RELIEF, UNKNOWN_CODE, exaggeration, limits, palette, shade
from orthomill.pipeline.painting.overview import overview
from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.schemas.maps.map_parts import RIM, Shades
from orthomill.schemas.raster import RasterSpec, Window
from orthomill.schemas.stage_report import Picture

OVERVIEW = 1000
"""px along the longer side of the overview from which limits are taken"""
SAMPLE = 1024
"""chunks that the overview of a large raster is made of, spread evenly: percentiles of the others are the same"""
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
    paint: Callable[[np.ndarray], np.ndarray]
    """(rows, cols) or (rows, cols, bands) values to (rows, cols, 4) uint8; relief gets a pixel more on every side, and loses it"""
    rim: int = 0

    def tile(self, store: ReadableStore, window: Window) -> np.ndarray:
        """(height, width, 4) uint8 of a window inside the raster."""
        wide = window.grown(self.rim).clipped(self.spec.shape)
        return self.paint(store.read(self.spec.name, wide))[window.within(wide).slices]


def shades_of(store: ReadableStore, picture: Picture) -> Shades:
    """What the colours of a picture's raster rest on. Raises StoreError when it does not exist."""
    spec = store.spec(picture.raster)
    if picture.style == "classes" or (picture.style == "rgb" and spec.dtype == "uint8"):
        return Shades()
    seen = overview(store, picture.raster, OVERVIEW, nearest=False, most=SAMPLE)
    if picture.style == "rgb":
        return _stretched(seen.values[..., :3])
    values = _plane(seen.values)
    low, high = limits(values, picture)
    if picture.style == "diverging":
        high = max(abs(low), abs(high))
        low = -high
    # On cells of its own an overview is flatter than the raster: its slopes only tell how hilly the land is.
    steep = exaggeration(values, _cell(spec) * seen.factor) if picture.style == "hillshade" else 1.0
    return Shades(low=low, high=high, steep=steep)


def _stretched(seen: np.ndarray) -> Shades:
    """Colours of more than 8 bits, from their 1st to their 99th percentile."""
    low, high = map(float, np.nanpercentile(seen, (1, 99))) if np.isfinite(seen).any() else (0.0, 1.0)
    return Shades(low=low, high=high)


def legend_of(picture: Picture, spec: RasterSpec, shades: Shades) -> MapLegend:
    """What the colours of a picture mean."""
    if picture.style == "rgb":
        return MapLegend()
    if picture.style == "classes":
        return MapLegend(classes=tuple((colour, meaning) for code, colour, meaning in picture.classes if code != spec.nodata))
    return MapLegend(colours=_colours(picture), low=shades.low, high=shades.high, unit=picture.unit or spec.unit)


def _colours(picture: Picture) -> tuple[str, ...]:
    if picture.style == "ramp":
        return tuple(matplotlib.colors.to_hex(c) for c in matplotlib.colormaps[picture.colours](np.linspace(0, 1, 17)))
    return BLUE_WHITE_RED if picture.style == "diverging" else RELIEF


def painted(store: ReadableStore, picture: Picture, shades: Shades) -> PaintedRaster:
    """The raster of a picture, ready to be painted. Raises StoreError when it does not exist."""
    spec, low, high = store.spec(picture.raster), shades.low, shades.high
    if picture.style == "rgb":
        return PaintedRaster(picture, spec, _rgb if spec.dtype == "uint8" else lambda v: _stretch(v, low, high))
    if picture.style == "classes":
        return PaintedRaster(picture, spec, _classes(picture, spec))
    table = np.concatenate([palette(_colours(picture), STEPS), np.full((STEPS, 1), 255, np.uint8)], axis=1)
    if picture.style != "hillshade":
        return PaintedRaster(picture, spec, lambda v: _ramp(v, low, high, table))
    return PaintedRaster(picture, spec, lambda v: _relief(v, (low, high), table, _cell(spec), shades.steep), rim=RIM)


def _cell(spec: RasterSpec) -> float:
    return abs(spec.transform[0]) if spec.transform else 1.0


def _plane(values: np.ndarray) -> np.ndarray:
    return values if values.ndim == 2 else values[..., 0]


def _rgb(values: np.ndarray) -> np.ndarray:
    if values.shape[2] == 4:
        return values
    return np.concatenate([values[..., :3], np.full((*values.shape[:2], 1), 255, np.uint8)], axis=2)


def _stretch(values: np.ndarray, low: float, high: float) -> np.ndarray:
    colours = (values[..., :3].astype(np.float64) - low) / max(high - low, 1e-12) * 255
    opaque = values[..., 3:] > 0 if values.shape[2] == 4 else np.ones((*values.shape[:2], 1), bool)
    return np.concatenate([np.rint(np.clip(colours, 0, 255)), 255 * opaque], axis=2).astype(np.uint8)


def _classes(picture: Picture, spec: RasterSpec) -> Callable[[np.ndarray], np.ndarray]:
    # One more than the highest code: what is beyond it is unknown, too.
    table = np.zeros((max(256, 2 + max(code for code, _, _ in picture.classes)), 4), np.uint8)
    table[:, :3], table[:, 3] = palette((UNKNOWN_CODE,), 1)[0], 255
    for known, colour, _ in picture.classes:
        table[known, :3] = palette((colour,), 1)[0]
    # Code 0 is no value in every raster of codes that has an empty class.
    empty = next((code for code, _, meaning in picture.classes if code == 0 and meaning.startswith(("empty", "no "))), None)
    for code in (empty, None if spec.nodata is None or spec.nodata != spec.nodata else int(spec.nodata)):
        if code is not None:
            table[code] = 0
    narrow, last = spec.dtype == "uint8", len(table) - 1
    return lambda values: _looked_up(table, _plane(values) if narrow else np.clip(_plane(values), 0, last).astype(np.uint16))


def _looked_up(table: np.ndarray, codes: np.ndarray) -> np.ndarray:
    """The rows (..., 4) uint8 of a table (n, 4) uint8 that `codes` name."""
    # As one number each they are copied ten times as fast.
    return table.view(np.uint32)[:, 0].take(codes)[..., None].view(np.uint8)


def _ramp(values: np.ndarray, low: float, high: float, table: np.ndarray) -> np.ndarray:
    plane = _plane(values)
    known = np.isfinite(plane)
    step = np.where(known, plane, low).astype(np.float32) - np.float32(low)
    out = _looked_up(table, np.rint(np.clip(step * np.float32((STEPS - 1) / (high - low)), 0, STEPS - 1)).astype(np.uint8))
    out[~known] = 0
    return out


def _relief(values: np.ndarray, bounds: tuple[float, float], table: np.ndarray, cell: float, steep: float) -> np.ndarray:
    out = _ramp(values, *bounds, table)
    light = shade(_plane(values).astype(np.float64), cell, steep)
    for band in range(3):
        out[..., band] = np.rint(np.minimum(out[..., band] * light, 255))
    return out
