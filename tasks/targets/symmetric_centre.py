"""The centre of a target by its symmetry: least squares of a patch with itself, turned by 180 degrees.

Chequered plates, crosses and circles look the same upside down, and so do their affine images. If the patch and the turned patch
fit best with a shift d, the centre lies d / 2 from the middle. Blur, light and the width of lines cancel, since they are the same
in both. The standard error follows from the residuals, which are also those of what is no target.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.imagery.bicubic import bilinear_at
from orthomill.tasks.targets.target_centre import CORRELATED, LEAST_SIGMA, TargetCentre

STEPS = 12
STOP = 1e-3
"""px"""
FARTHEST = 3.0
"""px from the start beyond which another thing was found"""
WORST_CONDITION = 1e4
"""Ratio of the eigenvalues of the normal equations beyond which a patch has edges of one direction only."""


def symmetric_centre(grey: np.ndarray, start: np.ndarray, radius: float) -> TargetCentre | None:
    """The centre of symmetry near `start` (2,) px of a grey image (rows, cols) float32, in a round patch of `radius` px; None where
    there is none, or the patch leaves the image."""
    found, col, row, largest, variance, spread = _symmetry(grey, float(start[0]), float(start[1]), float(radius))
    if not found:
        return None
    # Each pair of pixels occurs twice.
    sigma = max(CORRELATED * float(np.sqrt(2.0 * variance * largest)), LEAST_SIGMA)
    return TargetCentre(np.array([col, row]), sigma, min(variance / max(2.0 * spread, 1e-9), 1.0))


@njit(error_model="numpy")
def _symmetry(grey, start_col, start_row, radius):
    """Whether there is a centre; (col, row) px, the largest eigenvalue of the inverse normal equations, the variance of the
    residuals, and that of the patch."""
    half = int(np.ceil(radius))
    weight = _soft_disc(half, radius)
    patch = np.empty((2 * half + 3, 2 * half + 3))
    col, row = start_col, start_row
    largest, variance = 0.0, 0.0
    for _ in range(STEPS):
        room = half + 2
        if not (room <= col < grey.shape[1] - room and room <= row < grey.shape[0] - room):
            return False, col, row, 0.0, 0.0, 0.0
        _interpolated(grey, col, row, patch)
        found, by_col, by_row, largest, variance = _step(patch, weight)
        if not found:
            return False, col, row, 0.0, 0.0, 0.0
        col += min(max(by_col, -1.0), 1.0)
        row += min(max(by_row, -1.0), 1.0)
        if np.hypot(col - start_col, row - start_row) > FARTHEST:
            return False, col, row, 0.0, 0.0, 0.0
        if max(abs(by_col), abs(by_row)) < STOP:
            break
    return True, col, row, largest, variance, _weighted_variance(patch, weight)


@njit(error_model="numpy")
def _soft_disc(half, radius):
    """Weights (2 half + 1, 2 half + 1) that fall off softly: a hard border would pull the centre to whole pixels."""
    weight = np.empty((2 * half + 1, 2 * half + 1))
    for i in range(2 * half + 1):
        for j in range(2 * half + 1):
            weight[i, j] = min(max(radius + 0.5 - np.hypot(float(i - half), float(j - half)), 0.0), 1.0)
    return weight


@njit(error_model="numpy")
def _interpolated(grey, col, row, patch):
    """The square `patch` about a place, linear between pixels."""
    reach = patch.shape[0] // 2
    for i in range(patch.shape[0]):
        for j in range(patch.shape[1]):
            patch[i, j] = bilinear_at(grey, row + (i - reach), col + (j - reach))


@njit(error_model="numpy")
def _step(patch, weight):
    """A step of least squares: whether it is determined, (col, row) px, the largest eigenvalue of the inverse normal equations, and
    the variance of the residuals. `patch` is larger by a pixel on all sides."""
    size = weight.shape[0]
    # The sums over f(c + s) - f(c - s) = 0, its derivatives by the centre g and h, and their products.
    gg, gh, hh, gd, hd, dd, total = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(size):
        for j in range(size):
            w = weight[i, j]
            # The pixel, and the one that it is turned to.
            r, c, u, v = i + 1, j + 1, size - i, size - j
            g = 0.5 * (patch[r, c + 1] - patch[r, c - 1] - patch[u, v + 1] + patch[u, v - 1])
            h = 0.5 * (patch[r + 1, c] - patch[r - 1, c] - patch[u + 1, v] + patch[u - 1, v])
            d = patch[r, c] - patch[u, v]
            gg += w * g * g
            gh += w * g * h
            hh += w * h * h
            gd += w * g * d
            hd += w * h * d
            dd += w * d * d
            total += w
    mean, spread = 0.5 * (gg + hh), np.hypot(0.5 * (gg - hh), gh)
    if not mean + spread <= WORST_CONDITION * (mean - spread):
        return False, 0.0, 0.0, 0.0, 0.0
    determinant = gg * hh - gh * gh
    by_col, by_row = -(hh * gd - gh * hd) / determinant, -(gg * hd - gh * gd) / determinant
    variance = max(dd + gd * by_col + hd * by_row, 0.0) / max(total - 4.0, 1.0)
    return True, by_col, by_row, 1.0 / (mean - spread), variance


@njit(error_model="numpy")
def _weighted_variance(patch, weight):
    """The variance of a patch, without its border of a pixel."""
    total, first, second = 0.0, 0.0, 0.0
    for i in range(weight.shape[0]):
        for j in range(weight.shape[1]):
            total += weight[i, j]
            first += weight[i, j] * patch[i + 1, j + 1]
    mean = first / total
    for i in range(weight.shape[0]):
        for j in range(weight.shape[1]):
            second += weight[i, j] * (patch[i + 1, j + 1] - mean) ** 2
    return second / total
