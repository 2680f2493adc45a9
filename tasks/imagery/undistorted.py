"""Photographs without distortion: resampled into an ideal camera, for programs that know no lens."""

import numpy as np

from orthomill.schemas.camera import BrownLens, Camera
from orthomill.tasks.geometry.distortion import image_to_pixel, pixel_to_image
from orthomill.tasks.imagery.resampling import sample_cubic

_STRIP = 256
"""rows that are resampled at a time"""


def ideal_camera(camera: Camera) -> Camera:
    """A central projection of the same size and camera constant: square pixels, the principal point in the middle, no lens."""
    square = {"x0": 0.0, "y0": 0.0, "affinity": 0.0, "skew": 0.0, "lens": BrownLens(), "covariance": None}
    return camera.model_copy(update=square)


def ideal_pixels(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """Observed pixels (N, 2) (col, row) to those of the ideal camera (N, 2)."""
    return image_to_pixel(ideal_camera(camera), pixel_to_image(camera, pixels))


def undistorted_photograph(pixels: np.ndarray, camera: Camera) -> np.ndarray:
    """Pixels (rows, cols, bands) of a camera resampled into its ideal one, in the same type; 0 where the photograph has none."""
    out, ideal = np.zeros_like(pixels), ideal_camera(camera)
    top = np.iinfo(pixels.dtype).max
    for first in range(0, pixels.shape[0], _STRIP):
        row, col = np.mgrid[first : min(first + _STRIP, pixels.shape[0]), : pixels.shape[1]]
        places = image_to_pixel(camera, pixel_to_image(ideal, np.column_stack([col.ravel(), row.ravel()])))
        values = np.clip(np.rint(np.nan_to_num(sample_cubic(pixels, places))), 0, top)
        out[first : first + _STRIP] = values.reshape(*row.shape, -1).astype(pixels.dtype)
    return out
