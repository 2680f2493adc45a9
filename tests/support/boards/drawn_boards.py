"""Chessboards drawn through a homography, so that the sub-pixel position of every corner is known."""

import numpy as np

BLACK, WHITE, GREY = 40.0, 210.0, 128.0


def homography_of(spacing: float, angle: float, shift: tuple[float, float], tilt: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """(3, 3) from grid coordinates (column, row) to pixels (col, row): `spacing` px per square, `angle` degrees, `tilt` per
    square."""
    cos, sin = spacing * np.cos(np.radians(angle)), spacing * np.sin(np.radians(angle))
    similar = np.array([[cos, -sin, shift[0]], [sin, cos, shift[1]], [0.0, 0.0, 1.0]])
    return similar @ np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [tilt[0], tilt[1], 1.0]])


def corner_grid(H: np.ndarray, corners: tuple[int, int]) -> np.ndarray:
    """(rows, cols, 2) px: true positions of inner corners (columns, rows); the first one is (0, 0) of the grid."""
    col, row = np.meshgrid(np.arange(corners[0], dtype=float), np.arange(corners[1], dtype=float))
    points = np.stack([col, row, np.ones_like(col)], axis=-1) @ H.T
    return points[..., :2] / points[..., 2:]


def drawn(H: np.ndarray, corners: tuple[int, int], shape: tuple[int, int], onto: np.ndarray | None = None) -> np.ndarray:
    """uint8 image (rows, cols): a board whose first square is black, with half a square of white margin, on grey or on another
    image.

    Every pixel is the mean of 4 x 4 samples.
    """
    # An even number: of an odd one, the middle sample of an edge through the centre of a pixel would count for one side.
    fine = (np.arange(4) - 1.5) / 4.0
    row, col = (axis[:, None] + fine for axis in (np.arange(shape[0]), np.arange(shape[1])))
    x, y = np.meshgrid(col.ravel(), row.ravel())
    grid = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(H).T
    u, v = grid[..., 0] / grid[..., 2], grid[..., 1] / grid[..., 2]
    black = (np.floor(u) + np.floor(v)) % 2 == 0
    squares = (u >= -1) & (u < corners[0]) & (v >= -1) & (v < corners[1])
    paper = (u >= -1.5) & (u < corners[0] + 0.5) & (v >= -1.5) & (v < corners[1] + 0.5)
    ground = GREY if onto is None else np.repeat(np.repeat(onto.astype(float), 4, axis=0), 4, axis=1)
    light = np.where(squares & black, BLACK, np.where(paper, WHITE, ground))
    return np.rint(light.reshape(shape[0], 4, shape[1], 4).mean(axis=(1, 3))).astype(np.uint8)


def on_grid(H: np.ndarray, lattice: np.ndarray) -> np.ndarray:
    """(n, 2) column and row, not rounded, of the known corners of a lattice (rows, cols, 2) px."""
    found = lattice[np.isfinite(lattice).all(axis=-1)]
    grid = np.column_stack([found, np.ones(len(found))]) @ np.linalg.inv(H).T
    return grid[:, :2] / grid[:, 2:]
