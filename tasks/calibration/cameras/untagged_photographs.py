"""Photographs whose EXIF tags tell no camera constant, among others that do: edited or sent through a messenger, they lost them.

Such a photograph takes the camera of the others of its size: the one that took most of them. Where there is none of its size, a
constant is guessed, with a standard error that says so: matching does not need it, and the block shows whether it fits. Either
way the photograph is named; a block does not fail because of it.
"""

from collections import Counter

import numpy as np

from orthomill.schemas.camera import INTERIOR, Camera
from orthomill.schemas.errors import PhotoError, some_of
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.calibration.cameras.nominal_cameras import nominal_camera, nominal_constant
from orthomill.tasks.geometry.camera_change import sensor_size

_GUESS, _GUESS_SHARE = 1.0, 0.25
"""A camera constant in units of the longer side (a 36 mm lens on 35 mm film), and its relative standard error: phones, drones and
normal lenses lie within."""


def cameras_from_exif(photos: Photos) -> tuple[Photos, dict[str, Camera], tuple[str, ...]]:
    """The photographs, blind ones with the camera lent to them; one nominal camera per `Photo.camera`; a sentence for every group
    of blind photographs. Raises PhotoError when no photograph tells a camera constant."""
    blind = [photo for photo in photos.photos if nominal_constant(photo) is None]
    if len(blind) == len(photos.photos):
        raise PhotoError(_nobody_knows(photos))
    telling = [photo for photo in photos.photos if nominal_constant(photo) is not None]
    cameras = {photo.camera: nominal_camera(photo) for photo in reversed(telling)}
    lent = {photo.name: _lender(photo, telling) for photo in blind}
    cameras |= {photo.camera: _guessed(photo) for photo in blind if lent[photo.name] is None}
    taken = tuple(photo.model_copy(update={"camera": lent.get(photo.name) or photo.camera}) for photo in photos.photos)
    return photos.model_copy(update={"photos": taken}), cameras, _sentences(blind, lent, cameras)


def _lender(photo: Photo, telling: list[Photo]) -> str | None:
    """The camera of most photographs of the same size that lie alike in their files."""
    same = [
        other.camera for other in telling
        if sensor_size(other) == sensor_size(photo) and other.exif_orientation == photo.exif_orientation
    ]  # fmt: skip
    return Counter(same).most_common(1)[0][0] if same else None


def _guessed(photo: Photo) -> Camera:
    width, height = sensor_size(photo)
    c = _GUESS * max(width, height)
    camera = nominal_camera(photo.model_copy(update={"focal_mm": None, "focal_35mm": 36.0 * _GUESS}))
    covariance = np.array(camera.covariance)
    covariance[INTERIOR.index("c"), INTERIOR.index("c")] = (_GUESS_SHARE * c) ** 2
    return camera.model_copy(update={"covariance": tuple(map(tuple, covariance.tolist()))})


def _sentences(blind: list[Photo], lent: dict[str, str | None], cameras: dict[str, Camera]) -> tuple[str, ...]:
    found = []
    for lender in dict.fromkeys(lent.values()):
        names = some_of([photo.name for photo in blind if lent[photo.name] == lender])
        if lender:
            found.append(
                f"EXIF tells no focal length of {names}; taken as photographs of {lender}, which has their size. If another camera "
                "took them, give it a camera of its own or leave them out."
            )
        else:
            guessed = sorted({f"{cameras[photo.camera].c:.0f} px" for photo in blind if lent[photo.name] is None})
            found.append(
                f"EXIF tells no focal length of {names}, and no other photograph has their size: a camera constant of "
                f"{', '.join(guessed)} was guessed, good to {100 * _GUESS_SHARE:.0f} %. Give their camera in a file, or leave them "
                "out."
            )
    return tuple(found)


def _nobody_knows(photos: Photos) -> str:
    return (
        f"No camera constant can be found for {len(photos.photos)} of {len(photos.photos)} photographs "
        f"({some_of(photos.names)}): their EXIF tags do not tell a focal length together with the size of a pixel or its "
        "35 mm equivalent; add the camera to the workflow, for example cameras: {kind: given, c: <camera constant in pixels>}, or "
        "a camera file, or photographs of a chessboard."
    )
