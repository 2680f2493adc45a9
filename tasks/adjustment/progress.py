"""The state of a bundle adjustment between two of its steps."""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.tasks.adjustment.model.network import Distances, Network, Rays, State
from orthomill.tasks.adjustment.model.surveyed_observations import Blunder, SurveyedKind, without
from orthomill.tasks.adjustment.testing.adjustment_result import AS_STATED, Adjustment, Factors, Group, surveyed


@dataclass(frozen=True)
class BlunderTest:
    """Limits of the blunder tests, in standard errors: Huber's (`huber`), on the robust solution for rays (`gross`) and for
    surveyed points and positions (`gross_surveyed`), and on the plain solution (`limit`); and the largest number of `rounds`.

    `gross_surveyed` is below `gross`, because a wrong coordinate must not take its rays with it.
    """

    huber: float = 2.0
    gross: float = 8.0
    gross_surveyed: float = 6.0
    limit: float = 4.0
    rounds: int = 15


@dataclass(frozen=True, eq=False)
class Progress:
    """An adjustment between two of its steps; every step returns a new one.

    Given once: the network `first`, its `rays` with stated standard errors, the limits of the `test`. So far: the `network` with
    stated weights, 0 for the `blunders`; the `state` of the unknowns; the `used` rays (M,) bool; the `factors` of the standard
    errors; `confirmed`: surveyed observations that were suspected, but agree with the solution without them; `explained`: how many
    control points took part when it was last decided what explains their contradictions (0: never); whether blunders were
    `reinstated`; `iterations` and `rounds`. `result` belongs to the last plain solution, `estimated` and `groups` are its variance
    components; it is out of date where weights or observations have `changed` since.
    """

    first: Network
    rays: Rays
    test: BlunderTest
    network: Network
    state: State
    used: np.ndarray
    blunders: tuple[Blunder, ...] = ()
    factors: Factors = AS_STATED
    confirmed: frozenset[tuple[SurveyedKind, int]] = frozenset()
    explained: int = 0
    reinstated: bool = False
    iterations: int = 0
    rounds: int = 0
    changed: bool = True
    result: Adjustment | None = None
    estimated: Factors = AS_STATED
    groups: tuple[Group, ...] = ()

    @property
    def solution(self) -> Adjustment:
        """The last plain solution. Raises ValueError before the first one."""
        if self.result is None:
            raise ValueError("the block has no plain solution yet")
        return self.result

    @property
    def weighted_network(self) -> Network:
        """The network with the standard errors of surveyed observations multiplied by their factors."""
        network, distances = self.network, self.network.distances
        return replace(
            network,
            centre_weight=network.centre_weight / self.factors.of_positions(network) ** 2,
            point_weight=network.point_weight / self.factors.control**2,
            distances=Distances(distances.ends, distances.length, distances.weight / self.factors.distance**2),
        )

    @property
    def weighted_rays(self) -> Rays:
        """All rays, with standard errors multiplied by the factors of their groups."""
        return replace(self.rays, sigma=self.rays.sigma * self.by_group(self.factors))

    def by_group(self, factors: Factors) -> np.ndarray:
        """(M,) the factor of each ray's group."""
        # Pointings by hand and matched tie points differ by a factor of ten: one variance for both would reject good control.
        return np.where(surveyed(self.network, self.rays), factors.pointing, factors.image)

    def without(self, blunder: Blunder) -> "Progress":
        """The adjustment with one more rejected observation."""
        # The given network keeps the weight: reinstatement takes it from there.
        return replace(self, network=without(self.network, blunder), blunders=(*self.blunders, blunder), changed=True)
