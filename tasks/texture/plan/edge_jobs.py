"""The jobs of straight edges: the lines of each sheet through the places that the tiles measured, and their products."""

from collections.abc import Iterator

from orthomill.schemas.job import Export, Job, Table
from orthomill.schemas.maps.straight_edges import edge_sheets, straight_edges_table
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.raster import MapGrid, Tile, tiles_in
from orthomill.schemas.surface import ORTHO
from orthomill.tasks.texture.edges.grown_lines import EdgeSums, edge_sheet
from orthomill.tasks.texture.edges.measured_edges import MeasuredEdges

_FORMATS = {"edges.gpkg": "gpkg", "edges.dxf": "dxf"}
_PLACE = 600
"""bytes of a place while lines are grown through it and its neighbours"""
_APART = 100
"""px of the orthoimage for a place, at least: edges of roofs and beams 50 px apart"""


def places_table(tile: Tile) -> Table[MeasuredEdges]:
    """The places along edges of a tile."""
    return Table(f"texture/edges/{tile.row}-{tile.col}.parquet", MeasuredEdges)


def sums_table(sheet: Tile) -> Table[EdgeSums]:
    """Sums over the lines of a sheet."""
    return Table(f"texture/edges/sums_{sheet.row}-{sheet.col}.json", EdgeSums)


def edge_jobs(ortho: MapGrid, size: int, cell: float) -> Iterator[Job | Export]:
    """The straight edges of an orthoimage in tiles of `size` pixels over a surface model with cells of `cell` m."""
    sheets = edge_sheets(ortho.shape, size)
    for sheet in sheets:
        yield _lines(ortho, sheet, size, cell)
    lines = tuple(map(straight_edges_table, sheets))
    for name, kind in _FORMATS.items():
        yield Export("texture", f"edges_{kind}", f"products/{name}", kind, {"place": ORTHO}, lines)


def _lines(ortho: MapGrid, sheet: Tile, size: int, cell: float) -> Job:
    inside = tiles_in(sheet, ortho.shape, size)
    return Job(
        stage="texture",
        item="edges",
        function=edge_sheet,
        reads={"parts": tuple(map(places_table, inside))},
        writes={"lines": straight_edges_table(sheet), "sums": sums_table(sheet)},
        params={"cell": cell},
        row=sheet.row,
        col=sheet.col,
        scratch=array_bytes(_PLACE, sheet.window) // _APART,
    )
