"""The terrain: rasters that the stage `terrain` writes, on the grid of the surface model, and their codes."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from orthomill.schemas.job import Columns, Table
from orthomill.schemas.maps.map_lines import MapLines
from orthomill.schemas.raster import Tile, sheets_of

TERRAIN = "terrain/height"
"""float32 m: height of the bare ground, NaN beyond the surface and where no ground is near"""
TERRAIN_PRECISION = "terrain/precision"
"""float32 m: standard error of it"""
TERRAIN_RELATIVE = "terrain/relative"
"""float32 m: standard error of it against the ground around, without what the whole block is off"""
TERRAIN_CODE = "terrain/code"
"""uint8 code of TerrainCode"""
ABOVE_GROUND = "terrain/above"
"""float32 m: height of the surface above the bare ground"""
CELL_CLASS = "terrain/class"
"""uint8 code of CellClass"""


class TerrainCode(IntEnum):
    """Where the height of the bare ground comes from; uint8 in rasters."""

    # The numbers are part of the product terrain.tif: users' maps are classified by them, so they never change.
    EMPTY = 0
    MEASURED = 1
    UNDER_BUILDING = 2
    UNDER_WOOD = 3
    GUESSED = 4
    WATER = 5


TERRAIN_CODES: tuple[tuple[int, str, str], ...] = (
    (TerrainCode.EMPTY, "#000000", "empty: no height"),
    (TerrainCode.MEASURED, "#c9b38c", "measured ground"),
    (TerrainCode.UNDER_BUILDING, "#c1523c", "bridged under a building"),
    (TerrainCode.UNDER_WOOD, "#2f6b33", "bridged under trees and shrubs"),
    (TerrainCode.GUESSED, "#7b3294", "guessed: no ground was measured here, or none on one side"),
    (TerrainCode.WATER, "#08519c", "outlined water: the level of its shore"),
)
"""(code, colour, meaning) for pictures and tables"""


class CellClass(IntEnum):
    """What a cell or a point is, by the numbers of the standard; 0 is no height.

    Source: ASPRS, LAS Specification 1.4 - R15, table 17.
    """

    NONE = 0
    UNCLASSIFIED = 1
    GROUND = 2
    LOW_VEGETATION = 3
    MEDIUM_VEGETATION = 4
    HIGH_VEGETATION = 5
    BUILDING = 6
    LOW_NOISE = 7
    WATER = 9


CELL_CLASSES: tuple[tuple[int, str, str], ...] = (
    (CellClass.NONE, "#000000", "no height"),
    (CellClass.UNCLASSIFIED, "#9a9a9a", "not classified"),
    (CellClass.GROUND, "#c9b38c", "ground"),
    (CellClass.LOW_VEGETATION, "#b5d98a", "low vegetation"),
    (CellClass.MEDIUM_VEGETATION, "#6aab4f", "medium vegetation"),
    (CellClass.HIGH_VEGETATION, "#2f6b33", "high vegetation"),
    (CellClass.BUILDING, "#c1523c", "building"),
    (CellClass.LOW_NOISE, "#e377c2", "below the ground: an error"),
    (CellClass.WATER, "#3d6fa3", "water"),
)
"""(code, colour, meaning) for pictures and tables"""


@dataclass(frozen=True)
class PointClasses(Columns):
    """One row for every row of the points of a tile."""

    classification: np.ndarray
    """uint8 code of CellClass"""


def point_classes_table(row: int, col: int) -> Table[PointClasses]:
    """The classes of the points of a tile of the surface model."""
    return Table(f"terrain/points/{row}-{col}.parquet", PointClasses)


@dataclass(frozen=True)
class ContourLines(MapLines):
    """The contours of a terrain."""

    height: np.ndarray
    """float64 m"""
    index: np.ndarray
    """bool: one of the thicker lines that are labelled"""
    measured: np.ndarray
    """bool: whether the ground under the line was measured"""
    sigma: np.ndarray
    """float64 m: root mean square of the standard errors of the ground along the line"""


CONTOUR_SHEET = 4096
"""cells along a sheet of contours, about: lines are joined within a sheet, so that memory does not grow with the map"""


def contour_sheets(shape: tuple[int, ...], tile: int) -> tuple[Tile, ...]:
    """The sheets of a terrain of `shape` cells: whole tiles (of `tile` cells) together; most terrains are one sheet."""
    return sheets_of(shape, tile, CONTOUR_SHEET)


def terrain_lines_table(sheet: Tile) -> Table[ContourLines]:
    """The contours of a sheet."""
    return Table(f"terrain/contours/sheet_{sheet.row}-{sheet.col}.parquet", ContourLines)
