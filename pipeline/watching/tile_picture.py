"""A small picture of a tile as soon as it is done: colours as they are, everything else as grey, heights shaded."""

import cv2
import numpy as np

from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.schemas.raster import Window

SIDE = 48
"""px, at most"""


def tile_picture(store: ReadableStore, raster: str, window: Window) -> bytes:
    """A PNG of a window, transparent where nothing is. Raises StoreError when the raster does not exist."""
    spec = store.spec(raster)
    step = max(1, -(-max(window.height, window.width) // SIDE))
    values = store.read(raster, window)[::step, ::step]
    present = np.isfinite(values) if values.dtype.kind == "f" else np.ones(values.shape, bool)
    if spec.nodata is not None and np.isfinite(spec.nodata):
        present &= values != spec.nodata
    if values.ndim == 3 and values.shape[2] >= 3:
        colours = values[..., 2::-1].astype(np.uint8)
        alpha = 255 * (values[..., 3] > 0) if values.shape[2] == 4 else np.full(values.shape[:2], 255)
        return _png(np.dstack([colours, alpha.astype(np.uint8)]))
    plane, shown = (values[..., 0], present[..., 0]) if values.ndim == 3 else (values, present)
    grey = _shaded(plane.astype(np.float64)) if spec.transform and values.dtype.kind == "f" else _stretched(plane, shown)
    return _png(np.dstack([grey, grey, grey, np.where(shown, 255, 0).astype(np.uint8)]))


def _shaded(heights: np.ndarray) -> np.ndarray:
    """Light from the north-west on heights; its strength follows the slopes of the tile, so that any relief shows."""
    if min(heights.shape) < 2:
        return np.full(heights.shape, 160, np.uint8)
    south, east = np.gradient(heights)
    slope = np.nan_to_num(south + east)
    usual = float(np.percentile(np.abs(slope), 90)) or 1.0
    return np.clip(160 + 60 * slope / usual, 30, 255).astype(np.uint8)


def _stretched(values: np.ndarray, present: np.ndarray) -> np.ndarray:
    low, high = (float(values[present].min()), float(values[present].max())) if present.any() else (0.0, 1.0)
    return np.clip(40 + 200 * (np.nan_to_num(values.astype(np.float64)) - low) / ((high - low) or 1.0), 0, 255).astype(np.uint8)


def _png(pixels: np.ndarray) -> bytes:
    return bytes(cv2.imencode(".png", np.ascontiguousarray(pixels))[1])
