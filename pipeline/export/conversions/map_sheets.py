"""Sheets: an area divided by the client's own index, or by a rule of a national grid, with names.

Rules: a side such as "1km" or "500m" (named by the lower left corner in that unit, as 407_4357), "linz:5000" (sheets of New
Zealand's Topo50 divided to a scale, in EPSG:2193), "doqq" (quarter quadrangles of the USGS, in NAD83). Where the file has another
system than the grid, a sheet is the rectangle around its outline there.

Source: LINZ, Topo50 sheets of 24 x 36 km and their division (topo-imagery, tile_index.py); USGS, Digital orthophoto quadrangles:
3.75 minutes, named by latitude, longitude, and the quadrangle of 7.5 minutes in the degree (rows A to H from the south, columns 1
to 8 from the east).
"""

import re
from collections import Counter
from collections.abc import Iterator
from itertools import islice
from math import ceil, floor
from pathlib import Path

import numpy as np
from pyproj import CRS

from orthomill.pipeline.export.conversions.sheet_index import Bounds, Sheet
from orthomill.pipeline.storage.features.outline_files import Outline, moved, read_outlines
from orthomill.schemas.errors import WorkflowError

MOST_SHEETS = 10_000
"""of an export: more is a grid given by mistake"""
LINZ_SYSTEM, DOQQ_SYSTEM = "EPSG:2193", "EPSG:4269"
_LINZ_SHEET, _LINZ_CORNER = (24_000, 36_000), (988_000, 6_234_000)
"""m: size, and the upper left corner of what would be sheet AS00"""
_LINZ_SCALES = (50_000, 10_000, 5_000, 2_000, 1_000, 500)
_LINZ_ROWS = [a + b for a in "ABC" for b in "ABCDEFGHIJKLMNOPQRSTUVWXYZ" if a + b >= "AS" and a + b not in ("BI", "BO", "CI")]
_DOQQ = 0.0625
"""degrees: 3.75 minutes"""


def sheets_of(grid: str, crs: str, bounds: Bounds) -> tuple[Sheet, ...]:
    """The sheets of a grid, a rule or the path of an index file, that meet the bounds in the system `crs`; WorkflowError where
    there are none, or no such grid."""
    found = tuple(islice(_in_bounds(_sheets(grid, crs, bounds), bounds), MOST_SHEETS + 1))
    if not found:
        raise WorkflowError(f"--sheets {grid}: none of its sheets meets what is exported.")
    if len(found) > MOST_SHEETS:
        raise WorkflowError(f"--sheets {grid} makes more than {MOST_SHEETS} sheets; give a coarser grid, or an --area.")
    if repeated := [name for name, times in Counter(sheet.name for sheet in found).items() if times > 1]:
        raise WorkflowError(f"--sheets {grid}: the name {repeated[0]} stands for several sheets; give each its own.")
    return found


def _in_bounds(sheets: Iterator[Sheet], bounds: Bounds) -> Iterator[Sheet]:
    for sheet in sheets:
        west, south, east, north = sheet.area
        if west < bounds[2] and east > bounds[0] and south < bounds[3] and north > bounds[1]:
            yield sheet


def _sheets(grid: str, crs: str, bounds: Bounds) -> Iterator[Sheet]:
    if metric := re.fullmatch(r"(\d+)(km|m)", grid):
        side = int(metric[1]) * (1000 if metric[2] == "km" else 1)
        if side and CRS.from_user_input(crs).is_geographic:
            raise WorkflowError(f"--sheets {grid} needs a system in metres; give another --crs, or an index file.")
        return metric_sheets(side, 1000 if metric[2] == "km" else 1, bounds) if side else iter(())
    if linz := re.fullmatch(r"linz(?::(\d+))?", grid):
        if not CRS.from_user_input(crs).equals(CRS.from_user_input(LINZ_SYSTEM), ignore_axis_order=True):
            raise WorkflowError(f"The sheets of LINZ are those of {LINZ_SYSTEM}; give --crs {LINZ_SYSTEM}.")
        return linz_sheets(int(linz[1] or 50_000), bounds)
    if grid == "doqq":
        return _elsewhere(quarter_quads(_bounds_in(bounds, crs, DOQQ_SYSTEM)), DOQQ_SYSTEM, crs)
    if not Path(grid).suffix:
        raise WorkflowError(f"--sheets {grid} is no grid; give an index file (.gpkg, .geojson), 1km, 500m, linz:5000 or doqq.")
    return (Sheet(_file_name(one.name), one.bounds) for one in read_outlines(Path(grid), crs))


def metric_sheets(side: int, unit: int, bounds: Bounds) -> Iterator[Sheet]:
    """Squares of `side` m, named by their lower left corner in units of `unit` m."""
    west, south, east, north = bounds
    for row in range(floor(south / side), ceil(north / side)):
        for col in range(floor(west / side), ceil(east / side)):
            left, bottom = col * side, row * side
            yield Sheet(f"{left // unit}_{bottom // unit}", (left, bottom, left + side, bottom + side))


def linz_sheets(scale: int, bounds: Bounds) -> Iterator[Sheet]:
    """Sheets of a scale in EPSG:2193: BQ31, and BQ31_5000_0301 (row and column within it). Raises WorkflowError."""
    if scale not in _LINZ_SCALES:
        raise WorkflowError(f"linz:{scale} is no scale of LINZ; give one of {', '.join(map(str, _LINZ_SCALES))}.")
    parts = _LINZ_SCALES[0] // scale
    width, height = _LINZ_SHEET[0] / parts, _LINZ_SHEET[1] / parts
    digits = 3 if scale == 500 else 2
    for row in range(max(floor((_LINZ_CORNER[1] - bounds[3]) / height), 0), ceil((_LINZ_CORNER[1] - bounds[1]) / height)):
        for col in range(max(floor((bounds[0] - _LINZ_CORNER[0]) / width), 0), ceil((bounds[2] - _LINZ_CORNER[0]) / width)):
            if row // parts >= len(_LINZ_ROWS):
                continue
            sheet = f"{_LINZ_ROWS[row // parts]}{col // parts:02d}"
            name = sheet if parts == 1 else f"{sheet}_{scale}_{row % parts + 1:0{digits}d}{col % parts + 1:0{digits}d}"
            left, top = _LINZ_CORNER[0] + col * width, _LINZ_CORNER[1] - row * height
            yield Sheet(name, (left, top - height, left + width, top))


def quarter_quads(bounds: Bounds) -> Iterator[Sheet]:
    """Quarter quadrangles in degrees of the northern and western hemisphere, as 38077a1_ne. Raises WorkflowError elsewhere."""
    west, south, east, north = bounds
    if east > 0 or south < 0:
        raise WorkflowError("Quarter quadrangles are those of the USGS, north of the equator and west of Greenwich.")
    for row in range(floor(south / _DOQQ), ceil(north / _DOQQ)):
        for col in range(floor(-east / _DOQQ), ceil(-west / _DOQQ)):
            # Columns are counted to the west, as the degrees are.
            degrees, quad = (row // 16, col // 16), ("abcdefgh"[row % 16 // 2], col % 16 // 2 + 1)
            quarter = ("s", "n")[row % 2] + ("e", "w")[col % 2]
            name = f"{degrees[0]:02d}{degrees[1]:03d}{quad[0]}{quad[1]}_{quarter}"
            yield Sheet(name, (-(col + 1) * _DOQQ, row * _DOQQ, -col * _DOQQ, (row + 1) * _DOQQ))


def _bounds_in(bounds: Bounds, crs: str, other: str) -> Bounds:
    return moved(_rectangle("", bounds), crs, other).bounds


def _elsewhere(sheets: Iterator[Sheet], system: str, crs: str) -> Iterator[Sheet]:
    for sheet in sheets:
        yield Sheet(sheet.name, moved(_rectangle(sheet.name, sheet.area), system, crs).bounds)


def _rectangle(name: str, area: Bounds) -> Outline:
    west, south, east, north = area
    return Outline(name, (np.array([[west, south], [east, south], [east, north], [west, north], [west, south]], np.float64),))


def _file_name(name: str) -> str:
    """What is no letter, digit, dot or hyphen would be a path or a trap of some system."""
    return re.sub(r"[^\w.-]+", "_", name).strip(".") or "_"
