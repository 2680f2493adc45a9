"""What explains control that contradicts the block: a few wrong points, or standard errors that are too small for all of them.

Few points cannot be tested one by one: a block follows three of five that are all wrong by the same size, and the other two look
like blunders. All hypotheses "these points are wrong, and the standard errors of the others are f times those stated" are therefore
compared by their evidence, the probability of the coordinates with everything unknown integrated out. A factor may have any
logarithm, and so may the size of a blunder, up to the largest. Never are more than a third of the points called wrong, nor one
whose errors hardly show, nor one that another could be in place of.

Everything refers to the block without its control, which one adjusted solution with any weights of the control contains: its
normal matrix is that of the solution less these weights.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

FACTORS = np.geomspace(1.0, 1e4, 49)
"""Factors of the standard errors that are compared; from 1 to control of a few hundred metres."""
AS_STATED = 0.9
"""Probability beforehand that standard errors are those stated; a block that hardly checks its control must not question them."""
WRONG = 0.05
"""Probability beforehand that a point is wrong"""
BLUNDERS = np.log(1e5)
"""Natural logarithm of the ratio of the largest to the smallest blunder"""
MOST = 3
"""One in so many points, at most, is called wrong: of more nobody could say which are right."""
CHECKED = 0.3
"""A point of whose errors a smaller share shows in its own residuals is not called wrong (its mean redundancy number)."""
CLEAR = 2.0
"""Logarithm of the ratio by which a hypothesis must be more probable than one with another point in place of one of its own."""
SINGULAR = 1e-12
"""Smallest relative eigenvalue of the normal matrix of points that the rest of the block determines"""
ROUNDING = 1e-9
"""Smaller eigenvalues, in units of the largest, are zero: nothing but the control determines these combinations of coordinates."""
SPHERE = (np.nan, 2.0, 2.0 * np.pi, 4.0 * np.pi)
"""Surface of the unit sphere by the number of known coordinates"""


class Explanation(NamedTuple):
    """The `factor` of the standard errors, and which points are `wrong` (n,) bool."""

    factor: float
    wrong: np.ndarray


@dataclass(frozen=True, eq=False)
class ControlEquations:
    """What the block without its control says of the coordinates of n points, as normal equations of given minus true: `normal`
    (3n, 3n) 1/m^2, which may be singular, its right-hand side `right` (3n,), and the stated weights `weight` (3n,) (0: unknown)."""

    normal: np.ndarray
    right: np.ndarray
    weight: np.ndarray

    @property
    def points(self) -> int:
        """The number of points."""
        return len(self.weight) // 3


def control_equations(residual: np.ndarray, covariance: np.ndarray, used: np.ndarray, stated: np.ndarray) -> ControlEquations:
    """From an adjusted solution: given minus adjusted coordinates `residual` (n, 3) m, their joint `covariance` (3n, 3n) m^2, and
    the weights (n, 3) 1/m^2 that were `used` and that are `stated`."""
    scale = np.sqrt(np.diagonal(covariance))
    whole = np.linalg.inv(covariance / np.outer(scale, scale)) / np.outer(scale, scale)
    # The solution x^ of N' (x - p) + W (x - l) = 0 has N' (l - p) = (N' + W) (l - x^).
    return ControlEquations(whole - np.diag(used.ravel()), whole @ residual.ravel(), stated.ravel())


def explained(equations: ControlEquations, most: int) -> Explanation:
    """The most probable explanation with no more than `most` wrong points."""
    best = [_judged(equations, np.zeros(equations.points, bool))]
    for _ in range(most):
        now = _with_one_more(equations, best[-1])
        if now is None:
            break
        best.append(now)
    # From the most probable on: one of whose points another could take the place is no finding.
    for one in sorted(best, key=lambda each: -each.evidence):
        if _is_clear(equations, one):
            return Explanation(one.factor, one.wrong)
    raise ArithmeticError("no hypothesis about the control is clear, not even that without wrong points; please report it")


class _Weighed(NamedTuple):
    """A hypothesis: the logarithm of its evidence, its most probable factor, and its wrong points (n,) bool."""

    evidence: float
    factor: float
    wrong: np.ndarray


def _with_one_more(equations: ControlEquations, now: _Weighed) -> _Weighed | None:
    """The most probable hypothesis with one more wrong point among those that are checked; None without one."""
    number = np.flatnonzero(~now.wrong & (_redundancies(equations, now) >= CHECKED))
    tried = [_judged(equations, now.wrong | (np.arange(equations.points) == i)) for i in number]
    return max(tried, key=lambda each: each.evidence, default=None)


def _is_clear(equations: ControlEquations, one: _Weighed) -> bool:
    """Whether no other point in place of one of the wrong ones is nearly as probable."""
    for i in np.flatnonzero(one.wrong):
        for j in np.flatnonzero(~one.wrong):
            other = one.wrong.copy()
            other[[i, j]] = False, True
            if _judged(equations, other).evidence > one.evidence - CLEAR:
                return False
    return True


def _redundancies(equations: ControlEquations, now: _Weighed) -> np.ndarray:
    """(n,) the mean redundancy numbers of the known coordinates of each point."""
    weight = np.where(np.repeat(now.wrong, 3), 0.0, equations.weight / now.factor**2)
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(equations.normal) + weight, 1e-300))
    inverse = np.linalg.pinv((equations.normal + np.diag(weight)) * np.outer(scale, scale), hermitian=True) * np.outer(scale, scale)
    numbers = (1.0 - weight * np.diagonal(inverse)).reshape(-1, 3)
    known = (equations.weight > 0).reshape(-1, 3)
    return (numbers * known).sum(axis=1) / np.maximum(known.sum(axis=1), 1)


def _judged(equations: ControlEquations, wrong: np.ndarray) -> _Weighed:
    evidence = _evidences(equations, wrong) + wrong.sum() * np.log(WRONG / (1.0 - WRONG))
    stated = evidence[0] + np.log(AS_STATED)
    larger = _log_mean(evidence[1:]) + np.log(1.0 - AS_STATED)
    total = float(np.logaddexp(stated, larger))
    if not larger > stated:
        return _Weighed(total, 1.0, wrong)
    share = np.exp(evidence[1:] - evidence[1:].max())
    return _Weighed(total, float(np.exp(share @ np.log(FACTORS[1:]) / share.sum())), wrong)


def _log_mean(values: np.ndarray) -> float:
    """The logarithm of the mean of numbers given by their logarithms."""
    top = float(values.max())
    return top + float(np.log(np.exp(values - top).mean())) if np.isfinite(top) else -np.inf


def _evidences(equations: ControlEquations, wrong: np.ndarray) -> np.ndarray:
    """(F,) logarithms of the evidence at each of FACTORS, up to a constant; -inf where the rest does not determine the wrong
    points."""
    nothing = np.full(len(FACTORS), -np.inf)
    out = np.repeat(wrong, 3) | (equations.weight == 0)
    N, right, W = equations.normal, equations.right, equations.weight[~out]
    own, cross = N[np.ix_(out, out)], N[np.ix_(out, ~out)]
    scale = np.sqrt(np.maximum(np.diagonal(own), 1e-300))
    values, vectors = np.linalg.eigh(own / np.outer(scale, scale))
    if len(values) and values[0] < SINGULAR:
        return nothing
    inverse = (vectors / values) @ vectors.T / np.outer(scale, scale)
    # Without the wrong points, and in units of the stated standard errors: factors then change eigenvalues only.
    reduced, rest = N[np.ix_(~out, ~out)] - cross.T @ inverse @ cross, right[~out] - cross.T @ inverse @ right[out]
    root = np.sqrt(W)
    eigen, axes = np.linalg.eigh(reduced / np.outer(root, root))
    # Of a block without positions seven are zero but for rounding, which large factors would multiply.
    known = eigen > ROUNDING * eigen.max(initial=0.0)
    spread = np.where(known, eigen, 0.0) * FACTORS[:, None] ** 2 + 1.0
    along = np.where(known, axes.T @ (rest / root), 0.0)
    square = -right[out] @ inverse @ right[out] - (along**2 * FACTORS[:, None] ** 2 / spread).sum(axis=1)
    likelihood = -0.5 * (square + np.log(spread).sum(axis=1) + len(W) * np.log(2.0 * np.pi))
    likelihood -= 0.5 * (np.log(values).sum() + 2.0 * np.log(scale).sum())
    turned = inverse @ cross @ (axes / root[:, None])
    moved = inverse @ right[out] - (turned @ (along * FACTORS[:, None] ** 2 / spread)[:, :, None])[:, :, 0]
    variance = np.diagonal(inverse) + (FACTORS[:, None] ** 2 / spread) @ (turned**2).T
    return likelihood + _of_blunders(equations.weight[out], np.flatnonzero(out) // 3, moved, variance)


def _of_blunders(weight: np.ndarray, point: np.ndarray, size: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """(F,) logarithms of the densities of blunders of these sizes and variances (F, m) in coordinates (m,) of these weights and
    points: all directions alike, and every order of magnitude."""
    total = np.zeros(len(size))
    for number in np.unique(point[weight > 0]):
        own = (point == number) & (weight > 0)
        length = np.sqrt(np.maximum((weight * (size**2 + variance))[:, own].sum(axis=1), 1.0))
        dimensions = int(own.sum())
        total += 0.5 * np.log(weight[own]).sum() - np.log(SPHERE[dimensions] * BLUNDERS) - dimensions * np.log(length)
    return total
