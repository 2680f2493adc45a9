"""The jobs of the stage `calibration`: cameras that are known already, and their calibration from chessboards.

One job, except for chessboards: there one job per photograph measures its corners, one job identifies the boards, photographs that
lack boards are searched again, and one job adjusts them all. Chessboard photographs are used as stored, not turned upright: it is
the sensor that is calibrated. Without the stage `photos` the calibration is run alone.
"""

from collections.abc import Callable, Iterator
from typing import Any

from orthomill.schemas.camera import CAMERAS
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import Export, Job, Region, TextFile
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.stage_contract import ProjectView
from orthomill.schemas.stage_report import report_table
from orthomill.tasks.calibration.plan.chessboard_jobs import KIND, chessboard_exports, chessboard_jobs
from orthomill.tasks.calibration.report.known_cameras import KnownCameras, as_given, from_exif, from_file
from orthomill.tasks.calibration.stage import CalibrationStage


def calibration_jobs(asked: CalibrationStage, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
    """One job for cameras that are known already; corners per photograph and an adjustment for chessboards."""
    source = view.project.cameras
    if source.kind != "chessboards":
        _refuse_parameters(asked, source.kind)
    if source.kind == "chessboards":
        yield from chessboard_jobs(asked, view, source)
        yield from chessboard_exports()
    elif source.kind == "file":
        yield _job(from_file, {"text": TextFile(source.path)}, {"path": source.path, "serves": source.serves})
    elif source.kind == "given":
        yield _job(as_given, {}, {"given": source})
    else:
        yield _job(from_exif, {}, {})


def _refuse_parameters(asked: CalibrationStage, kind: str) -> None:
    """Raises WorkflowError for parameters that nothing would estimate."""
    if asked.parameters or asked.model != "automatic":
        what = f"parameters ({', '.join(asked.parameters)})" if asked.parameters else f"model ({asked.model})"
        raise WorkflowError(
            f"The calibration's {what} have no effect with cameras of kind: {kind}, as only "
            "photographs of chessboards estimate them; remove the setting, or calibrate with cameras of kind: chessboards."
        )


def _job(function: Callable[..., KnownCameras], reads: dict[str, Region | tuple[Region, ...]], params: dict[str, Any]) -> Job:
    return Job(
        stage=KIND,
        item="cameras",
        function=function,
        reads={"photos": PHOTOS, **reads},
        writes={"cameras": CAMERAS, "report": report_table(KIND)},
        params=params,
    )
