"""The balanced curve of radial distortion: the camera constant for which distortion is smallest over a given radius.

c and radial distortion are interchangeable to first order. Of all such pairs, the balanced one has the smallest integral of the
squared displacement from the centre to the given radius. Only for reports: the camera itself stays as adjusted.

Source: Kawka 2021, S13, with the factor 2 of the mixed term corrected (sources/calibration.md).
"""

import numpy as np

from orthomill.schemas.camera import INTERIOR, LensKind
from orthomill.tasks.geometry.distortion import distorted, lens_numbers

Radial = tuple[float, float, float]
"""k1, k2, k3 in units of c"""
RADIUS_SHARE = 0.85
"""The radius of the balanced curve as a share of half the diagonal."""


def displacement(radius: np.ndarray, c: float, k: Radial) -> np.ndarray:
    """Radial displacement (px) at ideal `radius` (px) of coefficients normalised by c (px)."""
    r2 = (radius / c) ** 2
    return radius * r2 * (k[0] + r2 * (k[1] + r2 * k[2]))


def radial_displacement(radius: np.ndarray, interior: np.ndarray, lens: LensKind) -> np.ndarray:
    """The same of any lens, without its tangential part; interior (17,) in the order of INTERIOR."""
    aside = np.isin(INTERIOR, ("p1", "p2", "affinity", "skew", "s1", "s2", "s3", "s4"))
    numbers, c = lens_numbers(np.where(aside, 0.0, interior), lens), interior[0]
    return distorted(np.column_stack([radius, np.zeros_like(radius)]) / c, numbers)[:, 0] * c - radius


def balancing_change(c: float, k: Radial, radius: float) -> float:
    """dc (px) to be added to c so that the displacement from 0 to `radius` px is smallest in the mean square.

    With k3 = 0 this is c (D2 - D1) / (D1 - 2 D2 + D3) of the source; here the integrals are those of polynomials of any degree.
    """
    # A change of c scales the ideal image by 1 + dc / c: the distortion polynomial is compared with the straight line r.
    polynomial = np.polynomial.Polynomial([0.0, 0.0, 0.0, k[0] / c**2, 0.0, k[1] / c**4, 0.0, k[2] / c**6])
    ray = np.polynomial.Polynomial([0.0, 1.0])
    D1, D2, D3 = ((a * b).integ()(radius) for a, b in ((polynomial, polynomial), (polynomial, ray), (ray, ray)))
    return float(c * (D2 - D1) / (D1 - 2.0 * D2 + D3))


def balanced(radius: np.ndarray, c: float, k: Radial, change: float) -> np.ndarray:
    """Displacement (px) at `radius` (px) when c + `change` is the camera constant."""
    share = change / c
    return displacement(radius, c, k) * (1.0 + share) - share * radius
