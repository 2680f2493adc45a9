"""Grey values: one band from three, eight bits from sixteen.

Matching needs one band. Grey is the luma of ITU-R BT.601, whose weights JPEG itself uses. Sixteen-bit photographs are stretched
between two grey values found once for the whole photograph (on its coarsest pyramid level), never per tile: neighbouring tiles
must have the same contrast.
"""

import numpy as np

from orthomill.tasks.imagery.masked_pixels import colours_of, is_masked, picture_of

LUMA = np.array([0.299, 0.587, 0.114], dtype=np.float32)
"""Red, green, blue (ITU-R BT.601)"""


def grey(pixels: np.ndarray) -> np.ndarray:
    """Grey values (rows, cols) float32 in the units of the pixels (rows, cols), (rows, cols, 1) or (rows, cols, 3).

    NaN where a mask behind the bands says that there is no picture.
    """
    if is_masked(pixels):
        return np.where(picture_of(pixels), grey(colours_of(pixels)), np.float32(np.nan))
    if pixels.ndim == 2:
        return pixels.astype(np.float32)
    if pixels.shape[2] == 1:
        return pixels[:, :, 0].astype(np.float32)
    # Band by band: a matrix product would first convert all bands to float32, three times the memory of the result.
    total = np.multiply(pixels[:, :, 0], LUMA[0], dtype=np.float32)
    for band in (1, 2):
        total += np.multiply(pixels[:, :, band], LUMA[band], dtype=np.float32)
    return total


def grey_range(overview: np.ndarray) -> tuple[float, float]:
    """The grey values that become 0 and 255, from a photograph's coarsest level: the full range for 8 bits, percentiles for 16."""
    if overview.dtype == np.uint8:
        return 0.0, 255.0
    # Percentiles, for a few dead or saturated pixels would otherwise take up most of the 256 levels.
    values = grey(overview)
    values = values[np.isfinite(values)]
    low, high = np.percentile(values, (0.1, 99.9)) if values.size else (0.0, 1.0)
    return float(low), float(max(high, low + 1.0))


def grey_bytes(pixels: np.ndarray, limits: tuple[float, float] = (0.0, 255.0)) -> np.ndarray:
    """Grey values (rows, cols) uint8, `limits` stretched to 0 and 255; 0 where there is no picture."""
    low, high = limits
    stretched = (grey(pixels) - np.float32(low)) * np.float32(255.0 / (high - low))
    if is_masked(pixels):
        stretched = np.nan_to_num(stretched, copy=False, nan=0.0)
    return np.clip(np.rint(stretched), 0, 255).astype(np.uint8)


def real_grey(pixels: np.ndarray, limits: tuple[float, float] = (0.0, 255.0)) -> np.ndarray:
    """As `grey_bytes`, but 0 only where there is no picture: the darkest pixels become 1."""
    return np.where(picture_of(pixels), np.maximum(grey_bytes(pixels, limits), 1), np.uint8(0))
