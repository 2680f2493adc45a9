"""Makes the rasters of the store maps for other programs: dimension names, coordinates and the reference system.

zarr knows arrays only. xarray and GDAL (3.11 and newer) treat an array as a map when its dimensions have names, arrays of these
names in the same group contain the coordinates, and the reference system is given: by GDAL's attribute `_CRS` and by the CF
convention's `grid_mapping`, which names an empty array with the system in its attributes. Map rasters of one group on the same grid
share their axes. Pixel rasters have axes of their own, because their sizes differ within a group.
"""

from pathlib import Path
from typing import Any

import numpy as np
import zarr
from pyproj import CRS

from orthomill.pipeline.storage.file_names import path_of
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


def write_axes(rasters: Path, spec: RasterSpec) -> None:
    """Write the coordinate arrays and the reference system of a map raster into its group, unless they are there already."""
    if not spec.transform:
        return
    group = zarr.open_group(rasters, path=path_of(spec.name).parent.as_posix(), mode="a")
    cell, _, west, _, _, north = spec.transform
    grid = MapGrid(west=west, north=north, cell=cell, rows=spec.shape[0], cols=spec.shape[1])
    columns, rows = grid.centres(spec.full)
    for name, direction, values in zip(spec.axes, ("y", "x"), (rows, columns), strict=True):
        _write_axis(group, name, direction, values)
    if spec.crs and GRID_MAPPING not in group:
        group.create_array(
            GRID_MAPPING, shape=(), dtype="int8", attributes=CRS(spec.crs).to_cf() | {"spatial_ref": CRS(spec.crs).to_wkt()}
        )


def _write_axis(group: zarr.Group, name: str, direction: str, values: np.ndarray) -> None:
    known = group.get(name)
    if isinstance(known, zarr.Array):
        if known.shape == values.shape and np.array_equal(np.asarray(known[:]), values):
            return
        # The grid has changed since an earlier run: its rasters are created again, and their axes with them.
        del group[name]
    axis, standard_name = _DIRECTIONS[direction]
    attributes: dict[str, Any] = {"axis": axis, "standard_name": standard_name, "units": "m", "_ARRAY_DIMENSIONS": [name]}
    array = group.create_array(name, shape=values.shape, dtype="float64", dimension_names=[name], attributes=attributes)
    array[:] = values
