"""Which mark is wrong: data snooping over marks and coordinates, one after the other, and what a wrong mark was meant to be.

The alternative that explains most is taken first: one mark off by two numbers, or the coordinates of one point off by three. It is
taken out, and the rest is tested again, for a gross error spreads into everything near it. At the end whatever agrees with the rest
after all is taken back.

Source: Baarda 1968.
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.tasks.adjustment.model.network import Rays
from orthomill.tasks.marking.belief import Belief
from orthomill.tasks.marking.mark_solution import MarkSolution, solved
from orthomill.tasks.marking.ray_meeting import MarkedRays

FALSE_ALARM = 0.003
"""Probability that anything at all is named although nothing is wrong."""
MOST_WRONG = 40
"""Wrong marks that are looked for, at most this share (per cent) of all."""
PER_NUMBER = 4.0
"""What an additional number of an alternative has to explain, in squares of standard errors."""
ALIKE = 0.995
"""Two marks whose tests have this ratio cannot be told apart."""
MEDIAN_TEST = 1.177
"""Median length of a two-dimensional normal vector, in standard errors."""
ENOUGH = 12
"""Tested marks from which their usual size tells the true standard error of a mark."""


@dataclass(frozen=True, eq=False)
class Contradiction:
    """A ray (its number in the marks as given) or, where it is -1, the coordinates of a point, with its test value, how far it is
    off (px), and the rays that may be meant instead."""

    ray: int
    point: int
    test: float
    off: np.ndarray | None
    others: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class Examined:
    """The solution without what is wrong; `wrong`, the worst first; `limit` of the tests; `unit`: by how much marks scatter more
    than stated; `tests` and `off` of all marks (M,), (M, 2), those of wrong ones against the rest."""

    solution: MarkSolution
    wrong: tuple[Contradiction, ...]
    limit: float
    unit: float
    tests: np.ndarray
    off: np.ndarray
    residual: np.ndarray


def examined(belief: Belief, marked: MarkedRays) -> Examined:
    """The marks of a block examined."""
    count = len(marked.rays)
    limit = float(np.sqrt(-2.0 * np.log(FALSE_ALARM / max(count, 1))))
    dropped, freed = np.zeros(count, bool), np.zeros(len(marked.known), bool)
    first = solved(belief, marked)
    start = first.start
    found: list[Contradiction] = []
    unit = 1.0
    solution = first
    while True:
        unit = usual_size(solution.mark_tests[0])
        worst = _worst(solution, marked.rays, dropped, limit * unit)
        if worst is None or len(found) >= max(2, MOST_WRONG * count // 100):
            break
        found.append(worst)
        if worst.ray >= 0:
            dropped[worst.ray] = True
        else:
            freed[worst.point] = True
        solution = _without(belief, marked, dropped, freed, start)
    found, dropped = _taken_back(belief, marked, found, (dropped, freed), start, limit * unit)
    solution = _without(belief, marked, dropped, freed, start)
    return _with_tests(belief, marked, solution, (found, dropped, freed), (limit, unit), start)


def usual_size(tests: np.ndarray) -> float:
    """By how much marks scatter more than stated: from the median of their tests; 1 for few of them, or where they do not."""
    checked = tests[np.isfinite(tests)]
    return max(1.0, float(np.median(checked)) / MEDIAN_TEST) if len(checked) >= ENOUGH else 1.0


def _without(belief: Belief, marked: MarkedRays, dropped: np.ndarray, freed: np.ndarray, start: np.ndarray) -> MarkSolution:
    known = np.where(freed[:, None], np.nan, marked.known)
    left = replace(marked, known=known).without(dropped)
    # A point that keeps no two rays and no coordinates has no place.
    rays = np.bincount(left.rays.point, minlength=len(known))
    return solved(belief, left, np.where((np.isfinite(known).all(axis=1) | (rays >= 2))[:, None], start, np.nan))


def _numbers(solution: MarkSolution, rays: Rays, dropped: np.ndarray) -> np.ndarray:
    """The numbers, among the marks as given, of those of a solution."""
    kept = np.flatnonzero(~dropped)
    return kept[np.isfinite(solution.start).all(axis=1)[rays.point[kept]]]


def _worst(solution: MarkSolution, rays: Rays, dropped: np.ndarray, limit: float) -> Contradiction | None:
    tests, off = solution.mark_tests
    number = _numbers(solution, rays, dropped)
    best, chosen = -np.inf, None
    sizes = np.nan_to_num(tests)
    if len(sizes) and sizes.max() > limit:
        i = int(sizes.argmax())
        point = solution.marked.rays.point[i]
        same = np.flatnonzero((solution.marked.rays.point == point) & (sizes > ALIKE * sizes[i]))
        others = tuple(int(number[j]) for j in same if j != i)
        best = sizes[i] ** 2 - 2 * PER_NUMBER
        chosen = Contradiction(int(number[i]), int(point), float(sizes[i]), off[i], others)
    for point in np.unique(solution.marked.rays.point):
        if solution.free[point]:
            continue
        square, _ = solution.alternative(solution.B[:, point])
        explained = square - 3 * PER_NUMBER
        if square > limit**2 + PER_NUMBER and explained > best:
            best, chosen = explained, Contradiction(-1, int(point), float(np.sqrt(square)), None)
    return chosen


def _taken_back(
    belief: Belief,
    marked: MarkedRays,
    found: list[Contradiction],
    out: tuple[np.ndarray, np.ndarray],
    start: np.ndarray,
    limit: float,
) -> tuple[list[Contradiction], np.ndarray]:
    """What contradicts everything that is left, and the marks (M,) bool that do."""
    dropped, freed = out
    kept: list[Contradiction] = []
    for one in found:
        if one.ray >= 0 and len([other for other in found if other.ray >= 0]) > 1:
            test, _ = _against_rest(belief, marked, one.ray, (dropped, freed), start)
            if np.isfinite(test) and test < limit:
                dropped = dropped.copy()
                dropped[one.ray] = False
                continue
        kept.append(one)
    return kept, dropped


def _against_rest(
    belief: Belief, marked: MarkedRays, ray: int, out: tuple[np.ndarray, np.ndarray], start: np.ndarray
) -> tuple[float, np.ndarray]:
    """The test value of one dropped mark against all that is left, and how far it is off (2,) px."""
    alone = out[0].copy()
    alone[ray] = False
    solution = _without(belief, marked, alone, out[1], start)
    at = np.flatnonzero(_numbers(solution, marked.rays, alone) == ray)
    if not len(at):
        return np.nan, np.full(2, np.nan)
    tests, off = solution.mark_tests
    return float(tests[at[0]]), off[at[0]]


def _with_tests(
    belief: Belief,
    marked: MarkedRays,
    solution: MarkSolution,
    out: tuple[list[Contradiction], np.ndarray, np.ndarray],
    limits: tuple[float, float],
    start: np.ndarray,
) -> Examined:
    found, dropped, freed = out
    count = len(marked.rays)
    tests, off, residual = np.full(count, np.nan), np.full((count, 2), np.nan), np.full((count, 2), np.nan)
    number = _numbers(solution, marked.rays, dropped)
    tests[number], off[number] = solution.mark_tests
    residual[number] = solution.residual
    final = []
    for one in found:
        if one.ray >= 0:
            test, away = _against_rest(belief, marked, one.ray, (dropped, freed), start)
            if np.isfinite(test):
                one = replace(one, test=test, off=away)
                tests[one.ray], off[one.ray], residual[one.ray] = test, away, away
        final.append(one)
    return Examined(solution, tuple(sorted(final, key=lambda one: -one.test)), *limits, tests, off, residual)
