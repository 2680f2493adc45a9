"""The stage `calibration`: the interior orientation of every camera of the project."""

from collections.abc import Iterator
from typing import ClassVar, Literal

from orthomill.schemas.job import Export, Job
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.settings import setting
from orthomill.schemas.stage_contract import InspectionPart, ProjectView, Stage

Parameter = Literal["c", "x0", "y0", "k1", "k2", "k3", "p1", "p2", "affinity", "skew", "k4", "k5", "k6", "s1", "s2", "s3", "s4"]
LensChoice = Literal["automatic", "brown", "rational", "thin_prism", "fisheye", "division"]


class CalibrationStage(Stage):
    """Determines the interior orientation from the source that the project names."""

    title: ClassVar[str] = "Interior orientation"
    inspects: ClassVar[InspectionPart | None] = "cameras"
    kind: Literal["calibration"] = "calibration"
    parameters: tuple[Parameter, ...] = setting(
        (),
        "Interior parameters to estimate from chessboards, the others being zero; empty: those that held-out photographs support.",
    )
    model: LensChoice = setting(
        "automatic",
        "Model of the lens that is calibrated from chessboards; automatic: the one that fits all corners of held-out photographs "
        "best (Brown's where it is as good as any, and for stated parameters).",
    )

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """Cameras from the source that the project names."""
        from orthomill.tasks.calibration.plan.calibration_jobs import calibration_jobs

        return calibration_jobs(self, view)
