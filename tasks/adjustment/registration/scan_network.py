"""What takes part in the joint registration of scans: points measured in scans, control, and the unknowns.

X_i = R_k x_ik + t_k: point i in the system of the control, and the same point in scan k. There is no scale: a scanner measures
lengths. Errors of a scanned point are alike in all directions, so that a misfit has the same weight in either system.

Source: Petsa et al. 2007, section 4.3 (sources/blending.md, M18).
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.tasks.geometry.rotation_vector import rotation_of_vector


@dataclass(frozen=True, eq=False)
class ScannedPoints:
    """Points as measured in scans, one row each: `scan` (M,) and `point` (M,) numbers, `xyz` (M, 3) m in the scan's own system, and
    the standard error `sigma` (M,) m of each coordinate."""

    scan: np.ndarray
    point: np.ndarray
    xyz: np.ndarray
    sigma: np.ndarray

    def __len__(self) -> int:
        return len(self.scan)

    def take(self, index: np.ndarray) -> "ScannedPoints":
        """The rows at `index` (numbers or a mask)."""
        return ScannedPoints(self.scan[index], self.point[index], self.xyz[index], self.sigma[index])


@dataclass(frozen=True, eq=False)
class ScanNetwork:
    """The unknowns and what is known of them: `scans` and `points` are counts; `control` (P, 3) m with its `weight` (P, 3) 1/m^2, 0
    for points that were not surveyed. Without any weight the system is that of the scan `reference`, which does not move."""

    scans: int
    points: int
    control: np.ndarray
    weight: np.ndarray
    reference: int = 0

    @property
    def free(self) -> bool:
        """Whether no control defines the system."""
        return not self.weight.any()

    @property
    def moving(self) -> np.ndarray:
        """(6 S,) bool: the unknowns of scans that are adjusted."""
        moves = np.ones((self.scans, 6), bool)
        moves[self.reference] = not self.free
        return moves.ravel()

    def without_control(self, point: int) -> "ScanNetwork":
        """The network in which a surveyed point is known by the scans only."""
        weight = self.weight.copy()
        weight[point] = 0.0
        return replace(self, weight=weight)


@dataclass(frozen=True, eq=False)
class ScanState:
    """Values of the unknowns: `rotation` (S, 3, 3), `translation` (S, 3) m, `point` (P, 3) m in the system of the control."""

    rotation: np.ndarray
    translation: np.ndarray
    point: np.ndarray

    def placed(self, points: ScannedPoints) -> np.ndarray:
        """(M, 3) m: scanned points in the system of the control."""
        return np.einsum("mij,mj->mi", self.rotation[points.scan], points.xyz) + self.translation[points.scan]

    def misfits(self, points: ScannedPoints) -> np.ndarray:
        """(M, 3) m: the adjusted point minus the scanned one, in the system of the control."""
        return self.point[points.point] - self.placed(points)

    def residuals(self, points: ScannedPoints) -> np.ndarray:
        """(M, 3) m: the same along the axes of each scan: the corrections of its coordinates."""
        return np.einsum("mji,mj->mi", self.rotation[points.scan], self.misfits(points))

    def moved(self, scans: np.ndarray, points: np.ndarray, about: np.ndarray) -> "ScanState":
        """After corrections `scans` (S, 6), a shift in m and a rotation vector about the point `about` (S, 3) of each, and `points`
        (P, 3) m."""
        turn = np.array([rotation_of_vector(w) for w in scans[:, 3:]])
        shift = np.einsum("kij,kj->ki", turn, self.translation - about) + about + scans[:, :3]
        return ScanState(turn @ self.rotation, shift, self.point + points)
