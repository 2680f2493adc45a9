"""Control measured in photographs that were reduced afterwards: the list holds pixels of the originals.

Nothing in a list says which pixels are meant. But where measurements lie outside of the photographs, and all of them inside of what
the tags say that the camera wrote, they are those of the originals: wrong lines are few, and lie anywhere. Where no tag tells the
originals, or the measurements fill only a part of these (photographs that were reduced twice), a plain factor that puts all of them
inside, and some near the border, is the one by which they were reduced.
"""

from collections.abc import Callable
from typing import TypeVar

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.findings.control_findings import MeasurementsOfOriginals, MeasurementsReduced
from orthomill.schemas.observations import Control
from orthomill.schemas.photo import Photo, Photos

LEAST_OUTSIDE = 0.2
"""Share of the measurements that lie outside of the photographs as they are: points that fill the frame of photographs reduced by a
tenth"""

FACTORS = (1.25, 4.0 / 3.0, 1.5, 1.6, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 16.0, 20.0)
"""by which people reduce photographs"""
FILLED = 0.85
"""of the frame that measurements must reach: ten of them anywhere in the frame do so in 19 of 20 cases"""
ENOUGH = 6
"""measurements, below which wrong lines are as likely"""

_T = TypeVar("_T")


def read_in_frame(
    photos: Photos, read: Callable[[Photos], _T], control_of: Callable[[_T], Control]
) -> tuple[_T, Photos, tuple[MeasurementsOfOriginals | MeasurementsReduced, ...]]:
    """What `read` finds in a text on the photographs, the photographs in whose pixels it is, and that these are the originals.

    Raises WorkflowError where neither the photographs nor their originals hold the measurements, and where these are no pixels.
    """
    try:
        found = read(photos)
        _require_pixels(control_of(found))
        return found, photos, ()
    except WorkflowError as refused:
        before, divided = _originals(photos), _reduced(photos, read, control_of)
        if divided is not None and (before is None or divided[2] < FILLED * _least_reduction(photos)):
            found, frame, factor = divided
            return found, frame, (_about_factor(control_of(found), photos, factor),)
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


def _require_pixels(control: Control) -> None:
    """Raises WorkflowError where all measurements lie in one corner pixel: they are shares of the frame."""
    places = [place for point in control.points for place in point.measurements.values()]
    if len(places) >= ENOUGH and all(-0.5 <= value <= 1.0 for col, row, _ in places for value in (col, row)):
        raise WorkflowError(
            f"All {len(places)} control measurements lie within the first pixel of their photographs: they seem to be shares of "
            "the width and height, from 0 to 1; multiply them by the numbers of columns and rows."
        )


def _originals(photos: Photos) -> Photos | None:
    """The photographs, with pixels of their originals as those of their files; None where none was reduced."""
    if all(photo.original is None for photo in photos.photos):
        return None
    return photos.model_copy(update={"photos": tuple(map(_original, photos.photos))})


def _least_reduction(photos: Photos) -> float:
    """By which factor the photographs that were reduced least are smaller than what the camera wrote."""
    return min(photo.original[0] / photo.width for photo in photos.photos if photo.original is not None)


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


def _about_factor(control: Control, photos: Photos, factor: float) -> MeasurementsReduced:
    measured = [(photos[name], col, row) for point in control.points for name, (col, row, _) in point.measurements.items()]
    outside = sum(not photo.holds(col, row) for photo, col, row in measured)
    return MeasurementsReduced(measurements=len(measured), outside=outside, factor=factor)


def _divided(photos: Photos, factor: float) -> Photos:
    """The photographs, with pixels of pictures `factor` times as large as those of their files."""
    shrunk = 1.0 / factor
    scan = (0.5 * shrunk - 0.5, shrunk, 0.0, 0.5 * shrunk - 0.5, 0.0, shrunk)
    return photos.model_copy(
        update={"photos": tuple(p if p.scan is not None else p.model_copy(update={"scan": scan}) for p in photos.photos)}
    )


def _reduced(photos: Photos, read: Callable[[Photos], _T], control_of: Callable[[_T], Control]) -> tuple[_T, Photos, float] | None:
    """What `read` finds on photographs that were reduced by the least plain factor that holds all measurements; None without
    one."""
    try:
        anywhere = control_of(read(_divided(photos, FACTORS[-1] * 2.0)))
    except WorkflowError:
        return None
    measured = [(photos[name], col, row) for point in anywhere.points for name, (col, row, _) in point.measurements.items()]
    outside = [photo for photo, col, row in measured if not photo.holds(col, row)]
    if len(measured) < ENOUGH or len(outside) < LEAST_OUTSIDE * len(measured):
        return None
    needed = max(max((col + 0.5) / photo.width, (row + 0.5) / photo.height) for photo, col, row in measured)
    factor = next((factor for factor in FACTORS if factor >= needed), None)
    # Where measurements end far from the border of the next plain factor, another may be the right one.
    if factor is None or needed < FILLED * factor:
        return None
    frame = _divided(photos, factor)
    try:
        return read(frame), frame, factor
    except WorkflowError:
        return None
