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

from orthomill.schemas.job import Export, Job
from orthomill.schemas.project_paths import ProjectPath
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.settings import Settings, refuse_ignored, setting
from orthomill.schemas.stage_contract import InspectionPart, ProjectView, Stage
from orthomill.tasks.densification.settings.guide_settings import ConfidenceLimits, Guide, TiePointGuide
from orthomill.tasks.densification.settings.guided_matching import Guided
from orthomill.tasks.densification.settings.line_locus_settings import LineLocus
from orthomill.tasks.densification.settings.pair_strategy_settings import Cascade, CoarseToFine, Growing
from orthomill.tasks.densification.settings.surface_settings import (
    Completion,
    EstimateGaps,
    Filling,
    Fusion,
    Gridding,
    PointThinning,
    SpikeFilter,
)
from orthomill.tasks.matching.dense.dense_settings import DenseMatching
from orthomill.tasks.matching.volume.volume_settings import HeightVolume


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


class DensificationStage(Stage):
    """A surface model with a precision for every height, from matching of the photographs."""

    title: ClassVar[str] = "Dense matching and surface model"
    inspects: ClassVar[InspectionPart | None] = "filling"

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
    water: ProjectPath | None = setting(
        None, "Outlines of still water: polygons (GeoPackage, GeoJSON); each gets one level, that of its shore."
    )

    @model_validator(mode="after")
    def _water_has_an_effect(self) -> "DensificationStage":
        if not isinstance(self.matching, ObjectSpace):
            refuse_ignored(self, ("water",), f"matching: {{kind: {self.matching.kind}}}", "match in object space, or leave it out")
        return self

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """The jobs of the method that is asked for."""
        from orthomill.tasks.densification.plan.densification_jobs import densification_jobs

        return densification_jobs(self, view)
