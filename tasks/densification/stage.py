"""The stage `densification`: heights by one of several methods, then the surface tile by tile.

By default a volume of heights over all photographs is solved level by level, tile by tile; a block of a pair is matched as soon as
its epipolar tiles and the volume under it are there, and a tile of the surface follows as soon as the blocks that may show it are
matched. Vertical line locus finds the heights in blocks of cells and needs neither volume nor epipolar images. The strategies of
pairs need no volume: pyramids, region growing and the cascade match every pair by itself, guided densification all of them near
one height model that grows from level to level.
"""

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from orthomill.schemas.epipolar import PAIRS, EpipolarPair
from orthomill.schemas.job import Export, Job, Reading
from orthomill.schemas.observations import GROUND_POINTS
from orthomill.schemas.orientation import BLOCK as BLOCK_TABLE
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.settings import Settings, refuse_ignored, setting
from orthomill.schemas.stage_contract import ProjectView, Stage
from orthomill.schemas.stage_report import report_table
from orthomill.schemas.surface import SURFACE, Surface
from orthomill.tasks.densification.completion import Completion
from orthomill.tasks.densification.filling import EstimateGaps, Filling
from orthomill.tasks.densification.fusion import Fusion
from orthomill.tasks.densification.gridding import Gridding
from orthomill.tasks.densification.guided.guided_matching import Guided
from orthomill.tasks.densification.guided.guided_plan import GuidedPlan, level_table
from orthomill.tasks.densification.guided.guided_report import guided_report
from orthomill.tasks.densification.line_locus.locus_block import LineLocus, LocusScene
from orthomill.tasks.densification.line_locus.locus_plan import LINE_NODES, LINE_OUTCOME, LINE_PHOTOGRAPHS, LINES, locus_plan
from orthomill.tasks.densification.line_locus.locus_surface import make_line_surface
from orthomill.tasks.densification.planning.pair_plan import matching_table, pair_plan
from orthomill.tasks.densification.planning.surface_plan import CELLS, SurfacePlan, SurfaceSource
from orthomill.tasks.densification.points import PointThinning
from orthomill.tasks.densification.report import line_report, report
from orthomill.tasks.densification.spike_filter import SpikeFilter
from orthomill.tasks.densification.strategies.near_model import model_plan
from orthomill.tasks.densification.strategies.pair_strategies import Cascade, CoarseToFine, Growing, PairStrategy
from orthomill.tasks.densification.strategies.strategy_block import make_pair_surface
from orthomill.tasks.densification.strategies.strategy_plan import strategy_plan
from orthomill.tasks.densification.surface_grid import surface_of, window_cells
from orthomill.tasks.densification.surface_tile import SurfaceRules, make_surface
from orthomill.tasks.densification.volume.confidence import ConfidenceLimits
from orthomill.tasks.densification.volume.guide_heights import Guide, GuideFile, TiePointGuide
from orthomill.tasks.densification.volume.levels import VolumeScene
from orthomill.tasks.densification.volume.volume_plan import CONFIDENCE, JUDGED_HEIGHT, JUDGEMENT, volume_plan
from orthomill.tasks.matching.dense.blocks import DenseMatching
from orthomill.tasks.matching.volume.height_volume import HeightVolume


class ObjectSpace(Settings):
    """Semi-global matching of all photographs together in a volume of heights, then least-squares matching of every pair near
    it."""

    renamed: ClassVar = {"sure": "confidence"}  # 0.2
    kind: Literal["object_space"] = "object_space"
    volume: HeightVolume = setting(HeightVolume(), "The volume of heights over all photographs.")
    confidence: ConfidenceLimits = setting(ConfidenceLimits(), "When a height of the volume counts as measured.")
    pairs: DenseMatching = setting(DenseMatching(), "Dense matching of a pair.")
    guide: Guide = setting(TiePointGuide(), "What bounds the heights that are looked for; with tie points, the range of the block.")
    reach: Literal["auto"] | Annotated[float, Field(gt=0)] = setting(
        "auto", "How far from an existing model they are looked for; auto is twice as far as tie points lie from it.", "m"
    )

    @model_validator(mode="after")
    def _reach_has_an_effect(self) -> "ObjectSpace":
        if isinstance(self.guide, TiePointGuide):
            refuse_ignored(self, ("reach",), "guide: {kind: tie_points}", "name a file, or leave it out")
        return self


class VerticalLineLocus(LineLocus):
    """Vertical line locus: on the vertical line of every cell the height at which the photographs are most alike."""

    kind: Literal["vertical_line_locus"]


Matching = Annotated[ObjectSpace | VerticalLineLocus | Guided | CoarseToFine | Growing | Cascade, Field(discriminator="kind")]
_Plan = Iterator[RasterSpec | Job | Export]


class DensificationStage(Stage):
    """A surface model with a precision for every height, from matching of the photographs."""

    title: ClassVar[str] = "Dense matching and surface model"

    kind: Literal["densification"] = "densification"
    cell: Literal["auto"] | Annotated[float, Field(gt=0)] = setting(
        "auto", "Cell size; auto is a round number near 1.5 ground pixels of the level that is matched.", "m"
    )
    matching: Matching = setting(ObjectSpace(), "How heights are measured.")
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

    def plan(self, view: ProjectView) -> _Plan:
        cell = None if self.cell == "auto" else self.cell
        reads: dict[str, Reading] = {"block": BLOCK_TABLE, "pairs": PAIRS, "points": GROUND_POINTS}
        yield Job(
            stage=self.kind, item="grid", function=surface_of, reads=reads, writes={"surface": SURFACE}, params={"cell": cell}
        )
        surface = view.table(SURFACE)
        if isinstance(self.matching, VerticalLineLocus):
            yield from self._lines(view, surface, self.matching)
        elif isinstance(self.matching, Guided):
            yield from self._guided(view, surface, self.matching)
        elif isinstance(self.matching, PairStrategy):
            yield from self._pairs_alone(view, surface, self.matching)
        else:
            yield from self._object_space(view, surface, self.matching)

    def _tiles(self, view: ProjectView) -> SurfacePlan:
        return SurfacePlan(self.kind, view.table(BLOCK_TABLE).crs, view.project.tile, self.rules)

    def _object_space(self, view: ProjectView, surface: Surface, matching: ObjectSpace) -> _Plan:
        """The volume, the pairs near it, and the surface from both."""
        pairs = view.table(PAIRS).pairs
        reach = None if matching.reach == "auto" else float(matching.reach)
        scene = VolumeScene(view.table(BLOCK_TABLE), view.table(PHOTOS), surface, matching.volume, matching.guide, reach)
        yield from volume_plan(scene, matching.confidence, self.kind, view.table(BLOCK_TABLE).crs)
        for pair in pairs:
            yield from pair_plan(pair, surface, matching.pairs, self.kind)
        volume = {"height": JUDGED_HEIGHT, "judgement": JUDGEMENT, "confidence": CONFIDENCE}
        source = SurfaceSource(make_surface, volume, surface, scene.block.ground_mean, scene.levels[-1].step, matching.pairs.step)
        yield from self._tiles(view).jobs(source, pairs)
        yield self._report_of_pairs(pairs)

    def _pairs_alone(self, view: ProjectView, surface: Surface, matching: PairStrategy) -> _Plan:
        """The pairs, each by a strategy of its own, and the surface from their nodes."""
        pairs, ground = view.table(PAIRS).pairs, view.table(BLOCK_TABLE).ground_mean
        if isinstance(matching.guide, GuideFile):
            yield from model_plan(matching.guide, surface, self.kind, view.table(BLOCK_TABLE).crs)
        for pair in pairs:
            yield from strategy_plan(pair, matching, surface, self.kind)
        window = window_cells(matching.window, pairs, surface)
        yield from self._tiles(view).jobs(
            SurfaceSource(
                function=make_pair_surface,
                rasters={},
                surface=surface,
                ground=ground,
                step=0.0,
                node_step=matching.step,
                window_cells=window,
            ),
            pairs,
        )
        yield self._report_of_pairs(pairs)

    def _guided(self, view: ProjectView, surface: Surface, matching: Guided) -> _Plan:
        """The levels of points, every pixel of the pairs, and the surface from these."""
        pairs, ground = view.table(PAIRS).pairs, view.table(BLOCK_TABLE).ground_mean
        yield from GuidedPlan(self.kind, view.table(BLOCK_TABLE).crs, surface, pairs, matching).jobs()
        window = window_cells(matching.pixels.correlation.template, pairs, surface)
        source = SurfaceSource(
            function=make_pair_surface,
            rasters={},
            surface=surface,
            ground=ground,
            step=0.0,
            node_step=matching.pixels.step,
            window_cells=window,
        )
        yield from self._tiles(view).jobs(source, pairs)
        reads = {**_read_of_pairs(pairs), "levels": tuple(level_table(level.number) for level in matching.levels)}
        yield Job(
            stage=self.kind,
            item="report",
            function=guided_report,
            reads=reads,
            writes={"report": report_table(self.kind)},
            params={"settings": matching},
        )

    def _report_of_pairs(self, pairs: tuple[EpipolarPair, ...]) -> Job:
        return Job(
            stage=self.kind, item="report", function=report, reads=_read_of_pairs(pairs), writes={"report": report_table(self.kind)}
        )

    def _lines(self, view: ProjectView, surface: Surface, matching: VerticalLineLocus) -> _Plan:
        """Blocks of vertical lines, and the surface from them."""
        scene = LocusScene(view.table(BLOCK_TABLE), view.table(PHOTOS), surface, matching)
        yield from locus_plan(scene, self.kind, view.table(BLOCK_TABLE).crs)
        lines = {"nodes": LINE_NODES, "photographs": LINE_PHOTOGRAPHS, "outcome": LINE_OUTCOME}
        source = SurfaceSource(
            function=make_line_surface,
            rasters=lines,
            surface=surface,
            ground=scene.block.ground_mean,
            step=scene.metres_per_pixel,
            node_step=1,
            window_cells=scene.window_cells,
            reads_nodes=False,
        )
        yield from self._tiles(view).jobs(source, view.table(PAIRS).pairs)
        reads: dict[str, Reading] = {"surface": SURFACE, "lines": LINES, "cells": CELLS}
        yield Job(stage=self.kind, item="report", function=line_report, reads=reads, writes={"report": report_table(self.kind)})


def _read_of_pairs(pairs: tuple[EpipolarPair, ...]) -> dict[str, Reading]:
    """What the report of surfaces from pairs reads."""
    statistics = tuple(matching_table(pair.name) for pair in pairs)
    return {"pairs": PAIRS, "surface": SURFACE, "matching": statistics, "cells": CELLS}
