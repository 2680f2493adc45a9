"""Reads georeferenced raster files that the user provides: windows of them, resampled to the project's grid."""

import warnings
from pathlib import Path

import numpy as np
import pyproj
import rasterio
from rasterio.crs import CRS
from rasterio.enums import Resampling
from rasterio.errors import CRSError, NotGeoreferencedWarning, RasterioError
from rasterio.transform import Affine
from rasterio.vrt import WarpedVRT
from rasterio.warp import transform_bounds
from rasterio.windows import Window as FileWindow

from orthomill.pipeline.storage.depots.product_files import joins_own_sheets
from orthomill.pipeline.storage.height_systems import horizontal
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import MapFile
from orthomill.schemas.raster import MapGrid, Window


def read_map_grid(path: Path, crs: str) -> MapGrid:
    """The bounds of a file in `crs` as a grid of about its own cell size. Raises WorkflowError."""
    with opened_map(path) as source:
        return read_grid_of(source, crs)


def read_grid_of(source: rasterio.DatasetReader, crs: str, system: str | None = None) -> MapGrid:
    """The bounds of an open file in `crs` as a grid of about its own cell size; `system`: its reference system, where it has
    none."""
    # Bounds are densified along their edges: the corners alone do not bound a rectangle that another projection bends.
    own = source.crs or _horizontal(str(system))
    west, south, east, north = transform_bounds(own, _horizontal(crs), *source.bounds)
    cell = max((east - west) / source.width, (north - south) / source.height)
    rows, cols = (max(1, round(length / cell)) for length in (north - south, east - west))
    return MapGrid(west=west, north=north, cell=cell, rows=rows, cols=cols)


def check_map_file(path: Path) -> None:
    """Raises WorkflowError for a file that is no georeferenced raster."""
    opened_map(path).close()


def read_map(path: Path, region: MapFile) -> np.ndarray:
    """The region's window as float32, bilinear; NaN where the file has no value. Raises WorkflowError."""
    with opened_map(path) as source:
        if source.count < region.bands:
            raise WorkflowError(f"{path} has {source.count} bands, but {region.bands} are needed; provide a file with as many.")
        bands = warped_window(source, region.crs, region.grid, region.window, list(range(1, region.bands + 1)))
    return bands[0] if region.bands == 1 else np.ascontiguousarray(np.moveaxis(bands, 0, -1))


def warped_window(
    source: rasterio.DatasetReader, crs: str, grid: MapGrid, window: Window, bands: list[int], system: str | None = None
) -> np.ndarray:
    """(bands, height, width) float32 of a window of `grid` in `crs`, bilinear; NaN where the file has no value."""
    # A virtual warp reads only the source pixels of this window, so that a file of any size costs the memory of a tile.
    with WarpedVRT(
        source,
        src_crs=source.crs or _horizontal(str(system)),
        crs=_horizontal(crs),
        transform=Affine(*grid.transform),
        width=grid.cols,
        height=grid.rows,
        resampling=Resampling.bilinear,
        nodata=np.nan,
        dtype="float32",
    ) as warped:
        part = FileWindow(window.col, window.row, window.width, window.height)
        return np.asarray(warped.read(bands, window=part))


def _horizontal(crs: str) -> CRS:
    # With a height part GDAL would also transform the values, as heights; height_systems.py does that where values are heights.
    try:
        return CRS.from_wkt(horizontal(pyproj.CRS.from_user_input(crs)).to_wkt())
    except pyproj.exceptions.CRSError as error:
        raise WorkflowError(f"'{crs}' is not a coordinate reference system that PROJ knows ({error}).") from None


def opened_map(path: Path, system: str | None = None) -> rasterio.DatasetReader:
    """A georeferenced raster file, open; `system`: the reference system of a file that names none. Raises WorkflowError."""
    try:
        # One driver only: a VRT could read any file of this machine, but for those of runs, of which it is known what they join.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)  # a sentence follows below
            source = rasterio.open(path, driver="VRT" if joins_own_sheets(path) else "GTiff")
    except RasterioError as error:
        raise WorkflowError(f"{path} is not a GeoTIFF that can be read ({error}); export the surface as a GeoTIFF.") from None
    try:
        known = system is not None or (source.crs is not None and bool(CRS.from_user_input(source.crs)))
    except CRSError:
        known = False
    if not known:
        source.close()
        raise WorkflowError(f"{path} has no coordinate reference system; assign one (for example with gdal_edit) and run again.")
    return source
