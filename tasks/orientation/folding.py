"""Distortion that cannot be inverted near the border of the frame.

A strong barrel distortion grows faster with the radius than the radius itself: beyond some radius it folds the image back, and no
ideal point corresponds to what is observed farther out. Coefficients of another camera, in other units or for another camera
constant have this effect, and calibrations whose boards never reached the corners.
"""

import numpy as np

from orthomill.schemas.camera import BrownLens, Camera, Cameras
from orthomill.schemas.findings.camera_findings import DistortionFolds
from orthomill.tasks.geometry.distortion import distorted, lens_of


def reach(camera: Camera) -> float:
    """The largest observed radius, px from the principal point, that the radial distortion can produce; inf without a limit."""
    if not isinstance(camera.lens, BrownLens):
        return _wide_reach(camera)
    lens = camera.lens
    # The observed radius r (1 + k1 r^2 + k2 r^4 + k3 r^6) is largest where its derivative, a cubic in r^2, has its first root.
    roots = np.roots([7.0 * lens.k3, 5.0 * lens.k2, 3.0 * lens.k1, 1.0])
    square = roots[(np.abs(roots.imag) < 1e-12) & (roots.real > 0)].real
    if not len(square):
        return float("inf")
    r2 = float(square.min())
    return camera.c * float(np.sqrt(r2)) * (1.0 + r2 * (lens.k1 + r2 * (lens.k2 + r2 * lens.k3)))


def _wide_reach(camera: Camera) -> float:
    """`reach` of a lens that is no polynomial, by steps of a twentieth of a degree; that of a fisheye ends at 90 degrees."""
    lens = lens_of(camera)._replace(p1=0.0, p2=0.0, affinity=0.0, skew=0.0, s1=0.0, s2=0.0, s3=0.0, s4=0.0)
    ideal = np.tan(np.radians(np.arange(0.0, 89.95, 0.05)))
    observed = distorted(np.column_stack([ideal, np.zeros_like(ideal)]), lens)[:, 0]
    falls = np.flatnonzero(~(np.diff(observed) > 0))
    if not len(falls):
        return camera.c * float(observed[-1]) if camera.lens.kind == "fisheye" else float("inf")
    return camera.c * float(observed[falls[0]])


def folding_cameras(cameras: Cameras) -> tuple[DistortionFolds, ...]:
    """The cameras whose distortion folds the corners of their frames, in the order of their names."""
    found = []
    for name, camera in sorted(cameras.cameras.items()):
        limit, far = reach(camera), _farthest(camera)
        if limit < far:
            found.append(DistortionFolds(camera=name, reach_px=limit, corner_px=far, k1=camera.value("k1"), c=camera.c))
    return tuple(found)


def _farthest(camera: Camera) -> float:
    """Distance of the farthest corner of the frame from the principal point, px."""
    return float(np.hypot(0.5 * camera.width + abs(camera.x0), 0.5 * camera.height + abs(camera.y0)))
