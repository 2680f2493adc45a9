"""The mixed model of adjustment (Gauss-Helmert): conditions between observations and unknowns, one condition per row.

A model holds its unknowns, evaluates its conditions with their derivatives, and returns itself moved by a correction of the
unknowns, so that rotations and unit vectors are corrected on their own manifold. Every condition has observations of its own:
B P^-1 B' is diagonal, and thousands of conditions cost little. By-products are the redundancy number (the share of an error that
its own condition shows), the standardised discrepancy, and the smallest error that a test would find.

Source: Karfis 2009, section 3.4 (sources/epipolar.md#relative-orientation, with its misprint in M corrected); Baarda
1968 for reliability.
"""

from dataclasses import dataclass
from typing import Generic, Protocol, Self, TypeVar

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.model.reliability import NONCENTRALITY


class ConditionModel(Protocol):
    """Unknowns with conditions F(unknowns, observations) = 0."""

    def evaluate(self, observations: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """F (s,), dF/dunknowns (s, u) and dF/dobservations (s, q) at observations (s, q)."""

    def moved(self, correction: np.ndarray) -> Self:
        """The model with its unknowns corrected by (u,)."""


M = TypeVar("M", bound=ConditionModel)


@dataclass(frozen=True, eq=False)
class MixedSolution(Generic[M]):
    """An adjusted model. `residuals` (s, q) in the unit of the observations; `sigma0` (in that unit, or relative to the stated
    standard errors where these were given) and `covariance` (u, u) are NaN without redundancy. By condition: `discrepancy` (s,) in
    stated standard errors, `redundancy_number` (s,), and `slope` (s, q), its derivatives by the observations."""

    model: M
    residuals: np.ndarray
    sigma0: float
    covariance: np.ndarray
    redundancy: int
    iterations: int
    discrepancy: np.ndarray
    redundancy_number: np.ndarray
    slope: np.ndarray

    @property
    def standard_errors(self) -> np.ndarray:
        """(u,) of the unknowns."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def standardised(self) -> np.ndarray:
        """(s,) discrepancies in units of their own standard errors; 0 where the other conditions do not check one."""
        checked = self.redundancy_number > 1e-6
        # With the estimated sigma0: stated standard errors of matches are often a guess.
        size = self.sigma0 * np.sqrt(np.maximum(self.redundancy_number, 1e-6))
        return np.where(checked, self.discrepancy / np.maximum(size, 1e-300), 0.0)

    @property
    def detectable(self) -> np.ndarray:
        """(s, q) the smallest error of each observation that the test would find with 80 % probability at 0.1 %."""
        size = NONCENTRALITY * self.sigma0 / np.sqrt(np.maximum(self.redundancy_number, 1e-12))
        return size[:, None] / np.maximum(np.abs(self.slope), 1e-300)


def solve_mixed(
    model: M, observations: np.ndarray, limit: float = 1e-12, most: int = 50, sigma: np.ndarray | None = None
) -> MixedSolution[M]:
    """The least-squares solution of the mixed model, linearised at the adjusted observations.

    observations (s, q): row i belongs to condition i. `sigma` (s, q): their standard errors; equal weights without. Stops when no
    correction of an unknown exceeds `limit` (or, near the rounding of the observations, when corrections no longer shrink). Raises
    GeometryError with fewer conditions than unknowns, for a singular configuration, and when `most` iterations do not converge.
    """
    variance = np.ones_like(observations) if sigma is None else sigma**2
    residuals, previous = np.zeros_like(observations), np.inf
    for iteration in range(1, most + 1):
        F, A, B = model.evaluate(observations + residuals)
        _check_count(*A.shape)
        # Linearised at the adjusted observations: B applies to all of their residuals, not to the change since the last step.
        w = F - (B * residuals).sum(axis=1)
        inverse_m = 1.0 / (B**2 * variance).sum(axis=1)
        normal = A.T @ (inverse_m[:, None] * A)
        correction = -_solve(normal, A.T @ (inverse_m * w))
        gap = w + A @ correction
        residuals = -variance * B * (inverse_m * gap)[:, None]
        model = model.moved(correction)
        largest = float(np.abs(correction).max())
        # Near the rounding of the observations corrections stop shrinking above any limit; they are as good as zero then.
        if largest < limit or (largest < 1e-8 and largest > 0.5 * previous):
            return _solution(model, residuals, iteration, normal, (A, B, inverse_m, gap))
        previous = largest
    raise GeometryError(
        f"The relative orientation did not converge in {most} iterations; its matches may be wrong, or its starting values poor."
    )


def _check_count(conditions: int, unknowns: int) -> None:
    if conditions < unknowns:
        raise GeometryError(f"{conditions} matches cannot determine {unknowns} unknowns; at least {unknowns} are needed.")


def _solve(normal: np.ndarray, right: np.ndarray) -> np.ndarray:
    # The condition is a matter of geometry only after scaling: a base in metres and angles in radians differ by powers of ten.
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal * scale[:, None] * scale
    if not np.isfinite(scaled).all() or _singular(scaled):
        raise GeometryError(
            "The matches do not determine the relative orientation: they are too close together or on a critical surface."
        )
    return scale * np.linalg.solve(scaled, scale * right)


def _singular(scaled: np.ndarray) -> bool:
    """Whether a positive matrix (n, n) with ones on its diagonal has a condition above 1e14."""
    # Its eigenvalues sum to n, so that those without the smallest have a product below e: the condition is below n e / determinant,
    # which takes a fifth of the time and is far below the limit in all but a few cases.
    return bool(np.linalg.det(scaled) < 1e-10 and np.linalg.cond(scaled) > 1e14)


def _solution(
    model: M, residuals: np.ndarray, iterations: int, normal: np.ndarray, at_end: tuple[np.ndarray, ...]
) -> MixedSolution[M]:
    A, B, inverse_m, gap = at_end
    redundancy, root = len(residuals) - len(normal), np.sqrt(inverse_m)
    discrepancy, cofactor = gap * root, np.linalg.inv(normal)
    sigma0 = float(np.sqrt((discrepancy**2).sum() / redundancy)) if redundancy else np.nan
    # Rounding may take a condition that alone determines an unknown slightly below 0.
    numbers = np.clip(1.0 - inverse_m * np.einsum("ni,ij,nj->n", A, cofactor, A), 0.0, 1.0)
    return MixedSolution(
        model, residuals, sigma0, sigma0**2 * cofactor, redundancy, iterations, discrepancy, numbers, B * root[:, None]
    )
