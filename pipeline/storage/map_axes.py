"""Makes the rasters of the store maps for other programs: dimension names, coordinates and the reference system.

zarr knows arrays only. xarray and GDAL (3.11 and newer) treat an array as a map when its dimensions have names, arrays of these
names in the same group contain the coordinates, and the reference system is given: by GDAL's attribute `_CRS` and by the CF
convention's `grid_mapping`, which names an empty array with the system in its attributes. Map rasters of one group on the same grid
share their axes. Pixel rasters have axes of their own, because their sizes differ within a group.
"""

from pathlib import PurePosixPath
from typing import Any

import numpy as np
from pyproj import CRS

from orthomill.pipeline.storage.array_metadata import array_metadata
from orthomill.pipeline.storage.depots.depot import Depot
from orthomill.pipeline.storage.file_names import path_of
from orthomill.pipeline.storage.zarr_arrays import put_array, values_of_array
from orthomill.schemas.raster import MapGrid, RasterSpec

GRID_MAPPING = "spatial_ref"
_DIRECTIONS = {"x": ("X", "projection_x_coordinate"), "y": ("Y", "projection_y_coordinate")}


def dimension_names(spec: RasterSpec) -> tuple[str, ...]:
    """Names of a raster's axes, unique in its group wherever lengths may differ."""
    leaf = spec.name.split("/")[-1]
    rows_and_cols = spec.axes if spec.transform else (f"row_{leaf}", f"col_{leaf}")
    return (*rows_and_cols, f"band_{leaf}")[: len(spec.shape)]


def map_attributes(spec: RasterSpec) -> dict[str, Any]:
    """Attributes by which other programs find unit, missing values and reference system of a raster."""
    attributes: dict[str, Any] = {"units": spec.unit} if spec.unit else {}
    if spec.crs and spec.transform:
        attributes |= {"grid_mapping": GRID_MAPPING, "_CRS": {"wkt": CRS(spec.crs).to_wkt()}}
    if spec.nodata is not None and not np.isnan(spec.nodata):
        attributes["_FillValue"] = spec.nodata
    return attributes


def write_axes(depot: Depot, top: str, spec: RasterSpec) -> list[str]:
    """Write the coordinate arrays and the reference system of a map raster into its group, unless they are there already.

    `top` is the folder of all rasters. Returns the folders of the arrays that were written. Raises OSError, StoreError.
    """
    if not spec.transform:
        return []
    folder = (PurePosixPath(top) / path_of(spec.name).parent).as_posix()
    cell, _, west, _, _, north = spec.transform
    grid = MapGrid(west=west, north=north, cell=cell, rows=spec.shape[0], cols=spec.shape[1])
    columns, rows = grid.centres(spec.full)
    wanted = list(zip(spec.axes, "yx", (rows, columns), strict=True))
    # Absent, damaged, or the grid has changed since an earlier run: then its rasters are created again, and their axes with them.
    wanting = [axis for axis in wanted if not _is_whole(depot, f"{folder}/{axis[0]}", axis[2])]
    for name, direction, values in wanting:
        _write_axis(depot, f"{folder}/{name}", direction, values)
    written = [f"{folder}/{name}" for name, _, _ in wanting]
    if spec.crs and not array_metadata(depot, f"{folder}/{GRID_MAPPING}"):
        _write_reference_system(depot, f"{folder}/{GRID_MAPPING}", spec.crs)
        written.append(f"{folder}/{GRID_MAPPING}")
    return written


def _write_axis(depot: Depot, folder: str, direction: str, values: np.ndarray) -> None:
    axis, standard_name = _DIRECTIONS[direction]
    name = PurePosixPath(folder).name
    attributes: dict[str, Any] = {"axis": axis, "standard_name": standard_name, "units": "m", "_ARRAY_DIMENSIONS": [name]}
    wanted = {"shape": values.shape, "dtype": "float64", "dimension_names": [name], "attributes": attributes}
    put_array(depot, folder, wanted, values)


def _write_reference_system(depot: Depot, folder: str, crs: str) -> None:
    put_array(depot, folder, {"shape": (), "dtype": "int8", "attributes": CRS(crs).to_cf() | {"spatial_ref": CRS(crs).to_wkt()}})


def _is_whole(depot: Depot, folder: str, values: np.ndarray) -> bool:
    """Whether an axis exists, can be read and has these values."""
    if not array_metadata(depot, folder):
        return False
    try:
        return np.array_equal(values_of_array(depot, folder), values)
    except (OSError, ValueError, RuntimeError):  # of zarr's codecs, for a damaged chunk
        return False
