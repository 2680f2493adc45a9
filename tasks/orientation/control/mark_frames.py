"""Marks of control that are not counted as those of the photographs are: rows from below, copies of another size, frames that were
turned.

Such lists stay inside of the photographs, so that nothing refuses them; but the rays of a point do not meet. Each way of counting
is tried on the model of the tie points: the one in which the rays meet far better than as they were read is the cause.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

from orthomill.schemas.observations import ControlPoint
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.orientation.control.reduced_photographs import FACTORS

CLEARLY = 5.0
"""times as well as they were read, and as the second best way: marks of any quality meet by chance in one of many ways"""

_Count = Callable[[Photo, float, float], tuple[float, float]]


class MarkFrame(NamedTuple):
    """A way in which marks may have been counted: `change` in words for the one who corrects the list."""

    counted: str
    change: str
    pixel: _Count


def _scaled(factor: float) -> _Count:
    # Integers are centres of pixels.
    return lambda _, col, row: ((col + 0.5) * factor - 0.5, (row + 0.5) * factor - 0.5)


TURNED = (
    MarkFrame("from the lower left corner", "replace every row by height - 1 - row", lambda p, c, r: (c, p.height - 1 - r)),
    MarkFrame("from the upper right corner", "replace every column by width - 1 - column", lambda p, c, r: (p.width - 1 - c, r)),
    MarkFrame(
        "from the lower right corner",
        "replace them by width - 1 - column and height - 1 - row",
        lambda p, c, r: (p.width - 1 - c, p.height - 1 - r),
    ),
    MarkFrame("with the row before the column", "exchange the two", lambda p, c, r: (r, c)),
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
REDUCED = tuple(
    MarkFrame(f"in copies reduced by {factor:.4g}", f"multiply columns and rows by {factor:.4g}", _scaled(factor))
    for factor in FACTORS
)


def explaining_frame(
    points: list[ControlPoint], photos: Photos, frames: tuple[MarkFrame, ...], scatter: Callable[[list[ControlPoint]], float]
) -> tuple[MarkFrame, float, float] | None:
    """The one of `frames` in which the marks of `points` meet, and how well as they were read and in it; None where they meet no
    better in any.

    `scatter`: the standard error of marks by how the rays of the points miss each other, in any unit; 0 where it cannot be told.
    """
    given = scatter(points)
    tried = (
        (scatter(changed), number) for number, changed in enumerate(_counted(points, photos, frame) for frame in frames) if changed
    )
    found = sorted((size, number) for size, number in tried if size > 0.0)
    if not found or CLEARLY * found[0][0] > min([given, *(size for size, _ in found[1:2])]):
        return None
    size, number = found[0]
    return frames[number], given, size


def _counted(points: list[ControlPoint], photos: Photos, frame: MarkFrame) -> list[ControlPoint]:
    """The points with marks as the frame counts them; none where it puts a mark outside of its photograph."""
    changed = [point.model_copy(update={"measurements": dict(_marks(point, photos, frame))}) for point in points]
    inside = (photos[name].holds(col, row) for point in changed for name, (col, row, _) in point.measurements.items())
    return changed if all(inside) else []


def _marks(point: ControlPoint, photos: Photos, frame: MarkFrame) -> Iterator[tuple[str, tuple[float, float, float]]]:
    for name, (col, row, sigma) in point.measurements.items():
        yield name, (*frame.pixel(photos[name], col, row), sigma)
