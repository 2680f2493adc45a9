"""What each source says of each parameter by itself, and what all the others say of it without that source.

Parameters are the motion of the block, its bend, the camera constant of each camera, and the height of each flight.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from orthomill.tasks.orientation.sources.causes import FEWEST_BENT, Groups
from orthomill.tasks.orientation.sources.evidence import FIRST_CAMERA, Equations, Source
from orthomill.tasks.orientation.sources.hypotheses import Bend, Cause, Offset
from orthomill.tasks.orientation.sources.rigid_block import RigidBlock
from orthomill.tasks.orientation.sources.robust_motion import Explained

SEES = {
    Source.PLAN: (0, 1, 5, 6),
    Source.HEIGHT: (2, 3, 4),
    Source.CONTROL: (0, 1, 2, 3, 4, 5, 6),
    Source.ATTITUDE: (3, 4, 5),
    Source.MODEL: (2, 3, 4),
}
"""Parameters of the motion (shift in X, Y, height; tilts about the x and y axes; azimuth; scale) that a source can determine."""
NUISANCE = slice(7, None)
"""Parameters that every source has to itself or from elsewhere: common errors, camera constants, offsets."""
POINTS, BENT_POINTS = 3, 5
"""Control points that determine more than a shift, and those that show a bend"""
UNKNOWN = np.array([1e4, 1e4, 1e4, 0.3, 0.3, 0.3, 0.05])
"""Standard errors (m, rad, share) from which on a parameter counts as not determined. Equations are linear: who knows the scale to
a fifth can name one that turns the block inside out."""


@dataclass(frozen=True, eq=False)
class Parameter:
    """What something is said of: the `number` of a parameter of the motion, of a camera, or of a flight with its photographs (P,)
    bool; the bend of the block has none."""

    kind: Literal["motion", "camera", "flight", "bend"]
    number: int = 0
    photos: np.ndarray | None = None


@dataclass(frozen=True)
class Said:
    """A parameter by one `source` and by all `others`, relative to the block as it is; NaN where they do not determine it. None as
    source: tags and calibrations."""

    parameter: Parameter
    source: Source | None
    value: float
    sigma: float
    others: float
    others_sigma: float

    @property
    def ratio(self) -> float:
        """The difference in standard errors."""
        return abs(self.value - self.others) / max(float(np.hypot(self.sigma, self.others_sigma)), 1e-300)


@dataclass(frozen=True, eq=False)
class _Estimate:
    """All parameters (u,) with their covariance; those that were not free are 0, with an infinite variance."""

    value: np.ndarray
    covariance: np.ndarray

    def of(self, number: int) -> tuple[float, float]:
        """A parameter and its standard error."""
        return float(self.value[number]), float(np.sqrt(max(self.covariance[number, number], 0.0)))


def source_table(
    block: RigidBlock, at_block: Equations, total: Explained, causes: tuple[Cause, ...], groups: Groups
) -> Iterator[Said]:
    """The table of the equations `at_block` of a block, weighted as in `total`; parameters of the `causes` are open."""
    A = np.hstack([at_block.A, *(cause.columns(block, at_block) for cause in causes)])
    yield from _motions(at_block, A, total)
    yield from _bends(block, at_block, A, total, causes)
    yield from _cameras(at_block, A, total)
    yield from _flights(block, at_block, total, causes, groups)


def _motions(has: Equations, A: np.ndarray, total: Explained) -> Iterator[Said]:
    for source in Source:
        own = has.source == source
        if not own.any():
            continue
        sees = SEES[source] if source != Source.CONTROL or own.sum() >= 3 * POINTS else SEES[source][:3]
        alone = _estimate(has, A, total.weight * own, _free(A, sees))
        others = _estimate(has, A, total.weight * ~own, np.ones(A.shape[1], bool))
        for p in sees:
            if alone.of(p)[1] < UNKNOWN[p]:
                yield Said(Parameter("motion", p), source, *_known(alone.of(p), UNKNOWN[p]), *_known(others.of(p), UNKNOWN[p]))


def _free(A: np.ndarray, sees: tuple[int, ...]) -> np.ndarray:
    """(u,) bool: what a source alone determines, and what every source has to itself."""
    free = np.zeros(A.shape[1], bool)
    free[list(sees)] = free[NUISANCE] = True
    return free


def _bends(block: RigidBlock, has: Equations, A: np.ndarray, total: Explained, causes: tuple[Cause, ...]) -> Iterator[Said]:
    """What heights, attitudes, control and an elevation model say of a bend of the block."""
    others_ = [cause.columns(block, has) for cause in causes if not isinstance(cause, Bend)]
    A = np.hstack([has.A, *others_, Bend().columns(block, has)])
    enough = {
        Source.HEIGHT: FEWEST_BENT,
        Source.CONTROL: 3 * BENT_POINTS,
        Source.ATTITUDE: 3 * FEWEST_BENT,
        Source.MODEL: FEWEST_BENT,
    }
    for source, least in enough.items():
        own = has.source == source
        if own.sum() < least:
            continue
        alone = _estimate(has, A, total.weight * own, _free(A, SEES[source])).of(-1)
        others = _estimate(has, A, total.weight * ~own, np.ones(A.shape[1], bool)).of(-1)
        if alone[1] < UNKNOWN[2]:
            yield Said(Parameter("bend"), source, *alone, *_known(others, UNKNOWN[2]))


def _cameras(has: Equations, A: np.ndarray, total: Explained) -> Iterator[Said]:
    """What tags say of each camera constant, and what all other sources say."""
    for k in range(FIRST_CAMERA, len(has.expected)):
        value, sigma = _estimate(has, A, total.weight, np.ones(A.shape[1], bool), without=k).of(k)
        if np.isfinite(has.expected_sigma[k]) and sigma < 1.0:
            given = float(has.expected[k]), float(has.expected_sigma[k])
            yield Said(Parameter("camera", k - FIRST_CAMERA), None, *given, value, sigma)


def _flights(block: RigidBlock, has: Equations, total: Explained, causes: tuple[Cause, ...], groups: Groups) -> Iterator[Said]:
    """The height of each flight by its own positions, and where all other sources expect these, errors that all positions share
    included."""
    numbers = np.unique(groups.flight[has.photo[has.source == Source.HEIGHT]])
    for number in numbers if len(numbers) > 1 else ():
        photos = groups.flight == number
        own = (has.source == Source.HEIGHT) & photos[has.photo]
        kept = [cause for cause in causes if not (isinstance(cause, Offset) and (cause.photos & photos).any())]
        A = np.hstack([has.A, *(cause.columns(block, has) for cause in kept)])
        others = _estimate(has, A, total.weight * ~own, np.ones(A.shape[1], bool))
        share = total.weight[own] / total.weight[own].sum()
        mean = share @ A[own]
        sigma = float(np.sqrt(share**2 @ (1.0 / total.weight[own])))
        there = float(mean @ others.value), float(np.sqrt(max(mean @ others.covariance @ mean, 0.0)))
        yield Said(
            Parameter("flight", int(number), photos), Source.HEIGHT, float(share @ has.y[own]), sigma, *_known(there, UNKNOWN[2])
        )


def _known(estimate: tuple[float, float], unknown: float) -> tuple[float, float]:
    return estimate if estimate[1] < unknown else (float("nan"), float("nan"))


def _estimate(has: Equations, A: np.ndarray, weight: np.ndarray, free: np.ndarray, without: int | None = None) -> _Estimate:
    """All parameters from equations with `weight` (m,), those that are `free`; `without` the expected value of one of them."""
    extra = A.shape[1] - len(has.expected)
    known = np.append(1.0 / has.expected_sigma**2, np.zeros(extra))
    if without is not None:
        known[without] = 0.0
    # Loose expectations keep the equations solvable; what rests on them is recognised by its standard error.
    loose = np.concatenate([1.0 / (10.0 * UNKNOWN) ** 2, np.full(A.shape[1] - 7, 1e-12)])
    normal = A.T @ (weight[:, None] * A) + np.diag(known + loose)
    right = A.T @ (weight * has.y) + known * np.append(has.expected, np.zeros(extra))
    value, covariance = np.zeros(len(free)), np.diag(np.where(free, 0.0, np.inf))
    size = np.sqrt(np.diag(normal))[free]
    inverse = np.linalg.inv(normal[np.ix_(free, free)] / np.outer(size, size)) / np.outer(size, size)
    value[free], covariance[np.ix_(free, free)] = inverse @ right[free], inverse
    return _Estimate(value, covariance)
