"""Which photograph was taken with which camera, and a camera made to fit: scaled to reduced photographs, turned with upright ones.

An interior orientation belongs to the sensor. A photograph that was reduced in size scales it; one that EXIF turns or mirrors
moves its principal point and its tangential distortion with the pixels.
"""

from collections.abc import Mapping

import numpy as np

from schemas.camera import Camera, Cameras
from schemas.errors import PhotoError
from schemas.photo import Photo, Photos

_SAME_SHAPE = 0.005
_TURN: dict[int, tuple[tuple[int, int], tuple[int, int]]] = {
    1: ((1, 0), (0, 1)),
    2: ((-1, 0), (0, 1)),
    3: ((-1, 0), (0, -1)),
    4: ((1, 0), (0, -1)),
    5: ((0, -1), (-1, 0)),
    6: ((0, 1), (-1, 0)),
    7: ((0, 1), (1, 0)),
    8: ((0, -1), (1, 0)),
}
"""EXIF orientation -> how image coordinates (x right, y up) of the file become those of the upright photograph."""


def cameras_for(photos: Photos, sources: Mapping[str, Camera]) -> Cameras:
    """Every photograph with its camera. sources: the camera of the sensor by the name of `Photo.camera`.

    Raises PhotoError naming the photographs whose shape does not fit.
    """
    misfits = [photo for photo in photos.photos if not fits(sources[photo.camera], photo)]
    if misfits:
        camera = sources[misfits[0].camera]
        names = ", ".join(f"{photo.name} ({photo.width} x {photo.height})" for photo in misfits[:8])
        raise PhotoError(
            f"The camera {camera.name} has {camera.width} x {camera.height} pixels, another shape than {len(misfits)} "
            f"photographs: {names}; "
            "take them out of the workflow or give the camera that took them."
        )
    sheared = sorted({camera.name for camera in sources.values() if camera.affinity or camera.skew})
    if sheared:
        raise PhotoError(
            f"The camera {sheared[0]} has an affinity or a skew, which the stages after the calibration do not know; calibrate "
            "without these two parameters for a project with photographs."
        )
    first = {photo.camera: photo for photo in reversed(photos.photos)}
    cameras = {name: fitted(sources[name], photo) for name, photo in sorted(first.items())}
    return Cameras(cameras=cameras, of_photo={photo.name: photo.camera for photo in photos.photos})


def file_size(photo: Photo) -> tuple[int, int]:
    """Width and height of the file, before the photograph was turned upright."""
    return (photo.height, photo.width) if photo.exif_orientation >= 5 else (photo.width, photo.height)


def fits(camera: Camera, photo: Photo) -> bool:
    """Whether the photograph has the camera's shape, in any size."""
    width, height = file_size(photo)
    return abs(width / camera.width * camera.height / height - 1.0) < _SAME_SHAPE


def fitted(camera: Camera, photo: Photo) -> Camera:
    """The camera of the sensor as this photograph shows it, under the photograph's camera name."""
    own = turned(scaled(camera, file_size(photo)), photo.exif_orientation)
    return own.model_copy(update={"name": photo.camera, "pixel_um": own.pixel_um or photo.pixel_um})


def scaled(camera: Camera, size: tuple[int, int]) -> Camera:
    """The camera of photographs reduced (or enlarged) to `size` (width, height)."""
    factor = size[0] / camera.width
    if size == (camera.width, camera.height):
        return camera
    change = np.diag([factor, factor, factor, 1, 1, 1, 1, 1])
    pixel_um = None if camera.pixel_um is None else camera.pixel_um / factor
    lengths = {name: factor * getattr(camera, name) for name in ("c", "x0", "y0")}
    return camera.model_copy(
        update={"width": size[0], "height": size[1], "pixel_um": pixel_um, "covariance": _carried(camera, change), **lengths}
    )


def turned(camera: Camera, orientation: int) -> Camera:
    """The camera of photographs turned or mirrored upright.

    The tangential distortion is 2 (q x) x + r^2 q with q = (p2, -p1): q turns as the principal point does.
    """
    if orientation == 1:
        return camera
    turn = np.array(_TURN[orientation], dtype=float)
    x0, y0 = (turn @ [camera.x0, camera.y0]).tolist()
    p2, minus_p1 = (turn @ [camera.p2, -camera.p1]).tolist()
    change = np.eye(8)
    change[1:3, 1:3] = turn
    swap = np.array([[0.0, 1.0], [-1.0, 0.0]])
    change[6:8, 6:8] = swap.T @ turn @ swap
    size = (camera.height, camera.width) if orientation >= 5 else (camera.width, camera.height)
    return camera.model_copy(
        update={
            "x0": x0,
            "y0": y0,
            "p1": -minus_p1,
            "p2": p2,
            "width": size[0],
            "height": size[1],
            "covariance": _carried(camera, change),
        }
    )


def _carried(camera: Camera, change: np.ndarray) -> tuple[tuple[float, ...], ...] | None:
    if camera.covariance is None:
        return None
    covariance = change @ np.array(camera.covariance) @ change.T
    return tuple(tuple(row) for row in covariance.tolist())
