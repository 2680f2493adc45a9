"""The jobs of the stage `registration`: one adjustment, its report and its products."""

from collections.abc import Iterator

from orthomill.schemas.job import Export, Job, Reading, TextFile
from orthomill.schemas.observations import REGISTERED_POINTS
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.stage_report import report_table
from orthomill.tasks.registration.registered_scans import REGISTERED_SCANS, TARGET_RESIDUALS, register_scans
from orthomill.tasks.registration.report.registration_report import report
from orthomill.tasks.registration.stage import RegistrationStage


def registration_jobs(asked: RegistrationStage) -> Iterator[RasterSpec | Job | Export]:
    """One adjustment of all scans, its report and its products."""
    reads: dict[str, Reading] = {"texts": tuple(map(TextFile, asked.paths))}
    # Optional, and then a parameter of the function with a default.
    if asked.points:
        reads["surveyed"] = TextFile(asked.points)
    yield Job(
        stage="registration",
        item="scans",
        function=register_scans,
        reads=reads,
        writes={"scans": REGISTERED_SCANS, "points": REGISTERED_POINTS, "residuals": TARGET_RESIDUALS},
        params={"paths": asked.paths, "sigma": asked.sigma, "rejection": asked.rejection},
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
