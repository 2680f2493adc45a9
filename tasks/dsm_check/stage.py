"""The stage `dsm_check`: how the surface is checked without reference data, in one pass or in several."""

from collections.abc import Iterator
from typing import ClassVar, Literal

from orthomill.schemas.job import Export, Job
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.settings import Settings, setting
from orthomill.schemas.stage_contract import InspectionPart, ProjectView, Stage
from orthomill.tasks.dsm_check.comparison_settings import NodeMatching
from orthomill.tasks.dsm_check.height_correction import Correction, RayCorrection
from orthomill.tasks.dsm_check.surfaces.checked_surface import CheckedSurface, DensifiedSurface, SurfaceFile

_FILE_ROUNDS, _FILE_LEVELS = 4, 3


class CloserLook(Settings):
    """How places are compared that an earlier round corrected: smaller windows, nodes closer together."""

    window: int = setting(7, "Side of the least-squares window.", "orthoimage pixels", ge=5, le=31)
    search_window: int = setting(7, "Side of the correlation window on orthoimages of half the size.", "px", ge=5, le=31)
    step: Literal[2, 4, 8] = setting(2, "Distance of the nodes.", "cells")


class DsmCheckStage(Stage):
    """Two orthoimages made with the surface must agree; where they do not, their shift gives the error of the height."""

    title: ClassVar[str] = "Surface model check"
    inspects: ClassVar[InspectionPart | None] = "surface"

    kind: Literal["dsm_check"] = "dsm_check"
    surface: CheckedSurface = setting(DensifiedSurface(), "The surface that is checked.")
    pairs: int | None = setting(None, "Pairs that check the surface, at most; null: as many as `pairs_per_place` needs.", ge=1)
    pairs_per_place: int = setting(1, "Pairs that check every place, if as many see it: one sees what another hides.", ge=1, le=12)
    pixels_per_cell: int | None = setting(
        None, "Pixels of orthoimage along a cell, 1 or 2; null: 2 where cells are coarser than the photographs.", ge=1, le=2
    )
    step: Literal[2, 4, 8, 16] = setting(4, "Distance of the nodes where the orthoimages are compared.", "cells")
    matching: NodeMatching = setting(NodeMatching(), "How the orthoimages are compared.")
    correction: Correction = setting(RayCorrection(), "How a shift becomes a height.")
    radius: float = setting(1.5, "How far the correction of a node reaches.", "steps", ge=1.25, le=8)
    apply: Literal["all", "significant", "none"] = setting(
        "significant", "Which corrections are added to the surface; below their own standard error they would add noise."
    )
    # Of a million cells three or four standard errors are exceeded by thousands without any error of the surface.
    significance: float = setting(5.0, "A correction of this many of its standard errors is significant.", "sigma", ge=1, le=10)
    levels: int | None = setting(
        None,
        "How often the orthoimages are halved, at most, for a second surface that shows large, steep and narrow errors; null: 3 "
        "times for a surface from a file, never for the one that this project measured.",
        ge=0,
        le=5,
    )
    rounds: int | None = setting(
        None,
        "How often the surface is checked, at most: again where it was corrected, until nothing more is asked for; null: 4 "
        "times for a "
        "surface from a file, once for the one that this project measured.",
        ge=1,
        le=12,
    )
    tolerance: float | None = setting(
        None,
        "Greatest error of a height that the survey allows; the report then tells which share of the surface is proved to keep it, "
        "breaks it, or stays undecided.",
        "m",
        gt=0,
    )
    closer: CloserLook = setting(CloserLook(), "How later rounds compare the orthoimages.")

    @property
    def once(self) -> bool:
        """Whether one pass over the surface is the whole check."""
        return self.most_rounds == 1 and self.most_levels == 0 and not isinstance(self.surface, SurfaceFile)

    @property
    def most_rounds(self) -> int:
        """How often the surface is checked, at most."""
        if self.correction.kind == "norvelle":
            return self.correction.rounds
        return self.rounds or (_FILE_ROUNDS if isinstance(self.surface, SurfaceFile) else 1)

    @property
    def most_levels(self) -> int:
        """How often the orthoimages are halved, at most, for a second surface."""
        return self.levels if self.levels is not None else (_FILE_LEVELS if isinstance(self.surface, SurfaceFile) else 0)

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """The pairs that check the surface, one pass or several over it, and the answer."""
        from orthomill.tasks.dsm_check.plan.check_jobs import check_jobs

        return check_jobs(self, view)
