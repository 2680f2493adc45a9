"""What contradicts the block: control points, single measurements of them, positions, distances.

A large residual has several explanations. Coordinates are blamed only where all measurements of a point agree, positions together
only where many of them are off, and a distance only where others show which one is wrong.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from orthomill.schemas.findings.block_findings import BlockFinding
from orthomill.schemas.findings.observation_findings import (
    CheckMeasurementsApart,
    ControlContradicted,
    DistanceContradicted,
    DistanceUnchecked,
    MeasurementsRejected,
    Misfit,
    PositionContradicted,
    PositionsAlongView,
    PositionsElsewhere,
)
from orthomill.schemas.observations import Control, ControlPoint
from orthomill.schemas.orientation import DistanceResidual, GroundResidual
from orthomill.tasks.adjustment.model.collinearity import residuals
from orthomill.tasks.adjustment.model.network import Rays
from orthomill.tasks.orientation.block.assembly import BY_CHANCE, BlockResults, Problem, mark_sigma, meeting
from orthomill.tasks.orientation.control.ground_points import approximate_points
from orthomill.tasks.orientation.measurements import ground_rays
from orthomill.tasks.orientation.results.block_results import rays_used
from orthomill.tasks.orientation.results.ground_results import (
    check_distance_rows,
    control_rows,
    distance_rows,
    position_rows,
    stated_distances,
)

AGREES = 3.0
"""What was set aside before the adjustment but lies within this many predicted standard errors of the block is no blunder."""
UNLIKELY = 4.0
"""A distance that misses the block by more of its predicted standard errors is reported."""
LIES_ON = 5.0
"""px: a measurement so near to a point may be meant for it; about the size of a signal on the ground."""
SINGLE = 5
"""More positions than these that were left out are reported together."""
A_FEW = 2
"""Positions from this number on show whether they are off in one direction."""
ACROSS = 0.3
"""Differences along the viewing direction have at most this share of their length across it."""
ENLARGED = 1.01
"""A standard error counts as enlarged from here on; the factors come out of an iteration."""


def contradictions(
    results: BlockResults, points: list[GroundResidual], distances: list[DistanceResidual], control: Control
) -> Iterator[BlockFinding]:
    """All contradictions of a block: `points` and `distances` took no part because of them."""
    yield from _points_left_out(results, points)
    yield from _distances(results, distances, control)
    yield from filter(None, (_distance(row, left_out=False, enlarged=False) for row in check_distance_rows(results, control)))
    yield from _measurements_left_out(results, points)
    if not results.datum.free:
        yield from _check_measurements(results, control)


def contradicting_distances(results: BlockResults, control: Control) -> list[DistanceResidual]:
    """Distances that took no part because they contradict the block."""
    weight = results.result.network.distances.weight
    return [row for row, own in zip(distance_rows(results, control), weight, strict=True) if own == 0]


def contradicting_points(results: BlockResults) -> list[GroundResidual]:
    """Control points and positions that took no part because they contradict the block, with their differences from it."""
    result, problem = results.result, results.problem
    control = {problem.surveyed[i].name for i in np.flatnonzero(~result.network.point_weight[problem.ties :].any(axis=1))}
    positions = {problem.names[i] for i in np.flatnonzero(~result.network.centre_weight.any(axis=1))}
    # Weight 0 means that an observation took no part, whether a test or the start set it aside.
    rows = [row for row in control_rows(results) if row.name in control]
    rows += [row for row in position_rows(results) if row.name in positions]
    tested = {problem.surveyed[b.number - problem.ties].name for b in result.blunders if b.kind == "control"}
    tested |= {problem.names[b.number] for b in result.blunders if b.kind == "position"}
    # The start compares with a rough model; what agrees with the adjusted block was set aside without need.
    return [row for row in rows if row.name in tested or _ratio(row) > AGREES]


def agreeing_positions(results: BlockResults) -> list[str]:
    """The photographs whose positions the start set aside although they agree with the adjusted block."""
    if results.datum.free:
        return []
    aside = {name for name, out in zip(results.problem.names, results.datum.positions_aside, strict=True) if out}
    return [row.name for row in position_rows(results) if row.name in aside and _ratio(row) <= AGREES]


def _ratio(row: GroundResidual) -> float:
    """The largest component of a difference in predicted standard errors."""
    return max(abs(d) / max(s, 1e-9) for d, s in zip(row.difference, row.predicted, strict=True))


def _points_left_out(results: BlockResults, points: list[GroundResidual]) -> Iterator[BlockFinding]:
    positions = [row for row in points if row.role == "position"]
    for row in points:
        if row.role == "control":
            yield ControlContradicted(point=row.name, difference=row.difference, ratio=_ratio(row))
    if len(positions) > A_FEW and (along := _along_the_view(results, positions)):
        yield along
    elif len(positions) > SINGLE:
        away = np.median([row.difference for row in positions], axis=0)
        yield PositionsElsewhere(photos=len(positions), distance_m=float(np.linalg.norm(away)))
    else:
        for row in positions:
            yield PositionContradicted(photo=row.name, difference=row.difference, ratio=_ratio(row))


def _along_the_view(results: BlockResults, positions: list[GroundResidual]) -> PositionsAlongView | None:
    """Positions and control that contradict each other along the viewing direction only: flying height, camera constant and the
    height system trade against each other there."""
    up = results.result.state.rotation[:, 2].mean(axis=0)
    up = up / np.linalg.norm(up)
    away = np.median([row.difference for row in positions], axis=0)
    along = float(away @ up)
    if np.linalg.norm(away - along * up) > ACROSS * abs(along):
        return None
    return PositionsAlongView(photos=len(positions), along_m=along)


def _distances(results: BlockResults, left_out: list[DistanceResidual], control: Control) -> Iterator[BlockFinding]:
    """Distances that were left out, those that miss the block although nothing shows which is wrong, and a scale that nothing
    checks."""
    rows = distance_rows(results, control)
    for row, enlarged in zip(rows, _enlarged(results), strict=True):
        found = _distance(row, row in left_out, bool(enlarged))
        if found:
            yield found
    if results.datum.free and len(rows) - len(left_out) == 1:
        yield DistanceUnchecked()


def _enlarged(results: BlockResults) -> np.ndarray:
    """(D,) bool: distances that took part with larger standard errors than stated, because they contradict each other."""
    sigma, (_, stated) = results.result.network.distances.sigma, stated_distances(results)
    enlarged: np.ndarray = np.isfinite(sigma) & (sigma > ENLARGED * stated * results.result.factors.distance)
    return enlarged


def _distance(row: DistanceResidual, left_out: bool, enlarged: bool) -> DistanceContradicted | None:
    ratio = abs(row.difference) / row.predicted if row.predicted > 0 else 0.0
    if not (enlarged or left_out) and ratio <= UNLIKELY:
        return None
    return DistanceContradicted(
        first=row.first,
        second=row.second,
        length=row.length,
        measured=row.measured,
        difference=row.difference,
        ratio=ratio,
        outcome="downweighted" if enlarged else "excluded" if left_out else "check" if row.role == "check" else "undecided",
    )


def _measurements_left_out(results: BlockResults, points: list[GroundResidual]) -> Iterator[MeasurementsRejected]:
    """Points with single measurements in photographs that took no part, except points that are wrong as a whole."""
    problem, used = results.problem, rays_used(results.problem, results.result)
    size = np.linalg.norm(residuals(results.result.state, problem.rays, problem.camera_of), axis=1)
    wrong = {row.name for row in points}
    for i, point in enumerate(problem.surveyed):
        own = problem.rays.point == problem.ties + i
        rejected = np.flatnonzero(own & ~used)
        if len(rejected) and used[own].any() and point.name not in wrong:
            yield MeasurementsRejected(
                role="control" if point.role == "control" else "tie",
                point=point.name,
                measured=int(own.sum()),
                rejected=tuple(
                    Misfit(
                        photo=problem.names[problem.rays.photo[ray]],
                        misfit_px=_within_frame(problem, int(ray), float(size[ray])),
                        lies_on=_lies_on(results, int(ray)),
                    )
                    for ray in rejected
                ),
            )


def _within_frame(problem: Problem, ray: int, size: float) -> float | None:
    """A misfit in px; None beyond the diagonal of the frame, where the block does not see the point at all."""
    camera = problem.cameras[problem.camera_of[problem.rays.photo[ray]]]
    return size if size < float(np.hypot(camera.width, camera.height)) else None


def _lies_on(results: BlockResults, ray: int) -> str | None:
    """The control point on which a measurement lies that is not its own: it was measured under a wrong name."""
    problem, rays = results.problem, results.problem.rays
    others = [i for i, point in enumerate(problem.surveyed) if point.role == "control" and problem.ties + i != rays.point[ray]]
    if not others:
        return None
    many = np.full(len(others), ray)
    # The same measurement as a ray to each of the other points.
    there = Rays(problem.ties + np.array(others, np.int32), rays.photo[many], rays.xy[many], rays.sigma[many])
    size = np.linalg.norm(residuals(results.result.state, there, problem.camera_of), axis=1)
    best = int(size.argmin())
    return problem.surveyed[others[best]].name if size[best] < LIES_ON else None


def _check_measurements(results: BlockResults, control: Control) -> Iterator[CheckMeasurementsApart]:
    """Check points whose rays do not meet, while some of their measurements lie on the given coordinates: these show which of the
    others are wrong, although the point takes no part."""
    checks = [point for point in control.points if point.role == "check" and point.measurements]
    rays = ground_rays(checks, {name: i for i, name in enumerate(results.problem.names)}, results.cameras)
    missed, size = _check_misfits(results, checks, rays)
    # Check points are marked as well as the others are.
    marks = _marks(results, control)
    constant = np.array([camera.c for camera in results.problem.cameras])[results.problem.camera_of[rays.photo]]
    for i, point in enumerate(checks):
        own = rays.point == i
        off = own & (size > np.maximum(LIES_ON, BY_CHANCE * marks * constant))
        meet = missed[i] < meeting(marks)
        if not meet and off.any() and off.sum() < own.sum():
            yield CheckMeasurementsApart(
                point=point.name,
                measured=int(own.sum()),
                apart=tuple(
                    Misfit(
                        photo=results.problem.names[rays.photo[ray]],
                        misfit_px=_within_frame(replace(results.problem, rays=rays), int(ray), float(size[ray])),
                    )
                    for ray in np.flatnonzero(off)
                ),
            )


def _marks(results: BlockResults, control: Control) -> float:
    """rad: the standard error of the marks of all surveyed points in the photographs, by how their rays miss each other."""
    problem, points = results.problem, [point for point in control.points if point.role != "tie"]
    rays = ground_rays(points, {name: i for i, name in enumerate(problem.names)}, results.cameras)
    return mark_sigma(rays, approximate_points(results.result.state, problem.cameras, problem.camera_of, rays, len(points)))


def _check_misfits(results: BlockResults, checks: list[ControlPoint], rays: Rays) -> tuple[np.ndarray, np.ndarray]:
    """(n,) rad by which the rays of the check points miss each other, and (m,) px from the given coordinates to the
    measurements."""
    problem, state = results.problem, results.result.state
    missed = approximate_points(state, problem.cameras, problem.camera_of, rays, len(checks)).missed
    given = np.array([point.xyz for point in checks], float).reshape(-1, 3) - results.datum.origin
    return missed, np.linalg.norm(residuals(replace(state, point=given), rays, problem.camera_of), axis=1)
