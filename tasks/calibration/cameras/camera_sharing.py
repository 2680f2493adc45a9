"""A calibrated camera that took only some of the photographs: the others have nominal cameras from their EXIF tags."""

from collections.abc import Callable
from fnmatch import fnmatchcase
from pathlib import PurePath
from typing import NamedTuple

from orthomill.schemas.camera import Camera
from orthomill.schemas.errors import WorkflowError, some_of
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.calibration.cameras.untagged_photographs import UntaggedPhotos, cameras_from_exif


class SharedCameras(NamedTuple):
    """The photographs with the names of their cameras, the camera of the sensor by name, and the photographs without EXIF."""

    photos: Photos
    cameras: dict[str, Camera]
    untagged: tuple[UntaggedPhotos, ...] = ()


def cameras_shared(photos: Photos, pattern: str, calibrated: Callable[[Photos], dict[str, Camera]]) -> SharedCameras:
    """The calibrated camera for the photographs whose file names match `pattern`, nominal ones for the others.

    `calibrated` gives the cameras of the photographs that match. Raises WorkflowError when none does.
    """
    own = tuple(photo for photo in photos.photos if fnmatchcase(PurePath(photo.path).name, pattern))
    if not own:
        raise WorkflowError(
            f"No photograph matches '{pattern}', which the calibrated camera is said to have taken (serves); the photographs are "
            f"{some_of([PurePath(photo.path).name for photo in photos.photos], 4)}."
        )
    # The tags of photographs that the calibrated camera took are not read: they may be missing or wrong.
    if len(own) == len(photos.photos):
        return SharedCameras(photos, calibrated(photos))
    rest = tuple(photo for photo in photos.photos if photo not in own)
    others, nominal, untagged = cameras_from_exif(photos.model_copy(update={"photos": rest}))
    named = {photo.name: photo for photo in (*others.photos, *_renamed(own, others))}
    assigned = photos.model_copy(update={"photos": tuple(named[photo.name] for photo in photos.photos)})
    mine = assigned.model_copy(update={"photos": tuple(named[photo.name] for photo in own)})
    return SharedCameras(assigned, {**nominal, **calibrated(mine)}, untagged)


def _renamed(own: tuple[Photo, ...], others: Photos) -> tuple[Photo, ...]:
    """Photographs of the calibrated camera; it gets a name of its own where EXIF gives both cameras the same."""
    # Two bodies of one model have the same EXIF name, but not the same interior orientation: sharing the name would merge them.
    shared = {photo.camera for photo in others.photos}
    return tuple(
        photo.model_copy(update={"camera": f"{photo.camera}, calibrated"}) if photo.camera in shared else photo for photo in own
    )
