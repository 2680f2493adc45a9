"""Correlations of interior and exterior orientations, and the reliability of control, from what the adjustment stored.

Source: Baarda 1968, A testing procedure for use in geodetic networks: delta0 = 4.13 for a test at 0.1 % with a power of 80 %;
smallest error found delta0 sigma / sqrt(r), its effect on the adjusted coordinate (1 - r) times that.
"""

import math
from typing import NamedTuple

import numpy as np

from orthomill.schemas.accuracy.adjustment_statement import (
    AdjustmentStatement,
    ExteriorPrecision,
    InteriorCorrelation,
    InteriorStatement,
    SurveyedReliabilities,
    SurveyedReliability,
)
from orthomill.schemas.camera import INTERIOR, Camera
from orthomill.schemas.orientation import Block, BlockPrecision, DistanceResidual, GroundResidual, GroundResiduals, LeverArm

DELTA0 = 4.13
_CHECKED = 1e-4
"""redundancy number below which nothing checks an observation"""


class StatedAdjustment(NamedTuple):
    """The statement, and its long tables."""

    statement: AdjustmentStatement
    exterior: ExteriorPrecision
    interior: InteriorCorrelation
    surveyed: SurveyedReliabilities


def state_adjustment(block: Block, ground: GroundResiduals, precision: BlockPrecision) -> StatedAdjustment:
    """All that an authority asks for beyond the figures of the block."""
    cameras = tuple(found for name, camera in sorted(block.cameras.items()) if (found := _interior(name, camera)))
    control, positions = ([one for row in ground.of_role(role) for one in _surveyed(row)] for role in ("control", "position"))
    distances, checks = ([one for d in ground.distances if d.role == role for one in _measured(d)] for role in ("control", "check"))
    statement = AdjustmentStatement(
        cameras=cameras,
        groups=precision.groups,
        control=tuple(control),
        distances=tuple(distances),
        check_distances=tuple(checks),
        gnss_shift=precision.gnss_shift,
        gnss_shift_sigma=precision.gnss_shift_sigma,
        gnss_offsets=precision.offsets,
        gnss_drifts=precision.drifts,
        lever_arms=precision.lever_arms or _only_arm(precision),
    )
    surveyed = _columns({"control": control, "position": positions, "distance": distances, "check distance": checks})
    return StatedAdjustment(statement, _exterior(block), _pairs(cameras), surveyed)


def _only_arm(precision: BlockPrecision) -> tuple[LeverArm, ...]:
    if precision.lever_arm is None:
        return ()
    return (LeverArm(receiver="", value=precision.lever_arm, sigma=precision.lever_arm_sigma),)


def _columns(of_kinds: dict[str, list[SurveyedReliability]]) -> SurveyedReliabilities:
    every = [(kind, one) for kind, ones in of_kinds.items() for one in ones]
    words = (np.array(column, str) for column in zip(*((k, o.point, o.axis) for k, o in every), strict=True))
    numbers = np.array([(o.sigma, o.redundancy, o.detectable, o.effect) for _, o in every], np.float64).reshape(-1, 4)
    return SurveyedReliabilities(*(words if every else (np.zeros(0, str),) * 3), *numbers.T)


def correlations_of(covariance: np.ndarray) -> np.ndarray:
    """The correlation matrix (n, n) of a covariance (n, n); zero rows for what has no variance."""
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.nan_to_num(covariance / np.outer(sigma, sigma), posinf=0.0, neginf=0.0)


def _interior(name: str, camera: Camera) -> InteriorStatement | None:
    """A camera whose parameters have standard errors; None otherwise."""
    if camera.covariance is None:
        return None
    covariance = np.array(camera.covariance)
    known = np.flatnonzero(np.diag(covariance) > 0)
    if not len(known):
        return None
    part = covariance[np.ix_(known, known)]
    return InteriorStatement(
        camera=name,
        source=camera.source,
        parameters=tuple(INTERIOR[i] for i in known),
        values=tuple(camera.interior[i] for i in known),
        sigmas=tuple(map(float, np.sqrt(np.diag(part)))),
        correlations=tuple(tuple(map(float, row)) for row in correlations_of(part)),
    )


def _surveyed(residual: GroundResidual) -> list[SurveyedReliability]:
    if residual.redundancy is None or residual.sigma is None:
        return []
    rows = zip("XYZ", residual.sigma, residual.redundancy, strict=True)
    return [_reliability(residual.name, axis, sigma, share) for axis, sigma, share in rows]


def _measured(residual: DistanceResidual) -> list[SurveyedReliability]:
    name = f"{residual.first} to {residual.second}"
    if residual.role == "check":
        return [_reliability(name, "length", residual.predicted, 1.0)]
    if residual.redundancy is None or residual.sigma is None:
        return []
    return [_reliability(name, "length", residual.sigma, residual.redundancy)]


def _reliability(name: str, axis: str, sigma: float, share: float) -> SurveyedReliability:
    found = DELTA0 * sigma / math.sqrt(share) if share > _CHECKED else None
    effect = None if found is None else (1 - share) * found
    return SurveyedReliability(point=name, axis=axis, sigma=sigma, redundancy=share, detectable=found, effect=effect)


def _exterior(block: Block) -> ExteriorPrecision:
    known = [photo for photo in block.photos if photo.covariance is not None]
    covariance = np.array([photo.covariance for photo in known], np.float64).reshape(-1, 6, 6)
    sigma = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0))
    sigma[:, 3:] = np.degrees(sigma[:, 3:])
    correlation = np.array([correlations_of(one) for one in covariance]).reshape(-1, 6, 6)
    rows, cols = np.triu_indices(6, 1)
    return ExteriorPrecision(np.array([photo.photo for photo in known], str), *sigma.T, *correlation[:, rows, cols].T)


def _pairs(cameras: tuple[InteriorStatement, ...]) -> InteriorCorrelation:
    rows = [
        (camera.camera, first, second, camera.correlations[i][j])
        for camera in cameras
        for i, first in enumerate(camera.parameters)
        for j, second in enumerate(camera.parameters)
        if i < j
    ]
    names, firsts, seconds, values = zip(*rows, strict=True) if rows else ((), (), (), ())
    return InteriorCorrelation(np.array(names, str), np.array(firsts, str), np.array(seconds, str), np.array(values, np.float64))
