"""Control measured in photographs that were reduced afterwards: the list holds pixels of the originals.

Nothing in a list says which pixels are meant. But where measurements lie outside of the photographs, and all of them inside of what
the tags say that the camera wrote, they are those of the originals: wrong lines are few, and lie anywhere.
"""

from collections.abc import Callable
from typing import TypeVar

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.findings.control_findings import MeasurementsOfOriginals
from orthomill.schemas.observations import Control
from orthomill.schemas.photo import Photo, Photos

LEAST_OUTSIDE = 0.2
"""Share of the measurements that lie outside of the photographs as they are: points that fill the frame of photographs reduced by a
tenth"""

_T = TypeVar("_T")


def read_in_frame(
    photos: Photos, read: Callable[[Photos], _T], control_of: Callable[[_T], Control]
) -> tuple[_T, Photos, tuple[MeasurementsOfOriginals, ...]]:
    """What `read` finds in a text on the photographs, the photographs in whose pixels it is, and that these are the originals.

    Raises WorkflowError where neither the photographs nor their originals hold the measurements.
    """
    try:
        return read(photos), photos, ()
    except WorkflowError as refused:
        before = _originals(photos)
        if before is None:
            raise
        # A mistake that the originals do not explain is one of the text, and was told already.
        try:
            found = read(before)
        except WorkflowError:
            raise refused from None
        finding = _finding(control_of(found), photos)
        if finding is None:
            raise
        return found, before, (finding,)


def _originals(photos: Photos) -> Photos | None:
    """The photographs, with pixels of their originals as those of their files; None where none was reduced."""
    if all(photo.original is None for photo in photos.photos):
        return None
    return photos.model_copy(update={"photos": tuple(map(_original, photos.photos))})


def _original(photo: Photo) -> Photo:
    if photo.original is None or photo.scan is not None:
        return photo
    # Integers are centres of pixels.
    across, down = photo.width / photo.original[0], photo.height / photo.original[1]
    return photo.model_copy(update={"scan": (0.5 * across - 0.5, across, 0.0, 0.5 * down - 0.5, 0.0, down)})


def _finding(control: Control, photos: Photos) -> MeasurementsOfOriginals | None:
    """None where so few measurements lie outside of the photographs that their lines are wrong."""
    measured = [(name, col, row) for point in control.points for name, (col, row, _) in point.measurements.items()]
    outside = [name for name, col, row in measured if not photos[name].holds(col, row)]
    if len(outside) < max(2.0, LEAST_OUTSIDE * len(measured)):
        return None
    photo = photos[outside[0]]
    if photo.original is None:
        return None
    return MeasurementsOfOriginals(
        measurements=len(measured), outside=len(outside), original=photo.original, reduced=(photo.width, photo.height)
    )
