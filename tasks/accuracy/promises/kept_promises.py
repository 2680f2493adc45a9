"""The reliability of promised errors: which share of independent observations lay within 1, 2 and 3 of them, by kind.

Check points took no part. Positions, control and distances did; their residual over its own standard error is, in least squares,
exactly the difference from what all others say without them over the standard error of that (leave-one-out), so that they count
as well. Two pairs of photographs without a common one test each other's heights. Coordinates of one point are not independent: the
interval is that of as many observations as there are points.

Source of the interval: Wilson 1927. Leave-one-out and residuals: Baarda 1968; Cook & Weisberg 1982, 2.2.
"""

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from scipy.special import bdtr

from orthomill.schemas.accuracy.point_tests import PointTests
from orthomill.schemas.accuracy.promised_errors import (
    EXPECTED,
    MULTIPLES,
    KeptPromises,
    PairDifferences,
    PhotographDifferences,
    Reliability,
)
from orthomill.schemas.orientation import GroundResidual, GroundResiduals

_95 = 1.959964
_LEAST = 1e-6
"""m: promised errors below it belong to observations that nothing checks"""
_OF_PHOTOGRAPHS = ("points of one strip, beside those of another", "photographs, left out in turn")
"""by the kind of `PhotographDifferences`"""
_ROLES = (
    ("check", "block at check points", True),
    ("control", "control, left out in turn", False),
    ("position", "GNSS positions, left out in turn", False),
)
_DISTANCES = (("check", "distances to check points", True), ("control", "measured distances, left out in turn", False))


def reliability_of(
    tests: PointTests,
    ground: GroundResiduals,
    pairs: tuple[PairDifferences, ...] = (),
    photographs: PhotographDifferences | None = None,
) -> Reliability:
    """The kinds of which a project has observations."""
    places = [_pairs(p.place_difference, p.place_predicted) for p in tests.points if p.place_difference and p.place_predicted]
    found = [kept(words, True, heights) for words, heights in _heights(tests)]
    found.append(kept("orthoimage at check points", True, places))
    for role, words, independent in _ROLES:
        found.append(kept(words, independent, [_of_residual(r) for r in ground.of_role(role)]))
    for role, words, independent in _DISTANCES:
        lengths = [[(d.difference, d.predicted)] for d in ground.distances if d.role == role]
        found.append(kept(words, independent, lengths))
    heights_of_pairs = [[one] for part in pairs for one in zip(part.difference.tolist(), part.promised.tolist(), strict=True)]
    found.append(kept("heights of disjoint pairs, among neighbours", False, heights_of_pairs))
    if photographs is not None:
        found += [kept(words, False, _groups(photographs, kind)) for kind, words in enumerate(_OF_PHOTOGRAPHS)]
    return Reliability(kinds=tuple(kind for kind in found if kind is not None))


def _heights(tests: PointTests) -> Iterator[tuple[str, list[list[tuple[float | None, float | None]]]]]:
    """Under vegetation a surface shows crowns: of the ground there it promises nothing."""
    open_ground, under = ([p for p in tests.points if p.vegetated == vegetated] for vegetated in (False, True))
    yield "surface at check points", [[(p.difference(p.height), p.predicted(p.height))] for p in open_ground]
    yield "bare ground at check points", [[(p.difference(p.terrain), p.predicted(p.terrain))] for p in open_ground]
    yield "bare ground under vegetation", [[(p.difference(p.terrain), p.predicted(p.terrain))] for p in under]


def _groups(found: PhotographDifferences, kind: int) -> list[list[tuple[float | None, float | None]]]:
    """The (difference, promised) pairs of each group of photographs."""
    own = np.flatnonzero(found.kind == kind)
    own = own[np.argsort(found.group[own], kind="stable")]
    cuts = np.flatnonzero(np.diff(found.group[own])) + 1
    parts = np.split(own, cuts) if len(own) else []
    return [list(zip(found.difference[part].tolist(), found.promised[part].tolist(), strict=True)) for part in parts]


def kept(kind: str, independent: bool, items: Iterable[Sequence[tuple[float | None, float | None]]]) -> KeptPromises | None:
    """One kind from the (difference, promised standard error) pairs of each item, m; None where nothing was promised."""
    known = [[abs(d) / s for d, s in item if d is not None and s is not None and s > _LEAST] for item in items]
    ratios = [np.array(item) for item in known if item]
    if not ratios:
        return None
    every, count = np.concatenate(ratios), len(ratios)
    within = [float((every <= multiple).mean()) for multiple in MULTIPLES]
    bounds = [_wilson(share, count) for share in within]
    return KeptPromises(
        kind=kind,
        independent=independent,
        items=count,
        values=len(every),
        within=_three(within),
        low=_three([low for low, _ in bounds]),
        high=_three([high for _, high in bounds]),
        factor=float(np.quantile(every, EXPECTED[0])),
        chance=float(bdtr(round(within[0] * count), count, EXPECTED[0])),
    )


def _pairs(difference: tuple[float, float], promised: tuple[float, float]) -> list[tuple[float | None, float | None]]:
    return list(zip(difference, promised, strict=True))


def _of_residual(residual: GroundResidual) -> list[tuple[float | None, float | None]]:
    return list(zip(residual.difference, residual.predicted, strict=True))


def _three(values: list[float]) -> tuple[float, float, float]:
    one, two, three = values
    return one, two, three


def _wilson(share: float, count: int) -> tuple[float, float]:
    """95 % confidence interval of a share of `count` observations."""
    middle, square = share + _95**2 / (2 * count), 1 + _95**2 / count
    reach = _95 * math.sqrt(share * (1 - share) / count + (_95 / (2 * count)) ** 2)
    return max(0.0, (middle - reach) / square), min(1.0, (middle + reach) / square)
