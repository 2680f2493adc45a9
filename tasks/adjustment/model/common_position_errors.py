"""What the positions of a receiver have in common: errors that change slowly, and that many positions do not average out.

Seventy positions of a telephone, each good to 15 m in height, do not say to 2 m how high the block lies, for all of them may be
7 m too high. Who compares them with control takes their common error for as large as each is stated to err.
"""

from dataclasses import replace

import numpy as np

from orthomill.tasks.adjustment.model.network import Network, State


def with_common_errors(network: Network, state: State) -> tuple[Network, State]:
    """The network with an unknown shift of each group of positions in each coordinate, as large as stated of them, and the state
    with these at zero; as they are where shifts are unknowns already, or there are no positions."""
    if network.shifts or not network.centre_weight.any():
        return network, state
    weight = network.centre_weight
    sigma = np.where(weight > 0, 1.0 / np.sqrt(np.where(weight > 0, weight, 1.0)), 0.0)
    return with_group_shifts(network, state, network.gnss_groups, sigma)


def with_group_shifts(network: Network, state: State, group: np.ndarray, sigma: np.ndarray) -> tuple[Network, State]:
    """The network with a shift of each group (P,) of positions in each coordinate that has none, whose standard error is the median
    of `sigma` (P, 3) m (0: no shift), and the state with these at zero."""
    has = network.centre_weight > 0
    shift = network.shift.copy() if network.shifts else np.full(sigma.shape, -1, np.int64)
    added: list[float] = []
    for number in np.unique(group):
        for axis in range(3):
            own = (group == number) & has[:, axis] & (shift[:, axis] < 0) & (sigma[:, axis] > 0)
            if own.any():
                shift[own, axis] = network.shifts + len(added)
                added.append(float(np.median(sigma[own, axis])))
    weight = np.concatenate([network.shift_weights, 1.0 / np.array(added) ** 2])
    values = np.append(state.shift[: network.shifts], np.zeros(len(added)))
    return replace(network, shift=shift, shift_weight=weight), replace(state, shift=values)
