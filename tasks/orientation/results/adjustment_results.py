"""The results of the adjustment itself: groups of observations, largest residuals, blunders by name, correlations, findings."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from orthomill.schemas.camera import INTERIOR
from orthomill.schemas.findings.block_findings import BlockFinding
from orthomill.schemas.findings.camera_findings import ConstantNominal, PrincipalPointMoved
from orthomill.schemas.findings.contradiction_findings import SourcesDisagree
from orthomill.schemas.findings.datum_findings import BlockSeparate, GroupsUnconnected
from orthomill.schemas.observations import Control
from orthomill.schemas.orientation import Block, BlockPrecision, LargestResidual, LeverArm, ObservationGroup, ParameterCorrelation
from orthomill.schemas.photo import Photos
from orthomill.tasks.adjustment.model.interior import given_sigmas, is_guessed
from orthomill.tasks.adjustment.model.network import Network, common_shift
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment, ObservationKind
from orthomill.tasks.orientation.block.assembly import BlockResults, Problem
from orthomill.tasks.orientation.block.camera_constant import MOVED
from orthomill.tasks.orientation.results.contradictions import contradicting_distances, contradicting_points, contradictions
from orthomill.tasks.orientation.results.group_reliability import reliability_of_groups
from orthomill.tasks.orientation.results.position_drifts import drift_findings, position_drifts
from orthomill.tasks.orientation.shape.bent_block import bent_block
from orthomill.tasks.orientation.shape.shape_precision import shape_precision
from orthomill.tasks.orientation.sources.source_findings import BEND, covered_by

WORST = 12
"""How many of the largest standardised residuals are named: a table that is read, not searched."""
STRONG = 0.9
"""Correlations from this on are reported: above it, the variance of one parameter grows more than fivefold through the other."""
PRINCIPAL_POINT = slice(1, 3)
"""x0, y0 in the order of INTERIOR"""


def block_precision(
    results: BlockResults, tracks: np.ndarray, apart: tuple[Block, ...], control: Control, photos: Photos
) -> BlockPrecision:
    """The table of the adjustment; `tracks` (N,) of its tie points, `apart`: blocks that nothing connects to the project's
    system."""
    problem, result = results.problem, results.result
    network, factors = result.network, result.factors
    # Rows of blunders are needed twice: by name, and to keep their single measurements out of the findings.
    # Without a datum nothing is known of the ground, so no coordinate can contradict the block.
    points = [] if results.datum.free else contradicting_points(results)
    distances = contradicting_distances(results, control)
    shape = shape_precision(results)
    bends = tuple(bent_block(results, shape.bend if shape else None))
    arms = tuple(_lever_arms(problem, result))
    drifts = position_drifts(results, photos)
    return BlockPrecision(
        image_factor=factors.image,
        position_factor=max(factors.position),
        control_factor=factors.control,
        rays=int(result.used.sum()),
        # Measurements of points that never got a place count as rejected: they took no part either.
        rejected=int(problem.measured - result.used.sum()),
        gnss_shift=_vector(result.state.shift) if _is_common(network) else None,
        gnss_shift_sigma=_sigmas(result, network.shift_columns) if _is_common(network) else None,
        lever_arm=arms[0].value if len(arms) == 1 else None,
        lever_arm_sigma=arms[0].sigma if len(arms) == 1 else None,
        lever_arms=arms if len(arms) > 1 else (),
        offsets=() if _is_common(network) else results.offsets,
        drifts=drifts,
        sources=results.statements,
        groups=tuple(_groups(problem, result)),
        largest=tuple(_largest(problem, result, tracks)),
        correlations=tuple(_correlations(problem, result)),
        blunders=(*(row.name for row in points), *(f"{row.first} - {row.second}" for row in distances)),
        common_px=result.correlated.rms_px if result.correlated else None,
        common_share=result.correlated.share if result.correlated else None,
        bend_sigma=shape.bend if shape else None,
        bend_extent=shape.extent if shape else None,
        white_sigma=_white_sigmas(problem, result),
        findings=(
            *bends,
            *results.datum.findings,
            *_unexplained(results, contradictions(results, points, distances, control)),
            *(finding for finding in results.findings if not (bends and _about_bend(finding))),
            *drift_findings(drifts, problem.known.position_sigma, problem.names),
            *_nominal_constants(problem, result),
            *_moved_principal_points(results),
            *_unconnected(problem, apart),
        ),
    )


def _groups(problem: Problem, result: Adjustment) -> Iterator[ObservationGroup]:
    reliability = reliability_of_groups(result)
    for group in result.groups:
        own = problem.gnss_groups[group.part] if group.name == ObservationKind.POSITIONS and problem.gnss_groups else ""
        yield ObservationGroup(
            name=group.name,
            count=group.count,
            redundancy=group.redundancy,
            factor=group.factor,
            part=own,
            reliability=reliability.get((group.name, group.part)),
        )


def _about_bend(finding: BlockFinding) -> bool:
    """Whether sources disagree in the bend of the block, of which positions and attitudes tell more."""
    return isinstance(finding, SourcesDisagree) and finding.parameter == BEND


def _unexplained(results: BlockResults, found: Iterator[BlockFinding]) -> Iterator[BlockFinding]:
    """The contradictions that no cause explains which the sources show."""
    covered = covered_by(results.findings)
    return (finding for finding in found if not isinstance(finding, covered))


def _lever_arms(problem: Problem, result: Adjustment) -> Iterator[LeverArm]:
    """The lever arms of the receivers; none where all are zero and exactly known."""
    network, lever = result.network, result.state.lever
    if not lever.any() and not len(network.lever_columns):
        return
    for i, value in enumerate(lever):
        sigma = _sigmas(result, network.lever_columns[i]) if len(network.lever_columns) else None
        yield LeverArm(receiver=problem.receivers[i] if problem.receivers else "", value=_vector(value), sigma=sigma)


def _is_common(network: Network) -> bool:
    """Whether all positions share one shift in all coordinates."""
    return network.shifts == 3 and bool((network.shift == common_shift(network.photos)).all()) and not network.shift_weights.any()


def _vector(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z


def _sigmas(result: Adjustment, columns: np.ndarray) -> tuple[float, float, float] | None:
    return _vector(np.sqrt(result.cofactor.variances[columns])) if len(columns) else None


def _white_sigmas(problem: Problem, result: Adjustment) -> dict[str, tuple[float, ...]]:
    """Standard errors of adjusted interior parameters without correlated image errors; nothing where there are none."""
    if result.before is None:
        return {}
    # Parameters that were not adjusted have the column -1: the 0 appended here.
    sigma = np.append(np.sqrt(np.maximum(result.white.cofactor.variances, 0.0)), 0.0)
    rows = zip(problem.camera_names, result.network.interior_columns, strict=True)
    return {name: tuple(map(float, sigma[own])) for name, own in rows if (own >= 0).any()}


def _largest(problem: Problem, result: Adjustment, tracks: np.ndarray) -> list[LargestResidual]:
    # A residual without redundancy has no standardised value: it sorts last, and is dropped.
    size = np.nan_to_num(np.abs(result.standardised))
    places = (divmod(int(place), 2) for place in np.argsort(-size, axis=None)[:WORST])
    rows = [_residual(problem, result, tracks, ray, axis) for ray, axis in places]
    return [row for row in rows if np.isfinite(row.standardised)]


def _residual(problem: Problem, result: Adjustment, tracks: np.ndarray, ray: int, axis: int) -> LargestResidual:
    point = int(result.rays.point[ray])
    tie = point < problem.ties
    return LargestResidual(
        point=f"tie point {tracks[point]}" if tie else problem.surveyed[point - problem.ties].name,
        photo=problem.names[result.rays.photo[ray]],
        axis="xy"[axis],
        residual_px=float(result.residual[ray, axis]),
        standardised=float(result.standardised[ray, axis]),
        redundancy_number=float(result.redundancy_number[ray, axis]),
        detectable_px=float(result.detectable[ray, axis]),
    )


def _nominal_constants(problem: Problem, result: Adjustment) -> Iterator[ConstantNominal]:
    """The camera constants that were only considered."""
    for k in np.flatnonzero(result.network.interior.considered[:, 0]):
        # A considered parameter has the variance that was given for it, whatever the block says.
        camera, column = problem.cameras[k], result.network.interior_columns[k, 0]
        share = float(np.sqrt(result.cofactor.variances[column]) / camera.c)
        yield ConstantNominal(camera=problem.camera_names[k], c=camera.c, share=share, guessed=is_guessed(camera))


def _moved_principal_points(results: BlockResults) -> Iterator[PrincipalPointMoved]:
    """The principal points that left their given places by many of their standard errors."""
    interior = results.result.network.interior
    # Only where a place was stated: a free principal point has none to leave.
    known = np.diagonal(interior.weight, axis1=1, axis2=2)[:, PRINCIPAL_POINT] > 0
    free = interior.free[:, PRINCIPAL_POINT] & ~interior.considered[:, PRINCIPAL_POINT] & known
    away = results.result.state.interior[:, PRINCIPAL_POINT] - interior.value[:, PRINCIPAL_POINT]
    for k in np.flatnonzero((free & (np.abs(away) > MOVED * given_sigmas(interior, (1, 2)))).any(axis=1)):
        yield PrincipalPointMoved(camera=results.problem.camera_names[k], moved_px=float(np.linalg.norm(away[k])))


def _unconnected(problem: Problem, apart: tuple[Block, ...]) -> Iterator[BlockFinding]:
    if len(problem.groups) > 1:
        yield GroupsUnconnected(groups=problem.groups)
    for block in apart:
        yield BlockSeparate(photos=block.names)


def _correlations(problem: Problem, result: Adjustment) -> list[ParameterCorrelation]:
    """Strong correlations of the interior parameters with each other and with the mean height of the projection centres."""
    names, columns = [], []
    for k, own in enumerate(result.network.interior_columns):
        names += [f"{INTERIOR[i]} of {problem.cameras[k].name}" for i in np.flatnonzero(own >= 0)]
        columns += list(own[own >= 0])
    photos = len(problem.names)
    names.append("the mean height of the projection centres")
    # The mean height represents the flying height: single centres are hardly correlated with c, all of them together are.
    J = np.zeros((len(names), len(result.cofactor)))
    J[np.arange(len(columns)), columns] = 1.0
    J[-1, 6 * np.arange(photos) + 2] = 1.0 / photos
    covariance = J @ result.cofactor.times(J.T)
    # Variances of fixed parameters are 0; the floor keeps 0 / 0 out of the table.
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = covariance / np.outer(scale, scale)
    return [
        ParameterCorrelation(first=names[i], second=names[j], value=float(correlation[i, j]))
        for i, j in combinations(range(len(names)), 2)
        if abs(correlation[i, j]) >= STRONG
    ]
