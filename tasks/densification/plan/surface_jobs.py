"""The rasters and jobs of the surface model: the same tiles, rasters and products, whatever the heights come from."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from statistics import median
from typing import Any

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.job import Export, Job, Raster, Reading, Stream, Table
from orthomill.schemas.observations import GROUND_POINTS
from orthomill.schemas.raster import RasterSpec, Tile, Window, map_raster, tiles_of, windows_in
from orthomill.schemas.surface import (
    COUNT,
    DATUM_PRECISION,
    HEIGHT,
    PRECISION,
    PROVENANCE,
    RELATIVE_PRECISION,
    Surface,
    points_table,
)
from orthomill.tasks.densification.plan.pair_jobs import nodes_raster
from orthomill.tasks.densification.points import points_bytes
from orthomill.tasks.densification.precision.tie_points import TieCounts, around, sum_ties, tie_counts
from orthomill.tasks.densification.surface_grid import parallax_height
from orthomill.tasks.densification.surface_tile import (
    PairPiece,
    SurfaceRules,
    SurfaceStatistics,
    SurfaceTile,
    sum_surface,
    surface_scratch,
)
from orthomill.tasks.geometry.epipolar_window import box_corners, node_window

CELLS = Table("densification/cells.json", SurfaceStatistics)
TIES = Table("densification/tie_points.json", TieCounts)
SHEET = 4096
"""cells along a part of the surface whose tie points are looked at in one job, about: most surfaces are one part"""
_HEIGHTS = {"height": HEIGHT, "precision": PRECISION, "relative": RELATIVE_PRECISION, "datum": DATUM_PRECISION}
"""float rasters of the surface, by the name of the band"""


@dataclass(frozen=True)
class SurfaceSource:
    """What a tile of the surface is made from: the function, the map rasters that it reads by argument, and the nodes of the
    pairs."""

    function: Callable[..., Any]
    rasters: Mapping[str, str]
    surface: Surface
    ground: float
    """mean height of the ground, m"""
    step: float
    """between the heights that were compared, m"""
    node_step: int
    """px between the nodes of the pairs"""
    window_cells: float = 0.0
    """cells along the side of windows that know no walls; 0: windows keep to one surface"""
    reads_nodes: bool = True
    """whether it reads the nodes of the pairs as well, as the argument `nodes`"""
    tables: Mapping[str, Table[Any]] = field(default_factory=dict)
    """what it reads of the whole block, by argument"""


@dataclass(frozen=True)
class SurfacePlan:
    """Everything about the tiles but what they are made from."""

    stage: str
    crs: str
    tile: int
    rules: SurfaceRules

    def jobs(self, source: SurfaceSource, pairs: tuple[EpipolarPair, ...]) -> Iterator[RasterSpec | Job | Export]:
        """The tiles of the surface model."""
        grid = source.surface.grid
        for name in _HEIGHTS.values():
            yield map_raster(name, grid, "float32", self.crs, self.tile, nodata=float("nan"), unit="m")
        yield map_raster(COUNT, grid, "uint8", self.crs, self.tile, unit="pairs")
        yield map_raster(PROVENANCE, grid, "uint8", self.crs, self.tile)
        tables = []
        for tile in tiles_of(grid.shape, self.tile):
            tables.append(Table(f"densification/cells/{tile.row}-{tile.col}.json", SurfaceStatistics))
            yield self._tile(source, pairs, tile, tables[-1])
        yield Job(stage=self.stage, item="cells", function=sum_surface, reads={"parts": tuple(tables)}, writes={"sum": CELLS})
        yield from self._ties(source.surface, pairs)
        yield Export(self.stage, "dsm", "products/dsm.tif", "cog", rasters=_HEIGHTS)
        yield Export(
            self.stage, "provenance", "products/dsm_provenance.tif", "cog", rasters={"provenance": PROVENANCE, "count": COUNT}
        )

    def _ties(self, surface: Surface, pairs: tuple[EpipolarPair, ...]) -> Iterator[Job]:
        """The tie points against the finished surface, whatever it was made from."""
        width = 0.25 * median(map(parallax_height, pairs))
        sheets = list(tiles_of(surface.grid.shape, max(SHEET // self.tile, 1) * self.tile))
        tables = [Table(f"densification/tie_points/{sheet.row}-{sheet.col}.json", TieCounts) for sheet in sheets]
        for sheet, table in zip(sheets, tables, strict=True):
            yield self._ties_of(surface, sheet, width, table)
        yield Job(stage=self.stage, item="tie-points", function=sum_ties, reads={"parts": tuple(tables)}, writes={"sum": TIES})

    def _ties_of(self, surface: Surface, sheet: Tile, width: float, table: Table[TieCounts]) -> Job:
        windows = windows_in(sheet.window, self.tile)
        read = [around(window, surface.grid.shape) for window in windows]
        rasters = {"height": HEIGHT, "relative": RELATIVE_PRECISION, "provenance": PROVENANCE}
        return Job(
            stage=self.stage,
            item="tie-points-of",
            function=tie_counts,
            reads={
                "points": GROUND_POINTS,
                **{key: Stream(tuple(Raster(name, window) for window in read)) for key, name in rasters.items()},
            },
            writes={"counts": table},
            params={"grid": surface.grid, "windows": windows, "width": width},
            row=sheet.row,
            col=sheet.col,
        )

    def _tile(self, source: SurfaceSource, pairs: tuple[EpipolarPair, ...], tile: Tile, table: Table[SurfaceStatistics]) -> Job:
        # The halo makes filters and filling see what they would see in one piece: any tile size gives the same bits.
        around = tile.window.grown(self.rules.halo)
        work = around.clipped(source.surface.grid.shape)
        pieces = pieces_of(source, pairs, around)
        reads = {**tile_reads(source, work, pieces), **source.tables}
        outputs = {**_HEIGHTS, "pairs": COUNT, "provenance": PROVENANCE}
        return Job(
            stage=self.stage,
            item="surface",
            function=source.function,
            reads=reads,
            writes={
                **{key: Raster(name, tile.window) for key, name in outputs.items()},
                "statistics": table,
                "points": points_table(tile.row, tile.col),
            },
            params={"tile": surface_tile(source, tile.window, work, pieces), "rules": self.rules},
            row=tile.row,
            col=tile.col,
            scratch=surface_scratch(pieces, work) + points_bytes(tile.window, 2 * len(pieces), self.rules.points),
        )


def tile_reads(source: SurfaceSource, work: Window, pieces: tuple[PairPiece, ...]) -> dict[str, Reading]:
    """The rasters that a tile reads, and the nodes of the pairs that can show it."""
    reads: dict[str, Reading] = {key: Raster(name, work) for key, name in source.rasters.items()}
    if source.reads_nodes:
        reads["nodes"] = Stream(tuple(Raster(nodes_raster(piece.pair.name), piece.nodes) for piece in pieces))
    return reads


def surface_tile(source: SurfaceSource, window: Window, work: Window, pieces: tuple[PairPiece, ...]) -> SurfaceTile:
    """The tile of the cells `window`, of which `work` are computed."""
    return SurfaceTile(
        surface=source.surface,
        window=window,
        work=work,
        pieces=pieces,
        ground=source.ground,
        step=source.step,
        window_cells=int(source.window_cells),
    )


def pieces_of(source: SurfaceSource, pairs: tuple[EpipolarPair, ...], around: Window) -> tuple[PairPiece, ...]:
    """The pairs that can show the cells `around`."""
    # All heights of the surface, not those of the tie points: a tower leans across several tiles of the left image.
    surface, step = source.surface, source.node_step
    corners = box_corners(surface.grid, around, surface.height_low, surface.height_high)
    pieces = (PairPiece(k, pair, node_window(pair, step, corners), step) for k, pair in enumerate(pairs))
    return tuple(piece for piece in pieces if not piece.nodes.empty)
