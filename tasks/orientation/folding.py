"""Distortion that cannot be undone at the border of the frame.

A strong barrel distortion grows with the radius faster than the radius itself: from some place on it folds the picture back, and no
ideal point belongs to what is observed farther out. Numbers of another camera, other units or another camera constant do that, and
calibrations whose boards never reached the corners.
"""

import numpy as np

from orthomill.schemas.camera import Camera, Cameras


def reach(camera: Camera) -> float:
    """The largest observed radius, px from the principal point, that the radial distortion can bring forth; inf without a limit."""
    roots = np.roots([7.0 * camera.k3, 5.0 * camera.k2, 3.0 * camera.k1, 1.0])
    square = roots[(np.abs(roots.imag) < 1e-12) & (roots.real > 0)].real
    if not len(square):
        return float("inf")
    r2 = float(square.min())
    return camera.c * float(np.sqrt(r2)) * (1.0 + r2 * (camera.k1 + r2 * (camera.k2 + r2 * camera.k3)))


def folding_remarks(cameras: Cameras) -> tuple[str, ...]:
    """A sentence for every camera whose distortion folds the corners of its frame."""
    found = []
    for name, camera in sorted(cameras.cameras.items()):
        limit, far = reach(camera), _farthest(camera)
        if limit < far:
            found.append(
                f"The distortion of the camera {name} cannot be undone farther than {limit:.0f} px from its principal point, while "
                f"a corner of the frame lies {far:.0f} px away (k1 = {camera.k1:.3g}, c = {camera.c:.0f} px): tie points farther "
                "out take no part, and those near the limit are poor. Look for a camera constant or distortion of another camera "
                "or image size, or calibrate with points that reach the corners."
            )
    return tuple(found)


def _farthest(camera: Camera) -> float:
    return float(np.hypot(0.5 * camera.width + abs(camera.x0), 0.5 * camera.height + abs(camera.y0)))
