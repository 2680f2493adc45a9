"""Photographs without a camera constant in their EXIF tags, next to others that have one: edited, or sent through a messenger.

Such a photograph takes the camera of the others of its size: the one that took most of them. Where no other photograph has its
size, or none has tags at all (scans, frames of a film, published sets), a constant is guessed, with a standard error that covers
most lenses: matching does not depend on it, and the block adjustment shows whether it fits. Either way the photographs are listed;
a block does not fail because of them.
"""

from collections import Counter
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from orthomill.schemas.camera import INTERIOR, Camera
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.calibration.cameras.nominal_cameras import nominal_camera, nominal_constant
from orthomill.tasks.geometry.camera_change import sensor_size

# A 36 mm lens on 35 mm film: between the wide lenses of phones and drones and the normal lens of a camera, so that one standard
# error of a quarter reaches both.
_GUESS = 1.0
"""The guessed camera constant in units of the longer side."""
GUESS_SHARE = 0.25
"""Relative standard error of a guessed camera constant."""


class Substitute(StrEnum):
    """Where the camera of photographs without EXIF comes from."""

    SAME_SIZE = "same size"
    GUESSED = "guessed"


@dataclass(frozen=True)
class UntaggedPhotos:
    """`photos`: names of photographs whose tags give no camera constant; `camera`: the one they take by their size, None when it is
    guessed; `constants`: the guessed camera constants, px."""

    substitute: Substitute
    photos: tuple[str, ...]
    camera: str | None = None
    constants: tuple[float, ...] = ()


def cameras_from_exif(photos: Photos) -> tuple[Photos, dict[str, Camera], tuple[UntaggedPhotos, ...]]:
    """The photographs, each with its camera; one nominal camera per `Photo.camera`; and the groups of photographs without tags."""
    untagged = [photo for photo in photos.photos if nominal_constant(photo) is None]
    tagged = [photo for photo in photos.photos if nominal_constant(photo) is not None]
    # Reversed, so that the first photograph of a camera decides, as it does wherever photographs share a name.
    cameras = {photo.camera: nominal_camera(photo) for photo in reversed(tagged)}
    substitutes = {photo.name: _same_size(photo, tagged) for photo in untagged}
    cameras |= {photo.camera: _guessed(photo) for photo in untagged if substitutes[photo.name] is None}
    assigned = tuple(photo.model_copy(update={"camera": substitutes.get(photo.name) or photo.camera}) for photo in photos.photos)
    return photos.model_copy(update={"photos": assigned}), cameras, _groups(untagged, substitutes, cameras)


def _same_size(photo: Photo, tagged: list[Photo]) -> str | None:
    """The camera of most photographs of the same size and EXIF orientation."""
    # Editors that drop the tags often turn the pixels as well. Only photographs stored in the same orientation are sure to have the
    # same pixel axes, and with them the same signs of principal point and tangential distortion.
    same = [
        other.camera
        for other in tagged
        if sensor_size(other) == sensor_size(photo) and other.exif_orientation == photo.exif_orientation
    ]
    return Counter(same).most_common(1)[0][0] if same else None


def _guessed(photo: Photo) -> Camera:
    width, height = sensor_size(photo)
    c = _GUESS * max(width, height)
    camera = nominal_camera(photo.model_copy(update={"focal_mm": None, "focal_35mm": 36.0 * _GUESS}))
    covariance = np.array(camera.covariance)
    covariance[INTERIOR.index("c"), INTERIOR.index("c")] = (GUESS_SHARE * c) ** 2
    return camera.model_copy(update={"c": c, "covariance": tuple(map(tuple, covariance.tolist()))})


def _groups(untagged: list[Photo], substitutes: dict[str, str | None], cameras: dict[str, Camera]) -> tuple[UntaggedPhotos, ...]:
    """One group per substitute camera, in the order of the photographs; all guessed ones in one group."""
    found = []
    for camera in dict.fromkeys(substitutes.values()):
        own = [photo for photo in untagged if substitutes[photo.name] == camera]
        names = tuple(photo.name for photo in own)
        if camera:
            found.append(UntaggedPhotos(Substitute.SAME_SIZE, names, camera=camera))
        else:
            constants = tuple(cameras[photo.camera].c for photo in own)
            found.append(UntaggedPhotos(Substitute.GUESSED, names, constants=constants))
    return tuple(found)
