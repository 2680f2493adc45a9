"""Pictures of rasters for the report: reduced, coloured by style, with their legend and their location on the ground.

One painter per style turns an overview into an image and its legend. Where there is no value the picture shows a pale hatching,
which cannot be mistaken for a colour of a colour map.
"""

from dataclasses import dataclass

import matplotlib
import numpy as np
from pyproj import CRS

from orthomill.pipeline.painting.map_colours import (
    BLUE_WHITE_RED,
    RELIEF,
    UNKNOWN_CODE,
    exaggeration,
    limits,
    palette,
    percentile,
    shade,
)
from orthomill.pipeline.painting.overview import Overview, overview
from orthomill.pipeline.report.image_uri import jpeg_uri, png_uri
from orthomill.pipeline.report.numbers import nice_step
from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.schemas.raster import NO_UNIT, RasterSpec
from orthomill.schemas.stage_report import Picture

LIMIT = 1100
"""longest side of a picture, px: a full screen; larger ones would make the page too heavy to send by e-mail"""
HATCH = np.array([[244, 243, 239], [219, 217, 210]], np.uint8)
HATCH_PERIOD = 8
CODES, COLOUR_STEPS = 256, 254
"""A palette has 256 entries; two of them are the hatching."""


@dataclass(frozen=True)
class ColourBar:
    """Which colours represent which values, and how often the values occur (`counts` in equal steps from `low` to `high`)."""

    low: float
    high: float
    unit: str
    colours: tuple[str, ...]
    counts: tuple[int, ...]


@dataclass(frozen=True)
class ClassEntry:
    """One line of a legend of codes; `share` of all pixels, %."""

    colour: str
    meaning: str
    share: float


@dataclass(frozen=True)
class ScaleBar:
    """A round length on the ground and the share of the picture's width that it takes, %."""

    metres: float
    per_cent: float


@dataclass(frozen=True)
class Drawing:
    """A picture as shown in the report. `corners` are (x, y) of the outer upper-left and lower-right corner, m."""

    uri: str
    width: int
    height: int
    bar: ColourBar | None = None
    classes: tuple[ClassEntry, ...] = ()
    empty_share: float = 0.0
    """share of the picture without a value, %"""
    scale: ScaleBar | None = None
    corners: tuple[tuple[float, float], tuple[float, float]] | None = None
    north: bool = False
    """whether north is up"""


@dataclass(frozen=True)
class _Painted:
    uri: str
    bar: ColourBar | None = None
    classes: tuple[ClassEntry, ...] = ()


def draw(store: ReadableStore, picture: Picture, limit: int = LIMIT) -> Drawing:
    """Draw the raster of `picture`, at most `limit` px a side. Raises StoreError when it does not exist."""
    spec = store.spec(picture.raster)
    seen = overview(store, picture.raster, limit, nearest=picture.style == "classes")
    painted = PAINTERS[picture.style](seen, picture, spec)
    rows, cols = seen.share.shape
    empty = 100 * float(1 - np.mean(seen.share))
    return Drawing(
        uri=painted.uri,
        width=cols,
        height=rows,
        bar=painted.bar,
        classes=painted.classes,
        empty_share=empty,
        scale=_scale_bar(spec),
        corners=_corners(spec),
        north=_is_map(spec),
    )


# --- colouring ---------------------------------------------------------------------------------------------------------------


def _paint_hillshade(seen: Overview, picture: Picture, spec: RasterSpec) -> _Painted:
    """Heights tinted by elevation and shaded by light from the north-west, with some light from the west and the north."""
    # Weak second lights keep slopes that run along the main light from looking flat.
    heights = _plane(seen)
    low, high = limits(heights, picture)
    tint = palette(RELIEF, CODES)[_steps(heights, low, high, CODES)].astype(np.float64)
    cell = abs(spec.transform[0]) * seen.factor if spec.transform else 1.0
    shaded = np.clip(tint * shade(heights, cell, exaggeration(heights, cell))[..., None], 0, 255)
    bar = _bar(heights, _Scale(low, high, RELIEF, picture.unit or spec.unit))
    return _Painted(jpeg_uri(_composed(shaded, np.isfinite(heights).astype(float))), bar)


def _paint_rgb(seen: Overview, picture: Picture, spec: RasterSpec) -> _Painted:
    """Colours as stored; more than 8 bits are stretched between the 1st and 99th percentile."""
    values = seen.values if seen.values.ndim == 3 else seen.values[..., None]
    colours = values[..., :3] if values.shape[2] >= 3 else np.repeat(values[..., :1], 3, axis=2)
    if spec.dtype != "uint8" and np.isfinite(colours).any():
        low, high = np.nanpercentile(colours, (1, 99))
        colours = (colours - low) / max(high - low, 1e-12) * 255
    return _Painted(jpeg_uri(_composed(np.clip(np.nan_to_num(colours), 0, 255), seen.share)))


def _paint_ramp(seen: Overview, picture: Picture, spec: RasterSpec) -> _Painted:
    # A stage may name a colour map that this version of matplotlib does not have; the picture matters more than its colours.
    name = picture.colours if picture.colours in matplotlib.colormaps else "viridis"
    colours = tuple(matplotlib.colors.to_hex(colour) for colour in matplotlib.colormaps[name](np.linspace(0, 1, 17)))
    values = _plane(seen)
    return _paint_steps(values, _Scale(*limits(values, picture), colours, picture.unit or spec.unit))


def _paint_diverging(seen: Overview, picture: Picture, spec: RasterSpec) -> _Painted:
    """Symmetric about 0: blue below, red above."""
    values = _plane(seen)
    given = [abs(limit) for limit in (picture.low, picture.high) if limit is not None]
    bound = max(given) if given else percentile(np.abs(values), 98)
    return _paint_steps(values, _Scale(-(bound or 1.0), bound or 1.0, BLUE_WHITE_RED, picture.unit or spec.unit))


@dataclass(frozen=True)
class _Scale:
    """A range of values and the colours it runs through."""

    low: float
    high: float
    colours: tuple[str, ...]
    unit: str


def _paint_steps(values: np.ndarray, scale: _Scale) -> _Painted:
    index = 2 + _steps(values, scale.low, scale.high, COLOUR_STEPS)
    index = np.where(np.isfinite(values), index, _hatch(values.shape)).astype(np.uint8)
    table = np.concatenate([HATCH, palette(scale.colours, COLOUR_STEPS)])
    return _Painted(png_uri(index, table), _bar(values, scale))


def _paint_classes(seen: Overview, picture: Picture, spec: RasterSpec) -> _Painted:
    """Codes in the given colours; codes without an explanation are grey and listed as such."""
    codes = np.where(seen.share > 0, _plane(seen), -1).astype(np.int64)
    # Two palette entries are the hatching and one is the unknown code.
    known = picture.classes[: CODES - 3]
    index = np.full(codes.shape, len(known) + 2)
    for place, (code, _, _) in enumerate(known):
        index[codes == code] = place + 2
    index = np.where(seen.share > 0, index, _hatch(codes.shape))
    entries = [(colour, meaning) for _, colour, meaning in known] + [(UNKNOWN_CODE, "code without explanation")]
    counts = np.bincount(index.ravel(), minlength=len(entries) + 2)[2:]
    table = np.concatenate([HATCH, palette(tuple(colour for colour, _ in entries), len(entries))])
    legend = tuple(ClassEntry(*entry, 100 * count / codes.size) for entry, count in zip(entries, counts, strict=True))
    return _Painted(png_uri(index.astype(np.uint8), table), classes=legend if counts[-1] else legend[:-1])


PAINTERS = {
    "hillshade": _paint_hillshade,
    "rgb": _paint_rgb,
    "ramp": _paint_ramp,
    "diverging": _paint_diverging,
    "classes": _paint_classes,
}


def _plane(seen: Overview) -> np.ndarray:
    return seen.values if seen.values.ndim == 2 else seen.values[..., 0]


def _steps(values: np.ndarray, low: float, high: float, count: int) -> np.ndarray:
    return np.nan_to_num(np.clip((values - low) / (high - low), 0, 1) * (count - 1)).round().astype(np.int64)


def _bar(values: np.ndarray, scale: _Scale) -> ColourBar | None:
    present = values[np.isfinite(values)]
    if not present.size:
        return None
    counts = np.histogram(np.clip(present, scale.low, scale.high), bins=48, range=(scale.low, scale.high))[0]
    return ColourBar(scale.low, scale.high, scale.unit, scale.colours, tuple(counts.tolist()))


# --- hatching --------------------------------------------------------------------------------------------------------------


def _hatch(shape: tuple[int, ...]) -> np.ndarray:
    """Thin diagonal lines as an array of 0 and 1."""
    rows, cols = np.ogrid[: shape[0], : shape[1]]
    return ((rows + cols) % HATCH_PERIOD == 0).astype(np.int64)


def _composed(colours: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Colours (rows, cols, 3) over the hatching, by the share of pixels that have a value."""
    back = HATCH[_hatch(share.shape)].astype(np.float64)
    return np.rint(colours * share[..., None] + back * (1 - share[..., None])).astype(np.uint8)


# --- place on the ground -----------------------------------------------------------------------------------------------------


def _is_map(spec: RasterSpec) -> bool:
    """Whether a raster lies on the earth: a facade has no north, nor has a block without positions and control."""
    return spec.transform is not None and spec.crs is not None and not CRS.from_user_input(spec.crs).is_engineering


def _scale_bar(spec: RasterSpec) -> ScaleBar | None:
    if spec.transform is None or (spec.crs and CRS.from_user_input(spec.crs).axis_info[0].unit_name == NO_UNIT):
        return None
    width = abs(spec.transform[0]) * spec.shape[1]
    metres = nice_step(width, 5)
    return ScaleBar(metres, 100 * metres / width)


def _corners(spec: RasterSpec) -> tuple[tuple[float, float], tuple[float, float]] | None:
    if spec.transform is None:
        return None
    a, _, west, _, e, north = spec.transform
    return (west, north), (west + a * spec.shape[1], north + e * spec.shape[0])
