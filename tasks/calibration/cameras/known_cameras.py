"""Cameras that are known already: from EXIF, from a file, typed in. Each function gives a dict with the cameras and their
report."""

from typing import Any

from orthomill.schemas.camera import Camera
from orthomill.schemas.photo import Photos
from orthomill.schemas.project import CameraGiven
from orthomill.tasks.calibration.cameras.camera_assignment import cameras_for
from orthomill.tasks.calibration.cameras.camera_sharing import shared_out
from orthomill.tasks.calibration.cameras.nominal_cameras import camera_given, cameras_from_file
from orthomill.tasks.calibration.cameras.untagged_photographs import cameras_from_exif
from orthomill.tasks.calibration.report import cameras_report


def from_exif(photos: Photos) -> dict[str, Any]:
    """Nominal cameras. Raises PhotoError when EXIF says too little of all photographs."""
    return _outcome(*cameras_from_exif(photos))


def from_file(photos: Photos, text: str, path: str, serves: str = "*") -> dict[str, Any]:
    """Cameras of a file for the photographs that match `serves`. Raises WorkflowError for the file, PhotoError for photographs that
    do not fit."""
    return _outcome(*shared_out(photos, serves, lambda own: cameras_from_file(text, path, own)))


def as_given(photos: Photos, given: CameraGiven) -> dict[str, Any]:
    """The camera typed into the workflow. Raises PhotoError for photographs that do not fit."""
    return _outcome(*shared_out(photos, given.serves, lambda own: camera_given(given, own)))


def _outcome(photos: Photos, sources: dict[str, Camera], remarks: tuple[str, ...]) -> dict[str, Any]:
    cameras = cameras_for(photos, sources)
    report = cameras_report(cameras, photos, sources)
    return {"cameras": cameras, "report": report.model_copy(update={"warnings": (*remarks, *report.warnings)})}
