"""Reads point clouds (LAS, LAZ) that the user provides as a surface: window by window, gridded in the project's system.

Strategy. The file is read in pieces, and only points above the window are kept. A cell gets the median of its points that lie
within two cells of the highest one: the surface seen from above, without the foot of a wall or the ground below a crown, and
without the highest errors. Points marked as noise or withheld are left out. Cells between points get the mean of those around
them, two cells away at most; larger gaps stay gaps.
"""

from collections.abc import Iterator
from pathlib import Path

import laspy
import numpy as np
from laspy.errors import LaspyException
from lazrs import LazrsError
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError

from orthomill.pipeline.storage.height_systems import HeightSystem, height_system, horizontal, named
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import HeightFile
from orthomill.schemas.raster import MapGrid, Window

SUFFIXES = (".las", ".laz")
_PIECE = 1_000_000
"""points that are decoded at a time"""
_NOISE = (7, 18)
"""ASPRS classes of low and high noise"""
_REACH = 2
"""cells: how far a gap is closed, and how far below the highest point of a cell its surface may lie"""
_LEAST_AROUND = 5
"""known cells of the 24 around that close a gap: fewer lie to one side of it"""


def is_point_file(path: Path) -> bool:
    """Whether the ending is that of a point cloud."""
    return path.suffix.lower() in SUFFIXES


def points_system(path: Path, system: str | None) -> HeightSystem:
    """The reference system of a point cloud; `system`: where the file names none. Raises WorkflowError."""
    with opened_points(path) as file:
        return system_of(file, path, system)


def points_grid(path: Path, crs: str, system: str | None) -> MapGrid:
    """The bounds of a point cloud in `crs`, in cells of the usual distance of its points. Raises WorkflowError."""
    with opened_points(path) as file:
        own, header = system_of(file, path, system).plan, file.header
        (west, south, _), (east, north, _) = header.mins, header.maxs
    change = Transformer.from_crs(own, horizontal(CRS.from_user_input(crs)), always_xy=True)
    west, south, east, north = change.transform_bounds(west, south, east, north)
    cell = float(np.sqrt(max((east - west) * (north - south), 1e-9) / max(header.point_count, 1)))
    rows, cols = (max(1, round(length / cell)) for length in (north - south, east - west))
    return MapGrid(west=west, north=north, cell=cell, rows=rows, cols=cols)


def read_points(path: Path, region: HeightFile) -> np.ndarray:
    """Heights (rows, cols) float32 of the region's window, in the unit of the file; NaN where no point is near."""
    # Gaps at the border are closed from beyond it, so that tiles agree.
    grown = region.window.grown(_REACH)
    parts = list(_near(path, region, grown))
    cells = np.concatenate([cell for cell, _ in parts]) if parts else np.zeros(0, np.int64)
    z = np.concatenate([height for _, height in parts]) if parts else np.zeros(0, np.float32)
    heights = _gridded(cells, z, grown.shape, region.grid.cell)
    return _closed(heights)[region.window.within(grown).slices]


def _near(path: Path, region: HeightFile, window: Window) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Numbers of cells of the window, row by row, and heights of the points above them, piece by piece."""
    with opened_points(path) as file:
        own = system_of(file, path, region.system).plan
        target = horizontal(CRS.from_user_input(region.crs))
        change = None if own == target else Transformer.from_crs(own, target, always_xy=True)
        try:
            for points in file.chunk_iterator(_PIECE):
                yield _cells_of(points, change, region.grid, window)
        except (LaspyException, LazrsError, ValueError) as error:
            raise WorkflowError(f"{path} is damaged ({str(error).splitlines()[0]}); get it again.") from error


def _cells_of(
    points: laspy.ScaleAwarePointRecord, change: Transformer | None, grid: MapGrid, window: Window
) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.asarray(points.x), np.asarray(points.y)
    if change is not None:
        x, y = change.transform(x, y)
    col, row = grid.pixel(np.asarray(x), np.asarray(y))
    col, row = np.rint(col) - window.col, np.rint(row) - window.row
    good = (col >= 0) & (row >= 0) & (col < window.width) & (row < window.height)
    good &= is_wanted(points)
    return (row[good].astype(np.int64) * window.width + col[good].astype(np.int64)), np.asarray(points.z)[good].astype(np.float32)


def is_wanted(points: laspy.ScaleAwarePointRecord) -> np.ndarray:
    """(N,) bool: what is neither noise nor withheld."""
    wanted = ~np.isin(np.asarray(points.classification), _NOISE)
    if "withheld" in points.point_format.dimension_names:
        wanted &= np.asarray(points.withheld) == 0
    return wanted


def _gridded(cells: np.ndarray, z: np.ndarray, shape: tuple[int, int], cell: float) -> np.ndarray:
    """Heights (rows, cols) float32 from points (N,) with the numbers of their cells; NaN without any."""
    out = np.full(shape[0] * shape[1], np.nan, np.float32)
    # By height within each cell, so that the result does not depend on the order of the file.
    order = np.lexsort((z, cells))
    cells, z = cells[order], z[order]
    last = np.flatnonzero(np.r_[cells[1:] != cells[:-1], True]) if len(cells) else np.zeros(0, int)
    first = np.r_[0, last[:-1] + 1] if len(cells) else last
    top = np.repeat(z[last], last - first + 1)
    # Points of a cell are sorted: those near the top are its last ones.
    near = np.add.reduceat((z >= top - _REACH * cell).astype(np.int64), first) if len(cells) else last
    low, high = last - near + 1 + (near - 1) // 2, last - near + 1 + near // 2
    out[cells[last]] = (z[low] + z[high]) / 2
    return out.reshape(shape)


def _closed(heights: np.ndarray) -> np.ndarray:
    """Heights (rows, cols) with gaps between points closed by the weighted mean of the cells around them."""
    total, weight, known = np.zeros(heights.shape), np.zeros(heights.shape), np.zeros(heights.shape, int)
    padded = np.pad(heights, _REACH, constant_values=np.nan)
    for row in range(-_REACH, _REACH + 1):
        for col in range(-_REACH, _REACH + 1):
            if row or col:
                top, left = _REACH + row, _REACH + col
                part = padded[top : top + heights.shape[0], left : left + heights.shape[1]]
                here, share = np.isfinite(part), 1.0 / (row**2 + col**2)
                total += np.where(here, part, 0.0) * share
                weight += here * share
                known += here
    gap = np.isnan(heights) & (known >= _LEAST_AROUND)
    return np.where(gap, total / np.maximum(weight, 1e-9), heights).astype(np.float32)


def opened_points(path: Path) -> laspy.LasReader:
    """A point cloud, to be closed. Raises WorkflowError for a file that is none."""
    try:
        return laspy.open(path, laz_backend=laspy.LazBackend.Lazrs)
    except (OSError, LaspyException, LazrsError, ValueError) as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise WorkflowError(f"{path} is not a LAS or LAZ file that can be read ({reason}); export the points again.") from None


def system_of(file: laspy.LasReader, path: Path, system: str | None) -> HeightSystem:
    """The reference system of an open point cloud; `system`: where it names none. Raises WorkflowError."""
    try:
        crs = file.header.parse_crs()
    except CRSError:
        crs = None
    if crs is None and system is None:
        raise WorkflowError(f"{path} has no coordinate reference system; name it (--system EPSG:..., or `system` in the workflow).")
    return height_system(crs if crs is not None else named(str(system), str(path)))
