"""The stage `texture`: a true orthoimage, blended from every photograph that sees the ground."""

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from orthomill.schemas.job import Export, Job
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.settings import Settings, setting
from orthomill.schemas.stage_contract import InspectionPart, ProjectView, Stage
from orthomill.tasks.colouring.colour_settings import ColourSettings


class LeaveHoles(Settings):
    """No texture where the surface model has no height."""

    kind: Literal["leave"]


class DrapeHoles(Settings):
    """Holes get an interpolated height for the texture only; `texture/height_source` marks them."""

    kind: Literal["drape"] = "drape"
    max_gap: Annotated[float, Field(gt=0)] | Literal["unlimited"] = setting(
        "unlimited", "Largest distance to a height of the surface model. unlimited: wherever a photo sees the ground.", "m"
    )


class KeepEdges(Settings):
    """Every pixel lies on the surface model, whose cells blur walls."""

    kind: Literal["keep"]


class SharpenEdges(Settings):
    """Near walls every pixel lies on the upper or the lower surface, whichever the photographs show there."""

    kind: Literal["sharpen"] = "sharpen"


Holes = Annotated[LeaveHoles | DrapeHoles, Field(discriminator="kind")]
Edges = Annotated[KeepEdges | SharpenEdges, Field(discriminator="kind")]


class TextureStage(ColourSettings, Stage):
    """Colours every ground cell from all photos that actually see it: a true orthoimage."""

    title: ClassVar[str] = "True orthoimage"
    inspects: ClassVar[InspectionPart | None] = "orthoimage"

    kind: Literal["texture"] = "texture"
    cell: Annotated[float, Field(gt=0)] | Literal["auto"] = setting(
        "auto",
        "Pixel of the orthoimage; must divide the cell of the surface model. auto: about the ground pixel of the photos.",
        "m",
    )
    holes: Holes = setting(DrapeHoles(), "What happens where the surface model has no height.")
    edges: Edges = setting(SharpenEdges(), "On which surface a pixel near a wall lies.")
    best: int = setting(0, "Number of photos of the greatest weight that are blended; 0 for all.", ge=0, le=64)
    occlusion_margin: float = setting(
        1.0, "Cells of the surface model next to an occlusion whose colour is used only if there is no other.", "cells", ge=0, le=32
    )
    occlusion_ramp: float = setting(
        2.0, "Width beyond the margin in which the weight rises to its full value.", "cells", ge=0, le=32
    )
    tolerance: Annotated[float, Field(ge=0)] | Literal["auto"] = setting(
        "auto", "How deep a ray may dip below the surface before it counts as hidden. auto: half a cell of the surface model.", "m"
    )
    bridge: int = setting(
        24, "Holes are bridged for the visibility test from heights at most this far away.", "cells", ge=0, le=256
    )

    @model_validator(mode="after")
    def _has_an_effect(self) -> "TextureStage":
        """Raises ValueError for settings that the others leave without effect."""
        if self.two_colours.kind == "prefer" and self.best == 1:
            raise ValueError(
                "two_colours: prefer without effect with best: 1, which always uses the one colour of the greatest weight: remove "
                "two_colours, or set best to 0 or to 2 and more"
            )
        return self

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """Samples of all tiles, the balance of the block, then the tiles of the orthoimage."""
        from orthomill.tasks.texture.plan.orthoimage_jobs import OrthoimageJobs
        from orthomill.tasks.texture.plan.texture_rules import texture_rules

        jobs = OrthoimageJobs(view, self, None if self.cell == "auto" else self.cell, self.holes.kind == "drape")
        return jobs.all(texture_rules(self, jobs.surface))
