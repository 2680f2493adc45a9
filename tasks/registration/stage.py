"""Stage `registration`: targets of any number of scans, measured by hand or by the scanner, in one adjustment."""

from collections.abc import Iterator
from typing import ClassVar, Literal

from orthomill.schemas.job import Export, Job
from orthomill.schemas.project_paths import ProjectPath
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.settings import setting
from orthomill.schemas.stage_contract import ProjectView, Stage


class RegistrationStage(Stage):
    """Joint registration of scans: a rotation and a translation of each, from control and the targets that they share."""

    title: ClassVar[str] = "Registration of scans"
    provides: ClassVar[frozenset[str]] = frozenset({"scans"})
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
        """One adjustment of all scans, and its products."""
        from orthomill.tasks.registration.plan.registration_jobs import registration_jobs

        return registration_jobs(self)
