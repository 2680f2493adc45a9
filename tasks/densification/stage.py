"""The stage `densification`: dense matching of every pair block by block, then the surface model tile by tile.

A block of a pair is matched as soon as its epipolar tiles are stored, and a tile of the surface follows as soon as the blocks that
may show it are matched.
"""

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from orthomill.schemas.epipolar import PAIRS, EpipolarPair, epipolar_raster
from orthomill.schemas.job import Export, Job, Raster, Region, Table
from orthomill.schemas.orientation import BLOCK as BLOCK_TABLE
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import RasterSpec, Tile, Window, map_raster, tiles_of
from orthomill.schemas.settings import setting
from orthomill.schemas.stage_contract import ProjectView, Stage
from orthomill.schemas.stage_report import report_table
from orthomill.schemas.surface import COUNT, HEIGHT, PRECISION, PROVENANCE, SURFACE, Surface
from orthomill.tasks.densification.filling import Filling, NoFill
from orthomill.tasks.densification.fusion import Fusion
from orthomill.tasks.densification.gridding import Gridding
from orthomill.tasks.densification.matching_block import MatchingStatistics, PairBlock, match_pair_block, sum_matching
from orthomill.tasks.densification.report import report
from orthomill.tasks.densification.spike_filter import SpikeFilter
from orthomill.tasks.densification.surface_grid import surface_of
from orthomill.tasks.densification.surface_tile import (
    PairPiece,
    SurfaceRules,
    SurfaceStatistics,
    SurfaceTile,
    make_surface,
    sum_surface,
    surface_scratch,
)
from orthomill.tasks.geometry.epipolar_window import box_corners, node_window, nodes_shape
from orthomill.tasks.matching.dense.blocks import BLOCK, DenseMatching, scratch_bytes

CELLS = Table("densification/cells.json", SurfaceStatistics)


def nodes_raster(pair: str) -> str:
    """(rows, cols, 3) float32 at the nodes of a pair: parallax px, its standard error px, correlation; NaN without a match."""
    return f"densification/nodes/{pair}"


def outcome_raster(pair: str) -> str:
    """uint8 `orthomill.schemas.outcome.Outcome` at the nodes of a pair."""
    return f"densification/outcome/{pair}"


def matching_table(pair: str) -> Table[MatchingStatistics]:
    """The matching statistics of a pair."""
    return Table(f"densification/matching/{pair}.json", MatchingStatistics)


class DensificationStage(Stage):
    """A surface model with a precision for every height, from hierarchical least-squares matching of the epipolar images."""

    title: ClassVar[str] = "Dense matching and surface model"

    kind: Literal["densification"] = "densification"
    cell: Literal["auto"] | Annotated[float, Field(gt=0)] = setting(
        "auto", "Cell size; auto is a round number near 1.5 ground pixels.", "m"
    )
    matching: DenseMatching = setting(DenseMatching(), "Dense matching of a pair.")
    gridding: Gridding = setting(Gridding(), "From the nodes of a pair to map cells.")
    fusion: Fusion = setting(Fusion(), "How the heights of several pairs become one.")
    spikes: SpikeFilter = setting(SpikeFilter(), "Removal of spikes.")
    fill: Filling = setting(NoFill(), "Whether gaps are filled.")

    @property
    def rules(self) -> SurfaceRules:
        """The settings that a tile of the surface needs."""
        return SurfaceRules(self.gridding, self.fusion, self.spikes, self.fill)

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        cell = None if self.cell == "auto" else self.cell
        yield Job(self.kind, "grid", surface_of, {"block": BLOCK_TABLE, "pairs": PAIRS}, {"surface": SURFACE}, {"cell": cell})
        pairs = view.table(PAIRS).pairs
        for pair in pairs:
            yield from self._pair(pair)
        # From here on planning waits for the grid; the blocks above are already being matched meanwhile.
        surface = view.table(SURFACE)
        yield from self._surface(view, surface, pairs)
        matching = tuple(matching_table(pair.name) for pair in pairs)
        yield Job(
            self.kind,
            "report",
            report,
            {"pairs": PAIRS, "surface": SURFACE, "matching": matching, "cells": CELLS},
            {"report": report_table(self.kind)},
        )

    def _pair(self, pair: EpipolarPair) -> Iterator[RasterSpec | Job]:
        """The blocks of a pair."""
        # One chunk of nodes is one block: every block is written by one job, whatever the tile of the project.
        shape, chunk = nodes_shape(pair, self.matching.step), BLOCK // self.matching.step
        yield RasterSpec(name=nodes_raster(pair.name), shape=(*shape, 3), dtype="float32", chunk=chunk, nodata=float("nan"))
        yield RasterSpec(name=outcome_raster(pair.name), shape=shape, dtype="uint8", chunk=chunk, nodata=Outcome.NOT_TRIED)
        tables = []
        for tile in tiles_of(shape, chunk):
            tables.append(Table(f"densification/matching/{pair.name}/{tile.row}-{tile.col}.json", MatchingStatistics))
            yield self._block(pair, tile, tables[-1])
        yield Job(self.kind, f"{pair.name}-statistics", sum_matching, {"parts": tuple(tables)}, {"sum": matching_table(pair.name)})

    def _block(self, pair: EpipolarPair, tile: Tile, table: Table[MatchingStatistics]) -> Job:
        block = PairBlock(pair, tile.window, self.matching.step)
        reads: dict[str, Region | tuple[Region, ...]] = {"left": Raster(epipolar_raster(pair.name, "left"), block.left)}
        if not block.right.empty:
            reads["right"] = Raster(epipolar_raster(pair.name, "right"), block.right)
        writes: dict[str, Raster | Table] = {
            "nodes": Raster(nodes_raster(pair.name), tile.window),
            "outcome": Raster(outcome_raster(pair.name), tile.window),
            "statistics": table,
        }
        return Job(
            self.kind,
            pair.name,
            match_pair_block,
            reads,
            writes,
            {"block": block, "matching": self.matching},
            row=tile.row,
            col=tile.col,
            scratch=scratch_bytes(block.parallaxes, self.matching),
        )

    def _surface(self, view: ProjectView, surface: Surface, pairs: tuple[EpipolarPair, ...]) -> Iterator[RasterSpec | Job | Export]:
        """The tiles of the surface model."""
        grid, crs, size = surface.grid, view.project.crs, view.project.tile
        nan = float("nan")
        yield map_raster(HEIGHT, grid, "float32", crs, size, nodata=nan, unit="m")
        yield map_raster(PRECISION, grid, "float32", crs, size, nodata=nan, unit="m")
        yield map_raster(COUNT, grid, "uint8", crs, size, unit="pairs")
        yield map_raster(PROVENANCE, grid, "uint8", crs, size)
        tables = []
        for tile in tiles_of(grid.shape, size):
            tables.append(Table(f"densification/cells/{tile.row}-{tile.col}.json", SurfaceStatistics))
            yield self._tile(surface, pairs, tile, tables[-1])
        yield Job(self.kind, "cells", sum_surface, {"parts": tuple(tables)}, {"sum": CELLS})
        yield Export(self.kind, "dsm", "products/dsm.tif", "cog", rasters={"height": HEIGHT, "precision": PRECISION})
        yield Export(
            self.kind, "provenance", "products/dsm_provenance.tif", "cog", rasters={"provenance": PROVENANCE, "count": COUNT}
        )

    def _tile(self, surface: Surface, pairs: tuple[EpipolarPair, ...], tile: Tile, table: Table[SurfaceStatistics]) -> Job:
        # The halo makes filters and filling see what they would see in one piece: any tile size gives the same bits.
        work = tile.window.grown(self.rules.halo(surface.grid.cell)).clipped(surface.grid.shape)
        pieces = self._pieces(surface, pairs, work)
        nodes = tuple(Raster(nodes_raster(piece.pair.name), piece.nodes) for piece in pieces)
        outputs = {"height": HEIGHT, "precision": PRECISION, "pairs": COUNT, "provenance": PROVENANCE}
        return Job(
            self.kind,
            "surface",
            make_surface,
            {"nodes": nodes} if nodes else {},
            {**{key: Raster(name, tile.window) for key, name in outputs.items()}, "statistics": table},
            {"tile": SurfaceTile(surface, tile.window, work, pieces), "rules": self.rules},
            row=tile.row,
            col=tile.col,
            scratch=surface_scratch(pieces, work),
        )

    def _pieces(self, surface: Surface, pairs: tuple[EpipolarPair, ...], work: Window) -> tuple[PairPiece, ...]:
        # All heights of the surface, not those of the tie points: a tower leans across several tiles of the left image.
        corners = box_corners(surface.grid, work.grown(1), surface.height_low, surface.height_high)
        pieces = (PairPiece(pair, node_window(pair, self.matching.step, corners), self.matching.step) for pair in pairs)
        return tuple(piece for piece in pieces if not piece.nodes.empty)
