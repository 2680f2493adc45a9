"""The surface as points in space for the page: cells with a measured height in the colours of the orthoimage, thinned, as a script.

A point is three whole numbers of 16 bits (column, row, height between the lowest and the highest) and three of 8 bits for its
colour; each kind lies in one piece, which packs better than points in a row.
"""

import base64
import json
import zlib
from pathlib import Path

import numpy as np

from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.job import Export
from orthomill.schemas.maps.map_page import CloudLayer, MapPage
from orthomill.schemas.raster import RasterSpec, Window, tiles_of

MOST_POINTS = 500_000
"""that a telephone turns without stopping"""
STEPS = 65535
"""heights between the lowest and the highest"""
EFFORT = 1
"""of packing"""
_GREY = 170
"""of points without a colour"""


def write_cloud(export: Export, store: ReadableStore, path: Path) -> None:
    """Write the script; empty where no cell was measured."""
    (table,) = export.tables
    page = store.table(table)
    assert isinstance(page, MapPage) and page.cloud is not None
    cloud = page.cloud
    spec = store.spec(cloud.height)
    stride = thinning(spec.shape[0] * spec.shape[1])
    parts = [_points(store, cloud, tile.window, stride) for tile in tiles_of(spec.shape, max(spec.chunk, stride))]
    col, row, z, rgb = (np.concatenate(values) for values in zip(*parts, strict=True))
    if not len(z):
        return write_whole(path, b"")
    low, high = float(z.min()), float(z.max())
    height = np.rint((z.astype(np.float64) - low) / max(high - low, 1e-6) * STEPS)
    whole = [np.asarray(values, "<u2") for values in (col // stride, row // stride, height)]
    data = b"".join(values.tobytes() for values in (*whole, *rgb.T))
    assert spec.transform is not None, "maps only"
    about = {
        "count": len(z),
        "cell": abs(spec.transform[0]) * stride,
        "cols": -(-spec.shape[1] // stride),
        "rows": -(-spec.shape[0] // stride),
        "low": round(low, 3),
        "high": round(high, 3),
        "data": base64.b64encode(zlib.compress(data, EFFORT)).decode(),
    }
    write_whole(path, f"omCloud({json.dumps(about)});\n".encode())


def thinning(cells: int) -> int:
    """Every so many-th row and column has a point."""
    return max(1, int(np.ceil(np.sqrt(cells / MOST_POINTS))))


def _points(store: ReadableStore, cloud: CloudLayer, window: Window, stride: int) -> tuple[np.ndarray, ...]:
    """Columns, rows, heights (N,) and colours (N, 3) uint8 of a window."""
    row = np.arange(-(-window.row // stride) * stride, window.row + window.height, stride)
    col = np.arange(-(-window.col // stride) * stride, window.col + window.width, stride)
    at = np.ix_(row - window.row, col - window.col)
    z, codes = (store.read(name, window)[at] for name in (cloud.height, cloud.code))
    known = np.isfinite(z) & np.isin(codes, cloud.shown)
    rows, cols = (np.broadcast_to(values, z.shape)[known] for values in (row[:, None], col))
    return cols, rows, z[known], _colours(store, cloud, window, (rows, cols))


def _colours(store: ReadableStore, cloud: CloudLayer, window: Window, cells: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """uint8 (N, 3) of the orthoimage at the centres of cells (rows, columns); grey where it has none."""
    out = np.full((len(cells[0]), 3), _GREY, np.uint8)
    if cloud.colours is None or not len(out):
        return out
    surface, image = store.spec(cloud.height), store.spec(cloud.colours)
    row, col = _pixel(surface, image, cells)
    inside = (row >= 0) & (col >= 0) & (row < image.shape[0]) & (col < image.shape[1])
    if not inside.any():
        return out
    row, col = row[inside], col[inside]
    part = Window(int(row.min()), int(col.min()), int(np.ptp(row)) + 1, int(np.ptp(col)) + 1)
    pixels = store.read(cloud.colours, part)[row - part.row, col - part.col]
    seen = pixels[:, 3] > 0 if pixels.shape[1] > 3 else np.ones(len(pixels), bool)
    shown = pixels[:, :3] if image.dtype == "uint8" else np.zeros((len(pixels), 3), np.uint8) + _GREY
    out[inside] = np.where(seen[:, None], shown, out[inside])
    return out


def _pixel(surface: RasterSpec, image: RasterSpec, cells: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the image at the centres of cells of the surface."""
    assert surface.transform is not None and image.transform is not None, "maps only"
    cell, _, west, _, _, north = surface.transform
    pixel, _, left, _, _, top = image.transform
    x, y = west + (cells[1] + 0.5) * cell, north - (cells[0] + 0.5) * cell
    return np.floor((top - y) / pixel).astype(np.int64), np.floor((x - left) / pixel).astype(np.int64)
