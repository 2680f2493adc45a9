"""Whether the numbers of a camera can be those of a camera.

Camera files are written by hand and by other programs, in other units: a camera constant in millimetres, a distortion in pixels.
Such a camera fails much later, in the matching, where its photographs seem to have nothing in common.
"""

import numpy as np

from orthomill.schemas.camera import INTERIOR, Camera
from orthomill.tasks.geometry.distortion import lens_of, radial_factor

_LEAST_C, _MOST_C = 0.05, 1000.0
"""Camera constant as a share of the longer side: a field of view of 169 degrees, and one of 3 minutes of arc."""

# Anamorphic lenses squeeze by up to 2; nothing beyond that is a camera.
_MOST_AFFINITY = 1.0


def camera_mistake(camera: Camera) -> str | None:
    """What is impossible about a camera, as the end of a sentence; None when nothing is."""
    numbers = [*camera.interior, camera.sigma0 or 0.0, camera.pixel_um or 1.0]
    if not np.isfinite(numbers).all():
        return "holds a value that is not a number"
    longer = max(camera.width, camera.height)
    if not _LEAST_C * longer <= camera.c <= _MOST_C * longer:
        return (
            f"has a camera constant of {camera.c:g} px and {camera.width} x {camera.height} pixels; it is between "
            f"{_LEAST_C:g} and {_MOST_C:g} times the longer side, in pixels and not in millimetres"
        )
    if abs(camera.x0) > camera.width or abs(camera.y0) > camera.height:
        return f"has its principal point ({camera.x0:g}, {camera.y0:g}) px from the centre, outside of the photograph"
    if (share := _distortion(camera)) > 1.0:
        return f"has a distortion of {share:.3g} times the radius in the corners; coefficients refer to radii in units of c"
    if abs(camera.affinity) > _MOST_AFFINITY or abs(camera.skew) > _MOST_AFFINITY:
        return f"has an affinity of {camera.affinity:g} and a skew of {camera.skew:g}; pixels are square within {_MOST_AFFINITY:g}"
    if (camera.pixel_um or 1.0) <= 0:
        return f"has pixels of {camera.pixel_um:g} micrometres"
    return _covariance_mistake(camera)


def _distortion(camera: Camera) -> float:
    """Distortion in the corners as a share of the radius."""
    r = np.hypot(camera.width, camera.height) / 2 / camera.c
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        radial = radial_factor.py_func(r**2, lens_of(camera))[0] - 1.0
        tangential = 3 * r * np.hypot(camera.value("p1"), camera.value("p2"))
    # A division by zero within the frame is no lens either.
    return float(np.nan_to_num(abs(radial) + tangential, nan=np.inf))


def _covariance_mistake(camera: Camera) -> str | None:
    if camera.covariance is None:
        return None
    rows = {len(row) for row in camera.covariance}
    if len(camera.covariance) != len(INTERIOR) or rows != {len(INTERIOR)}:
        return f"has a covariance matrix that is not {len(INTERIOR)} x {len(INTERIOR)}, in the order {', '.join(INTERIOR)}"
    matrix = np.array(camera.covariance)
    if not np.isfinite(matrix).all() or (np.diag(matrix) < 0).any() or not np.allclose(matrix, matrix.T):
        return "has a covariance matrix that is not symmetric, or not finite, or has negative variances"
    return None
