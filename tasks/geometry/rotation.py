"""Rotation matrices from omega, phi, kappa and back: R = R3(kappa) R2(phi) R1(omega), from world to image."""

import numpy as np


def rotation_matrix(omega: float, phi: float, kappa: float) -> np.ndarray:
    """The 3 x 3 rotation world to image from three angles in radians.

    Source: Karfis 2009, section 3.3 (sources/epipolar.md#relative-orientation).
    """
    so, co = np.sin(omega), np.cos(omega)
    sp, cp = np.sin(phi), np.cos(phi)
    sk, ck = np.sin(kappa), np.cos(kappa)
    return np.array(
        [
            [ck * cp, ck * sp * so + sk * co, -ck * sp * co + sk * so],
            [-sk * cp, -sk * sp * so + ck * co, sk * sp * co + ck * so],
            [sp, -cp * so, cp * co],
        ]
    )


def angles(rotation: np.ndarray) -> tuple[float, float, float]:
    """omega, phi, kappa in radians of a 3 x 3 rotation; at phi = +-90 degrees kappa is set to 0."""
    # Rounding may leave the sine a little above 1, where arcsin is NaN.
    sin_phi = float(np.clip(rotation[2, 0], -1.0, 1.0))
    phi = float(np.arcsin(sin_phi))
    # Gimbal lock: only omega + kappa (or omega - kappa) is defined. 1e-12 is phi within 1.4e-6 rad of 90 degrees; nearer, the
    # elements in the quotients below are rounding errors.
    if abs(sin_phi) > 1.0 - 1e-12:
        return float(np.arctan2(rotation[1, 2], rotation[1, 1])), phi, 0.0
    omega = float(np.arctan2(-rotation[2, 1], rotation[2, 2]))
    kappa = float(np.arctan2(-rotation[1, 0], rotation[0, 0]))
    return omega, phi, kappa


def rotation_derivatives(omega: float, phi: float, kappa: float) -> np.ndarray:
    """(3, 3, 3): the derivatives of the rotation matrix by omega, phi and kappa, in this order along the first axis."""
    so, co = np.sin(omega), np.cos(omega)
    sp, cp = np.sin(phi), np.cos(phi)
    sk, ck = np.sin(kappa), np.cos(kappa)
    by_omega = [
        [0.0, ck * sp * co - sk * so, ck * sp * so + sk * co],
        [0.0, -sk * sp * co - ck * so, -sk * sp * so + ck * co],
        [0.0, -cp * co, -cp * so],
    ]
    by_phi = [[-ck * sp, ck * cp * so, -ck * cp * co], [sk * sp, -sk * cp * so, sk * cp * co], [cp, sp * so, -sp * co]]
    by_kappa = [
        [-sk * cp, -sk * sp * so + ck * co, sk * sp * co + ck * so],
        [-ck * cp, -ck * sp * so - sk * co, ck * sp * co - sk * so],
        [0.0, 0.0, 0.0],
    ]
    return np.array([by_omega, by_phi, by_kappa])


def nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) nearest to a matrix (3, 3) in the least-squares sense; for the sum of outer products of y and x it is the
    rotation that takes x closest to y.

    Source: Kabsch 1976.
    """
    U, _, Vt = np.linalg.svd(matrix)
    # U Vt may be a reflection (noise, or points in a plane); changing the sign of the smallest singular value costs least.
    return (U * np.array([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])) @ Vt
