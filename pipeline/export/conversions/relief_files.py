"""Shaded relief and slope of heights.

Source: Horn (1981), Hill shading and the reflectance map: the gradient from the eight neighbours.
"""

from pathlib import Path
from typing import Literal

import numpy as np
import rasterio

from orthomill.pipeline.export.conversions.raster_files import BLOCK, height_windows
from orthomill.pipeline.export.conversions.wanted import Wanted
from orthomill.pipeline.export.conversions.warped_product import warped
from orthomill.schemas.errors import WorkflowError

SUN = np.radians(315.0), np.radians(45.0)
"""azimuth and height of the light, as maps have it"""


def gradient(heights: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Rise to the east and to the north (rows, cols), as ratios, of heights (rows, cols) m on cells of `cell` m; NaN beside gaps
    and at the border."""
    z, out = heights, np.full((2, *heights.shape), np.nan)
    if min(heights.shape) >= 3:
        east = (z[:-2, 2:] + 2 * z[1:-1, 2:] + z[2:, 2:]) - (z[:-2, :-2] + 2 * z[1:-1, :-2] + z[2:, :-2])
        north = (z[:-2, :-2] + 2 * z[:-2, 1:-1] + z[:-2, 2:]) - (z[2:, :-2] + 2 * z[2:, 1:-1] + z[2:, 2:])
        out[:, 1:-1, 1:-1] = east / (8 * cell), north / (8 * cell)
    return out[0], out[1]


def hillshade(heights: np.ndarray, cell: float) -> np.ndarray:
    """uint8 (rows, cols): 1 to 255, 0 where there is none."""
    east, north = gradient(heights, cell)
    azimuth, height = SUN
    light = (np.sin(height) - np.cos(height) * (east * np.sin(azimuth) + north * np.cos(azimuth))) / np.sqrt(1 + east**2 + north**2)
    return np.where(np.isfinite(light), np.rint(1 + 254 * np.clip(np.nan_to_num(light), 0, 1)), 0).astype(np.uint8)


def slope(heights: np.ndarray, cell: float) -> np.ndarray:
    """float32 (rows, cols) degrees, NaN where there is none."""
    return np.degrees(np.arctan(np.hypot(*gradient(heights, cell)))).astype(np.float32)


def write_relief(product: Path, path: Path, wanted: Wanted, kind: Literal["hillshade", "slope"]) -> None:
    """Hillshade or slope of a product of heights as GeoTIFF. Raises WorkflowError in a system of degrees."""
    with warped(product, wanted) as view:
        if view.crs is not None and view.crs.is_geographic:
            raise WorkflowError(f"A {kind} needs a system in metres, and {wanted.crs} has degrees: give another --crs, or none.")
        make, dtype, nodata = (hillshade, "uint8", 0) if kind == "hillshade" else (slope, "float32", float("nan"))
        profile = {
            "driver": "GTiff",
            "width": view.width,
            "height": view.height,
            "count": 1,
            "dtype": dtype,
            "nodata": nodata,
            "crs": view.crs,
            "transform": view.transform,
            "compress": "deflate",
            "tiled": True,
            "blockxsize": BLOCK,
            "blockysize": BLOCK,
        }
        with rasterio.open(path, "w", **profile) as target:
            target.set_band_description(1, kind if kind == "hillshade" else "slope (degrees)")
            for window, heights, inner in height_windows(view):
                target.write(make(heights, abs(view.transform.a))[inner], 1, window=window)
