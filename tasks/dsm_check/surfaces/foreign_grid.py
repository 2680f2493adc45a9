"""The grid on which a surface from a file is checked.

Strategy. The project's own surface decides, if there is one. Otherwise the cells of the file are kept where they suit the
photographs, and replaced by a round size near 1.5 ground pixels where they are much finer (a laser scan) or coarser (a national
model). The grid ends where the photographs end: a file may cover a country.
"""

import numpy as np

from orthomill.schemas.epipolar import EpipolarPairs
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid
from orthomill.schemas.surface import Surface, round_cell_size
from orthomill.tasks.dsm_check.coverage import ground_pixel, seen_ground

_ROOM = 1 / 7
"""of the flying height by which a surface may exceed the heights of the tie points"""
_FINEST, _COARSEST = 0.7, 3.0
"""ground pixels: cells that are kept"""


def measured_surface(surface: Surface) -> Surface:
    """The surface under test where the project's own surface is checked: the same."""
    return surface


def surface_on(grid: MapGrid, block: Block) -> Surface:
    """A surface of which only the grid is known: its heights may exceed those of the tie points by a seventh of the flying height;
    higher and lower ones are not checked."""
    # The header of a file does not contain its heights, and reading all of them would delay every other job.
    flying = float(np.mean([photo.centre[2] for photo in block.photos])) - block.ground_mean
    low, high = block.ground_low - abs(flying) * _ROOM, block.ground_high + abs(flying) * _ROOM
    return Surface(grid=grid, height_low=low, height_high=high)


def foreign_surface(extent: MapGrid, block: Block, pairs: EpipolarPairs, surface: Surface | None = None) -> Surface:
    """The surface under test where a file is checked; extent: its bounds and cells in the project's system.

    Raises GeometryError where the file and the ground that two photographs see do not overlap.
    """
    rough = surface_on(extent, block)
    seen = [seen_ground(pair, block, rough) for pair in pairs.pairs]
    corners = np.concatenate([polygon for polygon in seen if len(polygon)] or [np.empty((0, 2))])
    if not len(corners):
        raise GeometryError(
            "No two photographs see common ground, so no surface can be checked; see the report on the orientation."
        )
    west, south = np.maximum(corners.min(axis=0), (extent.west, extent.north - extent.rows * extent.cell))
    east, north = np.minimum(corners.max(axis=0), (extent.west + extent.cols * extent.cell, extent.north))
    if not (east > west and north > south):
        raise GeometryError(_elsewhere(extent, corners))
    return surface_on(surface.grid if surface else _cut(extent, ground_pixel(block, rough), (west, south, east, north)), block)


def _cut(extent: MapGrid, pixel: float, bounds: tuple[float, float, float, float]) -> MapGrid:
    """Whole cells within bounds (west, south, east, north): the file's own, or round ones."""
    west, south, east, north = bounds
    if _FINEST * pixel <= extent.cell <= _COARSEST * pixel:
        cell, origin = extent.cell, (extent.west, extent.north)
    else:
        # Whole multiples of the cell, as for surfaces of the project: they can be subtracted cell by cell.
        cell, origin = round_cell_size(pixel), (0.0, 0.0)
    first_col, first_row = int(np.floor((west - origin[0]) / cell)), int(np.floor((origin[1] - north) / cell))
    last_col, last_row = int(np.ceil((east - origin[0]) / cell)), int(np.ceil((origin[1] - south) / cell))
    return MapGrid(
        west=origin[0] + first_col * cell,
        north=origin[1] - first_row * cell,
        cell=cell,
        rows=last_row - first_row,
        cols=last_col - first_col,
    )


def _elsewhere(extent: MapGrid, corners: np.ndarray) -> str:
    middle = np.array([extent.west + extent.cols * extent.cell / 2, extent.north - extent.rows * extent.cell / 2])
    away = float(np.hypot(*(middle - corners.mean(axis=0))))
    return (
        f"The surface is elsewhere: its middle (X {middle[0]:.0f}, Y {middle[1]:.0f}) is {away / 1000:.1f} km from that of the "
        "photographs, and they have no ground in common; check its reference system."
    )
