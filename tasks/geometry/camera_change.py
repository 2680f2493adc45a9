"""The camera of photographs that were resized, or rotated upright by EXIF.

An interior orientation belongs to the sensor. Resizing a photograph scales it; rotating or mirroring a photograph by its EXIF flag
moves its principal point and its tangential distortion along with the pixels.
"""

import numpy as np

from orthomill.schemas.camera import INTERIOR, Camera
from orthomill.schemas.errors import PhotoError
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


def pixel_turn(flag: int) -> np.ndarray:
    """(2, 2): the rotation `TURN` of an EXIF orientation for (col, row), whose second axis points down."""
    down = np.diag([1.0, -1.0])
    return down @ np.array(TURN[flag], float) @ down


def turned_pixels(pixels: np.ndarray, flag: int, size: tuple[int, int]) -> np.ndarray:
    """Pixels (n, 2) of an image of `size` (width, height) after its rotation by an EXIF orientation."""
    middle = np.array([(size[0] - 1) / 2, (size[1] - 1) / 2])
    return (pixels - middle) @ pixel_turn(flag).T + (middle[::-1] if flag >= 5 else middle)


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
    change = np.diag([*[factor] * 3, *[1.0] * (len(INTERIOR) - 3)])
    pixel_um = None if camera.pixel_um is None else camera.pixel_um / factor
    lengths = {name: factor * getattr(camera, name) for name in ("c", "x0", "y0")}
    return camera.model_copy(
        update={"width": size[0], "height": size[1], "pixel_um": pixel_um, "covariance": _carried(camera, change), **lengths}
    )


def turned(camera: Camera, orientation: int) -> Camera:
    """The camera of photographs rotated or mirrored upright by an EXIF flag, with its covariance.

    The tangential distortion is 2 (q x) x + r^2 q with q = (p2, -p1): q is a vector and rotates with the principal point, and so do
    the terms of a thin prism. Raises PhotoError for a quarter turn of skew axes, which would turn the photograph itself.
    """
    if orientation == 1:
        return camera
    if camera.skew and orientation >= 5:
        raise PhotoError(
            f"The camera {camera.name} has axes that are not perpendicular (skew {camera.skew:g}), and photographs turned by a "
            "quarter; give it without the skew, or turn the photographs' pixels."
        )
    change = interior_turn(orientation, camera.affinity)
    values = dict(zip(INTERIOR, (change @ camera.interior).tolist(), strict=True))
    if orientation >= 5:
        # Columns and rows exchange their constants: the change is that of small corrections, these are the values.
        values |= {"c": camera.c * (1.0 + camera.affinity), "affinity": -camera.affinity / (1.0 + camera.affinity)}
    size = (camera.height, camera.width) if orientation >= 5 else (camera.width, camera.height)
    own = camera.with_interior(np.array([values[name] for name in INTERIOR]))
    return own.model_copy(update={"width": size[0], "height": size[1], "covariance": _carried(camera, change)})


def interior_turn(orientation: int, affinity: float = 0.0) -> np.ndarray:
    """(17, 17): from small changes of the interior orientation (order of INTERIOR) of the file to those of the upright photograph;
    `affinity` is that of the camera."""
    turn, change = np.array(TURN[orientation], dtype=float), np.eye(len(INTERIOR))
    at = {name: k for k, name in enumerate(INTERIOR)}
    change[1:3, 1:3] = turn
    # (p1, p2) is stored, but the vector that rotates is q = (p2, -p1) = swap (p1, p2).
    swap = np.array([[0.0, 1.0], [-1.0, 0.0]])
    tangential = [at["p1"], at["p2"]]
    change[np.ix_(tangential, tangential)] = swap.T @ turn @ swap
    # s3 and s4 belong to a y that points down.
    down = np.diag([1.0, -1.0])
    for terms in (("s1", "s3"), ("s2", "s4")):
        own = [at[name] for name in terms]
        change[np.ix_(own, own)] = down @ turn @ down
    change[at["skew"], at["skew"]] = np.linalg.det(turn)
    if orientation >= 5:
        wide, c = 1.0 + affinity, at["c"]
        change[c, c], change[at["affinity"], at["affinity"]] = wide, -1.0 / wide**2
    return change


def _carried(camera: Camera, change: np.ndarray) -> tuple[tuple[float, ...], ...] | None:
    if camera.covariance is None:
        return None
    covariance = change @ np.array(camera.covariance) @ change.T
    return tuple(tuple(row) for row in covariance.tolist())
