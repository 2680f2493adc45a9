"""A calibrated camera that took only some of the photographs: the others have the camera that their EXIF tags tell."""

from collections.abc import Callable
from fnmatch import fnmatchcase
from pathlib import PurePath

from orthomill.schemas.camera import Camera
from orthomill.schemas.errors import WorkflowError, some_of
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.calibration.cameras.untagged_photographs import cameras_from_exif

Shared = tuple[Photos, dict[str, Camera], tuple[str, ...]]


def shared_out(photos: Photos, pattern: str, calibrated: Callable[[Photos], dict[str, Camera]]) -> Shared:
    """The photographs with the words of their cameras, the camera of every word, and sentences about the nominal ones.

    `calibrated` gives the cameras of the photographs whose file names match `pattern`. Raises WorkflowError when none does,
    PhotoError when EXIF says too little of all others.
    """
    own = tuple(photo for photo in photos.photos if fnmatchcase(PurePath(photo.path).name, pattern))
    if not own:
        raise WorkflowError(
            f"No photograph matches '{pattern}', which the calibrated camera is said to have taken (serves); the photographs are "
            f"{some_of([PurePath(photo.path).name for photo in photos.photos], 4)}."
        )
    if len(own) == len(photos.photos):
        return photos, calibrated(photos), ()
    rest = tuple(photo for photo in photos.photos if photo not in own)
    others, nominal, remarks = cameras_from_exif(photos.model_copy(update={"photos": rest}))
    named = {photo.name: photo for photo in (*others.photos, *_apart(own, others))}
    taken = photos.model_copy(update={"photos": tuple(named[photo.name] for photo in photos.photos)})
    mine = taken.model_copy(update={"photos": tuple(named[photo.name] for photo in own)})
    return taken, {**nominal, **calibrated(mine)}, remarks


def _apart(own: tuple[Photo, ...], others: Photos) -> tuple[Photo, ...]:
    """Photographs of the calibrated camera; it gets a word of its own where EXIF gives both cameras the same."""
    shared = {photo.camera for photo in others.photos}
    return tuple(
        photo.model_copy(update={"camera": f"{photo.camera}, calibrated"}) if photo.camera in shared else photo for photo in own
    )
