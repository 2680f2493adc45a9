"""The stage `projection`: a solid surface on maps, walls, cylinders and views, coloured from every photograph that sees it."""

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from orthomill.schemas.job import Export, Job
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.settings import Settings, setting
from orthomill.schemas.stage_contract import ProjectView, Stage
from orthomill.tasks.colouring.colour_settings import AverageTwo, ColourSettings, PreferUnbroken
from orthomill.tasks.projection.lines.section_line import SectionLine
from orthomill.tasks.projection.outputs import MapOutput, Output
from orthomill.tasks.projection.photographs.chosen_photographs import BorderMasks, LeaveOneOut, LeavingOut, Masks
from orthomill.tasks.projection.surface_source import SolidSurface


class NoWidening(Settings):
    """Colours are used up to the very limit of what is hidden."""

    kind: Literal["none"]


class WidenLimits(Settings):
    """Next to the limits of what a photograph does not see its colours serve only where there are no others."""

    kind: Literal["limits"] = "limits"
    window: int = setting(
        2, "Side of the window that opens what is hidden: specks smaller than it have no limits.", "px", ge=1, le=31
    )
    speck: int = setting(12, "Hidden specks of fewer pixels of the output are ignored.", "px", ge=0, le=10_000)
    dilation: Annotated[float, Field(ge=0, le=200)] | Literal["auto"] = setting(
        "auto",
        "Width of the zone in the photographs, on either side: the precision of mesh and orientation there. auto: the one of 1, 2, "
        "3, 5 px whose colours are nearest to those of photographs that are left out there; none where none is better.",
        "px",
    )


class SightSettings(Settings):
    """How exactly a photograph must show a place to see it, in its own pixels on the surface."""

    depth: float = setting(1.0, "How deep a ray may dip into another triangle before it counts as hidden.", "px", ge=0)
    rough: float = setting(3.0, "The same where triangles are smaller than a pixel, so that none is met exactly.", "px", ge=0)
    break_at: float = setting(20.0, "Difference of neighbouring depths from which one hides the other.", "px", gt=0)


class NoModel(Settings):
    """No coloured mesh is made."""

    kind: Literal["none"]


class TexturedModel(Settings):
    """The mesh with a texture for each part of it, from every photograph that sees it; coarser levels where it is large."""

    kind: Literal["tiles"] = "tiles"
    texel: Annotated[float, Field(gt=0)] | Literal["auto"] = setting(
        "auto", "Side of a texel. auto: that of a pixel of the photographs on the surface.", "m"
    )
    side: int = setting(
        2048,
        "Longest side of a texture; where it does not suffice for 16384 triangles, their texels are larger.",
        "px",
        ge=64,
        le=8192,
    )


TwoValues = Annotated[AverageTwo | PreferUnbroken, Field(discriminator="kind")]
Widening = Annotated[NoWidening | WidenLimits, Field(discriminator="kind")]
Model = Annotated[NoModel | TexturedModel, Field(discriminator="kind")]


class ProjectionStage(ColourSettings, Stage):
    """Projects a triangle mesh onto maps, walls, cylinders and views, each pixel coloured from all photos that really see it."""

    title: ClassVar[str] = "Projections of the surface"

    kind: Literal["projection"] = "projection"
    surface: SolidSurface = setting(..., "The surface.")
    outputs: tuple[Output, ...] = setting((MapOutput(),), "What it is projected onto.", min_length=1)
    without: tuple[str, ...] = setting((), "Shell patterns of names of photographs that take no part.")
    masks: Masks = setting(BorderMasks(), "Parts of the photographs that are not used.")
    sight: SightSettings = setting(SightSettings(), "How exactly the visibility is tested.")
    two_colours: TwoValues = setting(PreferUnbroken(), "What happens where exactly two photos see the surface and disagree.")
    widening: Widening = setting(WidenLimits(), "What happens next to the limits of what is hidden.")
    best: Annotated[int, Field(ge=0, le=64)] | Literal["auto"] = setting(
        "auto",
        "Number of photos of the greatest weight that are blended; 0 for all. auto: those whose pixels on the surface are not much "
        "larger than the finest ones; the others fade out and only help to find gross errors.",
    )
    section_lines: tuple[SectionLine, ...] = setting((), "Planes whose lines of intersection with the surface are drawn.")
    model: Model = setting(TexturedModel(), "The coloured mesh to take away.")
    depth_pictures: bool = setting(True, "Whether the depths of photos and outputs are also saved as pictures.")
    leave_one_out: LeavingOut = setting(LeaveOneOut(), "Whether the photos are made again from each other, as a proof.")

    @model_validator(mode="after")
    def _names_differ(self) -> "ProjectionStage":
        names = [output.name for output in self.outputs]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"outputs: {', '.join(twice)} is the name of several outputs; give each its own")
        return self

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """The mesh, depth rasters, sight and balance, then the tiles of the outputs, the coloured mesh and the proof."""
        from orthomill.tasks.projection.plan.projection_jobs import projection_jobs

        return projection_jobs(self, view)
