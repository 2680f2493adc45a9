"""Control, check points, positions and distances against the adjusted block, each with the standard error that is predicted for
its difference."""

import numpy as np
from scipy.special import chdtrc

from orthomill.schemas.observations import Control
from orthomill.schemas.orientation import DistanceResidual, GroundResidual, GroundResiduals, JointTest
from orthomill.tasks.adjustment.model.datum import antennas, distance_residuals, position_residuals
from orthomill.tasks.adjustment.testing.surveyed_blunders import CHECKABLE
from orthomill.tasks.adjustment.testing.variance_components import distance_variances, position_covariances
from orthomill.tasks.orientation.block.assembly import BlockResults
from orthomill.tasks.orientation.control.ground_points import (
    approximate_points,
    distance_variances_between,
    intersect_ground,
    joint_covariance,
)
from orthomill.tasks.orientation.measurements import ground_rays

_NO_WEIGHT = 1e-12
"""1/m^2: of a coordinate that is not known, a thousand kilometres"""


def ground_residuals(results: BlockResults, control: Control) -> GroundResiduals:
    """How the block fits what is known; observations that took no part are compared all the same."""
    distances = (*distance_rows(results, control), *check_distance_rows(results, control))
    # Coordinates of a free network are those of no ground point.
    if results.datum.free:
        return GroundResiduals(distances=distances)
    checks, checked = _checks(results, control)
    return GroundResiduals(points=(*control_rows(results), *position_rows(results), *checks), distances=distances, checked=checked)


def control_rows(results: BlockResults) -> list[GroundResidual]:
    """Control points, also those that took no part."""
    problem, result, known, rows = results.problem, results.result, results.problem.known, []
    computed = result.as_computed
    for i, point in enumerate(problem.surveyed):
        number, weight = problem.ties + i, result.network.point_weight[problem.ties + i]
        own = result.used & (result.rays.point == number)
        took_part = bool(weight.any())
        # A point that was set aside and has no ray left has no place in the block to compare.
        if point.role != "control" or not (took_part or own.any()):
            continue
        difference = result.state.point[number] + results.datum.origin - known.control[i]
        spread, white = (np.diag(r.point_covariance[number]) for r in (result, computed))
        variance = _of_residual(weight, spread, white) if took_part else known.control_sigma[i] ** 2 + spread
        row = _residual(point.name, "control", difference, variance, int(own.sum()), result.residual[own])
        rows.append(_with_redundancy(row, weight, white) if took_part else row)
    return rows


def position_rows(results: BlockResults) -> list[GroundResidual]:
    """Positions of the photographs, also those that took no part."""
    problem, result, rows = results.problem, results.result, []
    state, network = result.state, result.network
    # What a receiver measured: the centre, moved by the lever arm (image system, so R^T) and by its shift.
    antenna = antennas(network, state) + results.datum.origin
    number = np.flatnonzero(np.isfinite(problem.known.position).all(axis=1))
    spreads = (np.diagonal(position_covariances(r, number), axis1=1, axis2=2) for r in (result, result.as_computed))
    for i, spread, white in zip(number, *spreads, strict=True):
        weight = network.centre_weight[i]
        variance = _of_residual(weight, spread, white) if weight.all() else problem.known.position_sigma[i] ** 2 + spread
        difference = -position_residuals(network, state)[i] if weight.all() else antenna[i] - problem.known.position[i]
        row = _residual(problem.names[i], "position", difference, variance, 1, np.zeros((0, 2)))
        rows.append(_with_redundancy(row, weight, white) if weight.all() else row)
    return rows


def _checks(results: BlockResults, control: Control) -> tuple[list[GroundResidual], JointTest | None]:
    """The check points one by one, and all of them together."""
    problem, result = results.problem, results.result
    points = [point for point in control.points if point.role == "check" and point.measurements]
    rays = ground_rays(points, {name: i for i, name in enumerate(problem.names)}, results.cameras)
    start = approximate_points(result.state, problem.cameras, problem.camera_of, rays, len(points)).point
    # Intersected with the final orientation: a check point must not influence what it checks.
    found, rows = intersect_ground(result, start, rays), []
    placed = np.flatnonzero(np.isfinite(found.point).all(axis=1))
    for i in placed:
        point, own = points[i], rays.point == i
        # A check point is independent of the block: the variances add.
        variance = np.diag(found.covariance[i]) + np.square(point.sigma)
        difference = found.point[i] + results.datum.origin - point.xyz
        rows.append(_residual(point.name, "check", difference, variance, int(own.sum()), found.residual[own]))
    sigma = np.array([points[i].sigma for i in placed])
    return rows, _joint_test(rows, sigma, joint_covariance(result, found.point, rays, placed)) if rows else None


def _joint_test(rows: list[GroundResidual], sigma: np.ndarray, covariance: np.ndarray) -> JointTest:
    """Of check points with surveyed standard errors `sigma` (k, 3) m and the joint `covariance` (3k, 3k) m^2 of their places in the
    block."""
    difference = np.array([row.difference for row in rows]).ravel()
    square = float(difference @ np.linalg.solve(covariance + np.diag(np.square(sigma).ravel()), difference))
    return JointTest(square=square, coordinates=len(difference), chance=float(chdtrc(len(difference), square)))


def distance_rows(results: BlockResults, control: Control) -> list[DistanceResidual]:
    """Measured distances against the block; one that nothing checks has a predicted difference of 0."""
    network, state, problem = results.result.network, results.result.state, results.problem
    residual, rows = distance_residuals(network, state), []
    measured = {(d.first, d.second): d.measured for d in control.distances}
    spread, white = (distance_variances(r) for r in (results.result, results.result.as_computed))
    for i, ((first, second), stated) in enumerate(zip(*stated_distances(results), strict=True)):
        weight = network.distances.weight[i]
        variance = _of_residual(weight, spread[i], white[i]) if weight > 0 else stated**2 + spread[i]
        # The only distance of a free network has no redundancy: its residual is 0 by construction, not by precision.
        predicted = np.sqrt(variance) if variance > CHECKABLE * stated**2 else 0.0
        names = problem.surveyed[first].name, problem.surveyed[second].name
        rows.append(
            DistanceResidual(
                first=names[0],
                second=names[1],
                length=float(network.distances.length[i]),
                difference=float(-residual[i]),
                predicted=float(predicted),
                measured=measured.get(names),
                redundancy=float(np.clip(1.0 - weight * white[i], 0.0, 1.0)) if weight > 0 else None,
                sigma=float(1.0 / np.sqrt(weight)) if weight > 0 else None,
            )
        )
    return rows


def check_distance_rows(results: BlockResults, control: Control) -> list[DistanceResidual]:
    """Distances to check points against the block: they take no part, and both ends are intersected from their own marks."""
    points = [point for point in control.points if len(point.measurements) >= 2]
    number = {point.name: i for i, point in enumerate(points)}
    check = {point.name for point in points if point.role == "check"}
    distances = [d for d in control.distances if {d.first, d.second} & check and {d.first, d.second} <= number.keys()]
    if not distances:
        return []
    rays = ground_rays(points, {name: i for i, name in enumerate(results.problem.names)}, results.cameras)
    start = approximate_points(results.result.state, results.problem.cameras, results.problem.camera_of, rays, len(points)).point
    found = intersect_ground(results.result, start, rays).point
    placed = [d for d in distances if np.isfinite(found[[number[d.first], number[d.second]]]).all()]
    ends = np.array([(number[d.first], number[d.second]) for d in placed], int).reshape(-1, 2)
    variances = distance_variances_between(results.result, found, rays, ends)
    return [
        DistanceResidual(
            first=d.first,
            second=d.second,
            length=d.length,
            difference=float(np.linalg.norm(found[j] - found[i])) - d.length,
            predicted=float(np.sqrt(variance + d.sigma**2)),
            measured=d.measured,
            role="check",
        )
        for d, (i, j), variance in zip(placed, ends, variances, strict=True)
    ]


def stated_distances(results: BlockResults) -> tuple[list[list[int]], np.ndarray]:
    """The ends (numbers of surveyed points) and stated standard errors (D,) m of the distances of the adjustment."""
    stated = {(first, second): sigma for first, second, _, sigma in results.problem.distances}
    ends = (results.result.network.distances.ends - results.problem.ties).tolist()
    return ends, np.array([stated[first, second] for first, second in ends])


def _of_residual(weight: np.ndarray, spread: np.ndarray, white: np.ndarray) -> np.ndarray:
    """Variances of the residuals of observations that took part: Qvv = Qll - A Qxx A^T holds for the weights of the adjustment,
    that is for white noise and considered parameters as they are; the effect of correlated image errors and of what these
    parameters may be wrong by comes on top."""
    return 1.0 / weight - white + (spread - white)


def _with_redundancy(row: GroundResidual, weight: np.ndarray, white: np.ndarray) -> GroundResidual:
    """With the redundancy numbers of its coordinates, from their weights and the variances that their own adjustment yields."""
    share, sigma = np.clip(1.0 - weight * white, 0.0, 1.0), 1.0 / np.sqrt(np.maximum(weight, _NO_WEIGHT))
    return row.model_copy(update={"redundancy": tuple(share.tolist()), "sigma": tuple(sigma.tolist())})


def _residual(
    name: str, role: str, difference: np.ndarray, variance: np.ndarray, photos: int, residual: np.ndarray
) -> GroundResidual:
    return GroundResidual(
        name=name,
        role=role,
        difference=tuple(map(float, difference)),
        predicted=tuple(map(float, np.sqrt(np.maximum(variance, 0.0)))),
        photos=photos,
        residual_px=float(np.sqrt((residual**2).mean())) if len(residual) else None,
    )
