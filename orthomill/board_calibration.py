"""Calibration from photographs of chessboards without a project."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from orthomill.schemas.camera import Camera
from orthomill.schemas.project import ANY_CRS, CameraFromChessboards, Project
from orthomill.schemas.stage_report import StageReport, report_table
from orthomill.tasks.calibration.board_tables import CALIBRATION, CAMERA_FILE, RESIDUALS, Calibration, CornerResiduals
from orthomill.tasks.calibration.stage import CalibrationStage
from orthomill.temporary_run import Progress, photo_list, temporary_run


@dataclass(frozen=True)
class BoardCalibration:
    """A camera calibrated from photographs of chessboards."""

    camera: Camera
    """interior orientation with covariance, px"""
    calibration: Calibration
    """poses of photographs and boards, what took part, the choice of the model"""
    residuals: CornerResiduals
    """of every corner, px"""
    report: StageReport
    """figures, charts and warnings as in the report of a project"""


def calibrate(
    photographs: str | Path | Sequence[str | Path],
    *,
    corners: tuple[int, int],
    square: float,
    boards: int = 0,
    arrangement: Literal["plane", "space"] = "plane",
    stage: CalibrationStage | None = None,
    progress: Progress | None = None,
) -> BoardCalibration:
    """Calibrate a camera from photographs of chessboards: a folder, or a list of image files.

    corners: inner corners of a board, columns and rows. square: side of a square, m. boards: number of equal boards in the scene;
    0 for as many as the photographs show. arrangement: whether they lie on one plane or anywhere in space; their positions need not
    be known. stage: the stage with settings other than its defaults. progress: see `orthomill.orient`.

    Raises OrthomillError with one sentence when boards are not found or do not determine the camera; pydantic's ValidationError
    for impossible arguments.
    """
    photos = photo_list(photographs)
    source = CameraFromChessboards(
        kind="chessboards", photographs=photos, corners=corners, square=square, boards=boards, arrangement=arrangement
    )
    project = Project(project="calibrate", crs=ANY_CRS, photographs=photos, cameras=source)
    with temporary_run(project, (stage or CalibrationStage(),), progress) as store:
        return BoardCalibration(
            camera=store.table(CAMERA_FILE),
            calibration=store.table(CALIBRATION),
            residuals=store.table(RESIDUALS),
            report=store.table(report_table("calibration")),
        )
