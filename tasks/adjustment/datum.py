"""What is known beside the rays: weighted positions, control, distances, a wish for verticality; or inner constraints when nothing
holds the block in space.

Robust factors scale the weights of whole positions and whole surveyed points: a wrong one must not drag the block along while it
has not been found.
"""

from dataclasses import dataclass

import numpy as np

from tasks.adjustment.network import Network, State
from tasks.adjustment.robust import huber_cost, huber_weights
from tasks.geometry.rotation_vector import skew


@dataclass(frozen=True, eq=False)
class PriorFactors:
    """Robust factors of the weights of the positions (P,), the surveyed points (N,) and the distances (D,)."""

    centre: np.ndarray
    point: np.ndarray
    distance: np.ndarray


def prior_sizes(network: Network, state: State) -> PriorFactors:
    """Lengths of the misclosures of positions, surveyed points and distances, in standard errors; 0 where nothing is known."""
    position = (network.centre_weight * position_misclosures(network, state) ** 2).sum(axis=1)
    point = (network.point_weight * (network.point - state.point) ** 2).sum(axis=1)
    distance = network.distances.weight * distance_misclosures(network, state) ** 2
    return PriorFactors(np.sqrt(position), np.sqrt(point), np.sqrt(distance))


def prior_factors(network: Network, state: State, huber: float) -> PriorFactors:
    """Huber's factors of all that was surveyed; 1 for an infinite limit."""
    size = prior_sizes(network, state)
    return PriorFactors(*(huber_weights(each, huber) for each in (size.centre, size.point, size.distance)))


def prior_normals(network: Network, state: State, factors: PriorFactors | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Normal matrix (n, n) and right-hand side (n,) of all that is known beforehand, but for eliminated points (they carry their
    own)."""
    factors = factors or prior_factors(network, state, np.inf)
    normal, right = np.zeros((network.unknowns, network.unknowns)), np.zeros(network.unknowns)
    _add_positions(network, state, factors.centre, normal, right)
    _add_verticality(network, state, normal, right)
    _add_interior(network, state, normal, right)
    _add_lever(network, state, normal, right)
    _add_kept_points(network, state, factors.point, normal, right)
    _add_distances(network, state, factors.distance, normal, right)
    return normal, right


def prior_cost(network: Network, state: State, huber: float = np.inf) -> float:
    """Weighted sum of squares (of Huber's loss for what was surveyed) of all that is known beforehand, points included."""
    value, size = network.interior.value - state.interior, prior_sizes(network, state)
    return float(
        huber_cost(size.centre, huber)
        + huber_cost(size.point, huber)
        + (network.vertical_weight * (vertical_misclosures(network, state) ** 2).sum(axis=1)).sum()
        + np.einsum("ci,cij,cj->", value, network.interior.weight, value)
        + (network.lever_weight * (network.lever - state.lever) ** 2).sum()
        + huber_cost(size.distance, huber)
    )


def position_misclosures(network: Network, state: State) -> np.ndarray:
    """GNSS position minus (projection centre + lever arm + shift), (P, 3) m; meaningless where the weight is 0."""
    antenna = state.centre + np.einsum("pji,j->pi", state.rotation, state.lever) + state.shift
    return np.where(network.centre_weight > 0, network.centre - antenna, 0.0)


def vertical_misclosures(network: Network, state: State) -> np.ndarray:
    """(P, 3) expected zenith in the image system by the zenith there: zero where they agree, and as long as the sine of the angle
    between them; meaningless where the weight is 0."""
    return np.cross(network.zenith, state.rotation[:, :, 2])


def position_derivatives(network: Network, state: State, photo: int) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (3, m) of the antenna's place by the unknowns in the columns (m,)."""
    blocks, columns = [np.eye(3)], [6 * photo + np.arange(3)]
    if state.lever.any() or len(network.lever_columns):
        blocks.append(state.rotation[photo].T @ skew(state.lever))
        columns.append(6 * photo + 3 + np.arange(3))
    if len(network.lever_columns):
        blocks.append(state.rotation[photo].T)
        columns.append(network.lever_columns)
    if network.shift:
        blocks.append(np.eye(3))
        columns.append(network.shift_columns)
    return np.hstack(blocks), np.concatenate(columns)


def distance_misclosures(network: Network, state: State) -> np.ndarray:
    """Measured minus computed distances (D,), m."""
    first, second = network.distances.ends.T
    return network.distances.length - np.linalg.norm(state.point[second] - state.point[first], axis=1)


def distance_derivatives(network: Network, state: State) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (D, 6) of the distances by their ends in the columns (D, 6)."""
    first, second = network.distances.ends.T
    along = state.point[second] - state.point[first]
    along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    place = np.searchsorted(network.kept, network.distances.ends)
    return np.hstack([-along, along]), network.kept_columns[place].reshape(-1, 6)


def _add_positions(network: Network, state: State, factor: np.ndarray, normal: np.ndarray, right: np.ndarray) -> None:
    misclosure = position_misclosures(network, state)
    for photo in np.flatnonzero(network.centre_weight.any(axis=1)):
        J, columns = position_derivatives(network, state, photo)
        weighted = J.T * (factor[photo] * network.centre_weight[photo])
        right[columns] += weighted @ misclosure[photo]
        normal[np.ix_(columns, columns)] += weighted @ J


def _add_verticality(network: Network, state: State, normal: np.ndarray, right: np.ndarray) -> None:
    """The zenith u in the image system moves by w x u, and so does u x b by (b . w) u - (b . u) w, where b is the expected one."""
    misclosure, zenith = vertical_misclosures(network, state), np.broadcast_to(network.zenith, (network.photos, 3))
    for photo in np.flatnonzero(network.vertical_weight > 0):
        u, b, weight = state.rotation[photo, :, 2], zenith[photo], network.vertical_weight[photo]
        J = np.outer(u, b) - (b @ u) * np.eye(3)
        own = slice(6 * photo + 3, 6 * photo + 6)
        normal[own, own] += weight * J.T @ J
        right[own] += weight * J.T @ misclosure[photo]


def _add_interior(network: Network, state: State, normal: np.ndarray, right: np.ndarray) -> None:
    for columns, weight, value in zip(
        network.interior_columns, network.interior.weight, network.interior.value - state.interior, strict=True
    ):
        free = columns >= 0
        normal[np.ix_(columns[free], columns[free])] += weight[np.ix_(free, free)]
        right[columns[free]] += (weight @ value)[free]


def _add_lever(network: Network, state: State, normal: np.ndarray, right: np.ndarray) -> None:
    columns = network.lever_columns
    if len(columns):
        normal[columns, columns] += network.lever_weight
        right[columns] += network.lever_weight * (network.lever - state.lever)


def _add_kept_points(network: Network, state: State, factor: np.ndarray, normal: np.ndarray, right: np.ndarray) -> None:
    columns = network.kept_columns.ravel()
    weight = (factor[:, None] * network.point_weight)[network.kept].ravel()
    normal[columns, columns] += weight
    right[columns] += weight * (network.point - state.point)[network.kept].ravel()


def _add_distances(network: Network, state: State, factor: np.ndarray, normal: np.ndarray, right: np.ndarray) -> None:
    if not len(network.distances):
        return
    misclosure = distance_misclosures(network, state)
    for J, columns, weight, value in zip(
        *distance_derivatives(network, state), factor * network.distances.weight, misclosure, strict=True
    ):
        normal[np.ix_(columns, columns)] += weight * np.outer(J, J)
        right[columns] += weight * value * J


def freedoms(network: Network, state: State) -> np.ndarray:
    """(n, 7 or 6): how the unknowns move when the whole block is shifted, turned and (without distances) scaled; what measurements
    in photographs cannot see."""
    H = np.zeros((network.unknowns, 7))
    middle = state.centre.mean(axis=0)
    for photo in range(network.photos):
        _add_freedom(H, 6 * photo + np.arange(3), state.centre[photo] - middle)
        H[6 * photo + 3 : 6 * photo + 6, 3:6] = -state.rotation[photo]
    for columns, point in zip(network.kept_columns, network.kept, strict=True):
        _add_freedom(H, columns, state.point[point] - middle)
    return H[:, : network.freedoms]


def _add_freedom(H: np.ndarray, rows: np.ndarray, lever: np.ndarray) -> None:
    H[rows, :3] = np.eye(3)
    H[rows, 3:6] = -skew(lever)
    H[rows, 6] = lever
