"""The pose of a photograph from the line in which it sees the horizon of a plane, without any decomposition.

The published check of the pose that a calibration starts from (tasks/calibration/solving/initial_pose.py).

Source: Bender and von Gruber, in Kawka 2021, S9 (sources/calibration.md, with its corrections).
"""

import numpy as np

from orthomill.tasks.geometry.rotation import rotation_matrix


def pose_by_horizon(homography: np.ndarray, c: float) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and projection centre (3,) of a tilted photo from the homography (3, 3) of the plane Z = 0 and c, px."""
    (a11, a12, a13), (a21, a22, a23), (a31, a32, _) = homography / homography[2, 2]
    far, A = -np.sign(a32) / np.hypot(a31, a32), np.arctan(a31 / a32)
    centre = np.array([a31 * (a11 - a22) + a32 * (a12 + a21), a31 * (a12 + a21) - a32 * (a11 - a22)]) * far**2
    one, other = a22 * a31 - a21 * a32, a11 * a32 - a12 * a31
    S = np.arctan(one / other) + np.pi
    # Published as the mean of two quotients, of which one is 0 / 0 where S + A is a right angle: their common value.
    F = -((a31 * other + a32 * one) * np.sin(S + A) + (a32 * other - a31 * one) * np.cos(S + A)) * far**3
    sine, cosine, off = np.sin(S - A), np.cos(S - A), np.array([a13, a23]) - centre
    foot = np.array([cosine * off[0] - sine * off[1], sine * off[0] + cosine * off[1]]) * far / F
    # Noise can bring the horizon of a photo on edge nearer than c.
    tilt = np.arcsin(np.clip(c / F, -1.0, 1.0))
    height = -(far - np.sin(A) * foot[0] - np.cos(A) * foot[1]) * np.sin(tilt)
    place = np.array([*(foot - height * np.array([np.sin(A), np.cos(A)]) * np.tan(tilt / 2.0)), height])
    kappa = np.arctan((np.tan(S) - np.tan(A) * np.cos(tilt)) / (1.0 + np.tan(S) * np.tan(A) * np.cos(tilt)))
    phi, omega = np.arcsin(-np.sin(tilt) * np.sin(A)), np.arctan(np.tan(tilt) * np.cos(A))
    if height < 0:
        place[2], omega, phi = -height, -omega, -phi
    turned = rotation_matrix(omega, phi, kappa)
    # The arc tangent leaves half a turn about the axis: the right one maps the plane as the homography does.
    seen = np.diag([-c, -c, 1.0]) @ np.column_stack([turned[:, :2], -turned @ place])
    same = float((seen[:2, :2] / seen[2, 2] * homography[:2, :2] / homography[2, 2]).sum()) > 0
    return (turned if same else np.diag([-1.0, -1.0, 1.0]) @ turned), place
