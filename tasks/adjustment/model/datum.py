"""The datum: weighted positions, control, distances and verticality constraints; inner constraints where none of them is given.

Robust factors scale the weights of whole positions and whole surveyed points, so that a wrong one does not distort the block before
it has been found.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from orthomill.tasks.adjustment.model.network import Network, State
from orthomill.tasks.adjustment.model.robust_weights import huber_cost, huber_weights
from orthomill.tasks.adjustment.sparse.block_matrix import BlockMatrix, summed
from orthomill.tasks.geometry.rotation_vector import motion_derivatives, skew


@dataclass(frozen=True, eq=False)
class PriorFactors:
    """Robust factors of the weights of the positions (P,), the surveyed points (N,) and the distances (D,)."""

    centre: np.ndarray
    point: np.ndarray
    distance: np.ndarray


def prior_sizes(network: Network, state: State) -> PriorFactors:
    """Lengths of the residuals of positions, surveyed points and distances, in standard errors; 0 where the weight is 0."""
    position = (network.centre_weight * position_residuals(network, state) ** 2).sum(axis=1)
    point = (network.point_weight * (network.point - state.point) ** 2).sum(axis=1)
    distance = network.distances.weight * distance_residuals(network, state) ** 2
    return PriorFactors(np.sqrt(position), np.sqrt(point), np.sqrt(distance))


def prior_factors(network: Network, state: State, huber: float) -> PriorFactors:
    """Huber's factors of the surveyed observations; 1 for an infinite limit."""
    size = prior_sizes(network, state)
    return PriorFactors(*(huber_weights(each, huber) for each in (size.centre, size.point, size.distance)))


def add_prior(network: Network, state: State, matrix: BlockMatrix, factors: PriorFactors | None = None) -> np.ndarray:
    """Adds all prior information to the normal `matrix`, except that on eliminated points (`Linear` holds it); returns its
    right-hand side (n,)."""
    factors = factors or prior_factors(network, state, np.inf)
    right = np.zeros(len(matrix))
    for columns, J, weight, residual in _prior(network, state, factors):
        weighted = J.transpose(0, 2, 1) @ weight
        matrix.add(columns, weighted @ J)
        right += summed(columns, (weighted @ residual[:, :, None])[:, :, 0], len(matrix))
    return right


def prior_cost(network: Network, state: State, huber: float = np.inf) -> float:
    """Weighted sum of squares (Huber's loss for surveyed observations) of all prior information, that on points included."""
    value, size = network.interior.value - state.interior, prior_sizes(network, state)
    return float(
        huber_cost(size.centre, huber)
        + huber_cost(size.point, huber)
        + (network.vertical_weight * (vertical_residuals(network, state) ** 2).sum(axis=1)).sum()
        + np.einsum("ci,cij,cj->", value, network.interior.weight, value)
        + _variation_cost(network, state)
        + (network.lever_weight * (network.lever - state.lever) ** 2).sum()
        + (network.shift_weights * state.shift[: network.shifts] ** 2).sum()
        + huber_cost(size.distance, huber)
    )


def standardised_prior(network: Network, state: State) -> tuple[csr_array, np.ndarray]:
    """Prior information on the block, each observation in its standard error: derivatives (r, n) by the unknowns, residuals (r,).

    All but that on eliminated points and on the interior of cameras.
    """
    rows, columns, values, residuals, count = [], [], [], [], 0
    for of, J, weight, residual in _prior(network, state, prior_factors(network, state, np.inf)):
        # A root of the weights: correlated observations become as many independent ones.
        square, axes = np.linalg.eigh(weight)
        root = np.sqrt(np.maximum(square, 0.0))[:, :, None] * axes.transpose(0, 2, 1)
        derivatives = root @ J
        rows.append(np.broadcast_to(count + np.arange(square.size).reshape(*square.shape, 1), derivatives.shape).ravel())
        columns.append(np.broadcast_to(of[:, None, :], derivatives.shape).ravel())
        values.append(derivatives.ravel())
        residuals.append((root @ residual[:, :, None]).ravel())
        count += square.size
    row, column, value, rest = map(np.concatenate, (rows, columns, values, residuals))
    # Parameters without a column are no unknowns; observations without weight or of none of these say nothing.
    there = (column >= 0) & (value != 0.0)
    matrix = csr_array((value[there], (row[there], column[there])), shape=(count, network.unknowns))
    observed = np.diff(matrix.indptr) > 0
    # What is known of a camera by its tags or kind is a starting value with a generous standard error, no observation.
    cameras = np.zeros(network.unknowns)
    cameras[network.interior_columns[network.interior_columns >= 0]] = 1.0
    own = abs(matrix) @ cameras > 0.0
    return matrix[observed & ~own], rest[observed & ~own]


def antennas(network: Network, state: State) -> np.ndarray:
    """(P, 3) m where positions are observed: projection centre + lever arm + shift."""
    turned = state.centre + np.einsum("pji,pj->pi", state.rotation, network.levers(state.lever))
    # The 0 appended is the shift of what has none.
    return turned + np.append(state.shift, 0.0)[network.shift] if network.shifts else turned


def position_residuals(network: Network, state: State) -> np.ndarray:
    """GNSS position minus its place by the unknowns, (P, 3) m; 0 where the weight is 0."""
    return np.where(network.centre_weight > 0, network.centre - antennas(network, state), 0.0)


def vertical_residuals(network: Network, state: State) -> np.ndarray:
    """(P, 3) cross product of the expected and the actual up direction in the image system, as long as the sine of the angle
    between them; without meaning where the weight is 0."""
    return np.cross(network.up, state.rotation[:, :, 2])


def position_derivatives(network: Network, state: State, photos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (p, 3, m) of the antenna positions of `photos` (p,) by the unknowns in the columns (p, m)."""
    alike = np.broadcast_to(np.eye(3), (len(photos), 3, 3))
    blocks, columns = [alike], [6 * photos[:, None] + np.arange(3)]
    turned = state.rotation[photos].transpose(0, 2, 1)
    # The antenna depends on the rotation only through the lever arm; without one these columns would be zeros.
    if state.lever.any() or len(network.lever_columns):
        levers = network.levers(state.lever)[photos]
        blocks.append(turned @ skew(levers))
        columns.append(6 * photos[:, None] + 3 + np.arange(3))
    if len(network.lever_columns):
        blocks.append(turned)
        columns.append(network.levers(network.lever_columns)[photos])
    if network.shifts:
        blocks.append(alike)
        columns.append(np.append(network.shift_columns, -1)[network.shift[photos]])
    return np.concatenate(blocks, axis=2), np.hstack(columns)


def distance_residuals(network: Network, state: State) -> np.ndarray:
    """Measured minus computed distances (D,), m."""
    first, second = network.distances.ends.T
    return network.distances.length - np.linalg.norm(state.point[second] - state.point[first], axis=1)


def distance_derivatives(network: Network, state: State) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (D, 6) of the distances by their ends in the columns (D, 6)."""
    first, second = network.distances.ends.T
    along = state.point[second] - state.point[first]
    # Two ends may coincide at a poor start: no direction is then better than NaN in every unknown.
    along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    place = np.searchsorted(network.kept, network.distances.ends)
    return np.hstack([-along, along]), network.kept_columns[place].reshape(-1, 6)


def _prior(network: Network, state: State, factors: PriorFactors) -> Iterator[tuple[np.ndarray, ...]]:
    """The prior information, kind by kind: columns (q, m), derivatives (q, d, m), weights (q, d, d), residuals (q, d)."""
    yield _positions(network, state, factors.centre)
    yield _verticality(network, state)
    yield (
        network.interior_columns,
        np.broadcast_to(np.eye(network.interior.value.shape[1]), network.interior.weight.shape),
        network.interior.weight,
        network.interior.value - state.interior,
    )
    if len(network.variation):
        yield _variation(network, state)
    if len(network.lever_columns):
        alike = np.broadcast_to(np.eye(3), (len(network.lever), 3, 3))
        yield network.lever_columns, alike, alike * network.lever_weight, network.lever - state.lever
    if network.shift_weights.any():
        single = np.ones((network.shifts, 1, 1))
        yield network.shift_columns[:, None], single, single * network.shift_weights[:, None, None], -state.shift[:, None]
    if len(network.kept):
        weight = (factors.point[:, None] * network.point_weight)[network.kept]
        alike = np.broadcast_to(np.eye(3), (len(network.kept), 3, 3))
        yield network.kept_columns, alike, weight[:, :, None] * np.eye(3), (network.point - state.point)[network.kept]
    if len(network.distances):
        J, columns = distance_derivatives(network, state)
        weight = factors.distance * network.distances.weight
        yield columns, J[:, None], weight[:, None, None], distance_residuals(network, state)[:, None]


def _positions(network: Network, state: State, factor: np.ndarray) -> tuple[np.ndarray, ...]:
    photos = np.flatnonzero(network.centre_weight.any(axis=1))
    J, columns = position_derivatives(network, state, photos)
    weight = factor[photos, None, None] * network.centre_weight[photos][:, :, None] * np.eye(3)
    return columns, J, weight, position_residuals(network, state)[photos]


def _variation(network: Network, state: State) -> tuple[np.ndarray, ...]:
    own = network.variation
    now = np.zeros_like(own.expected) if state.variation is None else state.variation[:, own.parameters]
    return network.variation_columns, np.broadcast_to(np.eye(len(own)), own.weight.shape), own.weight, own.expected - now


def _variation_cost(network: Network, state: State) -> float:
    if not len(network.variation):
        return 0.0
    _, _, weight, away = _variation(network, state)
    return float(np.einsum("pi,pij,pj->", away, weight, away))


def _verticality(network: Network, state: State) -> tuple[np.ndarray, ...]:
    """The constraint that the up direction u in the image system is the expected one, b.

    A rotation w moves u by w x u, and therefore u x b by (b . w) u - (b . u) w.
    """
    # A cross product instead of two tilt angles: it is defined for every attitude, also for photographs that look at the horizon.
    photos = np.flatnonzero(network.vertical_weight > 0)
    u, b = state.rotation[photos, :, 2], np.broadcast_to(network.up, (network.photos, 3))[photos]
    J = u[:, :, None] * b[:, None, :] - (b * u).sum(axis=1)[:, None, None] * np.eye(3)
    weight = network.vertical_weight[photos, None, None] * np.eye(3)
    return 6 * photos[:, None] + 3 + np.arange(3), J, weight, vertical_residuals(network, state)[photos]


def freedoms(network: Network, state: State) -> np.ndarray:
    """(n, 7 or 6) the null space of the image measurements: how the unknowns move when the whole block is shifted, rotated and
    (without distances) scaled."""
    H = np.zeros((network.unknowns, 7))
    # Lever arms from the centroid keep the seven columns of one size, and the rotations nearly orthogonal to the shifts.
    middle = state.centre.mean(axis=0)
    centres = 6 * np.arange(network.photos)[:, None] + np.arange(3)
    H[centres] = motion_derivatives(state.centre - middle)
    # Rotations of a photograph are in its image system, those of the block in the world; they act with opposite sign.
    H[centres + 3, 3:6] = -state.rotation
    H[network.kept_columns] = motion_derivatives(state.point[network.kept] - middle)
    return H[:, : network.freedoms]
