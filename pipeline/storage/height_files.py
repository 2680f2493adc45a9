"""Reads windows of surfaces that the user provides, as heights in metres on the project's grid: GeoTIFF, LAS and LAZ."""

import warnings
from pathlib import Path

import numpy as np
from pyproj import CRS

from orthomill.pipeline.storage.height_systems import HeightSystem, height_system, in_metres, named
from orthomill.pipeline.storage.map_files import opened_map, read_grid_of, warped_window
from orthomill.pipeline.storage.point_files import is_point_file, points_grid, points_system, read_points
from orthomill.schemas.job import HeightFile, HeightHeader
from orthomill.schemas.raster import MapGrid

_ABSURD = 12_000.0
"""m: no ground lies farther from zero; programs write -32767, -9999 or 1e38 into gaps without saying so"""


def read_height_grid(path: Path, region: HeightHeader) -> MapGrid:
    """The bounds of a surface in the system of the region, in cells as wide as its own. Raises WorkflowError."""
    if is_point_file(path):
        return points_grid(path, region.crs, region.system)
    with opened_map(path, region.system) as source:
        return read_grid_of(source, region.crs, region.system)


def read_heights(path: Path, region: HeightFile) -> np.ndarray:
    """The region's window, float32 m; NaN where the file has no height. Raises WorkflowError."""
    if is_point_file(path):
        values, system = read_points(path, region), points_system(path, region.system)
    else:
        values, system = _read_band(path, region)
    values = np.where(np.abs(values) < _ABSURD / system.unit, values, np.float32(np.nan))
    x, y = region.grid.centres(region.window)
    return in_metres(values, x, y, system, region.crs, str(path))


def check_height_file(path: Path) -> None:
    """Raises WorkflowError for a file that is no surface."""
    if is_point_file(path):
        points_system(path, "EPSG:4326")
    else:
        opened_map(path, "EPSG:4326").close()


def plan_crs_of(path: Path) -> str | None:
    """The plan system of a surface as a project names it, where it is a projected one in metres; None otherwise."""
    if is_point_file(path):
        crs = points_system(path, "EPSG:4326").plan
    else:
        with opened_map(path, "EPSG:4326") as source:
            crs = height_system(_own(source.crs.to_wkt() if source.crs else "EPSG:4326", path)).plan
    if not crs.is_projected or any(axis.unit_conversion_factor != 1.0 for axis in crs.axis_info):
        return None
    code = crs.to_epsg(min_confidence=70)
    if code:
        return f"EPSG:{code}"
    # What a PROJ string loses against WKT is the name; it is the shorter text of the two in a workflow.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return str(crs.to_proj4())


def _read_band(path: Path, region: HeightFile) -> tuple[np.ndarray, HeightSystem]:
    with opened_map(path, region.system) as source:
        own = region.system or source.crs.to_wkt()
        system = height_system(_own(own, path), source.units[0] or "")
        values = warped_window(source, region.crs, region.grid, region.window, [1], region.system)[0]
    return values, system


def _own(text: str, path: Path) -> CRS:
    return named(text, str(path))
