"""The start of the original method: the whole interior orientation from the image of the absolute conic.

Noise shifts the principal point of homographies too much for it to start from (the published conclusion, which the benchmark of
starts repeats), so that a calibration takes only the mean camera constant, and only where the other two constants lead nowhere.

Source: Zhang 2000, in Kawka 2021, S7 (sources/calibration.md, with its corrections).
"""

from typing import NamedTuple

import numpy as np

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
