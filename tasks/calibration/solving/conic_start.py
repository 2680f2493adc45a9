"""The start of the original method: the whole interior orientation from the image of the absolute conic, the pose from the horizon.

Noise shifts the principal point of homographies too much for it to start from (the published conclusion, which the benchmark of
starts repeats), so that a calibration takes only the mean camera constant, and only where the other two constants lead nowhere. The
pose follows from the line in which the plane's horizon is seen, without any decomposition; it is the published check of the one
that is used (initial_pose.py).

Source: Zhang 2000; Bender and von Gruber, in Kawka 2021, S7 and S9 (methods/calibration.md, with its corrections).
"""

from typing import NamedTuple

import numpy as np

from orthomill.tasks.geometry.rotation import rotation_matrix

_DETERMINED = 1e-9
"""Least ratio of the second smallest singular value to the largest: below it two conics fit alike."""


class ConicInterior(NamedTuple):
    """Camera constants along the columns and rows, skew, principal point from the origin of the image coordinates, px; NaN where
    the photographs do not determine them."""

    cx: float
    cy: float
    skew: float
    x0: float
    y0: float

    @property
    def c(self) -> float:
        """The one constant that the published method keeps."""
        return (self.cx + self.cy) / 2.0


def interior_from_conic(homographies: list[np.ndarray], scale: float, skew: bool = False) -> ConicInterior:
    """From at least two homographies (3, 3) of a plane, three where the `skew` is unknown too; `scale` px: of the photographs."""
    unit = np.diag([1.0 / scale, 1.0 / scale, 1.0])
    # In units of the photograph: entries of pixels and of their squares would cost six digits. No skew: its term of the conic is 0.
    rows = [] if skew else [np.eye(6)[1]]
    for homography in homographies:
        H = unit @ homography
        H = H / np.linalg.norm(H[:, :2])
        rows += [_product(H, 0, 1), _product(H, 0, 0) - _product(H, 1, 1)]
    values, axes = np.linalg.svd(np.array(rows))[1:]
    if len(rows) < 5 or values[4] < _DETERMINED * values[0]:
        return ConicInterior(*[np.nan] * 5)
    return _interior_of(axes[5], scale)


def _product(H: np.ndarray, i: int, j: int) -> np.ndarray:
    """(6,): the product of two columns by the conic's B11, B12, B22, B13, B23, B33."""
    a, b = H[:, i], H[:, j]
    cross = [a[0] * b[1] + a[1] * b[0], a[0] * b[2] + a[2] * b[0], a[1] * b[2] + a[2] * b[1]]
    return np.array([a[0] * b[0], cross[0], a[1] * b[1], cross[1], cross[2], a[2] * b[2]])


def _interior_of(conic: np.ndarray, scale: float) -> ConicInterior:
    B11, B12, B22, B13, B23, B33 = conic
    with np.errstate(invalid="ignore", divide="ignore"):
        below = B11 * B22 - B12**2
        y0 = (B12 * B13 - B11 * B23) / below
        size = B33 - (B13**2 + y0 * (B12 * B13 - B11 * B23)) / B11
        cx, cy = np.sqrt(size / B11), np.sqrt(size * B11 / below)
        skew = -B12 * cx**2 * cy / size
        x0 = skew * y0 / cy - B13 * cx**2 / size
    return ConicInterior(*(float(scale * value) for value in (cx, cy, skew, x0, y0)))


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
