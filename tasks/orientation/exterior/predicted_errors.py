"""A block whose rays weigh what they are worth beside positions, control, attitudes and weighted cameras.

The adjustment weights every ray by itself. Where its residuals show that image errors are correlated, what these must have been for
all other observations to agree is predicted (`predicted_fields`), taken off the measurements, and the block is adjusted again.
"""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.bundle import BlunderTest, adjust
from orthomill.tasks.adjustment.model.network import Network, Rays
from orthomill.tasks.adjustment.solve.minimise import NEAR, minimise
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment
from orthomill.tasks.adjustment.testing.error_fields import TERMS, correlated_errors, displacements
from orthomill.tasks.adjustment.testing.predicted_fields import predicted_fields
from orthomill.tasks.orientation.block.assembly import Problem
from orthomill.tasks.orientation.block.camera_constant import Tested
from orthomill.tasks.orientation.shape.held_parameters import held_sigmas, with_held

ROUNDS = 2
"""Adjustments at most: what was rejected beside rays that outvoted it shows more of the fields."""


def with_predicted_errors(tested: Tested, network: Network, rays: Rays, test: BlunderTest, problem: Problem, fixed: bool) -> Tested:
    """The adjustment of the `rays` less the fields that all other observations in the `network` show; as it is where image errors
    are white, or where nothing but the rays determines the block. `fixed`: the workflow has decided what cameras are."""
    if network.free:
        return tested
    size = problem.frame_sizes
    errors = correlated_errors(tested.result, size)
    if errors is None:
        return tested
    held = np.array([held_sigmas(camera) for camera in problem.cameras]) * (not fixed)
    taken = np.zeros((len(problem.names), 2, TERMS))
    # Where a second adjustment fails, the one before it stands.
    with suppress(GeometryError):
        for _ in range(ROUNDS):
            before = _as_stated(tested.result)
            taken = predicted_fields(with_held(before, held), errors, size, taken).coefficients
            less = replace(rays, xy=rays.xy - displacements(rays, size, taken))
            # With the stated weights: what looked like a blunder beside rays that outvote it gets another trial.
            known = replace(network, interior=before.network.interior)
            tested = replace(tested, result=adjust(known, before.state, less, test))
            if len(tested.result.blunders) == len(before.blunders):
                break
    return tested


def _as_stated(result: Adjustment) -> Adjustment:
    """The solution with the stated standard errors of all that is no ray: enlarged ones would leave fields nothing to explain."""
    factors, network = result.factors, result.network
    stated = replace(
        network,
        centre_weight=network.centre_weight * factors.of_positions(network) ** 2,
        point_weight=network.point_weight * factors.control**2,
        distances=replace(network.distances, weight=network.distances.weight * factors.distance**2),
    )
    state, _ = minimise(stated, result.state, replace(result.rays, sigma=result.ray_sigma).take(result.used), damping=NEAR)
    return replace(result, network=stated, state=state)
