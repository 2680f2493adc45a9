"""Relative orientation in the classical forms of near-vertical pairs, and derived from exterior orientations.

`DependentOrientation`: the left photograph is fixed, b_x = 1, unknowns b_y, b_z, omega, phi, kappa of the right one.
`FiveRotations`: the base is the x axis, and both photographs rotate: kappa and phi of the left one, omega, phi and kappa of the
right one (omega of the left one is 0). Both parametrise the same five degrees of freedom and start at zero.

Image coordinates are ideal (no distortion), px, origin at the principal point, y up, as rows (x_left, y_left, x_right, y_right).
Sources: Karfis 2009, section 3.3 (sources/epipolar.md#relative-orientation); Skarlatos, section 4.3.5
(sources/surface_check.md#relative-orientation), equations 4.17 and 4.18.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from orthomill.tasks.geometry.rotation import angles, rotation_derivatives, rotation_matrix


def directions(observations: np.ndarray, c_left: float, c_right: float) -> tuple[np.ndarray, np.ndarray]:
    """Directions (s, 3) of the left and of the right rays in their image systems, of length c at the principal point."""
    s = len(observations)
    return (
        np.column_stack([observations[:, :2], np.full(s, -c_left)]),
        np.column_stack([observations[:, 2:], np.full(s, -c_right)]),
    )


def products_with(vectors: np.ndarray, base: np.ndarray) -> np.ndarray:
    """Vector products (s, 3) of vectors (s, 3) with one vector (3,)."""
    # One matrix product: np.cross takes ten times as long for a few hundred vectors.
    x, y, z = base
    return vectors @ np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def products(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Vector products (s, 3) of vectors (s, 3) row by row."""
    following, preceding = [1, 2, 0], [2, 0, 1]
    return first[:, following] * second[:, preceding] - first[:, preceding] * second[:, following]


def coplanarity(left: np.ndarray, right: np.ndarray, base: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """F = base . (left x R' right); dF/dobservations (s, 4); dF/d(R' right) (s, 3)."""
    turned = right @ R
    # The triple product is cyclic: each vector's derivative is the vector product of the two others.
    by_left = products_with(turned, base)
    by_turned = -products_with(left, base)
    F = (by_left * left).sum(axis=1)
    return F, np.hstack([by_left[:, :2], (by_turned @ R.T)[:, :2]]), by_turned


@dataclass(frozen=True)
class DependentOrientation:
    """Unknowns (b_y, b_z, omega, phi, kappa), radians, b_x = 1; camera constants in px."""

    c_left: float
    c_right: float
    by: float = 0.0
    bz: float = 0.0
    omega: float = 0.0
    phi: float = 0.0
    kappa: float = 0.0

    @property
    def unknowns(self) -> np.ndarray:
        """(5,): b_y, b_z, omega, phi, kappa, radians."""
        return np.array([self.by, self.bz, self.omega, self.phi, self.kappa])

    @property
    def rotation(self) -> np.ndarray:
        """Left image system to right image system."""
        return rotation_matrix(self.omega, self.phi, self.kappa)

    @property
    def base(self) -> np.ndarray:
        """Unit vector to the right projection centre, left image system."""
        base = np.array([1.0, self.by, self.bz])
        return base / np.linalg.norm(base)

    def moved(self, correction: np.ndarray) -> "DependentOrientation":
        """The orientation with a correction (5,) added to its unknowns."""
        return DependentOrientation(self.c_left, self.c_right, *(self.unknowns + correction))

    def evaluate(self, observations: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """F = c v + y w - b_y (x w + c u) + b_z (x v - y u), its derivatives by the unknowns (s, 5) and the observations (s, 4)."""
        left, right = directions(observations, self.c_left, self.c_right)
        base = np.array([1.0, self.by, self.bz])
        F, by_observation, by_turned = coplanarity(left, right, base, self.rotation)
        normal = np.cross(left, right @ self.rotation)
        by_angle = [(by_turned * (right @ D)).sum(axis=1) for D in rotation_derivatives(self.omega, self.phi, self.kappa)]
        return F, np.column_stack([normal[:, 1], normal[:, 2], *by_angle]), by_observation


@dataclass(frozen=True)
class FiveRotations:
    """Unknowns (kappa_1, kappa_2, phi_1, phi_2, omega_2), radians; camera constants in px. The base is (1, 0, 0)."""

    c_left: float
    c_right: float
    kappa_1: float = 0.0
    kappa_2: float = 0.0
    phi_1: float = 0.0
    phi_2: float = 0.0
    omega_2: float = 0.0

    @property
    def unknowns(self) -> np.ndarray:
        """(5,): kappa_1, kappa_2, phi_1, phi_2, omega_2, radians."""
        return np.array([self.kappa_1, self.kappa_2, self.phi_1, self.phi_2, self.omega_2])

    @property
    def left(self) -> np.ndarray:
        """(3, 3): base system to left image system."""
        return rotation_matrix(0.0, self.phi_1, self.kappa_1)

    @property
    def right(self) -> np.ndarray:
        """(3, 3): base system to right image system."""
        return rotation_matrix(self.omega_2, self.phi_2, self.kappa_2)

    @property
    def rotation(self) -> np.ndarray:
        """Left image system to right image system."""
        return self.right @ self.left.T

    @property
    def base(self) -> np.ndarray:
        """Unit vector to the right projection centre, left image system."""
        return self.left[:, 0]

    def moved(self, correction: np.ndarray) -> "FiveRotations":
        """The orientation with a correction (5,) added to its unknowns."""
        return FiveRotations(self.c_left, self.c_right, *(self.unknowns + correction))

    def evaluate(self, observations: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The coplanarity in the base system, its derivatives by the unknowns (s, 5) and the observations (s, 4)."""
        left, right = directions(observations, self.c_left, self.c_right)
        # Both rays are rotated into the base system, where the condition is the published y-parallax equation (4.17).
        base, turned = np.array([1.0, 0.0, 0.0]), left @ self.left
        F, _, by_right = coplanarity(turned, right, base, self.right)
        by_left = np.cross(right @ self.right, base)
        _, d_phi_1, d_kappa_1 = rotation_derivatives(0.0, self.phi_1, self.kappa_1)
        d_omega_2, d_phi_2, d_kappa_2 = rotation_derivatives(self.omega_2, self.phi_2, self.kappa_2)
        by_unknown = [
            (by * (ray @ D)).sum(axis=1)
            for by, ray, D in (
                (by_left, left, d_kappa_1),
                (by_right, right, d_kappa_2),
                (by_left, left, d_phi_1),
                (by_right, right, d_phi_2),
                (by_right, right, d_omega_2),
            )
        ]
        by_observation = np.hstack([(by_left @ self.left.T)[:, :2], (by_right @ self.right.T)[:, :2]])
        return F, np.column_stack(by_unknown), by_observation


def dependent_form(base: np.ndarray, rotation: np.ndarray, c_left: float, c_right: float) -> DependentOrientation:
    """The dependent form of a base (3,) in the left image system, which must have an x component, and a rotation left to right."""
    return DependentOrientation(c_left, c_right, base[1] / base[0], base[2] / base[0], *angles(rotation))


def five_rotation_form(base: np.ndarray, rotation: np.ndarray, c_left: float, c_right: float) -> FiveRotations:
    """The form of five rotations of a base (3,) in the left image system and a rotation left to right."""
    x, y, z = base / np.linalg.norm(base)
    phi_1, kappa_1 = np.arcsin(z), np.arctan2(-y, x)
    omega_2, phi_2, kappa_2 = angles(rotation @ rotation_matrix(0.0, phi_1, kappa_1))
    return FiveRotations(
        c_left=c_left, c_right=c_right, kappa_1=kappa_1, kappa_2=kappa_2, phi_1=phi_1, phi_2=phi_2, omega_2=omega_2
    )


def smallest_rotation(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The smallest rotation (3, 3) that takes the unit vector `first` (3,) to `second`, which must not be its opposite.

    Source: McGlone, in Skarlatos (sources/surface_check.md#relative-orientation), equation 4.18.
    """
    both = first + second
    return np.eye(3) + 2.0 * np.outer(second, first) - np.outer(both, both) / (1.0 + first @ second)


def from_exterior(exterior: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit base (3,) in the left image system and rotation (3, 3) left to right, from two exterior orientations.

    exterior (12,): X, Y, Z, omega, phi, kappa of the left photograph, then of the right one; m and radians. The base system is
    reached from the ground by the smallest rotation that takes the base to its x axis.
    """
    left, right = rotation_matrix(*exterior[3:6]), rotation_matrix(*exterior[9:12])
    base = exterior[6:9] - exterior[:3]
    base = base / np.linalg.norm(base)
    # The smallest rotation is undefined between opposite vectors; the base in the image system does not depend on it.
    if base[0] < -0.999:
        return left @ base, right @ left.T
    to_base = smallest_rotation(base, np.array([1.0, 0.0, 0.0]))
    return (left @ to_base.T)[:, 0], right @ left.T


def derived_precision(
    exterior: np.ndarray, covariance: np.ndarray, form: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """The five unknowns of a form and their covariance (5, 5) from two exterior orientations (12,) and their joint covariance
    (12, 12). `form`: base and rotation to unknowns. Derivatives by central differences.

    Errors that both photographs share, as of a poorly determined datum, cancel because the joint covariance holds them.
    """
    # A step of a millionth of the base or of a radian: truncation of central differences (1e-12) stays below rounding (1e-10).
    scale = np.repeat([np.linalg.norm(exterior[6:9] - exterior[:3]), 1.0, np.linalg.norm(exterior[6:9] - exterior[:3]), 1.0], 3)
    columns = []
    for k in range(12):
        step = np.zeros(12)
        step[k] = 1e-6 * scale[k]
        columns.append((form(*from_exterior(exterior + step)) - form(*from_exterior(exterior - step))) / (2.0 * step[k]))
    J = np.column_stack(columns)
    return form(*from_exterior(exterior)), J @ covariance @ J.T
