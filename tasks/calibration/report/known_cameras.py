"""The jobs for cameras that are known already: from EXIF, from a file, typed in."""

from typing import NamedTuple

from orthomill.schemas.camera import Cameras
from orthomill.schemas.photo import Photos
from orthomill.schemas.project import CameraGiven
from orthomill.schemas.stage_report import StageReport
from orthomill.tasks.calibration.cameras.camera_assignment import cameras_for
from orthomill.tasks.calibration.cameras.camera_sharing import SharedCameras, cameras_shared
from orthomill.tasks.calibration.cameras.nominal_cameras import camera_given, cameras_from_file
from orthomill.tasks.calibration.cameras.untagged_photographs import cameras_from_exif
from orthomill.tasks.calibration.report.cameras_report import cameras_report


class KnownCameras(NamedTuple):
    """Every photograph with its camera, and the report of the cameras."""

    cameras: Cameras
    report: StageReport


def from_exif(photos: Photos) -> KnownCameras:
    """Nominal cameras; guessed ones for photographs whose tags give no camera constant."""
    return _known(SharedCameras(*cameras_from_exif(photos)))


def from_file(photos: Photos, text: str, path: str, serves: str = "*") -> KnownCameras:
    """Cameras of a file for the photographs that match `serves`.

    text: the contents of the file; path: its name, for messages. Raises WorkflowError for the file, PhotoError for photographs that
    do not fit.
    """
    return _known(cameras_shared(photos, serves, lambda own: cameras_from_file(text, path, own)))


def as_given(photos: Photos, given: CameraGiven) -> KnownCameras:
    """The camera typed into the workflow. Raises PhotoError for photographs that do not fit."""
    return _known(cameras_shared(photos, given.serves, lambda own: camera_given(given, own)))


def _known(shared: SharedCameras) -> KnownCameras:
    cameras = cameras_for(shared.photos, shared.cameras)
    return KnownCameras(cameras, cameras_report(cameras, shared))
