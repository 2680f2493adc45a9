"""The four ways to the cameras of a project. Each function gives a dict with the cameras and their report."""

from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict

from schemas.camera import Camera
from schemas.errors import PhotoError
from schemas.photo import Header, Photos
from schemas.workflow import CameraGiven
from tasks.calibration.assignment import cameras_for
from tasks.calibration.boards import Corners
from tasks.calibration.nominal import camera_given, cameras_from_exif, cameras_from_file
from tasks.calibration.plane_views import PlaneView, calibrate, camera_of, held_out
from tasks.calibration.report import cameras_report, chessboards_report


class BoardPhotos(BaseModel):
    """The photographs of chessboards, all of one size (width, height) as their files are."""

    model_config = ConfigDict(frozen=True)

    paths: tuple[str, ...]
    size: tuple[int, int]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(PurePath(path).stem for path in self.paths)


@dataclass(frozen=True)
class BoardCalibration:
    """How to calibrate: the board's square in m, and the interior parameters to estimate (the others stay zero)."""

    square: float
    free: tuple[str, ...]


def from_exif(photos: Photos) -> dict[str, Any]:
    """Nominal cameras. Raises PhotoError when EXIF says too little."""
    return _outcome(photos, cameras_from_exif(photos))


def from_file(photos: Photos, text: str, path: str) -> dict[str, Any]:
    """Cameras of a file. Raises WorkflowError for the file, PhotoError for photographs that do not fit."""
    return _outcome(photos, cameras_from_file(text, path, photos))


def as_given(photos: Photos, given: CameraGiven) -> dict[str, Any]:
    """The camera typed into the workflow. Raises PhotoError for photographs that do not fit."""
    return _outcome(photos, camera_given(given, photos))


def _outcome(photos: Photos, sources: dict[str, Camera]) -> dict[str, Any]:
    cameras = cameras_for(photos, sources)
    return {"cameras": cameras, "report": cameras_report(cameras, photos, sources)}


def index_board_photos(headers: tuple[Header, ...]) -> BoardPhotos:
    """The calibration photographs. Raises PhotoError when their sizes differ."""
    size = (headers[0].width, headers[0].height)
    others = [header.path for header in headers if (header.width, header.height) != size]
    if others:
        raise PhotoError(
            f"The chessboard photographs differ in size: {headers[0].path} has {size[0]} x {size[1]} pixels, but not "
            f"{', '.join(others[:5])}; "
            "calibrate with photographs of one camera and one setting."
        )
    return BoardPhotos(paths=tuple(header.path for header in headers), size=size)


def from_chessboards(
    photos: Photos, boards: BoardPhotos, corners: tuple[Corners, ...], settings: BoardCalibration
) -> dict[str, Any]:
    """Calibration from the corners of all boards (one `Corners` per photograph of `boards`).

    Raises GeometryError when the boards do not determine the camera, PhotoError for photographs that do not fit it.
    """
    views = [view for name, found in zip(boards.names, corners, strict=True) for view in plane_views(name, found, settings.square)]
    solution = calibrate(views, boards.size, settings.free)
    camera = camera_of(solution, "chessboards", boards.size)
    sources = dict.fromkeys((photo.camera for photo in photos.photos), camera)
    cameras = cameras_for(photos, sources)
    check = held_out(views, boards.size, settings.free)
    return {"cameras": cameras, "report": chessboards_report(cameras, photos, sources, solution, check)}


def plane_views(photo: str, corners: Corners, square: float) -> list[PlaneView]:
    """The boards of one photograph as plane views; squares of `square` m."""
    plane = square * np.column_stack([corners.column, corners.row]).astype(np.float64)
    pixels = np.column_stack([corners.x, corners.y])
    return [PlaneView(photo, plane[corners.board == board], pixels[corners.board == board]) for board in np.unique(corners.board)]
