"""The motion of the block that the sources together ask for, with the scatter that each of them shows.

Residuals follow a t-distribution, so that single wrong positions, points or attitudes count little; its scale is estimated for each
source along with the motion (expectation maximisation, Lange et al. 1989). Positions may scatter less than stated, because their
stated errors are mostly common; control, attitudes and an elevation model are never better than stated.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.tasks.orientation.sources.evidence import MOTION, SOURCES, Equations, Source, Told, equations
from orthomill.tasks.orientation.sources.hypotheses import Cause
from orthomill.tasks.orientation.sources.rigid_block import RigidBlock

FREEDOM = 5.0
"""Degrees of freedom of the t-distribution of residuals: large errors are rare but not impossible."""
STEPS, NEGLIGIBLE = 40, 1e-3
"""Steps of the estimation, and the change of all scales, as a share, below which it ends."""
TAKEN = {Source.PLAN: 3, Source.HEIGHT: 3, Source.CONTROL: 0, Source.ATTITUDE: 0, Source.MODEL: 0}
"""Parameters that a source alone determines and that take their share of its residuals."""
STATED = (Source.CONTROL, Source.ATTITUDE, Source.MODEL)
"""Sources that are as precise as stated at best"""
STILL = 1e-3
"""Pixels on the ground by which linear equations may miss before they are made again"""
OPEN = 1e-12
"""Weight, in units of the largest, of what nothing is known of: keeps equations solvable where no source sees a parameter."""


@dataclass(frozen=True, eq=False)
class Explained:
    """What the sources say together: the `motion` (7,) of the block, all `parameters` (u,) with their `covariance` (those of the
    causes last), `scale` by source: estimated by stated standard error, `weight` (m,) of the equations at the end (`has`), and
    `misfit`: twice the negative logarithm of the likelihood; `stated`: the part of it that stated standard errors measure."""

    motion: np.ndarray
    parameters: np.ndarray
    covariance: np.ndarray
    scale: dict[Source, float]
    weight: np.ndarray
    misfit: float
    stated: float
    has: Equations


def explained(block: RigidBlock, told: Told, causes: tuple[Cause, ...] = (), near: Explained | None = None) -> Explained:
    """The most likely motion of a block and constant errors of its sources, given the causes; `near`: a solution with fewer causes
    to start from."""
    motion = np.zeros(7) if near is None else near.motion
    at = block.moved(motion)
    has, scale = equations(at, told), dict.fromkeys(SOURCES, np.inf)
    least, A, reach = _least(has, block.pixel), _with_causes(at, has, causes), _reach(block)
    # Of the motion, what the block has not made yet. Nothing is known of the causes before the first step.
    total = np.zeros(A.shape[1])
    for _ in range(STEPS):
        v = has.y - A @ total
        before, scale = scale, _scales(has, v, scale, least)
        weight = _weights(has, v, scale)
        total, covariance = _solved(has, A, weight)
        if _missed(told, total[MOTION], reach) > STILL * block.pixel:
            motion = motion + total[MOTION]
            at, total = block.moved(motion), _rest(total)
            has = equations(at, told)
            A = _with_causes(at, has, causes)
        if all(abs(scale[s] - before[s]) <= NEGLIGIBLE * scale[s] for s in SOURCES):
            break
    motion = motion + total[MOTION]
    at, total = block.moved(motion), _rest(total)
    has = equations(at, told)
    v = has.y - _with_causes(at, has, causes) @ total
    parameters = total.copy()
    parameters[MOTION] = motion
    return Explained(motion, parameters, covariance, scale, weight, *_misfits(has, v, scale, parameters), has)


def _reach(block: RigidBlock) -> float:
    """m of the longest lever about which the block turns."""
    return float(np.linalg.norm(block.centre - block.middle, axis=1).max() + np.median(block.depth))


def _missed(told: Told, motion: np.ndarray, reach: float) -> float:
    """m by which equations miss that are linear about where the block was before the `motion` (7,)."""
    turn = float(np.linalg.norm(motion[3:6]) + abs(motion[6]))
    # Ground of an elevation model is another one wherever the block goes; all others change by the square of a turn.
    return float(np.linalg.norm(motion[:3])) + reach * turn if told.model else reach * turn**2


def _rest(total: np.ndarray) -> np.ndarray:
    """The parameters without the motion, which the block has made already."""
    rest = total.copy()
    rest[MOTION] = 0.0
    return rest


def _with_causes(block: RigidBlock, has: Equations, causes: tuple[Cause, ...]) -> np.ndarray:
    return np.hstack([has.A, *(cause.columns(block, has) for cause in causes)])


def _spread(has: Equations, v: np.ndarray, source: Source, start: float) -> float:
    """Estimated by stated standard error of a source."""
    own = has.of_source[source]
    count = len(own) - TAKEN[source]
    if count < 1:
        return 1.0
    size = v[own] / has.sigma[own]
    if not np.isfinite(start):
        return float(np.sqrt((size**2).mean()))
    weight = (FREEDOM + 1.0) / (FREEDOM + (size / start) ** 2)
    return float(np.sqrt((weight * size**2).sum() / count))


def _least(has: Equations, pixel: float) -> dict[Source, float]:
    """The smallest scale of each source: the block itself is no better than a share of a pixel on the ground, and nothing of it
    shows less."""
    own = {source: has.sigma[has.of_source[source]] for source in SOURCES if source not in STATED}
    return {source: pixel / np.median(own[source]) if len(own.get(source, ())) else 1.0 for source in SOURCES}


def _scales(has: Equations, v: np.ndarray, scale: dict[Source, float], least: dict[Source, float]) -> dict[Source, float]:
    return {source: max(_spread(has, v, source, scale[source]), least[source]) for source in SOURCES}


def _weights(has: Equations, v: np.ndarray, scale: dict[Source, float]) -> np.ndarray:
    sigma = has.sigma * np.array([scale[source] for source in SOURCES])[has.source]
    return (FREEDOM + 1.0) / (FREEDOM + (v / sigma) ** 2) / sigma**2


def _solved(has: Equations, A: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The parameters (u,) by weighted least squares, and their covariance."""
    extra = A.shape[1] - len(has.expected)
    expected = np.append(has.expected, np.zeros(extra))
    known = np.append(1.0 / has.expected_sigma**2, np.zeros(extra))
    normal = A.T @ (weight[:, None] * A) + np.diag(known)
    right = A.T @ (weight * has.y) + known * expected
    size = np.sqrt(np.maximum(np.diag(normal), 1e-30))
    scaled = normal / np.outer(size, size) + OPEN * np.eye(len(size))
    inverse = np.linalg.inv(scaled) / np.outer(size, size)
    return inverse @ right, inverse


def _misfits(has: Equations, v: np.ndarray, scale: dict[Source, float], total: np.ndarray) -> tuple[float, float]:
    """The whole misfit, and the part of what has stated standard errors: control, attitudes, expectations."""
    value, stated = 0.0, 0.0
    for source in SOURCES:
        own = has.of_source[source]
        if len(own):
            size = v[own] / (has.sigma[own] * scale[source])
            part = (FREEDOM + 1.0) * np.log1p(size**2 / FREEDOM).sum()
            part += 2.0 * max(len(own) - TAKEN[source], 0) * np.log(scale[source])
            value += part
            stated += part if source in STATED else 0.0
    known = np.isfinite(has.expected_sigma)
    away = (total[: len(known)] - has.expected)[known] / has.expected_sigma[known]
    expected = (away**2).sum()
    return float(value + expected), float(stated + expected)
