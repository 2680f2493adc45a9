"""Colours and shades of values on a map: palettes, limits of ramps, relief."""

import math

import numpy as np

from orthomill.schemas.stage_report import Picture

RELIEF = ("#3f6b57", "#6f9271", "#b3b98a", "#dccf9f", "#c9a778", "#a17c5f", "#7d6256", "#cdc4bd", "#f4f1ee")
BLUE_WHITE_RED = ("#08306b", "#2a6fb0", "#7fb5d8", "#d6e6ef", "#f7f7f5", "#f6d5c3", "#e58f6f", "#be3a34", "#67001f")
UNKNOWN_CODE = "#8a8a8a"


def palette(colours: tuple[str, ...], count: int) -> np.ndarray:
    """(count, 3) uint8: `colours` ("#rrggbb") spread evenly and interpolated linearly."""
    stops = np.array([tuple(bytes.fromhex(colour.lstrip("#"))) for colour in colours], np.float64)
    at = np.linspace(0, len(colours) - 1, count)
    return np.column_stack([np.interp(at, np.arange(len(colours)), stops[:, band]) for band in range(3)]).round().astype(np.uint8)


def limits(values: np.ndarray, picture: Picture) -> tuple[float, float]:
    """The least and the greatest value that colours tell apart, of values with NaN gaps."""
    # Percentiles, because a single blunder in a surface would take up most of the colour range.
    low = percentile(values, 2) if picture.low is None else picture.low
    high = percentile(values, 98) if picture.high is None else picture.high
    return low, high if high > low else low + (abs(low) * 1e-3 or 1.0)


def percentile(values: np.ndarray, share: float) -> float:
    """The value below which `share` % of the finite ones lie; 0 where there are none."""
    present = values[np.isfinite(values)]
    return float(np.percentile(present, share)) if present.size else 0.0


def exaggeration(heights: np.ndarray, cell: float) -> float:
    """By how much heights (rows, cols) m on cells of `cell` m are exaggerated such that the steeper slopes are visible in any
    terrain."""
    steep = np.hypot(_slope(heights, 1), _slope(heights, 0)) / cell
    # The 90th percentile: house walls, nearly vertical in a surface model, would otherwise flatten the terrain around them.
    usual = np.nanpercentile(steep, 90) if np.isfinite(steep).any() else 0.0
    return float(np.clip(0.5 / usual, 0.3, 6.0)) if usual > 0 else 1.0


def shade(heights: np.ndarray, cell: float, exaggerated: float) -> np.ndarray:
    """Brightness, about 1, of heights (rows, cols) m on cells of `cell` m, `exaggerated` by a factor; 1 where there is no
    height."""
    east, south = _slope(heights, 1) * exaggerated / cell, _slope(heights, 0) * exaggerated / cell
    normal = np.sqrt(1 + east**2 + south**2)
    light = sum(weight * np.clip((-east * x - south * y + z) / normal, 0, 1) for weight, x, y, z in SUNS)
    return np.nan_to_num(0.42 + 0.80 * light, nan=1.0)


HALF = math.sqrt(0.5)
SUNS = ((0.70, -0.5, -0.5, HALF), (0.15, -HALF, 0.0, HALF), (0.15, 0.0, -HALF, HALF))
"""(weight, east, south, up) of the light's direction"""


def _slope(heights: np.ndarray, axis: int) -> np.ndarray:
    """Height difference per pixel along an axis: the mean of the forward and the backward step, or the one that exists."""
    steps = np.diff(heights, axis=axis)
    known = np.isfinite(steps)
    steps[~known] = 0.0
    total, count = np.zeros_like(heights), np.zeros(heights.shape, np.int32)
    # Views along the axis: a step is the forward one of the first of two pixels and the backward one of the second.
    sums, counts = np.moveaxis(total, axis, 0), np.moveaxis(count, axis, 0)
    for pixels in (slice(None, -1), slice(1, None)):
        sums[pixels] += np.moveaxis(steps, axis, 0)
        counts[pixels] += np.moveaxis(known, axis, 0)
    return np.where(np.isfinite(heights), total / np.maximum(count, 1), np.nan)
