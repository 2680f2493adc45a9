"""Where another point would help most: the worst standard error on the ground, and what surveying a point there would leave of it.

A place on the ground is seen by photographs whose rays intersect there; errors of their orientation move the intersection by M
times these errors. A surveyed point says that the intersection at its place is right, to its own precision, and so lessens what is
left everywhere else: a step of the conditioning of Gaussian errors, whose size is that of the places that are looked at, not of the
block.

Source: Schmidt 1966 for conditioning; the criterion, the largest of all standard errors, is that of Grafarend's first-order design.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.marks import Marks, NextPoint
from orthomill.tasks.marking.belief import Belief
from orthomill.tasks.marking.judging import numbered
from orthomill.tasks.marking.mark_solution import pushed_intersection
from orthomill.tasks.marking.target_points import belief_views
from orthomill.tasks.marking.wrong_marks import examined

SIDE = 13
"""places looked at along the longer side of the block"""
LEAST_SEEN = 2
SURVEYED = (0.02, 0.02, 0.03)
"""m: standard errors of a point that is surveyed"""
MARKED = 0.5
"""px: of its marks"""
BORDER = 0.03
"""Share of a photograph's longer side at its border where points are not planned."""


@dataclass(frozen=True, eq=False)
class SeenPlaces:
    """Places (k, 3) m, local, how many photographs see each (k,), the derivatives M (3k, n) of their intersections by the unknowns
    of the block, and the covariances (k, 3, 3) m^2 that marks of 0.5 px leave."""

    place: np.ndarray
    seen: np.ndarray
    moves: np.ndarray
    by_marks: np.ndarray


def next_points(belief: Belief, marks: Marks, count: int = 3) -> tuple[NextPoint, ...]:
    """The `count` places where another control point lessens the largest standard error on the ground most, one after the other,
    and last the place of the largest one that is left, for a check point. Empty where no two photographs see the ground."""
    places = seen_places(belief)
    if not len(places.place):
        return ()
    D = places.moves @ (_with_marks(belief, marks) @ places.moves.T)
    out, free = [], list(range(len(places.place)))
    # Nobody surveys one place twice, though that would count as another measurement of its rays.
    for _ in range(min(count, len(free))):
        before = _largest(D)
        left = {at: _largest(_conditioned(D, places, at)) for at in free}
        best = min(free, key=left.__getitem__)
        free.remove(best)
        out.append(_next(belief, places, best, "control", before, left[best]))
        D = _conditioned(D, places, best)
    worst = int(np.argmax(_sizes(D)))
    out.append(_next(belief, places, worst, "check", _largest(D), _largest(D)))
    return tuple(out)


def seen_places(belief: Belief) -> SeenPlaces:
    """A grid on the ground below the block, where two photographs or more see it."""
    views = belief_views(belief)
    centre = belief.state.centre
    height = max(float(np.median(centre[:, 2])) - belief.ground[0], 1.0)
    reach = 0.5 * height * max(camera.width for camera in belief.cameras) / min(camera.c for camera in belief.cameras)
    low, high = centre[:, :2].min(axis=0) - reach, centre[:, :2].max(axis=0) + reach
    step = float((high - low).max()) / SIDE
    x, y = np.meshgrid(*(np.arange(a + step / 2, b, step) for a, b in zip(low, high, strict=True)))
    grid = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, belief.ground[0])])
    inside = np.array([view.contains(view.project(grid), BORDER * max(view.camera.width, view.camera.height)) for view in views])
    kept = np.flatnonzero(inside.sum(axis=0) >= LEAST_SEEN)
    moves, spread, good = [], [], []
    for at in kept:
        found = pushed_intersection(belief, grid[at], np.flatnonzero(inside[:, at]), MARKED)
        if found is not None:
            moves.append(found[0])
            spread.append(found[1])
            good.append(at)
    n = belief.network.unknowns
    return SeenPlaces(
        grid[good],
        inside.sum(axis=0)[good],
        np.concatenate(moves) if moves else np.zeros((0, n)),
        np.array(spread).reshape(-1, 3, 3),
    )


def _with_marks(belief: Belief, marks: Marks) -> np.ndarray:
    """(n, n) the covariance of the block with the marks that there are."""
    points = tuple(point for point in marks.points if point.marks and point.role not in ("unused", "check"))
    table = numbered(belief, points)
    if not len(table.marked.rays):
        return belief.covariance
    solution = examined(belief, table.marked).solution
    return belief.covariance - solution.carried @ solution.weight @ solution.carried.T


def _conditioned(D: np.ndarray, places: SeenPlaces, at: int) -> np.ndarray:
    own = slice(3 * at, 3 * at + 3)
    spread = D[own, own] + places.by_marks[at] + np.diag(np.square(SURVEYED))
    return D - D[:, own] @ np.linalg.solve(spread, D[own])


def _sizes(D: np.ndarray) -> np.ndarray:
    """(k,) standard errors of the places in space, m."""
    return np.sqrt(np.maximum(np.diag(D).reshape(-1, 3).sum(axis=1), 0.0))


def _largest(D: np.ndarray) -> float:
    return float(_sizes(D).max())


def _next(belief: Belief, places: SeenPlaces, at: int, role: str, before: float, after: float) -> NextPoint:
    x, y, z = map(float, places.place[at] + belief.offset)
    return NextPoint("check" if role == "check" else "control", (x, y, z), int(places.seen[at]), before, after)
