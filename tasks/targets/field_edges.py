"""The centre of a plate of four fields by where their edges cross, each field in a light of its own.

Creases and shadows give the two dark fields, or the two bright ones, different grey values: such a plate is not symmetric. Two
edges that a lens has smoothed, and the four grey values between them, are fitted to the pixels by least squares.
"""

import numpy as np
from scipy.optimize import least_squares
from scipy.special import ndtr

from orthomill.tasks.targets.target_centre import CORRELATED, LEAST_SIGMA, TargetCentre

FARTHEST = 3.0
"""px from the start beyond which another thing was found"""
STOP = {"ftol": 1e-4, "xtol": 1e-4, "max_nfev": 30}
"""of the search: the last steps are below a hundredth of a pixel"""
SOFT = 0.7
"""px: width of an edge at the start"""
SOFTNESS = (0.2, 2.0)
"""px: widths that edges may have"""


def crossing_edges(grey: np.ndarray, start: np.ndarray, radius: float, directions: np.ndarray) -> TargetCentre | None:
    """Where the edges of four fields cross near `start` (2,) px of a grey image (rows, cols) float32, in a round patch of `radius`
    px; `directions` (2,) of the edges at the start, radians from the columns to the rows. None where there are no two dark fields
    opposite each other, or the patch leaves the image."""
    half = int(np.ceil(radius))
    middle = np.round(start).astype(int)
    if not ((middle - half >= 0).all() and middle[0] + half < grey.shape[1] and middle[1] + half < grey.shape[0]):
        return None
    rows, cols = np.mgrid[-half : half + 1, -half : half + 1]
    weight = np.sqrt(np.clip(radius + 0.5 - np.hypot(cols, rows), 0.0, 1.0)).ravel()
    inside = weight > 0
    pixels, root = np.stack([cols, rows]).reshape(2, -1)[:, inside], weight[inside]
    shown = grey[middle[1] - half : middle[1] + half + 1, middle[0] - half : middle[0] + half + 1].ravel()[inside].astype(float)

    def levels(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        fields = root[:, None] * _fields(x, pixels)
        values = np.linalg.lstsq(fields, root * shown, rcond=None)[0]
        return values, fields @ values - root * shown

    room = np.array([FARTHEST, FARTHEST, 0.5, 0.5])
    first = np.array([*(start - middle), *directions, SOFT])
    bounds = (np.append(first[:4] - room, SOFTNESS[0]), np.append(first[:4] + room, SOFTNESS[1]))
    fitted = least_squares(lambda x: levels(x)[1], first, bounds=bounds, x_scale=(0.3, 0.3, 0.2, 0.2, 0.3), **STOP)
    values, residual = levels(fitted.x)
    if not _alternate(values):
        return None
    normal = fitted.jac.T @ fitted.jac
    total = float((root**2).sum())
    variance = float(residual @ residual) / max(total - len(first) - len(values), 1.0)
    spread = float(np.average((shown - np.average(shown, weights=root**2)) ** 2, weights=root**2))
    largest = float(np.linalg.eigvalsh(np.linalg.pinv(normal)[:2, :2])[-1])
    sigma = max(CORRELATED * float(np.sqrt(variance * largest)), LEAST_SIGMA)
    return TargetCentre(middle + fitted.x[:2], sigma, min(variance / max(spread, 1e-9), 1.0))


def _fields(x: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """(n, 4) how much of pixels (2, n) lies in each field: of x (5,), the centre, the directions of two edges, and their width."""
    away = pixels - x[:2, None]
    first, second = (ndtr((away[1] * np.cos(a) - away[0] * np.sin(a)) / x[4]) for a in x[2:4])
    return np.stack([first * second, (1 - first) * (1 - second), first * (1 - second), (1 - first) * second], axis=1)


def _alternate(values: np.ndarray) -> bool:
    """Whether two of four fields (the first or the last) are darker than both others, by more than fields of a pair differ."""
    pairs = sorted((sorted(values[:2]), sorted(values[2:])), key=lambda pair: pair[0])
    (dark, less_dark), (less_bright, bright) = pairs
    return less_bright - less_dark > max(less_dark - dark, bright - less_bright)
