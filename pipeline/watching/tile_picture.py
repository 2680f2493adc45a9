"""Small pictures of tiles as they are done, and of whole rasters for the page that is kept.

Colours as they are, everything else as grey, heights shaded.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.schemas.raster import RasterSpec, Window

SIDE = 48
"""px, at most"""
QUALITY = 60
"""of WebP, 1 to 100: small pictures that are kept in a page"""


def tile_picture(store: ReadableStore, spec: RasterSpec, window: Window) -> bytes:
    """A PNG of a window, transparent where nothing is. Raises StoreError when the raster does not exist."""
    step = max(1, -(-max(window.height, window.width) // SIDE))
    return _encoded(".png", _coloured(store.read(spec.name, window)[::step, ::step], spec))


def raster_picture(store: ReadableStore, spec: RasterSpec) -> bytes:
    """A WebP of a whole raster, whose chunks are as large as pictures of tiles. Raises StoreError when it does not exist."""
    height, width = spec.shape[:2]
    step = max(1, -(-spec.chunk // SIDE))
    # Strips of chunks: a whole raster may be larger than the memory.
    strips = (
        store.read(spec.name, Window(row, 0, min(spec.chunk, height - row), width))[::step, ::step]
        for row in range(0, height, spec.chunk)
    )
    return _encoded(".webp", _coloured(np.concatenate(list(strips)), spec), [cv2.IMWRITE_WEBP_QUALITY, QUALITY])


def _coloured(values: np.ndarray, spec: RasterSpec) -> np.ndarray:
    """(rows, cols, 4) uint8, blue first and opacity last."""
    present = np.isfinite(values) if values.dtype.kind == "f" else np.ones(values.shape, bool)
    if spec.nodata is not None and np.isfinite(spec.nodata):
        present &= values != spec.nodata
    # Of bands that measure different things the first one is shown.
    if spec.colours and values.ndim == 3 and values.shape[2] in (3, 4) and values.dtype in (np.uint8, np.uint16):
        # The upper eight bits of sixteen: stretched tile by tile, the map would be a patchwork.
        colours = (values if values.dtype == np.uint8 else (values >> 8).astype(np.uint8))[..., 2::-1]
        alpha = 255 * (values[..., 3] > 0) if values.shape[2] == 4 else np.full(values.shape[:2], 255)
        return np.dstack([colours, alpha.astype(np.uint8)])
    plane, shown = (values[..., 0], present[..., 0]) if values.ndim == 3 else (values, present)
    is_relief = spec.transform is not None and values.dtype.kind == "f"
    grey = _shaded(np.where(shown, plane.astype(np.float64), np.nan)) if is_relief else _stretched(plane, shown)
    return np.dstack([grey, grey, grey, np.where(shown, 255, 0).astype(np.uint8)])


def _shaded(heights: np.ndarray) -> np.ndarray:
    """Light from the north-west on heights; its strength follows the slopes of the tile, so that any relief shows."""
    if min(heights.shape) < 2:
        return np.full(heights.shape, 160, np.uint8)
    south, east = np.gradient(heights)
    slope = np.nan_to_num(south + east)
    usual = float(np.percentile(np.abs(slope), 90)) or 1.0
    return np.clip(160 + 60 * slope / usual, 30, 255).astype(np.uint8)


def _stretched(values: np.ndarray, present: np.ndarray) -> np.ndarray:
    known = values[present].astype(np.float64)
    low, high = (known.min(), known.max()) if known.size else (0.0, 1.0)
    grey = np.zeros(values.shape, np.uint8)
    grey[present] = 40 + 200 * (known - low) / ((high - low) or 1.0)
    return grey


def _encoded(kind: str, pixels: np.ndarray, options: Sequence[int] = ()) -> bytes:
    return bytes(cv2.imencode(kind, np.ascontiguousarray(pixels), options)[1])
