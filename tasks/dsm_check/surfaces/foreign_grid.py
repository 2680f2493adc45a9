"""The grid on which a surface from a file is checked.

Strategy. The project's own surface decides, if there is one. Otherwise the cells of the file are kept where they suit the
photographs, and replaced by a round size near 1.5 ground pixels where they are much finer (a laser scan) or coarser (a national
model). The grid ends where the photographs end: a file may cover a country. An area, a corner and a cell that the project names
are kept to the letter.
"""

import numpy as np

from orthomill.schemas.epipolar import EpipolarPairs
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.maps.wanted_area import WantedArea
from orthomill.schemas.orientation import Area, Block
from orthomill.schemas.project import MapSurface
from orthomill.schemas.raster import MapGrid
from orthomill.schemas.surface import Surface, round_cell_size
from orthomill.tasks.dsm_check.coverage import ground_pixel, seen_ground

_ROOM = 1 / 7
"""of the flying height by which a surface may exceed the heights of the tie points"""
_FINEST, _COARSEST = 0.7, 3.0
"""ground pixels: cells that are kept"""
_WHOLE = 1e-6
"""cells: a corner as near to a whole number of them is one"""


def measured_surface(surface: Surface) -> Surface:
    """The surface under test where the project's own surface is checked: the same."""
    return surface


def surface_on(grid: MapGrid, block: Block, wanted: WantedArea | None = None) -> Surface:
    """A surface of which only the grid is known: its heights may exceed those of the tie points by a seventh of the flying height;
    higher and lower ones are not checked. wanted: polygons outside of which nothing is."""
    # The header of a file does not contain its heights, and reading all of them would delay every other job.
    flying = float(np.mean([photo.centre[2] for photo in block.photos])) - block.ground_mean
    low, high = block.ground_low - abs(flying) * _ROOM, block.ground_high + abs(flying) * _ROOM
    return Surface(grid=grid, height_low=low, height_high=high, wanted=wanted or WantedArea())


def foreign_surface(
    extent: MapGrid,
    block: Block,
    pairs: EpipolarPairs,
    asked: MapSurface | None = None,
    surface: Surface | None = None,
    wanted: WantedArea | None = None,
) -> Surface:
    """The surface under test where a file is checked; extent: its bounds and cells in the project's system; asked: what the project
    names of its grid; surface: that of the project, where it makes one; wanted: the polygons of its area, where it names such.

    Raises GeometryError where the file and the ground that two photographs see do not overlap, or not in that area.
    """
    rough = surface_on(extent, block)
    seen = [seen_ground(pair, block, rough) for pair in pairs.pairs]
    corners = np.concatenate([polygon for polygon in seen if len(polygon)] or [np.empty((0, 2))])
    if not len(corners):
        raise GeometryError(
            "No two photographs see common ground, so no surface can be checked; see the report on the orientation."
        )
    common = _common((*corners.min(axis=0), *corners.max(axis=0)), _bounds(extent))
    if common is None:
        raise GeometryError(_elsewhere(extent, corners))
    asked = asked or MapSurface()
    area = wanted.bounds if wanted else asked.area if isinstance(asked.area, tuple) else None
    if area is not None and (common := _common(common, area)) is None:
        west, south, east, north = (f"{value:.6g}" for value in area)
        raise GeometryError(
            f"Surface and photographs have no ground in common in the area that is asked for, from x = {west}, y = {south} to "
            f"x = {east}, y = {north} m; move it (grid, --area)."
        )
    if surface:
        return surface_on(surface.grid, block, surface.wanted)
    return surface_on(_cut(extent, ground_pixel(block, rough), asked, common), block, wanted)


def _bounds(grid: MapGrid) -> Area:
    return grid.west, grid.north - grid.rows * grid.cell, grid.west + grid.cols * grid.cell, grid.north


def _common(one: Area, other: Area) -> Area | None:
    """What two areas have in common; None: nothing."""
    west, south = np.maximum(one[:2], other[:2]).tolist()
    east, north = np.minimum(one[2:], other[2:]).tolist()
    return (west, south, east, north) if east > west and north > south else None


def _cut(extent: MapGrid, pixel: float, asked: MapSurface, bounds: Area) -> MapGrid:
    """Whole cells within bounds: those that are asked for, the file's own, or round ones."""
    west, south, east, north = bounds
    if asked.cell == "auto" and _FINEST * pixel <= extent.cell <= _COARSEST * pixel:
        cell, origin = extent.cell, (extent.west, extent.north)
    else:
        # Whole multiples of the cell, as for surfaces of the project: they can be subtracted cell by cell.
        cell, origin = round_cell_size(pixel) if asked.cell == "auto" else asked.cell, asked.origin
    # Corners that are whole cells already stay so, whatever the division left of them.
    first_col, first_row = (int(np.floor(v / cell + _WHOLE)) for v in (west - origin[0], origin[1] - north))
    last_col, last_row = (int(np.ceil(v / cell - _WHOLE)) for v in (east - origin[0], origin[1] - south))
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
