"""The jobs of the contours: their interval, pieces tile by tile, and the lines of each sheet."""

from collections.abc import Iterator

from orthomill.schemas.bare_ground import (
    TERRAIN,
    TERRAIN_CODE,
    TERRAIN_PRECISION,
    TERRAIN_RELATIVE,
    contour_sheets,
    terrain_lines_table,
)
from orthomill.schemas.job import Export, Job, Raster, Table
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.raster import MapGrid, Tile, Window, tiles_in, tiles_of
from orthomill.tasks.terrain.contours.contour_interval import ContourInterval, contour_interval
from orthomill.tasks.terrain.contours.contour_pieces import HALO, ContourPieces, contour_pieces
from orthomill.tasks.terrain.contours.joined_contours import join_contours
from orthomill.tasks.terrain.stage import DrawContours
from orthomill.tasks.terrain.terrain_sums import TerrainSums

INTERVAL = Table("terrain/contour_interval.json", ContourInterval)
_FORMATS = {"contours.gpkg": "gpkg", "contours.dxf": "dxf", "contours.geojson": "geojson"}
_VERTEX = 200
"""bytes of a vertex while lines are joined"""


def contour_jobs(asked: DrawContours, grid: MapGrid, size: int, sums: tuple[Table[TerrainSums], ...]) -> Iterator[Job | Export]:
    """The contours of a terrain on `grid` in tiles of `size` cells, whose interval follows from the sums of its tiles."""
    yield Job(
        stage="terrain",
        item="interval",
        function=contour_interval,
        reads={"sums": sums},
        writes={"interval": INTERVAL},
        params={"asked": None if asked.interval == "auto" else asked.interval},
    )
    yield from (_pieces(grid, tile) for tile in tiles_of(grid.shape, size))
    sheets = contour_sheets(grid.shape, size)
    yield from (_joined(asked, grid, sheet, size) for sheet in sheets)
    lines = tuple(terrain_lines_table(sheet) for sheet in sheets)
    for name, kind in _FORMATS.items():
        yield Export("terrain", f"contours_{kind}", f"products/{name}", kind, {"place": TERRAIN}, lines)


def _joined(asked: DrawContours, grid: MapGrid, sheet: Tile, size: int) -> Job:
    inside = tiles_in(sheet, grid.shape, size)
    return Job(
        stage="terrain",
        item="joined",
        function=join_contours,
        reads={"parts": tuple(map(_pieces_table, inside)), "interval": INTERVAL},
        writes={"lines": terrain_lines_table(sheet)},
        params={"cell": grid.cell, "every": asked.index_every},
        row=sheet.row,
        col=sheet.col,
        # Ten cells of ground for a vertex: contours are no closer than the relief allows.
        scratch=array_bytes(_VERTEX, sheet.window) // 10,
    )


def _pieces(grid: MapGrid, tile: Tile) -> Job:
    # A row and a column of the next tile: between their cells and the last ones of this tile lie contours as well.
    window = tile.window
    core = Window(window.row, window.col, window.height + 1, window.width + 1).clipped(grid.shape)
    outer = core.grown(HALO).clipped(grid.shape)
    names = {"height": TERRAIN, "precision": TERRAIN_PRECISION, "relative": TERRAIN_RELATIVE, "code": TERRAIN_CODE}
    return Job(
        stage="terrain",
        item="contours",
        function=contour_pieces,
        reads={**{key: Raster(name, outer) for key, name in names.items()}, "interval": INTERVAL},
        writes={"pieces": _pieces_table(tile)},
        params={"grid": grid, "windows": (outer, core)},
        row=tile.row,
        col=tile.col,
        scratch=array_bytes(80, outer),
    )


def _pieces_table(tile: Tile) -> Table[ContourPieces]:
    return Table(f"terrain/contours/{tile.row}-{tile.col}.parquet", ContourPieces)
