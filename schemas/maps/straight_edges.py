"""Straight edges of roofs and walls as lines of a map."""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.job import Table
from orthomill.schemas.maps.map_lines import MapLines
from orthomill.schemas.raster import Tile, sheets_of

SHEET = 4096
"""pixels of the orthoimage along a sheet, about: lines are joined within a sheet, so that memory does not grow with the map"""
EDGES = "products/edges.gpkg"


@dataclass(frozen=True)
class StraightEdges(MapLines):
    """Straight edges in space, two vertices each."""

    length: np.ndarray
    """float64 m, in plan"""
    step: np.ndarray
    """float64 m: height of the edge above the lower surface beside it"""
    sigma_across: np.ndarray
    sigma_height: np.ndarray
    """float64 m: standard errors across the line and of its height, at its less certain end, within the block"""
    scatter: np.ndarray
    """float64 m: root mean square of the distances of the places that were measured along it"""
    photos: np.ndarray
    """int64: photographs that show it, in the middle of its places"""


def edge_sheets(shape: tuple[int, ...], size: int) -> tuple[Tile, ...]:
    """The sheets of an orthoimage of `shape` pixels: whole tiles (of `size` pixels) together; most are one sheet."""
    return sheets_of(shape, size, SHEET)


def straight_edges_table(sheet: Tile) -> Table[StraightEdges]:
    """The straight edges of a sheet."""
    return Table(f"texture/edges/sheet_{sheet.row}-{sheet.col}.parquet", StraightEdges)
