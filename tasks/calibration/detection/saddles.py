"""The chessboard corner as a saddle of grey values between four squares: sub-pixel measurement and tests of corners.

A corner is refined as the saddle point of its neighbourhood (Foerstner's gradient condition, OpenCV's cornerSubPix), in a window
that follows the spacing of the corners. Whether a point is a corner at all, and of which colours, follows from the grey values in
the four squares around it: opposite ones are alike, adjacent ones are not.
"""

import cv2
import numpy as np

_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 60, 1e-4)
_LARGEST_HALF_WINDOW = 11
"""px: larger windows add little precision, but let edges that distortion bends bias the corner."""
_SQUARE = 0.35
"""Where a square is sampled, in its sides from the corner: away from blurred edges, and inside under perspective."""

_RING, _LEAST_RING, _PLACES = 0.2, 2.5, 16
"""Radius of the ring on which the shape of a corner is seen, in spacings and at least px, and the places on it."""


def spacings(grid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vectors (rows, cols, 2) px along a grid of corners (rows, cols, 2), from column to column and from row to row: the mean of
    the steps to both neighbours, or the step to the only one; NaN without any."""
    return _steps(grid.swapaxes(0, 1)).swapaxes(0, 1), _steps(grid)


def _steps(grid: np.ndarray) -> np.ndarray:
    step, none = np.diff(grid, axis=0), np.full_like(grid[:1], np.nan)
    after, before = np.concatenate([step, none]), np.concatenate([none, step])
    return np.where(np.isnan(after), before, np.where(np.isnan(before), after, 0.5 * (after + before)))


def refined(image: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Corners (rows, cols, 2) (col, row) as saddle points of a grey image (rows, cols) uint8.

    A corner that moves out of the window around its start keeps the start; NaN stays NaN.
    """
    across, down = spacings(grid)
    # One window for the whole grid, by its smallest spacing: a window that reaches the next corner would be drawn towards it.
    spacing = min(np.nanmin(np.linalg.norm(across, axis=2)), np.nanmin(np.linalg.norm(down, axis=2)))
    half = int(np.clip(0.4 * spacing, 2, _LARGEST_HALF_WINDOW))
    start = grid.reshape(-1, 1, 2)
    inside = ((start[:, 0] >= 0) & (start[:, 0] <= np.array(image.shape[::-1]) - 1)).all(axis=1)
    points = start[:, 0].copy()
    if inside.any():
        found = cv2.cornerSubPix(image, start[inside].astype(np.float32), (half, half), (-1, -1), _STOP)
        points[inside] = found.reshape(-1, 2).astype(np.float64)
    diverged = np.abs(points - start[:, 0]).max(axis=1) > half
    return np.where(diverged[:, None], start[:, 0], points).reshape(grid.shape)


def contrast(image: np.ndarray, points: np.ndarray, across: np.ndarray, down: np.ndarray) -> np.ndarray:
    """Signed contrast (...,) of corners in grey values: half the difference between the two diagonal pairs of squares, reduced by
    the differences within the pairs. Negative where the squares at -across - down and across + down are black; NaN where a square
    leaves the image.

    points, across, down: (..., 2) px, the corners and the steps to the next column and row.
    """
    grey = np.stack(
        [sampled(image, points + _SQUARE * (side * across + rest * down)) for side, rest in ((-1, -1), (1, 1), (1, -1), (-1, 1))]
    )
    pattern = (grey[0] + grey[1] - grey[2] - grey[3]) / 2.0
    # An edge or a line differs across the point as much as a corner does, but then one pair is unlike in itself.
    unlike = (np.abs(grey[0] - grey[1]) + np.abs(grey[2] - grey[3])) / 2.0
    return np.sign(pattern) * np.maximum(np.abs(pattern) - unlike, 0.0)


def crossings(image: np.ndarray, points: np.ndarray, across: np.ndarray, down: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whether dark and bright quarters meet at points: their signed contrast (...,) in grey values, as `contrast` counts it, and
    the share (...,) of the grey values on a small ring that four quarters explain (0.81 for perfect ones); NaN where the ring
    leaves the image. Nothing but the point's own neighbourhood is looked at.

    points, across, down: (..., 2) px, the corners and the steps to the next column and row.
    """
    step = np.minimum(np.linalg.norm(across, axis=-1), np.linalg.norm(down, axis=-1))
    radius = np.clip(_LEAST_RING / np.maximum(step, 1e-9), _RING, 2.0 * _RING)[..., None]
    angle = (np.arange(_PLACES) + 0.5) * (2.0 * np.pi / _PLACES)
    grey = np.stack([sampled(image, points + radius * (np.cos(a) * across + np.sin(a) * down)) for a in angle], axis=-1)
    deviation = grey - grey.mean(axis=-1, keepdims=True)
    # Four quarters are the second harmonic around the ring: an edge through the point is the first one, a spot none.
    quarters = (deviation * np.exp(-2j * angle)).mean(axis=-1)
    share = 2.0 * np.abs(quarters) ** 2 / np.maximum((deviation**2).mean(axis=-1), 1e-9)
    return -np.pi * quarters.imag, share


def sampled(image: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Grey values (...,) at points (..., 2) (col, row), bilinear; NaN outside."""
    flat = points.reshape(-1, 2)
    rows, cols = image.shape
    col, row = np.floor(flat[:, 0]), np.floor(flat[:, 1])
    with np.errstate(invalid="ignore"):
        inside = (col >= 0) & (row >= 0) & (col < cols - 1) & (row < rows - 1)
    j, i = np.where(inside, col, 0).astype(int), np.where(inside, row, 0).astype(int)
    u, v = flat[:, 0] - j, flat[:, 1] - i
    top = (1 - u) * image[i, j] + u * image[i, j + 1]
    bottom = (1 - u) * image[i + 1, j] + u * image[i + 1, j + 1]
    return np.where(inside, (1 - v) * top + v * bottom, np.nan).reshape(points.shape[:-1])


def signs(rows: int, cols: int) -> np.ndarray:
    """(rows, cols) -1 and +1: the signs of `contrast` on a board whose first square is black."""
    return np.where(np.add.outer(np.arange(rows), np.arange(cols)) % 2 == 0, -1.0, 1.0)


def edge_blur(image: np.ndarray, grid: np.ndarray) -> float:
    """Standard deviation (px) of the blur across the edges between neighbouring corners (rows, cols, 2); NaN where no edge lies in
    the image."""
    middle = (grid[:, 1:] + grid[:, :-1]) / 2.0
    along = grid[:, 1:] - grid[:, :-1]
    length = np.maximum(np.linalg.norm(along, axis=2), 1e-9)
    normal = np.stack([-along[..., 1], along[..., 0]], axis=-1) / length[..., None]
    reach = np.arange(-0.35, 0.3501, 0.02)
    profile = np.stack([sampled(image, middle + step * length[..., None] * normal) for step in reach], axis=-1)
    rise = np.abs(profile[..., -4:].mean(axis=-1) - profile[..., :4].mean(axis=-1))
    slope = np.abs(np.diff(profile, axis=-1)).max(axis=-1) / (0.02 * length)
    # A step of height h blurred by a Gaussian has the largest slope h / (sqrt(2 pi) sigma).
    with np.errstate(divide="ignore", invalid="ignore"):
        sigma = rise / (np.sqrt(2.0 * np.pi) * slope)
    sigma = sigma[np.isfinite(sigma)]
    # The median: edges next to a rejected corner or in shadow have no meaningful slope.
    return float(np.median(sigma)) if len(sigma) else float("nan")
