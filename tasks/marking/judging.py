"""From marks by name to arrays and back: the judgement of all marks, and the photographs that should show a point."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from orthomill.schemas.marks import ExpectedSight, MarkedPoint, MarkJudgement, Marks, MarkVerdict, PlacedPoint, WrongMark
from orthomill.tasks.adjustment.model.network import Rays
from orthomill.tasks.marking.belief import Belief
from orthomill.tasks.marking.mark_solution import MarkSolution, solved
from orthomill.tasks.marking.ray_meeting import MarkedRays, ray_directions
from orthomill.tasks.marking.wrong_marks import Contradiction, examined

NEAR = 3.0
"""Standard errors, and px, within which a wrong mark is taken for one of another point."""
MARGIN = 0.1
"""Share of its longer side by which a photograph may miss a point whose place is rough, and still be offered."""


@dataclass(frozen=True, eq=False)
class NumberedMarks:
    """Marks in the numbers of a belief: points (N,) by name, `photo` and `point` of each ray by name."""

    points: tuple[MarkedPoint, ...]
    marked: MarkedRays
    names: tuple[tuple[str, str], ...]
    """point and photo of each ray"""
    assumed: np.ndarray
    """(N,) bool: coordinates that stand for the height of the ground below, not for a survey"""


def numbered(belief: Belief, points: tuple[MarkedPoint, ...], all_known: bool = False) -> NumberedMarks:
    """Points with marks in the numbers of a belief; `all_known`: coordinates count whatever the role, as for a prediction."""
    number = belief.number
    rows = sorted((i, number[photo], photo) for i, point in enumerate(points) for photo in point.marks if photo in number)
    xy, sigma = np.zeros((len(rows), 2)), np.ones(len(rows))
    for n, (i, p, photo) in enumerate(rows):
        camera, mark = belief.camera_of(p), points[i].marks[photo]
        xy[n] = mark.col - (camera.width - 1) / 2, (camera.height - 1) / 2 - mark.row
        sigma[n] = mark.sigma
    rays = Rays(np.array([row[0] for row in rows], np.int32), np.array([row[1] for row in rows], np.int32), xy, sigma)
    known, spread, assumed = _coordinates(belief, points, rays, all_known)
    return NumberedMarks(points, MarkedRays(rays, known, spread), tuple((points[i].name, photo) for i, _, photo in rows), assumed)


def _coordinates(
    belief: Belief, points: tuple[MarkedPoint, ...], rays: Rays, all_known: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    known, spread = np.full((len(points), 3), np.nan), np.ones((len(points), 3))
    assumed = np.zeros(len(points), bool)
    count = np.bincount(rays.point, minlength=len(points))
    for i, point in enumerate(points):
        if point.xyz is not None and (point.known or (all_known and point.role != "unused")):
            known[i], spread[i] = np.array(point.xyz) - belief.offset, point.sigma
        elif count[i] == 1:
            # One ray and the height of the ground: where to look for the second one.
            ray = int(np.flatnonzero(rays.point == i)[0])
            known[i], spread[i] = _on_ground(belief, rays, ray)
            assumed[i] = True
    return known, spread, assumed


def _on_ground(belief: Belief, rays: Rays, ray: int) -> tuple[np.ndarray, float]:
    direction = ray_directions(belief, rays.photo[[ray]], rays.xy[[ray]])[0]
    centre = belief.state.centre[rays.photo[ray]]
    height, sigma = belief.ground
    steep = direction[2] < -0.1
    along = (height - centre[2]) / direction[2] if steep else abs(centre[2] - height) * 2.0
    return centre + direction * along, max(sigma / max(-direction[2], 0.1), 0.02 * along)


def judged(belief: Belief, marks: Marks) -> MarkJudgement:
    """All marks of points that take part, against the belief and each other."""
    points = tuple(point for point in marks.points if point.role != "unused" and point.marks)
    table = numbered(belief, points)
    if not len(table.marked.rays):
        return MarkJudgement((), (), (), 4.0, 1.0)
    found = examined(belief, table.marked)
    verdicts = tuple(
        MarkVerdict(point, photo, _flipped(found.residual[i]) or (0.0, 0.0), _number(found.tests[i]), _flipped(found.off[i]))
        for i, (point, photo) in enumerate(table.names)
        if np.isfinite(found.residual[i]).all()
    )
    solution = found.solution
    wrong = tuple(_named(one, table, belief, solution, found.wrong) for one in found.wrong)
    return MarkJudgement(verdicts, wrong, tuple(_places(table, solution, belief)), found.limit, found.unit)


def _named(
    one: Contradiction, table: NumberedMarks, belief: Belief, solution: MarkSolution, all_wrong: tuple[Contradiction, ...]
) -> WrongMark:
    name = table.points[one.point].name
    if one.ray < 0:
        return WrongMark(name, None, one.test)
    photo = table.names[one.ray][1]
    others = tuple(table.names[ray][1] for ray in one.others)
    instead = _meant(one, table, solution)
    return WrongMark(
        name,
        photo,
        one.test,
        _flipped(one.off) if one.off is not None else None,
        others,
        None if instead is None else table.points[instead].name,
        instead is not None and _has_mark_of(one, instead, table, all_wrong),
    )


def _meant(one: Contradiction, table: NumberedMarks, solution: MarkSolution) -> int | None:
    """The point at whose place a wrong mark lies; None for none."""
    rays = table.marked.rays
    nearest, least = None, np.inf
    for point in np.flatnonzero(np.isfinite(solution.start).all(axis=1)):
        if point == one.point:
            continue
        seen = solution.predicted(int(point), rays.photo[[one.ray]])
        away = rays.xy[one.ray] - seen.xy[0]
        spread = seen.covariance[0] + (rays.sigma[one.ray] ** 2 + NEAR) * np.eye(2)
        size = float(np.sqrt(away @ np.linalg.solve(spread, away))) if np.isfinite(away).all() else np.inf
        if size < min(NEAR, least):
            nearest, least = int(point), size
    return nearest


def _has_mark_of(one: Contradiction, instead: int, table: NumberedMarks, all_wrong: tuple[Contradiction, ...]) -> bool:
    """Whether the point that a wrong mark belongs to has a wrong mark in the same photograph: two names were exchanged."""
    photo = table.marked.rays.photo[one.ray]
    return any(other.ray >= 0 and other.point == instead and table.marked.rays.photo[other.ray] == photo for other in all_wrong)


def _places(table: NumberedMarks, solution: MarkSolution, belief: Belief) -> Iterator[PlacedPoint]:
    places = solution.places
    for i, point in enumerate(table.points):
        if not np.isfinite(places[i]).all() or table.assumed[i]:
            continue
        covariance = solution.covariance_of(i)
        x, y, z = map(float, places[i] + belief.offset)
        away = predicted = None
        if point.xyz is not None:
            away = tuple(map(float, places[i] + belief.offset - np.array(point.xyz)))
            given = np.array(point.sigma) ** 2
            own = np.diag(covariance)
            # Of a control point: that of its residual, of a check point: that of two independent values.
            both = np.maximum(given - own, 0.0) if not solution.free[i] else given + own
            predicted = tuple(map(float, np.sqrt(both)))
        sx, sy, sz = map(float, np.sqrt(np.maximum(np.diag(covariance), 0.0)))
        yield PlacedPoint(point.name, (x, y, z), (sx, sy, sz), away, predicted)  # type: ignore[arg-type]


def sights(belief: Belief, marks: Marks, name: str, sigma: float = 0.5) -> tuple[ExpectedSight, ...]:
    """The photographs without a mark of this point that should show it, those first whose mark would gain most."""
    placed = _solved_for(belief, marks, name)
    if placed is None:
        return ()
    points, at, found = placed
    own = points[at].marks
    photos = np.array([i for i, photo in enumerate(belief.names) if photo not in own], np.int64)
    seen = found.predicted(at, photos, sigma)
    known: Literal["block", "tags"] = "block" if belief.oriented else "tags"
    before = float(np.sqrt(np.trace(seen.point)))
    out = []
    for n, photo in enumerate(photos):
        camera = belief.camera_of(photo)
        col, row = (camera.width - 1) / 2 + seen.xy[n, 0], (camera.height - 1) / 2 - seen.xy[n, 1]
        inside = min(col, row, camera.width - 1 - col, camera.height - 1 - row) if np.isfinite(col) else -np.inf
        flipped = seen.covariance[n] * np.array([[1.0, -1.0], [-1.0, 1.0]])
        rough = min(float(np.sqrt(np.trace(flipped))), MARGIN * max(camera.width, camera.height) * (1 if belief.oriented else 3))
        if inside > -rough:
            after = float(np.sqrt(max(np.trace(seen.with_mark[n]), 0.0)))
            out.append(ExpectedSight(belief.names[photo], (float(col), float(row)), flipped, known, (before, after), float(inside)))
    return tuple(sorted(out, key=lambda sight: sight.gain[1]))


def _solved_for(belief: Belief, marks: Marks, name: str) -> tuple[tuple[MarkedPoint, ...], int, MarkSolution] | None:
    """The points that take part in a prediction of one, its number among them, and the solution; None where nothing places it."""
    points = tuple(point for point in marks.points if (point.marks and point.role != "unused") or point.name == name)
    at = next(i for i, point in enumerate(points) if point.name == name)
    points = (*points[:at], points[at].model_copy(update={"role": _seen_as(points[at])}), *points[at + 1 :])
    table = numbered(belief, points)
    if not np.isfinite(table.marked.known[at]).all() and not (table.marked.rays.point == at).any():
        return None
    found = examined(belief, table.marked).solution if len(table.marked.rays) else solved(belief, table.marked)
    return (points, at, found) if np.isfinite(found.start[at]).all() else None


def point_place(belief: Belief, marks: Marks, name: str) -> np.ndarray | None:
    """(3,) m in the project's system: a point by its marks and coordinates; None where nothing places it."""
    placed = _solved_for(belief, marks, name)
    return None if placed is None else placed[2].places[placed[1]] + belief.offset


def _seen_as(point: MarkedPoint) -> str:
    """A check point or an unused one is looked for by its coordinates as well, for which it counts as control."""
    return "control" if point.xyz is not None and not point.known else "tie" if point.role == "unused" else point.role


def _flipped(xy: np.ndarray) -> tuple[float, float] | None:
    """(x right, y up) as (col, row); None where it is not known."""
    return (float(xy[0]), -float(xy[1])) if np.isfinite(xy).all() else None


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
