"""Check points that differ by themselves: errors of the survey, or of one place of a product, while all others fit.

One wrong point of six makes differences thirty times as large as promised, and says nothing of what is promised.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import sqrt

from orthomill.schemas.accuracy.accuracy_statement import AccuracyKind
from orthomill.schemas.accuracy.point_tests import HeightTest, PointTest, PointTests

ALONE = 4.0
"""Promised standard errors by which a single point is told to differ."""
REALISTIC = 2.0
"""Differences this many times their promised standard errors contradict the promise."""
_MOST = 3
"""One of so many points may be wrong by itself; of more nobody can say that the others fit."""


@dataclass(frozen=True)
class SinglePoint:
    """A height at a check point that is off, m, and by how many promised standard errors, while those of all others fit."""

    name: str
    difference: float
    times: float


def single_points(tests: PointTests, kind: AccuracyKind) -> tuple[SinglePoint, ...]:
    """The points of a figure of heights that differ by themselves; none where the others do not fit without them."""
    known = [
        SinglePoint(point.name, difference, abs(difference) / promised)
        for point, height in heights_of(tests, kind)
        if (difference := point.difference(height)) is not None and (promised := point.predicted(height))
    ]
    found = tuple(one for one in known if one.times > ALONE)
    rest = [one.times for one in known if one.times <= ALONE]
    if len(found) * _MOST > len(known) or not rest or sqrt(sum(times**2 for times in rest) / len(rest)) > REALISTIC:
        return ()
    return found


def heights_of(tests: PointTests, kind: AccuracyKind) -> Iterator[tuple[PointTest, HeightTest | None]]:
    """The points of a figure with their tests; none for those in plan and in space."""
    for point in tests.points:
        if kind == ("vva" if point.vegetated else "nva"):
            yield point, point.height
        elif kind == ("vva_terrain" if point.vegetated else "nva_terrain"):
            yield point, point.terrain
