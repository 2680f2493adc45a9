"""Epipolar images of every useful pair: first the pairs, then their images tile by tile.

A tile reads the window of the photograph that it shows and nothing else, so it can start as soon as those pixels are stored.
"""

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from orthomill.schemas.job import Export, Job
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.settings import setting
from orthomill.schemas.stage_contract import InspectionPart, ProjectView, Stage
from orthomill.tasks.epipolar.pair_choice import PairChoice


class EpipolarStage(Stage):
    """Normal-case images of the useful pairs: axes parallel, base along x, homologous points on one row, distortion removed."""

    title: ClassVar[str] = "Epipolar images"
    inspects: ClassVar[InspectionPart | None] = "surface"

    kind: Literal["epipolar"] = "epipolar"
    pairs: PairChoice = setting(PairChoice(), "Which pairs of photographs are used.")
    height_margin: float = setting(
        0.08, "How far the surface may exceed the heights of the tie points, as a share of the flying height.", ge=0, le=0.5
    )
    height_room: float = setting(
        25.0, "How far crowns and roofs may rise above the highest tie points, which lie mostly on the ground.", "m", ge=0
    )
    level: Literal["auto"] | Annotated[int, Field(ge=0, le=8)] = setting(
        "auto",
        "Level of the photographs that is matched: 0 as they are, 1 at half their size, 2 at a quarter; auto is the finest on "
        "which the rows of the pairs agree, so that photographs which do not fit together to a pixel still give a surface.",
    )
    interpolation: Literal["bicubic", "bilinear"] = setting("bicubic", "How photographs are resampled.")

    images: Literal["all", "none"] = setting(
        "all", "Whether the images are made, or pairs chosen only: the check of a surface from a file needs no more."
    )

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """First the pairs, then their images tile by tile."""
        from orthomill.tasks.epipolar.plan.epipolar_jobs import epipolar_jobs

        return epipolar_jobs(self, view)
