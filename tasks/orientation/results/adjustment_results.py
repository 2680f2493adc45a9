"""The account of the adjustment itself: groups of observations, worst residuals, blunders by name, and what is weak."""

import numpy as np

from orthomill.schemas.camera import INTERIOR
from orthomill.schemas.observations import Control
from orthomill.schemas.orientation import Block, BlockPrecision, LargestResidual, ObservationGroup, ParameterCorrelation
from orthomill.tasks.adjustment.model.adjustment_result import Adjustment
from orthomill.tasks.adjustment.model.interior import given_sigmas
from orthomill.tasks.orientation.block.assembly import BlockResults, Problem
from orthomill.tasks.orientation.block.camera_constant import MOVED
from orthomill.tasks.orientation.results.contradictions import (
    blunder_sentences,
    check_pointing_sentences,
    distance_blunders,
    distance_sentences,
    pointing_sentences,
    surveyed_blunders,
)

WORST = 12
"""How many of the largest standardised residuals are named."""


def block_precision(account: BlockResults, tracks: np.ndarray, apart: tuple[Block, ...], control: Control) -> BlockPrecision:
    """The table of the adjustment's own account; `apart`: blocks that nothing connects to the project's system."""
    problem, result = account.problem, account.result
    network, factors = result.network, result.factors
    blunders = [] if account.datum.free else surveyed_blunders(account)
    distances = distance_blunders(account)
    return BlockPrecision(
        image_factor=factors.image,
        position_factor=factors.position,
        control_factor=factors.control,
        rays=int(result.used.sum()),
        rejected=int(problem.measured - result.used.sum()),
        gnss_shift=tuple(map(float, result.state.shift)) if network.shift else None,
        gnss_shift_sigma=_sigmas(result, network.shift_columns),
        lever_arm=tuple(map(float, result.state.lever)) if result.state.lever.any() or len(network.lever_columns) else None,
        lever_arm_sigma=_sigmas(result, network.lever_columns),
        groups=tuple(ObservationGroup(name=g.name, count=g.count, redundancy=g.redundancy, factor=g.factor) for g in result.groups),
        largest=tuple(_largest(problem, result, tracks)),
        correlations=tuple(_correlations(problem, result)),
        blunders=(*(row.name for row in blunders), *(f"{row.first} - {row.second}" for row in distances)),
        common_px=result.correlated and result.correlated.rms_px,
        common_share=result.correlated and result.correlated.share,
        white_sigma=_white_sigmas(problem, result),
        weaknesses=(
            *account.datum.weaknesses,
            *blunder_sentences(account, blunders),
            *distance_sentences(account, distances),
            *pointing_sentences(account, blunders),
            *(() if account.datum.free else check_pointing_sentences(account, control)),
            *account.remarks,
            *_nominal(problem, result),
            *_moved_principal_points(account),
            *_unconnected(problem, apart),
        ),
    )


def _sigmas(result: Adjustment, columns: np.ndarray) -> tuple[float, float, float] | None:
    return tuple(map(float, np.sqrt(result.cofactor.variances[columns]))) if len(columns) else None


def _white_sigmas(problem: Problem, result: Adjustment) -> dict[str, tuple[float, ...]]:
    """Standard errors of adjusted interior parameters without the errors in common; nothing where there are none."""
    if result.before is None:
        return {}
    sigma = np.append(np.sqrt(np.maximum(result.white.cofactor.variances, 0.0)), 0.0)
    rows = zip(problem.camera_names, result.network.interior_columns, strict=True)
    return {name: tuple(map(float, sigma[own])) for name, own in rows if (own >= 0).any()}


def _largest(problem: Problem, result: Adjustment, tracks: np.ndarray) -> list[LargestResidual]:
    size, detectable = np.nan_to_num(np.abs(result.standardised)), result.detectable
    rows = []
    for place in np.argsort(-size, axis=None)[:WORST]:
        ray, axis = divmod(int(place), 2)
        point = int(result.rays.point[ray])
        tie = point < problem.ties
        rows.append(
            LargestResidual(
                point=f"tie point {tracks[point]}" if tie else problem.surveyed[point - problem.ties].name,
                photo=problem.names[result.rays.photo[ray]],
                axis="xy"[axis],
                residual_px=float(result.residual[ray, axis]),
                standardised=float(result.standardised[ray, axis]),
                redundancy_number=float(result.redundancy_number[ray, axis]),
                detectable_px=float(detectable[ray, axis]),
            )
        )
    return [row for row in rows if np.isfinite(row.standardised)]


def _nominal(problem: Problem, result: Adjustment) -> list[str]:
    """A sentence for every camera constant that was only considered."""
    found = []
    for k in np.flatnonzero(result.network.interior.considered[:, 0]):
        camera, column = problem.cameras[k], result.network.interior_columns[k, 0]
        share = 100.0 * np.sqrt(result.cofactor.variances[column]) / camera.c
        found.append(
            f"The camera constant of {problem.camera_names[k]} is nominal (from EXIF, {camera.c:.0f} px, within {share:.0f} %) and "
            "cannot be told from the flying height without control: it and the principal point kept their values, and heights "
            "above and below the mean ground are uncertain by the same share. Calibrate the camera, or give three control points."
        )
    return found


def _moved_principal_points(account: BlockResults) -> list[str]:
    """A sentence for every principal point that left its stated place by many of its standard errors."""
    interior, found = account.result.network.interior, []
    known = np.diagonal(interior.weight, axis1=1, axis2=2)[:, 1:3] > 0
    free = interior.free[:, 1:3] & ~interior.considered[:, 1:3] & known
    away = account.result.state.interior[:, 1:3] - interior.value[:, 1:3]
    for k in np.flatnonzero((free & (np.abs(away) > MOVED * given_sigmas(interior, (1, 2)))).any(axis=1)):
        found.append(
            f"The principal point of {account.problem.camera_names[k]} moved {np.linalg.norm(away[k]):.0f} px from its stated "
            "place, many times its standard error: the block can hardly tell it from tangential distortion and the direction of "
            "the photographs, and systematic errors push it. Calibrate the camera, or hold x0 and y0 to compare."
        )
    return found


def _unconnected(problem: Problem, apart: tuple[Block, ...]) -> list[str]:
    found = []
    if len(problem.groups) > 1:
        others = "; ".join(", ".join(group) for group in problem.groups[1:])
        found.append(
            f"The photographs form {len(problem.groups)} groups which no reliable tie points connect; each is held by its own "
            f"positions and control only. Beside the largest: {others}. Photographs between them would join them."
        )
    for block in apart:
        found.append(
            f"{', '.join(block.names)} form a separate group which neither tie points nor positions or control connect to the "
            "block; it is kept as a free block of its own and takes no part in later stages. Run its photographs as a project of "
            "their own, or give positions or control that place it."
        )
    return found


def _correlations(problem: Problem, result: Adjustment) -> list[ParameterCorrelation]:
    """Interior parameters against each other, against the mean height of the centres, and that of 0.9 or more only."""
    names, columns = [], []
    for k, own in enumerate(result.network.interior_columns):
        names += [f"{INTERIOR[i]} of {problem.cameras[k].name}" for i in np.flatnonzero(own >= 0)]
        columns += list(own[own >= 0])
    photos = len(problem.names)
    names.append("the mean height of the projection centres")
    J = np.zeros((len(names), len(result.cofactor)))
    J[np.arange(len(columns)), columns] = 1.0
    J[-1, 6 * np.arange(photos) + 2] = 1.0 / photos
    covariance = J @ result.cofactor.times(J.T)
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = covariance / np.outer(scale, scale)
    return [
        ParameterCorrelation(first=names[i], second=names[j], value=float(correlation[i, j]))
        for i in range(len(names))
        for j in range(i + 1, len(names))
        if abs(correlation[i, j]) >= 0.9
    ]
