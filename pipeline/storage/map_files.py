"""Reads georeferenced raster files that the user provides: windows of them, resampled to the project's grid."""

import warnings
from pathlib import Path

import numpy as np
import rasterio
from rasterio.crs import CRS
from rasterio.enums import Resampling
from rasterio.errors import CRSError, NotGeoreferencedWarning, RasterioError
from rasterio.transform import Affine
from rasterio.vrt import WarpedVRT
from rasterio.warp import transform_bounds
from rasterio.windows import Window as FileWindow

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import MapFile
from orthomill.schemas.raster import MapGrid


def read_map_grid(path: Path, crs: str) -> MapGrid:
    """The bounds of a file in `crs` as a grid of about its own cell size. Raises WorkflowError."""
    with _opened(path) as source:
        # Bounds are densified along their edges: the corners alone do not bound a rectangle that another projection bends.
        west, south, east, north = transform_bounds(source.crs, _horizontal(crs), *source.bounds)
        cell = max((east - west) / source.width, (north - south) / source.height)
    rows, cols = (max(1, round(length / cell)) for length in (north - south, east - west))
    return MapGrid(west=west, north=north, cell=cell, rows=rows, cols=cols)


def check_map_file(path: Path) -> None:
    """Raises WorkflowError for a file that is no georeferenced raster."""
    _opened(path).close()


def read_map(path: Path, region: MapFile) -> np.ndarray:
    """The region's window as float32, bilinear; NaN where the file has no value. Raises WorkflowError."""
    grid, window = region.grid, region.window
    with _opened(path) as source:
        if source.count < region.bands:
            raise WorkflowError(f"{path} has {source.count} bands, but {region.bands} are needed; provide a file with as many.")
        # A virtual warp reads only the source pixels of this window, so that a file of any size costs the memory of a tile.
        with WarpedVRT(
            source,
            crs=_horizontal(region.crs),
            transform=Affine(*grid.transform),
            width=grid.cols,
            height=grid.rows,
            resampling=Resampling.bilinear,
            nodata=np.nan,
            dtype="float32",
        ) as warped:
            part = FileWindow(window.col, window.row, window.width, window.height)
            bands = warped.read(list(range(1, region.bands + 1)), window=part)
    return bands[0] if region.bands == 1 else np.ascontiguousarray(np.moveaxis(bands, 0, -1))


def _horizontal(crs: str) -> CRS:
    # With a height part GDAL would also transform the values, as heights; a vertical datum is handled where the file is used.
    return CRS.from_user_input(crs.split("+")[0])


def _opened(path: Path) -> rasterio.DatasetReader:
    try:
        # One driver only: a VRT named .tif could read any file of this machine.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)  # a sentence follows below
            source = rasterio.open(path, driver="GTiff")
    except RasterioError as error:
        raise WorkflowError(f"{path} is not a GeoTIFF that can be read ({error}); export the surface as a GeoTIFF.") from None
    try:
        known = source.crs is not None and bool(CRS.from_user_input(source.crs))
    except CRSError:
        known = False
    if not known:
        source.close()
        raise WorkflowError(f"{path} has no coordinate reference system; assign one (for example with gdal_edit) and run again.")
    return source
