"""The precision of a solution and the standardised residuals of its rays."""

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.model.collinearity import residuals
from orthomill.tasks.adjustment.model.linearisation import linearised
from orthomill.tasks.adjustment.model.network import Network, Rays, State
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment, Covariances, Factors
from orthomill.tasks.adjustment.testing.covariances import covariance_of, points_alone, points_and_rays, with_considered

# A ray that alone determines something has a redundancy number of 0 and a residual of 0: their quotient has to stay a number.
LEAST_REDUNDANCY = 1e-6
"""Smallest redundancy number in standardised residuals."""


def precise_solution(network: Network, state: State, rays: Rays, used: np.ndarray, factors: Factors) -> Adjustment:
    """Covariance, redundancy numbers and standardised residuals of a solution with the `used` rays.

    Raises GeometryError where the observations do not determine the unknowns, or without redundancy.
    """
    taken = rays.take(used)
    linear = linearised(network, state, taken)
    cofactor = covariance_of(network, state, linear)
    points, adjusted = points_and_rays(network, linear, cofactor)
    computed = None
    if network.considered_columns.any():
        # The redundancy numbers are those of the adjustment as computed; the covariance is that of what it does not know, too.
        computed = Covariances(network, cofactor, points)
        cofactor = with_considered(network, linear, cofactor)
        points = points_alone(network, linear, cofactor)
    numbers, standardised = np.full((len(rays), 2), np.nan), np.full((len(rays), 2), np.nan)
    numbers[used] = np.clip(1.0 - adjusted * linear.weight[:, None], LEAST_REDUNDANCY, 1.0)
    residual = residuals(state, rays, network.camera_of)
    standardised[used] = residual[used] / (taken.sigma[:, None] * np.sqrt(numbers[used]))
    redundancy = _redundancy(network, taken)
    tests = (residual, numbers, standardised)
    return Adjustment(state, network, rays, used, *tests, cofactor, points, redundancy, factors, computed=computed)


def _redundancy(network: Network, rays: Rays) -> int:
    """Observations minus unknowns, plus the datum defect. Raises GeometryError where that is not positive."""
    eliminated = np.union1d(rays.point, np.flatnonzero(network.point_weight.any(axis=1)))
    points = len(np.setdiff1d(eliminated, network.kept))
    # Considered parameters keep their value: they are columns, but no unknowns.
    redundancy = 2 * len(rays) + network.prior_observations - network.unknowns + int(network.interior.considered.sum())
    redundancy += network.freedoms - 3 * points
    if redundancy <= 0:
        raise GeometryError(f"The block has {len(rays)} rays, which is not enough to adjust it; more tie points are needed.")
    return redundancy
