"""The stage `accuracy`: what is stated of the products, and on what evidence."""

from collections.abc import Iterator
from typing import ClassVar, Literal

from orthomill.schemas.accuracy.accuracy_statement import STATEMENT
from orthomill.schemas.accuracy.point_tests import POINT_TESTS
from orthomill.schemas.job import Export, Job
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.settings import setting
from orthomill.schemas.stage_contract import ProjectView, Stage
from orthomill.schemas.stage_report import report_table
from orthomill.tasks.accuracy.plan.point_jobs import PointJobs
from orthomill.tasks.accuracy.report.accuracy_report import accuracy_report


class AccuracyStage(Stage):
    """Products tested at check points that took no part in them; classes and wording as ASPRS edition 2 prescribes."""

    title: ClassVar[str] = "Stated accuracy"

    kind: Literal["accuracy"] = "accuracy"
    steepest: float = setting(
        0.1, "Slope of the ground, rise over run, up to which heights are tested at a point; 0.1 as in the standard.", gt=0, le=2
    )
    vegetated: tuple[str, ...] = setting(
        (), "Check points under vegetation, by name or shell pattern; they are stated apart (VVA) from those on open ground (NVA)."
    )

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """A test of each point, the statement, the report, and the statement as a file."""
        yield from PointJobs(view, self.steepest, self.vegetated).jobs()
        yield Job(
            stage="accuracy",
            item="report",
            function=accuracy_report,
            reads={"tests": POINT_TESTS, "statement": STATEMENT},
            writes={"report": report_table("accuracy")},
        )
        yield Export("accuracy", "statement_json", "products/accuracy.json", "json", tables=(STATEMENT,))
