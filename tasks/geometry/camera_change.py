"""A camera made to fit its photographs: scaled to reduced ones, turned with upright ones.

An interior orientation belongs to the sensor. A photograph that was reduced in size scales it; one that EXIF turns or mirrors
moves its principal point and its tangential distortion with the pixels.
"""

import numpy as np

from orthomill.schemas.camera import Camera
from orthomill.schemas.photo import Photo

TURN: dict[int, tuple[tuple[int, int], tuple[int, int]]] = {
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


QUARTER_TURNS = {3: 3, 6: 8, 8: 6}
"""EXIF orientations that turn a photograph without mirroring it -> those that turn it back"""


def file_size(photo: Photo) -> tuple[int, int]:
    """Width and height of the file, before the photograph was turned upright."""
    return (photo.height, photo.width) if photo.exif_orientation >= 5 else (photo.width, photo.height)


def sensor_size(photo: Photo) -> tuple[int, int]:
    """Width and height as the sensor saw it, before the photograph was turned upright."""
    return (photo.height, photo.width) if photo.sensor_orientation >= 5 else (photo.width, photo.height)


def upright_name(photo: Photo) -> str:
    """The name of the camera in the upright photograph: that of its sensor, and how it was turned."""
    turned_by = photo.sensor_orientation
    return f"{photo.camera} turned {turned_by}" if turned_by in QUARTER_TURNS else photo.camera


def sensor_name(upright: str) -> str:
    """The name of the sensor's camera from that of the camera in the upright photograph."""
    name, _, flag = upright.rpartition(" turned ")
    return name if flag in map(str, QUARTER_TURNS) else upright


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
    change = interior_turn(orientation)
    _, x0, y0, _, _, _, p1, p2 = (change @ camera.interior).tolist()
    size = (camera.height, camera.width) if orientation >= 5 else (camera.width, camera.height)
    return camera.model_copy(
        update={"x0": x0, "y0": y0, "p1": p1, "p2": p2, "width": size[0], "height": size[1], "covariance": _carried(camera, change)}
    )


def interior_turn(orientation: int) -> np.ndarray:
    """(8, 8): the interior orientation (order of INTERIOR) after its photographs were turned or mirrored upright."""
    turn, change = np.array(TURN[orientation], dtype=float), np.eye(8)
    change[1:3, 1:3] = turn
    swap = np.array([[0.0, 1.0], [-1.0, 0.0]])
    change[6:8, 6:8] = swap.T @ turn @ swap
    return change


def _carried(camera: Camera, change: np.ndarray) -> tuple[tuple[float, ...], ...] | None:
    if camera.covariance is None:
        return None
    covariance = change @ np.array(camera.covariance) @ change.T
    return tuple(tuple(row) for row in covariance.tolist())
