"""Whether a surface from a file can belong to the photographs at all, and about how far it lies above or below them.

Strategy. Its heights are compared with those of the tie points, or with the range of the ground where there are none. Feet fit much
better once they are converted, and are refused; a height system of its own shows as a constant shift, which is removed before the
search, however large it is, and found exactly by the check itself (`surface_shift`).
"""

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.errors import GeometryError
from orthomill.schemas.job import Table
from orthomill.schemas.observations import GroundPoints
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid
from orthomill.tasks.geometry.coordinate_ranges import in_feet

_FEWEST = 10
"""tie points on the surface, below which the range of the ground is used"""
_PLACES = 256
"""cells along the longer side of the raster on which a surface is placed"""


class Placed(BaseModel):
    """What is added to the heights of a surface before it is checked (m), and the tie points that say so."""

    model_config = ConfigDict(frozen=True)

    up: float
    points: int = 0


PLACED = Table("dsm_check/placed.json", Placed)


def places(grid: MapGrid) -> MapGrid:
    """The coarse grid on which a surface of `grid` is placed."""
    factor = max(1, -(-max(grid.shape) // _PLACES))
    rows, cols = (-(-side // factor) for side in grid.shape)
    return MapGrid(west=grid.west, north=grid.north, cell=grid.cell * factor, rows=rows, cols=cols)


def place(heights: np.ndarray, block: Block, grid: MapGrid, path: str, points: GroundPoints | None = None) -> Placed:
    """How a surface (rows, cols) m on `grid` lies to the photographs.

    Raises GeometryError for one without heights where the photographs are, and for one in feet.
    """
    known = heights[np.isfinite(heights)].astype(np.float64)
    if not len(known):
        raise GeometryError(
            f"The surface {path} has no height where the photographs are; check its reference system, or its holes."
        )
    at, ties = _under(points, heights, grid) if points is not None else (known, np.zeros(0))
    if len(ties) < _FEWEST:
        return Placed(up=_into_range(known, block, path))
    _refuse_feet(at, ties, path)
    return Placed(up=-round(float(np.median(at - ties)), 3), points=len(ties))


def _under(points: GroundPoints, heights: np.ndarray, grid: MapGrid) -> tuple[np.ndarray, np.ndarray]:
    """Heights (N,) of the surface below tie points, and theirs."""
    col, row = grid.pixel(points.x, points.y)
    col, row = np.rint(np.nan_to_num(col, nan=-1)), np.rint(np.nan_to_num(row, nan=-1))
    inside = (col >= 0) & (row >= 0) & (col < grid.cols) & (row < grid.rows)
    at = heights[row[inside].astype(int), col[inside].astype(int)].astype(np.float64)
    both = np.isfinite(at) & np.isfinite(points.z[inside])
    return at[both], points.z[inside][both]


def _into_range(known: np.ndarray, block: Block, path: str) -> float:
    """What brings the middle of the surface to the ground of the block; 0 where it may lie there already."""
    middle = float(np.median(known))
    room = block.ground_high - block.ground_low
    low, high = block.ground_low - room, block.ground_high + room
    if low <= middle <= high:
        return 0.0
    _refuse_feet(np.array([middle]), np.array([block.ground_mean]), path)
    return round(block.ground_mean - middle, 3)


def _refuse_feet(heights: np.ndarray, ground: np.ndarray, path: str) -> None:
    if in_feet(heights, ground):
        raise GeometryError(
            f"The heights of {path} are in feet; convert them to metres, or name a system whose heights are in feet."
        )
