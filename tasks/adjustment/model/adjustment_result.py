"""What an adjustment hands over."""

from dataclasses import dataclass

import numpy as np

from orthomill.tasks.adjustment.model.network import Network, Rays, State
from orthomill.tasks.adjustment.testing.covariances import Covariance

NONCENTRALITY = 4.13
"""A bias of this many standard errors is found with 80 % probability by a test at 0.1 % (Baarda 1968)."""


@dataclass(frozen=True, eq=False)
class Factors:
    """Estimated by stated standard error, per group of observations: tie points in the photographs, surveyed points in the
    photographs, GNSS positions, coordinates of surveyed points, distances."""

    image: float = 1.0
    pointing: float = 1.0
    position: float = 1.0
    control: float = 1.0
    distance: float = 1.0


@dataclass(frozen=True, eq=False)
class Group:
    """A group of observations in the balance of the adjustment: how many numbers, their part of the redundancy (the sum of their
    redundancy numbers), and their estimated by stated standard error."""

    name: str
    count: int
    redundancy: float
    factor: float


@dataclass(frozen=True)
class Blunder:
    """Something surveyed that contradicts the rest: `kind` position, control or distance, the `number` of its photo, point or
    distance, and its misfit in standard errors."""

    kind: str
    number: int
    misfit: float


@dataclass(frozen=True)
class CorrelatedErrors:
    """Errors that the measurements of a region share: `rms_px` of a coordinate over the frame (before the adjustment absorbs its
    part), `share` of its variance that is the same in all photographs of a camera, `likelihood` ratio against white noise, and
    `white`: variance of what no field explains by that of all residuals."""

    rms_px: float
    share: float
    likelihood: float
    white: float


@dataclass(frozen=True, eq=False)
class Adjustment:
    """The adjusted block. `used` (M,) marks the rays that took part, `residual` (M, 2) px observed minus computed of all rays,
    `redundancy_number` (M, 2) and `standardised` (M, 2) are NaN for rays that did not. `cofactor` is the covariance of the
    unknowns of the reduced system, `point_covariance` (N, 3, 3) m^2. `factors` and `groups`: what the residuals say of the stated
    standard errors. `network` holds the weights as they were used in the end: 0 for the `blunders`. `correlated`: the correlated
    image errors that the covariances carry, None where they are those of white noise; `before`: the result that does not carry them."""

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

    @property
    def white(self) -> "Adjustment":
        """The result with the covariances of white noise: least squares took its weights from these."""
        return self.before or self

    @property
    def sigma0_px(self) -> float:
        """Standard error of a typical coordinate of a tie point, estimated from the residuals."""
        ties = self.used & ~surveyed(self.network, self.rays)
        return float(self.factors.image * np.sqrt(np.mean(self.rays.sigma[ties if ties.any() else self.used] ** 2)))

    @property
    def ray_sigma(self) -> np.ndarray:
        """(M,) px: the standard errors of the measurements as they were estimated."""
        return self.rays.sigma * np.where(surveyed(self.network, self.rays), self.factors.pointing, self.factors.image)

    @property
    def detectable(self) -> np.ndarray:
        """(M, 2) px: the smallest error of a coordinate that the test would find, its inner reliability (Baarda 1968)."""
        return NONCENTRALITY * self.ray_sigma[:, None] / np.sqrt(self.redundancy_number)

    def exterior_covariance(self, photo: int) -> np.ndarray:
        """(6, 6) of X, Y, Z and the three rotations in the image system, m and radians."""
        return self.cofactor.joint(6 * photo + np.arange(6))


def surveyed(network: Network, rays: Rays) -> np.ndarray:
    """(M,) which rays point at surveyed points."""
    return network.pointed[rays.point]
