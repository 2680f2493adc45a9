"""What each source says of each parameter by itself, and what all the others say of it without that source."""

from dataclasses import dataclass

import numpy as np

from orthomill.tasks.orientation.sources.evidence import FIRST_CAMERA, Equations, Source
from orthomill.tasks.orientation.sources.robust_motion import Explained

SEES = {Source.PLAN: (0, 1, 5, 6), Source.HEIGHT: (2, 3, 4), Source.CONTROL: (0, 1, 2, 3, 4, 5, 6), Source.ATTITUDE: (3, 4, 5)}
"""Parameters of the motion (shift in X, Y, height; tilts about the x and y axes; azimuth; scale) that a source can determine."""
NUISANCE = slice(7, None)
"""Parameters that every source has to itself or from elsewhere: common errors, camera constants, offsets."""
POINTS = 3
"""Control points that determine more than a shift."""
UNKNOWN = np.array([1e4, 1e4, 1e4, 0.3, 0.3, 0.3, 0.3])
"""Standard errors (m, rad, share) from which on a parameter counts as not determined."""


@dataclass(frozen=True)
class Said:
    """A parameter (0 to 6: motion; from 7 on: cameras) by one `source` and by all `others`, relative to the block as it is; NaN
    where they do not determine it. None as source: tags and calibrations."""

    parameter: int
    source: Source | None
    value: float
    sigma: float
    others: float
    others_sigma: float

    @property
    def ratio(self) -> float:
        """The difference in standard errors."""
        return abs(self.value - self.others) / max(float(np.hypot(self.sigma, self.others_sigma)), 1e-300)


def source_table(at_block: Equations, A: np.ndarray, total: Explained) -> list[Said]:
    """The table of the equations `at_block` with the derivatives `A` (m, u), causes included, weighted as in `total`."""
    rows = []
    for source in Source:
        own = at_block.source == source
        if not own.any():
            continue
        sees = SEES[source] if source != Source.CONTROL or own.sum() >= 3 * POINTS else SEES[source][:3]
        free = np.zeros(A.shape[1], bool)
        free[list(sees)] = free[NUISANCE] = True
        value, sigma = _estimate(at_block, A, total.weight * own, free, without=None)
        others, others_sigma = _estimate(at_block, A, total.weight * ~own, np.ones_like(free), without=None)
        rows += [
            Said(p, source, *_known(p, value[p], sigma[p]), *_known(p, others[p], others_sigma[p]))
            for p in sees
            if sigma[p] < UNKNOWN[p]
        ]
    return rows + _cameras(at_block, A, total)


def _cameras(has: Equations, A: np.ndarray, total: Explained) -> list[Said]:
    """What tags say of each camera constant, and what all other sources say."""
    rows = []
    for k in range(FIRST_CAMERA, len(has.expected)):
        others, sigma = _estimate(has, A, total.weight, np.ones(A.shape[1], bool), without=k)
        if np.isfinite(has.expected_sigma[k]) and sigma[k] < 1.0:
            rows.append(Said(7 + k - FIRST_CAMERA, None, float(has.expected[k]), float(has.expected_sigma[k]), others[k], sigma[k]))
    return rows


def _known(parameter: int, value: float, sigma: float) -> tuple[float, float]:
    return (float(value), float(sigma)) if sigma < UNKNOWN[parameter] else (float("nan"), float("nan"))


def _estimate(has: Equations, A: np.ndarray, weight: np.ndarray, free: np.ndarray, without: int | None) -> tuple[np.ndarray, ...]:
    """All parameters (u,) with their standard errors, from equations with `weight` (m,); those that are not `free` are 0; `without`
    the expected value of one of them."""
    extra = A.shape[1] - len(has.expected)
    known = np.append(1.0 / has.expected_sigma**2, np.zeros(extra))
    if without is not None:
        known[without] = 0.0
    # Loose expectations keep the equations solvable; what rests on them is recognised by its standard error.
    loose = np.concatenate([1.0 / (10.0 * UNKNOWN) ** 2, np.full(A.shape[1] - 7, 1e-12)])
    normal = A.T @ (weight[:, None] * A) + np.diag(known + loose)
    right = A.T @ (weight * has.y) + known * np.append(has.expected, np.zeros(extra))
    value, sigma = np.zeros(len(free)), np.full(len(free), np.inf)
    size = np.sqrt(np.diag(normal))[free]
    inverse = np.linalg.inv(normal[np.ix_(free, free)] / np.outer(size, size)) / np.outer(size, size)
    value[free], sigma[free] = inverse @ right[free], np.sqrt(np.maximum(np.diag(inverse), 0.0))
    return value, sigma
