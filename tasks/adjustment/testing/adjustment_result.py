"""The result of an adjustment: the solution, its tests, and its precision."""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from orthomill.tasks.adjustment.model.network import Network, Rays, State
from orthomill.tasks.adjustment.model.reliability import NONCENTRALITY
from orthomill.tasks.adjustment.model.surveyed_observations import Blunder
from orthomill.tasks.adjustment.testing.covariances import Covariance


class ObservationKind(StrEnum):
    """A group of observations, by the name that reports give it."""

    TIES = "tie points in photographs"
    POINTINGS = "surveyed points in photographs"
    POSITIONS = "GNSS positions"
    CONTROL = "surveyed coordinates"
    DISTANCES = "distances"


@dataclass(frozen=True, eq=False)
class Factors:
    """Ratio of estimated to stated standard errors of each group of observations: tie points in the photographs, surveyed points in
    the photographs, GNSS positions (one for each of their groups, or one for all), coordinates of surveyed points, distances."""

    image: float = 1.0
    pointing: float = 1.0
    position: tuple[float, ...] = (1.0,)
    control: float = 1.0
    distance: float = 1.0

    def of_positions(self, network: Network) -> np.ndarray:
        """(P, 1) the factor of each photograph's position."""
        groups = int(network.gnss_groups.max(initial=0)) + 1
        return np.broadcast_to(np.array(self.position), groups)[network.gnss_groups, None]


ROUNDING = 1e-2
"""Share of its count by which rounding may take the redundancy of a group out of its bounds."""
AS_STATED = Factors()
"""All standard errors are right."""


@dataclass(frozen=True, eq=False)
class Group:
    """A group of observations: the `count` of its numbers, its share of the redundancy (the sum of its redundancy numbers), the
    ratio of estimated to stated standard errors, and of positions the number of their group."""

    name: ObservationKind
    count: int
    redundancy: float
    factor: float
    part: int = 0

    def __post_init__(self) -> None:
        # A projection: no data can make these numbers others, only a covariance that is not that of the adjustment.
        if not -ROUNDING * self.count <= self.redundancy <= (1.0 + ROUNDING) * self.count:
            raise ArithmeticError(
                f"The redundancy of the {self.count} numbers of the group {self.name} came out as {self.redundancy:.1f}: an error "
                "of the program, not of the data; please report it."
            )


@dataclass(frozen=True)
class CorrelatedErrors:
    """Errors shared by neighbouring measurements: `rms_px` of a coordinate over the frame (before the adjustment absorbs a part),
    `share` of their variance that is common to all photographs of a camera, `likelihood` ratio against white noise, and `white`:
    the share of the residual variance that no error field explains."""

    rms_px: float
    share: float
    likelihood: float
    white: float


@dataclass(frozen=True, eq=False)
class Covariances:
    """The covariance of the unknowns of the reduced system of a network, and that of the points (N, 3, 3) m^2."""

    network: Network
    cofactor: Covariance
    point: np.ndarray


@dataclass(frozen=True, eq=False)
class Adjustment:
    """The adjusted block.

    `used` (M,) marks the rays that took part; `residual` (M, 2) px, observed minus computed, is that of all rays;
    `redundancy_number` (M, 2) and `standardised` (M, 2) are NaN for rays that took no part. `cofactor` is the covariance of the
    unknowns of the reduced system, `point_covariance` (N, 3, 3) m^2. `factors` and `groups` compare the residuals with the stated
    standard errors. `network` holds the weights of the final solution: 0 for the `blunders`. `correlated`: the correlated image
    errors that the covariances include, None for white noise; `before`: the result whose covariances do not include them.
    `computed`: the covariances without the uncertainty of parameters that are only considered; None: the same.
    """

    state: State
    network: Network
    rays: Rays
    used: np.ndarray
    residual: np.ndarray
    redundancy_number: np.ndarray
    standardised: np.ndarray
    cofactor: Covariance
    point_covariance: np.ndarray
    redundancy: int
    factors: Factors
    groups: tuple[Group, ...] = ()
    blunders: tuple[Blunder, ...] = ()
    iterations: int = 0
    correlated: CorrelatedErrors | None = None
    before: "Adjustment | None" = None
    computed: Covariances | None = None

    @property
    def white(self) -> "Adjustment":
        """The result with the covariances of white noise, on which the weights of the adjustment are based."""
        return self.before or self

    @property
    def as_computed(self) -> "Adjustment":
        """The result with the covariances that its own weights and unknowns yield: only of these are redundancy numbers made."""
        white = self.white
        if white.computed is None:
            return white
        own = white.computed
        # Its network as well: parameters that are considered since then have columns of their own.
        return replace(white, network=own.network, cofactor=own.cofactor, point_covariance=own.point, computed=None)

    @property
    def sigma0_px(self) -> float:
        """Standard error of a typical tie-point coordinate, estimated from the residuals, px."""
        ties = self.used & ~surveyed(self.network, self.rays)
        # A block of surveyed points only has no tie points: its pointings take their place.
        return float(self.factors.image * np.sqrt(np.mean(self.rays.sigma[ties if ties.any() else self.used] ** 2)))

    @property
    def ray_sigma(self) -> np.ndarray:
        """(M,) px: the estimated standard errors of the image measurements."""
        return self.rays.sigma * np.where(surveyed(self.network, self.rays), self.factors.pointing, self.factors.image)

    @property
    def detectable(self) -> np.ndarray:
        """(M, 2) px: the smallest error of a coordinate that the test would find, its inner reliability (Baarda 1968)."""
        return NONCENTRALITY * self.ray_sigma[:, None] / np.sqrt(self.redundancy_number)

    def exterior_covariance(self, photo: int) -> np.ndarray:
        """(6, 6) of X, Y, Z and the three rotations in the image system, m and radians."""
        # Rotations as vectors: reports turn them into angles, with `angles_from_vector`.
        return self.cofactor.joint(6 * photo + np.arange(6))


def surveyed(network: Network, rays: Rays) -> np.ndarray:
    """(M,) bool: the rays that point at surveyed points."""
    return network.pointed[rays.point]
