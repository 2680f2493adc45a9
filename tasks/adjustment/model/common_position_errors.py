"""What the positions of a receiver have in common: errors that change slowly, and that many positions do not average out.

Seventy positions of a telephone, each good to 15 m in height, do not say to 2 m how high the block lies, for all of them may be
7 m too high. Who compares them with control takes their common error for as large as each is stated to err.
"""

from dataclasses import replace

import numpy as np

from orthomill.tasks.adjustment.model.network import Network, State


def with_common_errors(network: Network, state: State) -> tuple[Network, State]:
    """The network with an unknown shift of each group of positions in each coordinate, and the state with these at zero; as they
    are where shifts are unknowns already, or there are no positions."""
    if network.shifts or not network.centre_weight.any():
        return network, state
    shift = np.full((network.photos, 3), -1, np.int64)
    weight: list[float] = []
    for group in np.unique(network.gnss_groups):
        for axis in range(3):
            own = (network.gnss_groups == group) & (network.centre_weight[:, axis] > 0)
            if own.any():
                shift[own, axis] = len(weight)
                weight.append(float(np.median(network.centre_weight[own, axis])))
    return replace(network, shift=shift, shift_weight=np.array(weight)), replace(state, shift=np.zeros(len(weight)))
