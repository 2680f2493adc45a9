"""Orientation of photographs without a project: tie points, block adjustment, residuals."""

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from orthomill.pipeline.storage.image_files import read_header
from orthomill.pipeline.workflow.photograph_survey import Survey
from orthomill.schemas.camera import Camera
from orthomill.schemas.observations import GROUND_POINTS, IMAGE_RESIDUALS, GroundPoints, ImageResiduals
from orthomill.schemas.orientation import (
    BLOCK,
    BLOCK_PRECISION,
    GROUND_RESIDUALS,
    RELATIVE,
    Block,
    BlockPrecision,
    GroundResiduals,
    RelativeOrientations,
)
from orthomill.schemas.photo import PHOTOS, Photos
from orthomill.schemas.project import (
    ANY_CRS,
    CameraFromExif,
    CameraFromFile,
    CameraSource,
    ControlSource,
    NoControl,
    PhotoFolder,
    Positions,
    PositionsFromExif,
    Project,
)
from orthomill.schemas.stage_contract import Stage
from orthomill.schemas.stage_report import StageReport, report_table
from orthomill.tasks.calibration.stage import CalibrationStage
from orthomill.tasks.orientation.stage import OrientationStage
from orthomill.tasks.photos.stage import PhotosStage
from orthomill.tasks.tie_points.stage import TiePointsStage
from orthomill.temporary_run import Progress, photo_list, temporary_run


@dataclass(frozen=True)
class OrientedBlock:
    """Photographs oriented together, and what the adjustment says of itself."""

    block: Block
    """exterior orientations with covariances, cameras, sigma0 (px)"""
    photographs: Photos
    points: GroundPoints
    """adjusted tie points, m, with covariances"""
    image_residuals: ImageResiduals
    """of the measurements that took part, px"""
    ground_residuals: GroundResiduals
    """at control, check points and positions, m, with the errors that the adjustment predicts"""
    precision: BlockPrecision
    """variance factors, correlations, blunders"""
    relative: RelativeOrientations
    """every pair on its own"""
    report: StageReport
    """figures, charts and warnings as in the report of a project"""


def orient(
    photographs: str | Path | Sequence[str | Path],
    *,
    crs: str | None = None,
    camera: Camera | CameraSource | None = None,
    positions: Positions | None = None,
    control: ControlSource | None = None,
    tie_points: TiePointsStage | None = None,
    orientation: OrientationStage | None = None,
    progress: Progress | None = None,
) -> OrientedBlock:
    """Orient photographs: a folder, or a list of image files.

    crs: projected, in metres; None: the UTM zone of the GPS tags, or a system of its own where there are none.
    camera: None for EXIF; a `Camera` (as `calibrate` returns it) or any camera source of a workflow. positions, control: sources as
    in a workflow, files by absolute path. tie_points, orientation: the stages with settings other than their defaults.
    progress: called with the name of a stage, its finished and its planned jobs.

    Raises OrthomillError with one sentence when the photographs cannot be read or do not make a block.
    """
    photos = photo_list(photographs)
    known = {"positions": positions or PositionsFromExif(kind="exif"), "control": control or NoControl(kind="none")}
    stages = (PhotosStage(), CalibrationStage(), tie_points or TiePointsStage(), orientation or OrientationStage())
    with _camera_source(camera) as cameras:
        project = Project(project="orient", crs=crs or _crs_of(photos.paths), photographs=photos, cameras=cameras, **known)
        return _oriented(project, stages, progress)


def _oriented(project: Project, stages: tuple[Stage, ...], progress: Progress | None) -> OrientedBlock:
    with temporary_run(project, stages, progress) as store:
        return OrientedBlock(
            block=store.table(BLOCK),
            photographs=store.table(PHOTOS),
            points=store.table(GROUND_POINTS),
            image_residuals=store.table(IMAGE_RESIDUALS),
            ground_residuals=store.table(GROUND_RESIDUALS),
            precision=store.table(BLOCK_PRECISION),
            relative=store.table(RELATIVE),
            report=store.table(report_table("orientation")),
        )


def _crs_of(paths: tuple[str, ...]) -> str:
    """The reference system that a starting workflow would propose, from the GPS tags."""
    return Survey(PhotoFolder(kind="folder", path=""), tuple(read_header(Path(path)) for path in paths)).utm or ANY_CRS


@contextmanager
def _camera_source(camera: Camera | CameraSource | None) -> Iterator[CameraSource]:
    """A calibrated camera goes by way of its file, which carries the covariance as well."""
    if isinstance(camera, Camera):
        with tempfile.TemporaryDirectory(prefix="orthomill-") as folder:
            path = Path(folder) / "camera.json"
            path.write_text(camera.model_dump_json())
            yield CameraFromFile(kind="file", path=str(path))
    else:
        yield camera or CameraFromExif(kind="exif")
