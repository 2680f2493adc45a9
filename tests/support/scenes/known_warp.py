"""A pair of textured images related by an affine that is known exactly."""

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

AFFINE = np.array([[0.95, -0.05], [0.03, 1.04]])
SHIFT = np.array([3.3, -4.7])


def texture(size: int = 420, seed: int = 5) -> np.ndarray:
    """(size, size) float64 grey values about 120, with detail of 1 to 6 px."""
    random = np.random.default_rng(seed)
    layers = [gaussian_filter(random.standard_normal((size, size)), s) * s for s in (1.2, 2.5, 6.0)]
    total = sum(layers)
    return 120.0 + 35.0 * total / total.std()


def warped(image: np.ndarray) -> np.ndarray:
    """The right image: what lies at `left` is seen at AFFINE left + SHIFT."""
    row, col = np.mgrid[: image.shape[0], : image.shape[1]]
    left = np.linalg.inv(AFFINE) @ (np.stack([col.ravel(), row.ravel()]) - SHIFT[:, None])
    return map_coordinates(image, [left[1], left[0]], order=5, mode="nearest").reshape(image.shape)


def grid_points(low: int = 60, high: int = 350, step: int = 6) -> np.ndarray:
    """Sub-pixel points that fall on every phase, (N, 2) (col, row)."""
    col, row = np.meshgrid(np.arange(low, high, step) + 0.37, np.arange(low, high, step) - 0.21)
    return np.column_stack([col.ravel(), row.ravel()])


def true_places(points: np.ndarray) -> np.ndarray:
    """Where points (N, 2) of the left image lie in the right one."""
    return points @ AFFINE.T + SHIFT


def noisy(image: np.ndarray, gain: float, offset: float, sigma: float, seed: int) -> np.ndarray:
    """The image as uint8 with another exposure and Gaussian noise."""
    noise = np.random.default_rng(seed).normal(0, sigma, image.shape)
    return np.clip(np.rint(gain * image + offset + noise), 1, 255).astype(np.uint8)
