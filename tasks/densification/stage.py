"""The stage `densification`: a volume of heights over all photographs, every pair matched near it, then the surface tile by tile.

The volume is solved level by level, tile by tile. A block of a pair is matched as soon as its epipolar tiles and the volume under
it are there, and a tile of the surface follows as soon as the blocks that may show it are matched.
"""

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from orthomill.schemas.epipolar import PAIRS, EpipolarPair, epipolar_raster
from orthomill.schemas.job import Export, Job, Raster, Reading, Stream, Table
from orthomill.schemas.orientation import BLOCK as BLOCK_TABLE
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.raster import RasterSpec, Tile, Window, map_raster, tiles_of
from orthomill.schemas.settings import Settings, setting
from orthomill.schemas.stage_contract import ProjectView, Stage
from orthomill.schemas.stage_report import report_table
from orthomill.schemas.surface import (
    COUNT,
    DATUM_PRECISION,
    HEIGHT,
    PRECISION,
    PROVENANCE,
    RELATIVE_PRECISION,
    SURFACE,
    Surface,
    points_table,
)
from orthomill.tasks.densification.completion import Completion
from orthomill.tasks.densification.filling import EstimateGaps, Filling
from orthomill.tasks.densification.fusion import Fusion
from orthomill.tasks.densification.gridding import Gridding
from orthomill.tasks.densification.matching_block import MatchingStatistics, PairBlock, match_pair_block, sum_matching
from orthomill.tasks.densification.points import PointThinning, points_bytes
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
from orthomill.tasks.densification.volume.levels import VolumeScene
from orthomill.tasks.densification.volume.sureness import Sureness
from orthomill.tasks.densification.volume.volume_plan import JUDGED_HEIGHT, JUDGEMENT, WORTH, volume_plan
from orthomill.tasks.geometry.epipolar_window import box_corners, node_window, nodes_shape
from orthomill.tasks.matching.dense.blocks import BLOCK, DenseMatching
from orthomill.tasks.matching.volume.height_volume import HeightVolume

CELLS = Table("densification/cells.json", SurfaceStatistics)
_HEIGHTS = {"height": HEIGHT, "precision": PRECISION, "relative": RELATIVE_PRECISION, "datum": DATUM_PRECISION}
"""float rasters of the surface, by the name of the band"""


def nodes_raster(pair: str) -> str:
    """(rows, cols, 3) float32 at the nodes of a pair: parallax px, its standard error px, correlation; NaN without a match."""
    return f"densification/nodes/{pair}"


def outcome_raster(pair: str) -> str:
    """uint8 `orthomill.schemas.outcome.Outcome` at the nodes of a pair."""
    return f"densification/outcome/{pair}"


def matching_table(pair: str) -> Table[MatchingStatistics]:
    """The matching statistics of a pair."""
    return Table(f"densification/matching/{pair}.json", MatchingStatistics)


class ObjectSpace(Settings):
    """Semi-global matching of all photographs together in a volume of heights, then least-squares matching of every pair near
    it."""

    kind: Literal["object_space"] = "object_space"
    volume: HeightVolume = setting(HeightVolume(), "The volume of heights over all photographs.")
    sure: Sureness = setting(Sureness(), "When a height of the volume counts as measured.")
    pairs: DenseMatching = setting(DenseMatching(), "Dense matching of a pair.")


class DensificationStage(Stage):
    """A surface model with a precision for every height, from hierarchical least-squares matching of the epipolar images."""

    title: ClassVar[str] = "Dense matching and surface model"

    kind: Literal["densification"] = "densification"
    cell: Literal["auto"] | Annotated[float, Field(gt=0)] = setting(
        "auto", "Cell size; auto is a round number near 1.5 ground pixels.", "m"
    )
    matching: ObjectSpace = setting(ObjectSpace(), "How heights are measured.")
    gridding: Gridding = setting(Gridding(), "From the nodes of a pair to map cells.")
    fusion: Fusion = setting(Fusion(), "How the heights of several pairs become one.")
    completion: Completion = setting(Completion(), "How the heights of pairs and those of the volume go together.")
    spikes: SpikeFilter = setting(SpikeFilter(), "Removal of spikes from the heights of pairs.")
    points: PointThinning = setting(PointThinning(), "Which matched nodes become points.")
    fill: Filling = setting(EstimateGaps(), "What happens where nothing was measured.")

    @property
    def rules(self) -> SurfaceRules:
        """The settings that a tile of the surface needs."""
        return SurfaceRules(self.gridding, self.fusion, self.completion, self.spikes, self.fill, self.points)

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        cell = None if self.cell == "auto" else self.cell
        yield Job(self.kind, "grid", surface_of, {"block": BLOCK_TABLE, "pairs": PAIRS}, {"surface": SURFACE}, {"cell": cell})
        pairs, block, photos, surface = view.table(PAIRS).pairs, view.table(BLOCK_TABLE), view.table(PHOTOS), view.table(SURFACE)
        scene = VolumeScene(block, photos, surface, self.matching.volume)
        yield from volume_plan(scene, self.matching.sure, self.kind, view.project.crs)
        for pair in pairs:
            yield from self._pair(pair, surface)
        yield from self._surface(view, scene, pairs)
        matching = tuple(matching_table(pair.name) for pair in pairs)
        yield Job(
            self.kind,
            "report",
            report,
            {"pairs": PAIRS, "surface": SURFACE, "matching": matching, "cells": CELLS},
            {"report": report_table(self.kind)},
        )

    def _pair(self, pair: EpipolarPair, surface: Surface) -> Iterator[RasterSpec | Job]:
        """The blocks of a pair."""
        # One chunk of nodes is one block: every block is written by one job, whatever the tile of the project.
        shape, chunk = nodes_shape(pair, self.matching.pairs.step), BLOCK // self.matching.pairs.step
        yield RasterSpec(name=nodes_raster(pair.name), shape=(*shape, 3), dtype="float32", chunk=chunk, nodata=float("nan"))
        yield RasterSpec(name=outcome_raster(pair.name), shape=shape, dtype="uint8", chunk=chunk, nodata=Outcome.NOT_TRIED)
        tables = []
        for tile in tiles_of(shape, chunk):
            tables.append(Table(f"densification/matching/{pair.name}/{tile.row}-{tile.col}.json", MatchingStatistics))
            yield self._block(pair, surface, tile, tables[-1])
        yield Job(self.kind, f"{pair.name}-statistics", sum_matching, {"parts": tuple(tables)}, {"sum": matching_table(pair.name)})

    def _block(self, pair: EpipolarPair, surface: Surface, tile: Tile, table: Table[MatchingStatistics]) -> Job:
        block = PairBlock.over(pair, tile.window, self.matching.pairs.step, surface)
        reads: dict[str, Reading] = {"left": Raster(epipolar_raster(pair.name, "left"), block.left)}
        if not block.right.empty:
            reads["right"] = Raster(epipolar_raster(pair.name, "right"), block.right)
        if not block.cells.empty:
            reads["heights"] = Raster(JUDGED_HEIGHT, block.cells)
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
            {"block": block, "matching": self.matching.pairs},
            row=tile.row,
            col=tile.col,
            scratch=block.scratch(self.matching.pairs),
        )

    def _surface(
        self, view: ProjectView, scene: VolumeScene, pairs: tuple[EpipolarPair, ...]
    ) -> Iterator[RasterSpec | Job | Export]:
        """The tiles of the surface model."""
        grid, crs, size = scene.surface.grid, view.project.crs, view.project.tile
        for name in _HEIGHTS.values():
            yield map_raster(name, grid, "float32", crs, size, nodata=float("nan"), unit="m")
        yield map_raster(COUNT, grid, "uint8", crs, size, unit="pairs")
        yield map_raster(PROVENANCE, grid, "uint8", crs, size)
        tables = []
        for tile in tiles_of(grid.shape, size):
            tables.append(Table(f"densification/cells/{tile.row}-{tile.col}.json", SurfaceStatistics))
            yield self._tile(scene, pairs, tile, tables[-1])
        yield Job(self.kind, "cells", sum_surface, {"parts": tuple(tables)}, {"sum": CELLS})
        yield Export(self.kind, "dsm", "products/dsm.tif", "cog", rasters=_HEIGHTS)
        yield Export(
            self.kind, "provenance", "products/dsm_provenance.tif", "cog", rasters={"provenance": PROVENANCE, "count": COUNT}
        )

    def _tile(self, scene: VolumeScene, pairs: tuple[EpipolarPair, ...], tile: Tile, table: Table[SurfaceStatistics]) -> Job:
        surface = scene.surface
        # The halo makes filters and filling see what they would see in one piece: any tile size gives the same bits.
        around = tile.window.grown(self.rules.halo)
        work = around.clipped(surface.grid.shape)
        pieces = self._pieces(surface, pairs, around)
        nodes = Stream(tuple(Raster(nodes_raster(piece.pair.name), piece.nodes) for piece in pieces))
        outputs = {**_HEIGHTS, "pairs": COUNT, "provenance": PROVENANCE}
        return Job(
            self.kind,
            "surface",
            make_surface,
            {
                "height": Raster(JUDGED_HEIGHT, work),
                "judgement": Raster(JUDGEMENT, work),
                "worth": Raster(WORTH, work),
                "nodes": nodes,
            },
            {
                **{key: Raster(name, tile.window) for key, name in outputs.items()},
                "statistics": table,
                "points": points_table(tile.row, tile.col),
            },
            {
                "tile": SurfaceTile(surface, tile.window, work, pieces, scene.block.ground_mean, scene.levels[-1].step),
                "rules": self.rules,
            },
            row=tile.row,
            col=tile.col,
            scratch=surface_scratch(pieces, work) + points_bytes(tile.window, 2 * len(pieces), self.points),
        )

    def _pieces(self, surface: Surface, pairs: tuple[EpipolarPair, ...], around: Window) -> tuple[PairPiece, ...]:
        # All heights of the surface, not those of the tie points: a tower leans across several tiles of the left image.
        corners, step = box_corners(surface.grid, around, surface.height_low, surface.height_high), self.matching.pairs.step
        pieces = (PairPiece(k, pair, node_window(pair, step, corners), step) for k, pair in enumerate(pairs))
        return tuple(piece for piece in pieces if not piece.nodes.empty)
