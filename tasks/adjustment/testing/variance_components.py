"""Variance components: one factor per group of observations, the ratio of estimated to stated standard errors.

Image measurements get the factor that their residuals and their share of the redundancy yield. What a person measured or surveyed
keeps its stated standard errors unless it contradicts them; then these are enlarged.

Source: Foerstner 1979 for the estimation of variance components from redundancy parts.
"""

import numpy as np

from orthomill.tasks.adjustment.model.datum import (
    distance_derivatives,
    distance_residuals,
    position_derivatives,
    position_residuals,
)
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment, Factors, Group, ObservationKind, surveyed
from orthomill.tasks.adjustment.testing.position_trend import without_bend

# One position has three coordinates: with less, a single observation would judge itself.
LEAST_REDUNDANCY_OF_GROUP = 3.0
"""Redundancy below which the stated standard errors of a surveyed group are not questioned."""


def estimated_factors(result: Adjustment) -> tuple[Factors, tuple[Group, ...]]:
    """The factors of the stated standard errors, and the groups with their shares of the redundancy."""
    by_person, old = surveyed(result.network, result.rays), result.factors
    ties, pointings = result.used & ~by_person, result.used & by_person
    square, redundancy = _image_share(result, ties)
    # The residuals refer to the weights of the last solution, which contain the old factor: the new one multiplies it.
    image = old.image * float(np.sqrt(square / redundancy)) if redundancy > 0 else old.image
    own = result.as_computed
    shares = (_image_share(result, pointings), _control_share(own), _distance_share(own))
    pointing, control, distance = (
        enlarged(f, *share) for f, share in zip((old.pointing, old.control, old.distance), shares, strict=True)
    )
    positions = _position_groups(result)
    # Simulated exact observations have residuals of rounding only; a factor of 0 would be an infinite weight.
    new = Factors(max(image, 1e-6), pointing, tuple(group.factor for group in positions), control, distance)
    groups = (
        Group(ObservationKind.TIES, 2 * int(ties.sum()), redundancy, new.image),
        Group(ObservationKind.POINTINGS, 2 * int(pointings.sum()), shares[0][1], pointing),
        *positions,
        Group(ObservationKind.CONTROL, _known(seen_control(result)), shares[1][1], control),
        Group(ObservationKind.DISTANCES, _known(result.network.distances.weight), shares[2][1], distance),
    )
    return new, tuple(group for group in groups if group.count)


def image_factor_without(result: Adjustment, lost: np.ndarray) -> float:
    """The factor of tie points as it would be without the rays `lost` (M,) bool, one of a point or all of them."""
    ties = result.used & ~surveyed(result.network, result.rays)
    square, redundancy = _image_share(result, ties & ~lost)
    # A ray that goes takes along what it has bent the other rays of its point: its square in units of its own redundancy.
    count = np.bincount(result.rays.point[ties & ~lost], minlength=len(result.state.point))
    alone = ties & lost & (count[result.rays.point] > 0)
    own, numbers = _image_share(result, alone)
    square -= float((result.standardised[alone] ** 2).sum()) - own
    redundancy -= 2.0 * alone.sum() - numbers
    return result.factors.image * float(np.sqrt(square / redundancy)) if square > 0 and redundancy > 0 else result.factors.image


def converged(new: Factors, old: Factors) -> bool:
    """Whether two sets of factors agree within 1 %."""
    # One per cent of a standard error decides no test, and the next round would change it by less.
    return all(np.abs(np.divide(vars(new)[name], vars(old)[name]) - 1.0).max() <= 0.01 for name in vars(new))


def _known(weight: np.ndarray) -> int:
    """The number of observed values among weights."""
    return int((weight > 0).sum())


def _image_share(result: Adjustment, chosen: np.ndarray) -> tuple[float, float]:
    """Weighted square sum and redundancy of the image measurements of the rays `chosen`."""
    square = (result.residual[chosen] ** 2 / result.rays.sigma[chosen][:, None] ** 2).sum()
    return float(square), float(result.redundancy_number[chosen].sum())


def position_covariances(result: Adjustment, photos: np.ndarray) -> np.ndarray:
    """(p, 3, 3) m^2 of the adjusted antenna positions of `photos` (p,)."""
    J, columns = position_derivatives(result.network, result.state, photos)
    return J @ result.cofactor.blocks.pieces(columns) @ J.transpose(0, 2, 1)


def _position_groups(result: Adjustment) -> list[Group]:
    """The groups of the GNSS positions with their shares of the redundancy and their new factors; heights that bend over the block
    count without that bend, and all residuals only as far as nominal cameras do not explain them: neither is an error of the
    receiver, and larger standard errors would only hide it."""
    network, weight = result.network, result.network.centre_weight
    photos = np.flatnonzero(weight.any(axis=1))
    residual = position_residuals(result.network, result.state)[photos]
    residual[:, 2] = without_bend(result.state.centre[photos, :2], residual[:, 2])
    root = np.sqrt(weight[photos])
    moved = root[:, :, None] * _moved_by_considered(result.white, photos)
    # Of the sum centre + lever arm + shift, for that is what was observed; its parts are correlated.
    variance = np.diagonal(position_covariances(result.as_computed, photos), axis1=1, axis2=2)
    old, group_of, groups = result.factors.of_positions(network), network.gnss_groups, []
    for part in range(int(group_of.max(initial=0)) + 1):
        own = group_of[photos] == part
        square = _square_beyond((root * residual)[own].ravel(), moved[own].reshape(3 * int(own.sum()), moved.shape[2]))
        count = _known(weight[photos][own])
        redundancy = count - float((weight[photos] * variance)[own].sum())
        before = float(old[group_of == part].max(initial=1.0))
        groups.append(Group(ObservationKind.POSITIONS, count, redundancy, enlarged(before, square, redundancy), part))
    return groups


def _moved_by_considered(result: Adjustment, photos: np.ndarray) -> np.ndarray:
    """(p, 3, k) m: what one standard error of each considered parameter moves the adjusted positions of `photos` (p,) by."""
    J, columns = position_derivatives(result.network, result.state, photos)
    return J @ result.cofactor.moves[columns]


def _square_beyond(residual: np.ndarray, moved: np.ndarray) -> float:
    """The square of residuals (n,), in standard errors, by the covariance I + D D' that they have where k quantities of standard
    error 1 move them by D = `moved` (n, k)."""
    along = moved.T @ residual
    return float(residual @ residual - along @ np.linalg.solve(np.eye(len(along)) + moved.T @ moved, along))


def _control_share(result: Adjustment) -> tuple[float, float]:
    """Weighted square sum and redundancy of the coordinates of the control points."""
    weight = seen_control(result)
    variance = np.diagonal(result.point_covariance, axis1=1, axis2=2)
    square = (weight * (result.network.point - result.state.point) ** 2).sum()
    return float(square), float((1.0 - weight * variance)[weight > 0].sum())


def seen_control(result: Adjustment) -> np.ndarray:
    """(N, 3) the weights of the control; 0 for points without rays, whose coordinates nothing checks and which check nothing."""
    network = result.network
    seen = np.bincount(result.rays.point[result.used], minlength=len(network.point)) > 0
    seen[network.kept] = True
    return np.where(seen[:, None], network.point_weight, 0.0)


def _distance_share(result: Adjustment) -> tuple[float, float]:
    """Weighted square sum and redundancy of the distances."""
    weight = result.network.distances.weight
    square = (weight * distance_residuals(result.network, result.state) ** 2).sum()
    return float(square), float((1.0 - weight * distance_variances(result))[weight > 0].sum())


def distance_variances(result: Adjustment) -> np.ndarray:
    """(D,) m^2 of the adjusted distances."""
    J, columns = distance_derivatives(result.network, result.state)
    return np.einsum("di,dij,dj->d", J, result.cofactor.blocks.pieces(columns), J)


def enlarged(old: float, square: float, redundancy: float) -> float:
    """The new factor of a surveyed group: above 1 only where its redundancy is sufficient and the contradiction is no chance."""
    if redundancy < LEAST_REDUNDANCY_OF_GROUP:
        return old
    factor = old * np.sqrt(square / redundancy)
    # The ratio of standard errors scatters by 1 / sqrt(2 r); 2.2 / sqrt(r) is 3.1 of these, exceeded by chance about once in 1000.
    return float(max(factor, 1.0)) if factor > 1.0 + 2.2 / np.sqrt(redundancy) else 1.0
