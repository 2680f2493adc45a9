"""What contradicted the block, by name and with advice: control points, single measurements of them, positions, distances."""

from dataclasses import replace

import numpy as np

from orthomill.schemas.observations import Control
from orthomill.schemas.orientation import DistanceResidual, GroundResidual
from orthomill.tasks.adjustment.model.collinearity import residuals
from orthomill.tasks.adjustment.model.network import Rays
from orthomill.tasks.orientation.block.assembly import MEETING, BlockResults
from orthomill.tasks.orientation.control.ground_points import approximate_points
from orthomill.tasks.orientation.measurements import ground_rays
from orthomill.tasks.orientation.results.block_results import rays_used
from orthomill.tasks.orientation.results.ground_results import control_rows, distance_rows, position_rows, stated_distances

AGREES = 3.0
"""What was set aside before the adjustment but lies within this many predicted standard errors of the block is no blunder."""
UNLIKELY = 4.0
"""A distance that misses the block by more of its predicted standard errors is told."""
LIES_ON = 5.0
"""px: a measurement so near to a point may be meant for it."""
SINGLE = 5
"""More positions than these that were set aside are summed up in one sentence."""


def distance_blunders(account: BlockResults) -> list[DistanceResidual]:
    """Distances that took no part because they contradict the block."""
    weight = account.result.network.distances.weight
    return [row for row, own in zip(distance_rows(account), weight, strict=True) if own == 0]


def pointing_sentences(account: BlockResults, blunders: list[GroundResidual]) -> list[str]:
    """A sentence for every point with single measurements in photographs that took no part, but for points that are wrong as a
    whole."""
    problem, used, found = account.problem, rays_used(account.problem, account.result), []
    size = np.linalg.norm(residuals(account.result.state, problem.rays, problem.camera_of), axis=1)
    wrong = {row.name for row in blunders}
    for i, point in enumerate(problem.surveyed):
        own = problem.rays.point == problem.ties + i
        out = np.flatnonzero(own & ~used)
        if not len(out) or not used[own].any() or point.name in wrong:
            continue
        owners = [_owner(account, int(ray)) for ray in out]
        where = ", ".join(
            f"{problem.names[problem.rays.photo[ray]]} ({size[ray]:.0f} px off{owner and f', where {owner} lies'})"
            for ray, owner in zip(out, owners, strict=True)
        )
        advice = "Measure {} again" if not any(owners) else "Give {} the right name"
        found.append(
            f"{len(out)} of {own.sum()} measurements of the {point.role} point {point.name} in photographs contradict the others "
            f"and took no part: {where}. {advice.format('it' if len(out) == 1 else 'them')}."
        )
    return found


def _owner(account: BlockResults, ray: int) -> str:
    """The control point on which a measurement lies that is not its own; empty where there is none."""
    problem, rays = account.problem, account.problem.rays
    others = [i for i, point in enumerate(problem.surveyed) if point.role == "control" and problem.ties + i != rays.point[ray]]
    if not others:
        return ""
    many = np.full(len(others), ray)
    there = Rays(problem.ties + np.array(others, np.int32), rays.photo[many], rays.xy[many], rays.sigma[many])
    size = np.linalg.norm(residuals(account.result.state, there, problem.camera_of), axis=1)
    best = int(size.argmin())
    return problem.surveyed[others[best]].name if size[best] < LIES_ON else ""


def check_pointing_sentences(account: BlockResults, control: Control) -> list[str]:
    """A sentence for every check point whose measurements do not meet, with those that lie off its coordinates."""
    problem, found = account.problem, []
    checks = [point for point in control.points if point.role == "check"]
    rays = ground_rays(checks, {name: i for i, name in enumerate(problem.names)}, account.cameras)
    _, missed = approximate_points(account.result.state, problem.cameras, problem.camera_of, rays, len(checks))
    given = np.array([point.xyz for point in checks], float).reshape(-1, 3) - account.datum.origin
    size = np.linalg.norm(residuals(replace(account.result.state, point=given), rays, problem.camera_of), axis=1)
    for i, point in enumerate(checks):
        own = rays.point == i
        off = own & (size > LIES_ON)
        if missed[i] < MEETING or not off.any() or off.sum() == own.sum():
            continue
        where = ", ".join(f"{problem.names[rays.photo[ray]]} ({size[ray]:.0f} px off)" for ray in np.flatnonzero(off))
        found.append(
            f"{off.sum()} of {own.sum()} measurements of the check point {point.name} in photographs do not meet the others, which "
            f"lie on its coordinates: {where}. Measure again, or give the right name."
        )
    return found


def surveyed_blunders(account: BlockResults) -> list[GroundResidual]:
    """Control points and positions that took no part because they contradict the block, with how they miss it."""
    result, problem = account.result, account.problem
    control = {problem.surveyed[i].name for i in np.flatnonzero(~result.network.point_weight[problem.ties :].any(axis=1))}
    positions = {problem.names[i] for i in np.flatnonzero(~result.network.centre_weight.any(axis=1))}
    rows = [row for row in control_rows(account) if row.name in control]
    rows += [row for row in position_rows(account) if row.name in positions]
    tested = {problem.surveyed[b.number - problem.ties].name for b in result.blunders if b.kind == "control"}
    tested |= {problem.names[b.number] for b in result.blunders if b.kind == "position"}
    return [row for row in rows if row.name in tested or _ratio(row) > AGREES]


def blunder_sentences(account: BlockResults, blunders: list[GroundResidual]) -> list[str]:
    found = []
    positions = [row for row in blunders if row.role == "position"]
    for row in blunders:
        if row.role == "control":
            found.append(
                f"The control point {row.name} contradicts the block {_misses(row)}; it took no part. Compare its coordinates "
                "(name, CRS, height system) and its measurements in the photographs."
            )
    if len(positions) > 2 and (along := _along_the_view(account, positions)):
        return [*found, along]
    if len(positions) > SINGLE:
        away = np.median([row.difference for row in positions], axis=0)
        found.append(
            f"The positions of {len(positions)} photographs contradict the block: they lie {_length(float(np.linalg.norm(away)))} "
            "from where everything else puts these photographs, and took no part. They are of another place or in another CRS, or "
            "the control is; compare one photograph with a map."
        )
        return found
    return found + [
        f"The position of {row.name} contradicts the block {_misses(row)}; it took no part. Correct it or leave it out."
        for row in positions
    ]


def distance_sentences(account: BlockResults, wrong: list[DistanceResidual]) -> list[str]:
    """A sentence for every distance that was thrown out, for those that miss the block but cannot be told from others, and for a
    scale that nothing checks."""
    rows, rough = distance_rows(account), _rougher_than_stated(account)
    found = [_distance_sentence(row, row in wrong, bool(own)) for row, own in zip(rows, rough, strict=True)]
    if account.datum.free and len(rows) - len(wrong) == 1:
        found.append(
            "One distance alone gives the scale of the block, and nothing checks it: measure two more, so that a wrong one can be "
            "named."
        )
    return [sentence for sentence in found if sentence]


def _rougher_than_stated(account: BlockResults) -> np.ndarray:
    """(D,) bool: distances that took part with larger standard errors than stated, because they contradict each other."""
    sigma, (_, stated) = account.result.network.distances.sigma, stated_distances(account)
    return np.isfinite(sigma) & (sigma > 1.01 * stated * account.result.factors.distance)


def _distance_sentence(row: DistanceResidual, wrong: bool, rough: bool) -> str | None:
    misfit = abs(row.difference) / row.predicted if row.predicted > 0 else 0.0
    if rough:
        return (
            f"The distance from {row.first} to {row.second} ({row.length:.3f} m) contradicts the other distances (block minus "
            f"given: {row.difference:+.3f} m), and too few of them tell which is wrong; the block's scale lies between them. "
            "Measure it again, or one more."
        )
    if not wrong and misfit <= UNLIKELY:
        return None
    end = (
        "it took no part. Compare it with its two points"
        if wrong
        else ("too few others tell which of them is wrong. Measure it again")
    )
    return (
        f"The distance from {row.first} to {row.second} ({row.length:.3f} m) contradicts the block (block minus given: "
        f"{row.difference:+.3f} m, {misfit:.0f} times the predicted standard error); {end}."
    )


def _along_the_view(account: BlockResults, positions: list[GroundResidual]) -> str | None:
    """A sentence where positions and control contradict each other along the viewing direction only."""
    up = account.result.state.rotation[:, 2].mean(axis=0)
    up = up / np.linalg.norm(up)
    away = np.median([row.difference for row in positions], axis=0)
    along = float(away @ up)
    if np.linalg.norm(away - along * up) > 0.3 * abs(along):
        return None
    return (
        f"The positions of {len(positions)} photographs contradict the control by {abs(along):.1f} m along the viewing direction "
        "and hardly across it, as heights in two systems do (above the ellipsoid and above the sea), or a wrong camera constant. "
        "The positions took no part; compare the systems, and the focal length."
    )


def _ratio(row: GroundResidual) -> float:
    return max(abs(d) / max(s, 1e-9) for d, s in zip(row.difference, row.predicted, strict=True))


def _misses(row: GroundResidual) -> str:
    there = ", ".join(f"{value:+.2f}" for value in row.difference)
    return f"(block minus given: {there} m in X, Y, Z; {_ratio(row):.0f} times the predicted standard error)"


def _length(metres: float) -> str:
    return f"{metres / 1000.0:.1f} km" if metres >= 1000.0 else f"{metres:.0f} m"
