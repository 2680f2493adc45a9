"""Radial distortion of several cameras along one axis of radii."""

import numpy as np

from orthomill.schemas.camera import Camera
from orthomill.tasks.geometry.distortion import image_to_pixel


def radial_curves(cameras: tuple[Camera, ...]) -> tuple[tuple[float, ...], dict[str, tuple[float, ...]]]:
    """Radii (px) to the farthest corner of all cameras, and by name the displacement (px) there, observed minus ideal."""
    reach = max(float(np.hypot(camera.width, camera.height)) / 2 for camera in cameras)
    radius = np.linspace(0.0, reach, 60)
    return tuple(radius.round(2).tolist()), {camera.name: tuple(_radial(camera, radius).round(4).tolist()) for camera in cameras}


def _radial(camera: Camera, radius: np.ndarray) -> np.ndarray:
    """Radial distortion (n,) px at ideal radii (n,) px from the principal point, without its tangential part."""
    only = {name: 0.0 for name in ("x0", "y0", "p1", "p2", "affinity", "skew", "s1", "s2", "s3", "s4") if camera.value(name)}
    centred = camera.changed(**only)
    pixels = image_to_pixel(centred, np.column_stack([radius, np.zeros_like(radius)]))
    return pixels[:, 0] - (camera.width - 1) / 2 - radius
