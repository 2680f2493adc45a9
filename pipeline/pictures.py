"""Pictures of rasters for the report: reduced chunk by chunk, coloured by style, encoded as data URIs.

A raster of any size is read one chunk at a time and reduced on the way, by means (heights, colours) or by the middle pixel
(codes). Where there is no value the picture shows a pale hatching, which no colour map contains. Photographs and shaded relief
become JPEG, everything else PNG with a palette, so that a colour in the picture is exactly a colour of its legend.
"""

import base64
import math
import struct
import zlib
from dataclasses import dataclass, field

import cv2
import matplotlib
import numpy as np

from pipeline.numbers import nice_step
from pipeline.reading import ReadableStore
from schemas.raster import RasterSpec, Window, tiles_of
from schemas.report import Picture

LIMIT = 1100
"""longest side of a picture, px"""
HATCH = np.array([[244, 243, 239], [219, 217, 210]], np.uint8)
HATCH_PERIOD = 8
RELIEF = ("#3f6b57", "#6f9271", "#b3b98a", "#dccf9f", "#c9a778", "#a17c5f", "#7d6256", "#cdc4bd", "#f4f1ee")
BLUE_WHITE_RED = ("#08306b", "#2a6fb0", "#7fb5d8", "#d6e6ef", "#f7f7f5", "#f6d5c3", "#e58f6f", "#be3a34", "#67001f")
UNKNOWN_CODE = "#8a8a8a"
CODES, COLOUR_STEPS = 256, 254


@dataclass(frozen=True)
class Overview:
    """A raster in reduced size. `values` (rows, cols) or (rows, cols, bands) in float64; `share` (rows, cols) of pixels with a value."""

    values: np.ndarray
    share: np.ndarray
    factor: int


@dataclass(frozen=True)
class ColourBar:
    """How colours stand for values, and how often the values occur (`counts` over equal steps from `low` to `high`)."""

    low: float
    high: float
    unit: str
    colours: tuple[str, ...]
    counts: tuple[int, ...]


@dataclass(frozen=True)
class ClassEntry:
    """One line of a legend of codes; `share` of all pixels, in per cent."""

    colour: str
    meaning: str
    share: float


@dataclass(frozen=True)
class ScaleBar:
    """A round length on the ground and the part of the picture's width that it takes, in per cent."""

    metres: float
    per_cent: float


@dataclass(frozen=True)
class Drawing:
    """A picture as the report shows it. Corners are (x, y) of the outer upper-left and lower-right corner, m."""

    uri: str
    width: int
    height: int
    bar: ColourBar | None = None
    classes: tuple[ClassEntry, ...] = ()
    empty_share: float = 0.0
    """per cent of the picture without a value"""
    scale: ScaleBar | None = None
    corners: tuple[tuple[float, float], tuple[float, float]] | None = None


@dataclass(frozen=True)
class _Painted:
    uri: str
    bar: ColourBar | None = None
    classes: tuple[ClassEntry, ...] = field(default=())


def draw(store: ReadableStore, picture: Picture, limit: int = LIMIT) -> Drawing:
    """Draw the raster of `picture`, at most `limit` px a side. Raises StoreError when it does not exist."""
    spec = store.spec(picture.raster)
    seen = overview(store, picture.raster, limit, nearest=picture.style == "classes")
    painted = PAINTERS[picture.style](seen, picture, spec)
    rows, cols = seen.share.shape
    return Drawing(painted.uri, cols, rows, painted.bar, painted.classes, 100 * float(1 - np.mean(seen.share)), _scale_bar(spec), _corners(spec))


# --- reducing ----------------------------------------------------------------------------------------------------------------


def overview(store: ReadableStore, name: str, limit: int, nearest: bool) -> Overview:
    """A raster reduced by a whole factor to `limit` px or less, reading one chunk at a time.

    `nearest` takes the middle pixel of every block; otherwise the mean of its pixels that have a value (finite, not nodata,
    alpha above 0). Blocks without any are NaN.
    """
    spec = store.spec(name)
    factor = max(1, -(-max(spec.shape[:2]) // limit))
    rows, cols = -(-spec.shape[0] // factor), -(-spec.shape[1] // factor)
    bands = spec.shape[2] if len(spec.shape) == 3 else 1
    total, count, area = np.zeros((rows, cols, bands)), np.zeros((rows, cols, 1)), np.zeros((rows, cols, 1))
    for tile in tiles_of(spec.shape, max(spec.chunk, 64)):
        values, weight, place = _thinned(store, spec, tile.window, factor) if nearest else _summed(store, spec, tile.window, factor)
        total[place] += values
        count[place] += weight[0]
        area[place] += weight[1]
    with np.errstate(invalid="ignore"):
        means = np.where(count > 0, total / count, np.nan)
    return Overview(means if len(spec.shape) == 3 else means[..., 0], (count / np.maximum(area, 1))[..., 0], factor)


def _pixels(store: ReadableStore, spec: RasterSpec, window: Window) -> tuple[np.ndarray, np.ndarray]:
    """Values (h, w, bands) float64, 0 where absent, and presence (h, w, 1)."""
    raw = store.read(spec.name, window)
    raw = raw[..., None] if raw.ndim == 2 else raw
    present = np.isfinite(raw).all(axis=2, keepdims=True)
    if spec.nodata is not None:
        present &= (raw != spec.nodata).any(axis=2, keepdims=True)
    if raw.shape[2] == 4:
        present &= raw[..., 3:] > 0
    return np.where(present, raw, 0).astype(np.float64), present.astype(np.float64)


def _summed(store: ReadableStore, spec: RasterSpec, window: Window, factor: int):
    values, present = _pixels(store, spec, window)
    rows, row_starts = _blocks(window.row, window.height, factor)
    cols, col_starts = _blocks(window.col, window.width, factor)

    def sums(array: np.ndarray) -> np.ndarray:
        return np.add.reduceat(np.add.reduceat(array, row_starts, axis=0), col_starts, axis=1)

    return sums(values), (sums(present), sums(np.ones_like(present))), (rows, cols)


def _blocks(start: int, length: int, factor: int) -> tuple[slice, np.ndarray]:
    """Which blocks the pixels from `start` belong to, and where each block begins among them."""
    block = np.arange(start, start + length) // factor
    return slice(int(block[0]), int(block[-1]) + 1), np.flatnonzero(np.diff(block, prepend=block[0] - 1))


def _thinned(store: ReadableStore, spec: RasterSpec, window: Window, factor: int):
    rows, row_pick = _middles(window.row, window.height, factor, spec.shape[0])
    cols, col_pick = _middles(window.col, window.width, factor, spec.shape[1])
    values, present = _pixels(store, spec, window)
    picked = np.ix_(row_pick, col_pick)
    return values[picked], (present[picked], np.ones_like(present[picked])), (rows, cols)


def _middles(start: int, length: int, factor: int, size: int) -> tuple[slice, np.ndarray]:
    """Blocks whose middle pixel (the last pixel in a cut block) lies in the window, and that pixel's place in the window."""
    blocks = np.arange(-(-size // factor))
    middle = np.minimum(blocks * factor + factor // 2, size - 1)
    inside = blocks[(middle >= start) & (middle < start + length)]
    first = int(inside[0]) if len(inside) else 0
    return slice(first, first + len(inside)), middle[inside] - start


# --- colouring ---------------------------------------------------------------------------------------------------------------


def _paint_hillshade(seen: Overview, picture: Picture, spec: RasterSpec) -> _Painted:
    """Heights tinted by elevation and shaded by light from the north-west, with a little light from the west and the north."""
    heights = _plane(seen)
    low, high = _limits(heights, picture)
    tint = palette(RELIEF, CODES)[_steps(heights, low, high, CODES)].astype(np.float64)
    cell = abs(spec.transform[0]) * seen.factor if spec.transform else 1.0
    shaded = np.clip(tint * _shade(heights, cell)[..., None], 0, 255)
    return _Painted(_jpeg(_composed(shaded, np.isfinite(heights).astype(float))), _bar(heights, low, high, RELIEF, picture, spec))


def _shade(heights: np.ndarray, cell: float) -> np.ndarray:
    """Brightness about 1. Relief is exaggerated until its steeper slopes show, whatever the terrain."""
    east, south = _slope(heights, 1) / cell, _slope(heights, 0) / cell
    steep = np.hypot(east, south)
    usual = np.nanpercentile(steep, 90) if np.isfinite(steep).any() else 0.0
    exaggeration = float(np.clip(0.5 / usual, 0.3, 6.0)) if usual > 0 else 1.0
    east, south = east * exaggeration, south * exaggeration
    normal = np.sqrt(1 + east**2 + south**2)
    light = sum(weight * np.clip((-east * x - south * y + z) / normal, 0, 1) for weight, x, y, z in SUNS)
    return np.nan_to_num(0.42 + 0.80 * light, nan=1.0)


SUNS = ((0.70, -0.5, -0.5, math.sqrt(0.5)), (0.15, -math.sqrt(0.5), 0.0, math.sqrt(0.5)), (0.15, 0.0, -math.sqrt(0.5), math.sqrt(0.5)))
"""(weight, east, south, up) of the light's direction"""


def _slope(heights: np.ndarray, axis: int) -> np.ndarray:
    """Height difference per pixel along an axis: the mean of the forward and the backward step, or the one that exists."""
    steps = np.diff(heights, axis=axis)
    edge = np.full_like(np.take(heights, [0], axis=axis), np.nan)
    both = np.stack([np.concatenate([steps, edge], axis=axis), np.concatenate([edge, steps], axis=axis)])
    count = np.isfinite(both).sum(axis=0)
    return np.where(np.isfinite(heights), np.nansum(both, axis=0) / np.maximum(count, 1), np.nan)


def _paint_rgb(seen: Overview, picture: Picture, spec: RasterSpec) -> _Painted:
    """Colours as they are; more than 8 bits are stretched between the 1st and 99th percentile."""
    values = seen.values if seen.values.ndim == 3 else seen.values[..., None]
    colours = values[..., :3] if values.shape[2] >= 3 else np.repeat(values[..., :1], 3, axis=2)
    if spec.dtype != "uint8" and np.isfinite(colours).any():
        low, high = np.nanpercentile(colours, (1, 99))
        colours = (colours - low) / max(high - low, 1e-12) * 255
    return _Painted(_jpeg(_composed(np.clip(np.nan_to_num(colours), 0, 255), seen.share)))


def _paint_ramp(seen: Overview, picture: Picture, spec: RasterSpec) -> _Painted:
    name = picture.colours if picture.colours in matplotlib.colormaps else "viridis"
    colours = tuple(matplotlib.colors.to_hex(colour) for colour in matplotlib.colormaps[name](np.linspace(0, 1, 17)))
    values = _plane(seen)
    return _paint_steps(values, *_limits(values, picture), colours, picture, spec)


def _paint_diverging(seen: Overview, picture: Picture, spec: RasterSpec) -> _Painted:
    """Symmetric about 0: blue below, red above."""
    values = _plane(seen)
    given = [abs(limit) for limit in (picture.low, picture.high) if limit is not None]
    bound = max(given) if given else _percentile(np.abs(values), 98)
    return _paint_steps(values, -(bound or 1.0), bound or 1.0, BLUE_WHITE_RED, picture, spec)


def _paint_steps(values: np.ndarray, low: float, high: float, colours: tuple[str, ...], picture: Picture, spec: RasterSpec) -> _Painted:
    index = 2 + _steps(values, low, high, COLOUR_STEPS)
    index = np.where(np.isfinite(values), index, _hatch(values.shape)).astype(np.uint8)
    table = np.concatenate([HATCH, palette(colours, COLOUR_STEPS)])
    return _Painted(_png(index, table), _bar(values, low, high, colours, picture, spec))


def _paint_classes(seen: Overview, picture: Picture, spec: RasterSpec) -> _Painted:
    """Codes in the colours given; a code nobody explained is grey and said to be unknown."""
    codes = np.where(seen.share > 0, _plane(seen), -1).astype(np.int64)
    known = picture.classes[:CODES - 3]
    index = np.full(codes.shape, len(known) + 2)
    for place, (code, _, _) in enumerate(known):
        index[codes == code] = place + 2
    index = np.where(seen.share > 0, index, _hatch(codes.shape))
    entries = [(colour, meaning) for _, colour, meaning in known] + [(UNKNOWN_CODE, "code without explanation")]
    counts = np.bincount(index.ravel(), minlength=len(entries) + 2)[2:]
    table = np.concatenate([HATCH, palette(tuple(colour for colour, _ in entries), len(entries))])
    legend = tuple(ClassEntry(colour, meaning, 100 * count / codes.size) for (colour, meaning), count in zip(entries, counts, strict=True))
    return _Painted(_png(index.astype(np.uint8), table), classes=legend if counts[-1] else legend[:-1])


PAINTERS = {"hillshade": _paint_hillshade, "rgb": _paint_rgb, "ramp": _paint_ramp, "diverging": _paint_diverging, "classes": _paint_classes}


def _plane(seen: Overview) -> np.ndarray:
    return seen.values if seen.values.ndim == 2 else seen.values[..., 0]


def _limits(values: np.ndarray, picture: Picture) -> tuple[float, float]:
    low = _percentile(values, 2) if picture.low is None else picture.low
    high = _percentile(values, 98) if picture.high is None else picture.high
    return low, high if high > low else low + (abs(low) * 1e-3 or 1.0)


def _percentile(values: np.ndarray, share: float) -> float:
    present = values[np.isfinite(values)]
    return float(np.percentile(present, share)) if present.size else 0.0


def _steps(values: np.ndarray, low: float, high: float, count: int) -> np.ndarray:
    return np.nan_to_num(np.clip((values - low) / (high - low), 0, 1) * (count - 1)).round().astype(np.int64)


def palette(colours: tuple[str, ...], count: int) -> np.ndarray:
    """(count, 3) uint8: `colours` ("#rrggbb") spread evenly and interpolated linearly."""
    stops = np.array([tuple(bytes.fromhex(colour.lstrip("#"))) for colour in colours], np.float64)
    at = np.linspace(0, len(colours) - 1, count)
    return np.column_stack([np.interp(at, np.arange(len(colours)), stops[:, band]) for band in range(3)]).round().astype(np.uint8)


def _bar(values: np.ndarray, low: float, high: float, colours: tuple[str, ...], picture: Picture, spec: RasterSpec) -> ColourBar | None:
    present = values[np.isfinite(values)]
    if not present.size:
        return None
    counts = np.histogram(np.clip(present, low, high), bins=48, range=(low, high))[0]
    return ColourBar(low, high, picture.unit or spec.unit, colours, tuple(counts.tolist()))


# --- hatching and encoding ---------------------------------------------------------------------------------------------------


def _hatch(shape: tuple[int, ...]) -> np.ndarray:
    """0 and 1: thin diagonal lines."""
    rows, cols = np.ogrid[:shape[0], :shape[1]]
    return ((rows + cols) % HATCH_PERIOD == 0).astype(np.int64)


def _composed(colours: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Colours (rows, cols, 3) over the hatching, by the share of pixels that have a value."""
    back = HATCH[_hatch(share.shape)].astype(np.float64)
    return np.rint(colours * share[..., None] + back * (1 - share[..., None])).astype(np.uint8)


def _uri(kind: str, data: bytes) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def _jpeg(colours: np.ndarray) -> str:
    data = cv2.imencode(".jpg", np.ascontiguousarray(colours[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, 87])[1]
    return _uri("jpeg", data.tobytes())


def _png(index: np.ndarray, table: np.ndarray) -> str:
    """A PNG with a palette of at most 256 colours (PNG specification, colour type 3, no filter)."""
    rows, cols = index.shape
    lines = np.concatenate([np.zeros((rows, 1), np.uint8), index], axis=1).tobytes()
    header = struct.pack(">IIBBBBB", cols, rows, 8, 3, 0, 0, 0)
    parts = ((b"IHDR", header), (b"PLTE", table.astype(np.uint8).tobytes()), (b"IDAT", zlib.compress(lines, 9)), (b"IEND", b""))
    return _uri("png", b"\x89PNG\r\n\x1a\n" + b"".join(_png_chunk(kind, data) for kind, data in parts))


def _png_chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


# --- place on the ground -----------------------------------------------------------------------------------------------------


def _scale_bar(spec: RasterSpec) -> ScaleBar | None:
    if spec.transform is None:
        return None
    width = abs(spec.transform[0]) * spec.shape[1]
    metres = nice_step(width, 5)
    return ScaleBar(metres, 100 * metres / width)


def _corners(spec: RasterSpec) -> tuple[tuple[float, float], tuple[float, float]] | None:
    if spec.transform is None:
        return None
    a, _, west, _, e, north = spec.transform
    return (west, north), (west + a * spec.shape[1], north + e * spec.shape[0])
