"""The control of a block against the block without it, at a solution that contains both."""

from dataclasses import replace

import numpy as np

from orthomill.tasks.adjustment.model.collinearity import residual_lengths
from orthomill.tasks.adjustment.model.datum import prior_factors
from orthomill.tasks.adjustment.model.linearisation import linearised
from orthomill.tasks.adjustment.model.network import Network, Rays, State
from orthomill.tasks.adjustment.model.robust_weights import huber_weights
from orthomill.tasks.adjustment.testing.control_explanation import ControlEquations, control_equations
from orthomill.tasks.adjustment.testing.covariances import covariance_of


def control_in_block(network: Network, state: State, rays: Rays, stated: np.ndarray) -> tuple[np.ndarray, ControlEquations]:
    """The surveyed points (n,) with coordinates and rays, and what the rest of the block says of them; the `state` is the solution
    with the weights of `network` and `rays`, and `stated` (N, 3) are the weights to judge (0: the point is left as it is).

    Raises GeometryError where the block is not determined.
    """
    seen = np.bincount(rays.point, minlength=len(network.point)) > 0
    number = np.flatnonzero(network.point_weight.any(axis=1) & stated.any(axis=1) & seen)
    # Their covariance with each other is needed: they have to be unknowns of the reduced system.
    joint = replace(network, kept=np.union1d(network.kept, number))
    cofactor = covariance_of(joint, state, linearised(joint, state, rays))
    columns = joint.kept_columns[np.searchsorted(joint.kept, number)].ravel()
    residual = (network.point - state.point)[number]
    return number, control_equations(residual, cofactor.joint(columns), network.point_weight[number], stated[number])


def as_weighted(network: Network, state: State, rays: Rays, huber: float) -> tuple[Network, Rays]:
    """The network and rays with the weights that Huber's estimate has given them: the state is their least-squares solution."""
    factor = prior_factors(network, state, huber)
    weighted = replace(
        network,
        centre_weight=network.centre_weight * factor.centre[:, None],
        point_weight=network.point_weight * factor.point[:, None],
        distances=replace(network.distances, weight=network.distances.weight * factor.distance),
    )
    return weighted, replace(rays, sigma=rays.sigma / np.sqrt(huber_weights(residual_lengths(network, state, rays), huber)))
