"""Stage `registration`: targets of any number of scans, measured by hand or by the scanner, in one adjustment."""

from collections.abc import Iterator
from typing import ClassVar, Literal

from orthomill.schemas.job import Export, Job, Reading, TextFile
from orthomill.schemas.observations import REGISTERED_POINTS
from orthomill.schemas.project_paths import ProjectPath
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.settings import setting
from orthomill.schemas.stage_contract import ProjectView, Stage
from orthomill.schemas.stage_report import report_table
from orthomill.tasks.registration.registered_scans import REGISTERED_SCANS, TARGET_RESIDUALS, register_scans
from orthomill.tasks.registration.report import report


class RegistrationStage(Stage):
    """Joint registration of scans: a rotation and a translation of each, from control and the targets that they share."""

    title: ClassVar[str] = "Registration of scans"
    kind: Literal["registration"] = "registration"
    paths: tuple[ProjectPath, ...] = setting(
        ...,
        "Targets of the scans, a CSV file for each scan with the columns name, x, y, z in metres of the scan's own system, and "
        "optionally sigma; a scan is called by its file.",
        min_length=2,
    )
    points: ProjectPath | None = setting(
        None,
        "CSV of surveyed targets in the project's system with the columns name, role (control or check), x, y, z, sigma_x, "
        "sigma_y, sigma_z; without it the first scan defines the system.",
    )
    sigma: float = setting(
        0.003, "Standard error of each coordinate of a target in a scan whose file does not tell it.", "m", gt=0, le=1
    )
    rejection: float = setting(4.0, "Targets with a larger standardised misfit are rejected.", "standard errors", ge=2.5)

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        reads: dict[str, Reading] = {"texts": tuple(map(TextFile, self.paths))}
        # Optional, and then a parameter of the function with a default.
        if self.points:
            reads["surveyed"] = TextFile(self.points)
        yield Job(
            stage="registration",
            item="scans",
            function=register_scans,
            reads=reads,
            writes={"scans": REGISTERED_SCANS, "points": REGISTERED_POINTS, "residuals": TARGET_RESIDUALS},
            params={"paths": self.paths, "sigma": self.sigma, "rejection": self.rejection},
        )
        yield Job(
            stage="registration",
            item="report",
            function=report,
            reads={"scans": REGISTERED_SCANS, "points": REGISTERED_POINTS, "residuals": TARGET_RESIDUALS},
            writes={"report": report_table("registration")},
        )
        yield Export("registration", "scans_json", "products/scans.json", "json", tables=(REGISTERED_SCANS,))
        yield Export("registration", "points_csv", "products/registered_points.csv", "csv", tables=(REGISTERED_POINTS,))
        yield Export("registration", "residuals_csv", "products/scan_residuals.csv", "csv", tables=(TARGET_RESIDUALS,))
