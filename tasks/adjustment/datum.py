"""What holds the block in space: weighted positions, control, a wish for verticality; or inner constraints when nothing does."""

import numpy as np

from tasks.adjustment.network import Network, State
from tasks.geometry.rotation_vector import skew


def prior_normals(network: Network, state: State) -> tuple[np.ndarray, np.ndarray]:
    """Normal matrix (n, n) and right-hand side (n,) of all that is known beforehand, but for the points (they carry their own)."""
    normal, right = np.zeros((network.unknowns, network.unknowns)), np.zeros(network.unknowns)
    _add_positions(network, state, normal, right)
    _add_verticality(network, state, normal, right)
    _add_interior(network, state, normal, right)
    return normal, right


def prior_cost(network: Network, state: State) -> float:
    """Weighted sum of squares of the misclosures of all that is known beforehand, points included."""
    value = network.interior.value - state.interior
    return float(
        (network.centre_weight * position_misclosures(network, state) ** 2).sum()
        + (network.point_weight * (network.point - state.point) ** 2).sum()
        + (network.vertical_weight * (state.rotation[:, 2, :2] ** 2).sum(axis=1)).sum()
        + np.einsum("ci,cij,cj->", value, network.interior.weight, value)
    )


def position_misclosures(network: Network, state: State) -> np.ndarray:
    """GNSS position minus (projection centre + shift), (P, 3) m; meaningless where the weight is 0."""
    return np.where(network.centre_weight > 0, network.centre - state.centre - state.shift, 0.0)


def _add_positions(network: Network, state: State, normal: np.ndarray, right: np.ndarray) -> None:
    misclosure = position_misclosures(network, state)
    for photo in np.flatnonzero(network.centre_weight.any(axis=1)):
        own = 6 * photo + np.arange(3)
        rows = [own, network.unknowns - 3 + np.arange(3)] if network.shift else [own]
        for a in rows:
            right[a] += network.centre_weight[photo] * misclosure[photo]
            for b in rows:
                normal[a, b] += network.centre_weight[photo]


def _add_verticality(network: Network, state: State, normal: np.ndarray, right: np.ndarray) -> None:
    """The third row of R is (0, 0, 1) in a vertical photograph; it moves by w1 R[1] - w2 R[0]."""
    for photo in np.flatnonzero(network.vertical_weight > 0):
        R, weight = state.rotation[photo], network.vertical_weight[photo]
        J = np.column_stack([R[1], -R[0], np.zeros(3)])[:2]
        own = slice(6 * photo + 3, 6 * photo + 6)
        normal[own, own] += weight * J.T @ J
        right[own] += weight * J.T @ -R[2, :2]


def _add_interior(network: Network, state: State, normal: np.ndarray, right: np.ndarray) -> None:
    for columns, weight, value in zip(
        network.interior_columns, network.interior.weight, network.interior.value - state.interior, strict=True
    ):
        free = columns >= 0
        normal[np.ix_(columns[free], columns[free])] += weight[np.ix_(free, free)]
        right[columns[free]] += (weight @ value)[free]


def freedoms(network: Network, state: State) -> np.ndarray:
    """(n, 7): how the unknowns move when the whole block is shifted, turned and scaled; what measurements in photographs cannot
    see."""
    H = np.zeros((network.unknowns, 7))
    lever = state.centre - state.centre.mean(axis=0)
    for photo in range(network.photos):
        H[6 * photo : 6 * photo + 3, :3] = np.eye(3)
        H[6 * photo : 6 * photo + 3, 3:6] = -skew(lever[photo])
        H[6 * photo + 3 : 6 * photo + 6, 3:6] = -state.rotation[photo]
        H[6 * photo : 6 * photo + 3, 6] = lever[photo]
    return H
