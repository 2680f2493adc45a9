"""Marks of control that are not counted as those of the photographs are: rows from below, copies of another size, frames that were
turned, or both.

Such lists stay inside of the photographs, so that nothing refuses them; but the rays of a point do not meet. Each way of counting
is tried on the model of the tie points, in pictures of every size: the one in which the rays meet far better than as they were read
is the cause. The size is no plain factor where programs reduce pictures to so many pixels.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from orthomill.schemas.observations import ControlPoint
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.geometry.camera_change import file_size, turned_pixels

CLEARLY = 5.0
"""times as well as they were read, and as in the second best way: marks of any quality meet by chance in one of many ways"""
MOST = 20.0
"""times as large or small as the photographs: other sizes of the pictures in which marks were made"""
STEP = 0.02
"""between the sizes that are tried, natural logarithm: marks of a frame of 1000 px then miss by 10 px at most"""
SAME = 0.1
"""difference of sizes, natural logarithm, below which both are the same way: the rays meet nearly as well beside the right one"""
UNCHANGED = 0.002
"""natural logarithm of a factor: nobody makes copies that are smaller by two pixels in a thousand"""

_Count = Callable[[Photo, float, float], tuple[float, float]]
_Scatter = Callable[[list[ControlPoint]], float]
_Mark = tuple[str, tuple[float, float, float]]


class MarkFrame(NamedTuple):
    """A way in which marks may be counted: `change` in words for the one who corrects the list, empty where nothing is turned."""

    counted: str
    change: str
    pixel: _Count


class FoundFrame(NamedTuple):
    """The way of counting in which marks meet: `factor`, by which pixels as they were read become those of the photographs before
    they are turned; how well the marks meet as they were `given` and as they are `found`, in the unit of the scatter."""

    frame: MarkFrame
    factor: float
    given: float
    found: float


AS_READ = MarkFrame("", "", lambda p, c, r: (c, r))
MIRRORED = (
    MarkFrame("from the lower left corner", "replace every row by height - 1 - row", lambda p, c, r: (c, p.height - 1 - r)),
    MarkFrame("from the upper right corner", "replace every column by width - 1 - column", lambda p, c, r: (p.width - 1 - c, r)),
    MarkFrame("with the row before the column", "exchange the two", lambda p, c, r: (r, c)),
)
TURNED = (
    MarkFrame(
        "from the lower right corner",
        "replace them by width - 1 - column and height - 1 - row",
        lambda p, c, r: (p.width - 1 - c, p.height - 1 - r),
    ),
    MarkFrame(
        "in the photographs turned right by a quarter",
        "replace them by row and height - 1 - column",
        lambda p, c, r: (r, p.height - 1 - c),
    ),
    MarkFrame(
        "in the photographs turned left by a quarter",
        "replace them by width - 1 - row and column",
        lambda p, c, r: (p.width - 1 - r, c),
    ),
)
FILES = MarkFrame(
    "in the files as they are before EXIF turns them",
    "turn them as EXIF turns each photograph (orthomill counts in the photograph as programs show it)",
    lambda p, c, r: tuple(turned_pixels(np.array([(c, r)]), p.exif_orientation, file_size(p))[0].tolist()),
)


def explaining_frame(points: list[ControlPoint], photos: Photos, scatter: _Scatter) -> FoundFrame | None:
    """The way of counting in which the marks of `points` meet; None where they meet no better in any.

    `scatter`: the standard error of marks by how the rays of the points miss each other, in any unit; 0 where it cannot be told.
    """
    marked = {name for point in points for name in point.measurements}
    # The turns of photographs that EXIF turns are those of their files.
    by_exif = any(photos[name].exif_orientation != 1 for name in marked)
    frames = (AS_READ, FILES, *MIRRORED) if by_exif else (AS_READ, *MIRRORED, *TURNED)
    given = scatter(points)
    tried = sorted(
        (size, step, number) for number, frame in enumerate(frames) for size, step in _sizes(points, photos, frame, scatter)
    )
    if not tried:
        return None
    _, step, number = tried[0]
    others = [size for size, at, k in tried if k != number or abs(at - step) > SAME]
    factor, found = _refined(points, photos, frames[number], scatter, step)
    if CLEARLY * found > min([given, *others[:1]]):
        return None
    return FoundFrame(frames[number], factor, given, found)


def recounted(points: Iterable[ControlPoint], photos: Photos, found: FoundFrame) -> tuple[ControlPoint, ...]:
    """The points with their marks as those of the photographs; marks that lie outside of these then are left out."""
    changed = (_with_marks(point, _marks(point, photos, found.frame, found.factor)) for point in points)
    return tuple(_with_marks(p, ((n, m) for n, m in p.measurements.items() if photos[n].holds(*m[:2]))) for p in changed)


def _sizes(points: list[ControlPoint], photos: Photos, frame: MarkFrame, scatter: _Scatter) -> Iterator[tuple[float, float]]:
    """The scatter of the marks at each size of the pictures that holds them, and the size, natural logarithm of the factor."""
    count = round(np.log(MOST) / STEP)
    for step in STEP * np.arange(-count, count + 1):
        changed = _counted(points, photos, frame, float(np.exp(step)))
        size = scatter(changed) if changed else 0.0
        if size > 0.0:
            yield size, float(step)


def _refined(points: list[ControlPoint], photos: Photos, frame: MarkFrame, scatter: _Scatter, step: float) -> tuple[float, float]:
    """The factor beside a step at which the marks meet best, and how well."""

    def missed(at: float) -> float:
        changed = _counted(points, photos, frame, float(np.exp(at)))
        return (scatter(changed) if changed else 0.0) or np.inf

    best = minimize_scalar(missed, bounds=(step - STEP, step + STEP), method="bounded", options={"xatol": 1e-5})
    at = 0.0 if abs(best.x) < UNCHANGED else float(best.x)
    return float(np.exp(at)), float(missed(at))


def _counted(points: list[ControlPoint], photos: Photos, frame: MarkFrame, factor: float) -> list[ControlPoint]:
    """The points with marks as the frame counts them; none where it puts a mark outside of its photograph."""
    changed = [tuple(_marks(point, photos, frame, factor)) for point in points]
    if not all(photos[name].holds(col, row) for marks in changed for name, (col, row, _) in marks):
        return []
    return [_with_marks(point, marks) for point, marks in zip(points, changed, strict=True)]


def _with_marks(point: ControlPoint, marks: Iterable[_Mark]) -> ControlPoint:
    return point.model_copy(update={"measurements": dict(marks)})


def _marks(point: ControlPoint, photos: Photos, frame: MarkFrame, factor: float) -> Iterator[_Mark]:
    for name, (col, row, sigma) in point.measurements.items():
        # Integers are centres of pixels.
        yield name, (*frame.pixel(photos[name], (col + 0.5) * factor - 0.5, (row + 0.5) * factor - 0.5), sigma)
