"""The stage `evaluation`: surface model, orthoimage and orientation against the truth of a simulation or against files."""

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from orthomill.schemas.job import Job
from orthomill.schemas.project_paths import ProjectMap, ProjectPath
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.settings import Settings, setting
from orthomill.schemas.stage_contract import ProjectView, Stage


class TruthReference(Settings):
    """The truth of a simulated scene."""

    kind: Literal["truth"] = "truth"


class FileReference(Settings):
    """Georeferenced raster files or points from another source."""

    kind: Literal["file"]
    dsm: ProjectMap | None = setting(
        None, "Raster file with heights, relative to the project's root; in metres or in what its system or its band says."
    )
    ortho: ProjectMap | None = setting(None, "RGB raster file, relative to the project's root.")
    points: ProjectPath | None = setting(
        None,
        "Points of known height, relative to the project's root: a table with x, y, z in the project's system and, where it is "
        "known, sigma_z (CSV, text), a point cloud in any system that it names, with an attribute sigma_z where there is one (LAZ, "
        "LAS), or vertices in the project's system (PLY).",
    )
    sigma: float = setting(
        0.0,
        "Standard error of the reference's heights, of points where their file states none: shares within standard errors are "
        "those of the differences.",
        "m",
        ge=0,
    )


class NoReference(Settings):
    """There is no reference."""

    kind: Literal["none"]


class EvaluationStage(Stage):
    """Surface model, orthoimage and orientation against truth or a reference: figures, maps, and shares within n sigma."""

    title: ClassVar[str] = "Accuracy evaluation"
    for_own_photographs: ClassVar[bool] = False

    kind: Literal["evaluation"] = "evaluation"
    reference: Annotated[TruthReference | FileReference | NoReference, Field(discriminator="kind")] = setting(
        TruthReference(), "What the results are compared with."
    )
    parallax_sigma: float = setting(
        0.5,
        "Error of a parallax from which the expected precision of heights is computed: (H/B) times the ground pixel times this.",
        "px",
        gt=0,
    )

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job]:
        """The comparisons that the reference and the stages of the workflow allow. Raises WorkflowError where there is no truth."""
        from orthomill.tasks.evaluation.plan.evaluation_jobs import evaluation_jobs

        return evaluation_jobs(self, view)
