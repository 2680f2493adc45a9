"""The stage `accuracy`: what is stated of the products, and on what evidence."""

from collections.abc import Iterator
from typing import ClassVar, Literal

from orthomill.schemas.accuracy.accuracy_statement import STATEMENT
from orthomill.schemas.accuracy.adjustment_statement import (
    ADJUSTMENT_STATEMENT,
    EXTERIOR_PRECISION,
    INTERIOR_CORRELATION,
    SURVEYED_RELIABILITY,
)
from orthomill.schemas.accuracy.point_tests import POINT_TESTS
from orthomill.schemas.accuracy.promised_errors import RELIABILITY
from orthomill.schemas.job import Export, Job, Table
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.settings import setting
from orthomill.schemas.stage_contract import ProjectView, Stage
from orthomill.schemas.stage_report import report_table

_FILES: dict[str, Table] = {
    "accuracy": STATEMENT,
    "accuracy_points": POINT_TESTS,
    "reliability": RELIABILITY,
    "adjustment": ADJUSTMENT_STATEMENT,
}
_TABLES: dict[str, Table] = {
    "exterior_precision": EXTERIOR_PRECISION,
    "interior_correlation": INTERIOR_CORRELATION,
    "surveyed_reliability": SURVEYED_RELIABILITY,
}


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
        from orthomill.tasks.accuracy.plan.point_jobs import PointJobs
        from orthomill.tasks.accuracy.report.accuracy_report import accuracy_report

        yield from PointJobs(view, self.steepest, self.vegetated).jobs()
        yield Job(
            stage="accuracy",
            item="report",
            function=accuracy_report,
            reads={"tests": POINT_TESTS, "statement": STATEMENT, "reliability": RELIABILITY, "adjustment": ADJUSTMENT_STATEMENT},
            writes={"report": report_table("accuracy")},
        )
        # Jobs and exports share their names: a file is called after its table and its kind.
        for name, table in _FILES.items():
            yield Export("accuracy", f"{name}_json", f"products/{name}.json", "json", tables=(table,))
        for name, columns in _TABLES.items():
            yield Export("accuracy", f"{name}_csv", f"products/{name}.csv", "csv", tables=(columns,))
