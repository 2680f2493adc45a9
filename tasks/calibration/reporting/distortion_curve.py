"""The balanced curve of radial distortion: the camera constant for which distortion is least over a stated radius.

c and radial distortion are exchangeable to first order. Of all pairs, the calibrated one has the least integral of the squared
displacement from the centre to the chosen radius. Only for reports: the camera itself stays as adjusted.

Source: Kawka 2021, S13, with the factor 2 of the mixed term put right (methods/calibration.md).
"""

import numpy as np

RADIUS_SHARE = 0.85
"""The chosen radius as a share of half the diagonal."""


def displacement(radius: np.ndarray, c: float, k: tuple[float, float, float]) -> np.ndarray:
    """Radial displacement (px) at ideal `radius` (px) of distortion numbers normalised by c."""
    r2 = (radius / c) ** 2
    return radius * r2 * (k[0] + r2 * (k[1] + r2 * k[2]))


def balancing_change(c: float, k: tuple[float, float, float], radius: float) -> float:
    """dc (px) to be added to c so that the displacement from 0 to `radius` px is least in the mean square.

    With k3 = 0 this is c (D2 - D1) / (D1 - 2 D2 + D3) of the source; here the integrals are those of polynomials of any degree.
    """
    polynomial = np.polynomial.Polynomial([0.0, 0.0, 0.0, k[0] / c**2, 0.0, k[1] / c**4, 0.0, k[2] / c**6])
    ray = np.polynomial.Polynomial([0.0, 1.0])
    D1, D2, D3 = ((a * b).integ()(radius) for a, b in ((polynomial, polynomial), (polynomial, ray), (ray, ray)))
    return float(c * (D2 - D1) / (D1 - 2.0 * D2 + D3))


def balanced(radius: np.ndarray, c: float, k: tuple[float, float, float], change: float) -> np.ndarray:
    """Displacement (px) at `radius` (px) when c + `change` is the camera constant."""
    share = change / c
    return displacement(radius, c, k) * (1.0 + share) - share * radius
