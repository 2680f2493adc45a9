"""The last job of a calibration from chessboards: the camera, its record, its residuals and its report."""

from typing import NamedTuple

from orthomill.schemas.camera import Camera, Cameras
from orthomill.schemas.photo import Photos
from orthomill.schemas.stage_report import StageReport
from orthomill.tasks.calibration.board_tables import (
    Arranged,
    BoardPhotos,
    Calibration,
    CornerResiduals,
    Corners,
    PhotoSearch,
    TextPage,
)
from orthomill.tasks.calibration.cameras.camera_assignment import cameras_for
from orthomill.tasks.calibration.cameras.camera_exchange import FORMATS
from orthomill.tasks.calibration.cameras.camera_sharing import SharedCameras, cameras_shared
from orthomill.tasks.calibration.chessboards import Model, calibrate, calibration_record, camera_of, residual_table
from orthomill.tasks.calibration.diagnosis.calibration_results import CalibrationResults
from orthomill.tasks.calibration.report.board_report import chessboards_report
from orthomill.tasks.calibration.report.cameras_report import cameras_report
from orthomill.tasks.calibration.solving.lens_models import LensModel
from orthomill.tasks.calibration.solving.solving import CalibrationTarget


class CalibrationProducts(NamedTuple):
    """What the calibration from chessboards writes: the cameras of the photographs, the report, the calibrated camera by itself,
    the full record, the residuals of all corners, and the camera in the formats of other programs."""

    cameras: Cameras
    report: StageReport
    camera: Camera
    calibration: Calibration
    residuals: CornerResiduals
    opencv: TextPage
    colmap: TextPage
    opensfm: TextPage
    agisoft: TextPage


def from_chessboards(
    boards: BoardPhotos,
    arranged: Arranged,
    corners: tuple[Corners, ...],
    completed: tuple[Corners, ...],
    searches: tuple[PhotoSearch, ...],
    target: CalibrationTarget,
    model: Model,
    photos: Photos | None = None,
    serves: str = "*",
) -> CalibrationProducts:
    """Cameras, records and report of a calibration, whose camera took the photographs that match `serves`; without `photos` the
    calibration is run alone.

    Raises GeometryError when the boards do not determine the camera, PhotoError for photographs that do not fit it.
    """
    result, constant, used, checks = calibrate(arranged, corners, completed, target, model)
    camera = camera_of(result, "chessboards", target.size)
    names = [boards.names[photo] for photo in used]
    results = CalibrationResults(
        result=result, target=target, photos=names, constant=constant, checks=checks, searches=searches, arranged=arranged
    )
    cameras, report = _served(photos, serves, camera)
    return CalibrationProducts(
        cameras=cameras,
        report=chessboards_report(report, results),
        camera=camera,
        calibration=calibration_record(result, camera, names, checks[LensModel(result.state.lens, result.network.free)], target),
        residuals=residual_table(result, names, target),
        **{name: TextPage(text=known.text(camera)) for name, known in FORMATS.items()},
    )


def _served(photos: Photos | None, serves: str, camera: Camera) -> tuple[Cameras, StageReport]:
    """The cameras of the project's photographs and their report; of a calibration that is run alone, only the camera itself."""
    if photos is None:
        cameras = Cameras(cameras={camera.name: camera}, of_photo={})
        return cameras, cameras_report(cameras, SharedCameras(Photos(photos=()), {camera.name: camera}))
    shared = cameras_shared(photos, serves, lambda own: dict.fromkeys((photo.camera for photo in own.photos), camera))
    cameras = cameras_for(shared.photos, shared.cameras)
    return cameras, cameras_report(cameras, shared)
