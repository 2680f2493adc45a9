"""Reliability of each group of observations: the smallest error of one of them that the test finds, and what it does unfound.

Source: Baarda 1968, A testing procedure for use in geodetic networks.
"""

from collections.abc import Iterator

import numpy as np

from orthomill.schemas.orientation import GroupReliability
from orthomill.tasks.adjustment.model.reliability import NONCENTRALITY
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment, ObservationKind, surveyed
from orthomill.tasks.adjustment.testing.surveyed_blunders import CHECKABLE
from orthomill.tasks.adjustment.testing.variance_components import distance_variances, position_covariances, seen_control

Key = tuple[ObservationKind, int]


def reliability_of_groups(result: Adjustment) -> dict[Key, GroupReliability]:
    """By kind and part of the groups of an adjustment."""
    return {(kind, part): _reliability(sigma, share) for kind, part, sigma, share in _groups(result)}


def _groups(result: Adjustment) -> Iterator[tuple[ObservationKind, int, np.ndarray, np.ndarray]]:
    """Standard errors and redundancy numbers of the observations of each group, in any shape."""
    by_person, network, own = surveyed(result.network, result.rays), result.network, result.as_computed
    for kind, rays in ((ObservationKind.TIES, ~by_person), (ObservationKind.POINTINGS, by_person)):
        used = result.used & rays
        number = result.redundancy_number[used]
        yield kind, 0, np.broadcast_to(result.ray_sigma[used][:, None], number.shape), number
    weight = network.centre_weight
    photos = np.flatnonzero(weight.any(axis=1))
    spread = np.diagonal(position_covariances(own, photos), axis1=1, axis2=2)
    for part in range(int(network.gnss_groups.max(initial=0)) + 1):
        chosen = network.gnss_groups[photos] == part
        yield ObservationKind.POSITIONS, part, *_of_weights(weight[photos][chosen], spread[chosen])
    points = np.diagonal(own.point_covariance, axis1=1, axis2=2)
    yield ObservationKind.CONTROL, 0, *_of_weights(seen_control(own), points)
    yield ObservationKind.DISTANCES, 0, *_of_weights(network.distances.weight, distance_variances(own))


def _of_weights(weight: np.ndarray, variance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Standard errors and redundancy numbers from the weights and the variances of the adjusted observations."""
    known = weight > 0
    return 1.0 / np.sqrt(weight[known]), 1.0 - weight[known] * variance[known]


def _reliability(sigma: np.ndarray, share: np.ndarray) -> GroupReliability:
    checked = share > CHECKABLE
    found = NONCENTRALITY * sigma[checked] / np.sqrt(share[checked])
    effect = np.clip(1.0 - share[checked], 0.0, 1.0) * found
    middle, most = ([float(f(v)) for v in (found, effect)] if len(found) else [None, None] for f in (np.median, np.max))
    return GroupReliability(
        detectable=middle[0],
        detectable_most=most[0],
        effect=middle[1],
        effect_most=most[1],
        unchecked=int(share.size - checked.sum()),
    )
