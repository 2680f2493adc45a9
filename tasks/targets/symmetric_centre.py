"""The centre of a target by its symmetry: least squares of a patch with itself, turned by 180 degrees.

Chequered plates, crosses and circles look the same upside down, and so do their affine images. If the patch and the turned patch
fit best with a shift d, the centre lies d / 2 from the middle. Blur, light and the width of lines cancel, since they are the same
in both. The standard error follows from the residuals, which are also those of what is no target.
"""

from dataclasses import dataclass

import cv2
import numpy as np

STEPS = 12
STOP = 1e-3
"""px"""
FARTHEST = 3.0
"""px from the start beyond which another thing was found"""
CORRELATED = 2.0
"""Grey values of neighbouring pixels share their errors (blur, demosaicing): standard errors of white ones, times this."""
LEAST_SIGMA = 0.02
"""px"""


@dataclass(frozen=True, eq=False)
class SymmetricCentre:
    """`place` (2,) (col, row) px, its standard error, and `asymmetry`: what of the patch's variance is not symmetric, 0 to 1."""

    place: np.ndarray
    sigma: float
    asymmetry: float


def symmetric_centre(grey: np.ndarray, start: np.ndarray, radius: float) -> SymmetricCentre | None:
    """The centre of symmetry near `start` (2,) px of a grey image (rows, cols) float32, in a round patch of `radius` px; None where
    there is none, or the patch leaves the image."""
    half = int(np.ceil(radius))
    offset = np.arange(-half, half + 1)
    x, y = (plane.astype(np.float32) for plane in np.meshgrid(offset, offset))
    # Weights that fall off softly: a hard border would pull the centre to whole pixels.
    weight = np.clip(radius + 0.5 - np.hypot(x, y), 0.0, 1.0)
    inside = weight > 0
    w = weight[inside].astype(np.float64)
    place = np.array(start, float)
    rows, cols = grey.shape
    normal = np.eye(2)
    residual = np.zeros(len(w))
    for _ in range(STEPS):
        if not (half + 2 <= place[0] < cols - half - 2 and half + 2 <= place[1] < rows - half - 2):
            return None
        patch = cv2.getRectSubPix(grey, (2 * half + 3, 2 * half + 3), (float(place[0]), float(place[1]))).astype(np.float64)
        gx, gy = 0.5 * (patch[1:-1, 2:] - patch[1:-1, :-2]), 0.5 * (patch[2:, 1:-1] - patch[:-2, 1:-1])
        middle = patch[1:-1, 1:-1]
        # f(c + s) - f(c - s) = 0; its derivative by the centre is the sum of both gradients there, which are opposite: 2 f'.
        difference = (middle - middle[::-1, ::-1])[inside]
        by_centre = np.stack([(g - g[::-1, ::-1])[inside] for g in (gx, gy)], axis=1)
        normal = by_centre.T @ (w[:, None] * by_centre)
        if np.linalg.cond(normal) > 1e4:
            return None
        step = -np.linalg.solve(normal, by_centre.T @ (w * difference))
        residual = difference + by_centre @ step
        place = place + np.clip(step, -1.0, 1.0)
        if np.linalg.norm(place - start) > FARTHEST:
            return None
        if np.abs(step).max() < STOP:
            break
    variance = float((w * residual**2).sum() / max(w.sum() - 4.0, 1.0))
    # Each pair of pixels occurs twice.
    covariance = 2.0 * variance * np.linalg.inv(normal)
    spread = float((w * (middle[inside] - np.average(middle[inside], weights=w)) ** 2).sum() / w.sum())
    sigma = max(CORRELATED * float(np.sqrt(np.linalg.eigvalsh(covariance)[-1])), LEAST_SIGMA)
    return SymmetricCentre(place, sigma, min(variance / max(2.0 * spread, 1e-9), 1.0))
