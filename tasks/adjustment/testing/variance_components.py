"""What the residuals say of the stated standard errors: one factor per group of observations.

Image measurements get the factor that their residuals and their part of the redundancy give. What a person measured or surveyed
keeps the standard errors it came with unless it contradicts them: then these are enlarged.

Source: Foerstner 1979 for the estimation of variance components from redundancy parts.
"""

import numpy as np

from orthomill.tasks.adjustment.model.adjustment_result import Adjustment, Factors, Group, surveyed
from orthomill.tasks.adjustment.model.datum import (
    distance_derivatives,
    distance_residuals,
    position_derivatives,
    position_residuals,
)

POINTINGS = "surveyed points in photographs"
"""A group of observations, by its name"""


def estimated(result: Adjustment) -> tuple[Factors, tuple[Group, ...]]:
    """The factors by which stated standard errors are to be multiplied, and the balance of the groups."""
    by_person, old = surveyed(result.network, result.rays), result.factors
    ties, pointings = result.used & ~by_person, result.used & by_person
    square, redundancy = _image_share(result, ties)
    image = old.image * float(np.sqrt(square / redundancy)) if redundancy > 0 else old.image
    shares = (_image_share(result, pointings), _position_share(result), _control_share(result), _distance_share(result))
    rest = [_enlarged(f, *share) for f, share in zip((old.pointing, old.position, old.control, old.distance), shares, strict=True)]
    new = Factors(max(image, 1e-6), *rest)
    counts = (
        2 * int(ties.sum()),
        2 * int(pointings.sum()),
        _known(result.network.centre_weight),
        _known(result.network.point_weight),
        _known(result.network.distances.weight),
    )
    names = ("tie points in photographs", POINTINGS, "GNSS positions", "surveyed coordinates", "distances")
    parts = (redundancy, *(share[1] for share in shares))
    factors = (new.image, *rest)
    return new, tuple(Group(*row) for row in zip(names, counts, parts, factors, strict=True) if row[1])


def settled(new: Factors, old: Factors) -> bool:
    """Whether two sets of factors agree within 1 %."""
    return all(abs(vars(new)[name] / vars(old)[name] - 1.0) <= 0.01 for name in vars(new))


def _known(weight: np.ndarray) -> int:
    return int((weight > 0).sum())


def _image_share(result: Adjustment, chosen: np.ndarray) -> tuple[float, float]:
    """Weighted square sum and redundancy of the image measurements of the rays `chosen`."""
    square = (result.residual[chosen] ** 2 / result.rays.sigma[chosen][:, None] ** 2).sum()
    return float(square), float(result.redundancy_number[chosen].sum())


def position_covariances(result: Adjustment, photos: np.ndarray) -> np.ndarray:
    """(p, 3, 3) m^2 of the adjusted places of the antennas of `photos` (p,)."""
    J, columns = position_derivatives(result.network, result.state, photos)
    return J @ result.cofactor.blocks.pieces(columns) @ J.transpose(0, 2, 1)


def _position_share(result: Adjustment) -> tuple[float, float]:
    """Weighted square sum and redundancy of the GNSS positions."""
    weight = result.network.centre_weight
    square = (weight * position_residuals(result.network, result.state) ** 2).sum()
    photos = np.flatnonzero(weight.any(axis=1))
    variance = np.diagonal(position_covariances(result, photos), axis1=1, axis2=2)
    return float(square), _known(weight) - float((weight[photos] * variance).sum())


def _control_share(result: Adjustment) -> tuple[float, float]:
    """Weighted square sum and redundancy of the coordinates of the control points."""
    weight = result.network.point_weight
    variance = np.diagonal(result.point_covariance, axis1=1, axis2=2)
    square = (weight * (result.network.point - result.state.point) ** 2).sum()
    return float(square), float((1.0 - weight * variance)[weight > 0].sum())


def _distance_share(result: Adjustment) -> tuple[float, float]:
    weight = result.network.distances.weight
    square = (weight * distance_residuals(result.network, result.state) ** 2).sum()
    return float(square), float((1.0 - weight * distance_variances(result))[weight > 0].sum())


def distance_variances(result: Adjustment) -> np.ndarray:
    """(D,) m^2 of the adjusted distances."""
    J, columns = distance_derivatives(result.network, result.state)
    return np.einsum("di,dij,dj->d", J, result.cofactor.blocks.pieces(columns), J)


def _enlarged(old: float, square: float, redundancy: float) -> float:
    """Standard errors are enlarged only where three or more redundant numbers contradict them by more than chance (about 99.9
    %)."""
    if redundancy < 3.0:
        return old
    factor = old * np.sqrt(square / redundancy)
    return float(max(factor, 1.0)) if factor > 1.0 + 2.2 / np.sqrt(redundancy) else 1.0
