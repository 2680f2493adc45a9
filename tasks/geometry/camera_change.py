"""The camera of photographs that were resized, or rotated upright by EXIF.

An interior orientation belongs to the sensor. Resizing a photograph scales it; rotating or mirroring a photograph by its EXIF flag
moves its principal point and its tangential distortion along with the pixels.
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
"""EXIF orientation -> 2 x 2 matrix from image coordinates (x right, y up) of the file to those of the upright photograph."""


QUARTER_TURNS = {3: 3, 6: 8, 8: 6}
"""EXIF orientations that rotate a photograph without mirroring it -> those that rotate it back."""


def file_size(photo: Photo) -> tuple[int, int]:
    """Width and height of the file, before the photograph was rotated upright."""
    # Flags 5 to 8 exchange rows and columns.
    return (photo.height, photo.width) if photo.exif_orientation >= 5 else (photo.width, photo.height)


def sensor_size(photo: Photo) -> tuple[int, int]:
    """Width and height of the frame of the sensor, before the photograph was rotated upright."""
    return (photo.height, photo.width) if photo.sensor_orientation >= 5 else (photo.width, photo.height)


def upright_name(photo: Photo) -> str:
    """The name of the camera of the upright photograph: that of its sensor, and the EXIF flag that rotated it."""
    # One sensor gives several cameras: its principal point lies elsewhere in photographs held upright.
    turned_by = photo.sensor_orientation
    return f"{photo.camera} turned {turned_by}" if turned_by in QUARTER_TURNS else photo.camera


def sensor_name(upright: str) -> str:
    """The name of the sensor's camera from the name of the camera of an upright photograph."""
    name, _, flag = upright.rpartition(" turned ")
    return name if flag in map(str, QUARTER_TURNS) else upright


def scaled(camera: Camera, size: tuple[int, int]) -> Camera:
    """The camera of photographs reduced (or enlarged) to `size` (width, height)."""
    factor = size[0] / camera.width
    if size == (camera.width, camera.height):
        return camera
    # The distortion coefficients refer to a radius in units of c and do not change with the size of a pixel.
    change = np.diag([factor, factor, factor, 1, 1, 1, 1, 1])
    pixel_um = None if camera.pixel_um is None else camera.pixel_um / factor
    lengths = {name: factor * getattr(camera, name) for name in ("c", "x0", "y0")}
    return camera.model_copy(
        update={"width": size[0], "height": size[1], "pixel_um": pixel_um, "covariance": _carried(camera, change), **lengths}
    )


def turned(camera: Camera, orientation: int) -> Camera:
    """The camera of photographs rotated or mirrored upright by an EXIF flag, with its covariance.

    The tangential distortion is 2 (q x) x + r^2 q with q = (p2, -p1): q is a vector and rotates with the principal point.
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
    """(8, 8): from the interior orientation (order of INTERIOR) of the file to that of the upright photograph."""
    turn, change = np.array(TURN[orientation], dtype=float), np.eye(8)
    change[1:3, 1:3] = turn
    # (p1, p2) is stored, but the vector that rotates is q = (p2, -p1) = swap (p1, p2).
    swap = np.array([[0.0, 1.0], [-1.0, 0.0]])
    change[6:8, 6:8] = swap.T @ turn @ swap
    return change


def _carried(camera: Camera, change: np.ndarray) -> tuple[tuple[float, ...], ...] | None:
    if camera.covariance is None:
        return None
    covariance = change @ np.array(camera.covariance) @ change.T
    return tuple(tuple(row) for row in covariance.tolist())
