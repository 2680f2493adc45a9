"""A step of the adjustment, and the two ways in which it is taken.

The normal equations give one correction for every unknown. Added to the unknowns it is the linear step. Most of a step is often a
motion of the whole block, of which image measurements see nothing, while its linear form would change them: the step with its
motion takes that part as the similarity transformation that it is, and only the rest as corrections of the unknowns. The linear
step is better where control is more precise than the image measurements (a single photograph over surveyed points).
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.tasks.adjustment.model.network import Network, State
from orthomill.tasks.adjustment.solve.whole_block import motion_in
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector


@dataclass(frozen=True, eq=False)
class BundleStep:
    """Corrections of all unknowns: projection centres (P, 3) m, rotation vectors (P, 3) in the image systems, points (N, 3) m,
    interior orientations (C, 17), shifts (S,) and lever arms (G, 3) m, and what varies from photograph to photograph (P, 17)."""

    centre: np.ndarray
    turn: np.ndarray
    point: np.ndarray
    interior: np.ndarray
    shift: np.ndarray
    lever: np.ndarray
    variation: np.ndarray | None = None

    def linear(self, state: State) -> State:
        """The state with every unknown corrected by itself."""
        turned = np.array([rotation_of_vector(w) @ R for w, R in zip(self.turn, state.rotation, strict=True)])
        return State(
            turned,
            state.centre + self.centre,
            state.point + self.point,
            state.interior + self.interior,
            state.shift + self.shift if len(self.shift) else state.shift,
            state.lever + self.lever,
            state.lens,
            state.variation if self.variation is None else self.variation + (0.0 if state.variation is None else state.variation),
        )

    def times(self, share: float) -> "BundleStep":
        """A part of the step."""
        if share == 1.0:
            return self
        return BundleStep(
            share * self.centre,
            share * self.turn,
            share * self.point,
            share * self.interior,
            share * self.shift,
            share * self.lever,
            None if self.variation is None else share * self.variation,
        )

    def with_motion(self, state: State) -> State:
        """The state corrected by what changes the shape of the block, then moved as a whole."""
        whole = motion_in(state, self.centre, self.turn)
        shape = replace(
            self,
            centre=self.centre - whole.linear(state.centre),
            turn=self.turn + state.rotation @ whole.numbers[3:6],
            point=self.point - whole.linear(state.point),
        )
        return whole.of(shape.linear(state), np.arange(len(state.point)))


def step_of(network: Network, correction: np.ndarray, points: np.ndarray) -> BundleStep:
    """The step from corrections (n,) of the unknowns of the reduced system and (N, 3) of the eliminated points."""
    photo = correction[: 6 * network.photos].reshape(-1, 6)
    interior, lever = np.zeros_like(network.interior.value), np.zeros_like(network.lever)
    interior[network.interior.free] = correction[6 * network.photos : 6 * network.photos + int(network.interior.free.sum())]
    # Without columns there is nothing to correct: the slice is empty then.
    lever[: len(network.lever_columns)] = correction[network.lever_columns]
    points[network.kept] = correction[network.kept_columns]
    return BundleStep(
        photo[:, :3], photo[:, 3:], points, interior, correction[network.shift_columns], lever, _variation_of(network, correction)
    )


def _variation_of(network: Network, correction: np.ndarray) -> np.ndarray | None:
    """(P, k) corrections of what varies from photograph to photograph; None where nothing does."""
    if not len(network.variation):
        return None
    own = np.zeros((network.photos, network.interior.value.shape[1]))
    own[:, network.variation.parameters] = correction[network.variation_columns]
    return own
