"""Image pyramids: each level half the size of the one below, smoothed against aliasing.

The kernel (1, 3, 3, 1) / 8 is the smallest symmetric low-pass filter centred between two pixels, so pixel p of a level lies at
2 p + 0.5 of the level below. Border pixels are repeated. All sums are integers below 2^24 and therefore exact in float32: a tile
with a halo of one pixel gives bit for bit what the whole image gives.
"""

import numpy as np

from orthomill.schemas.raster import Window


def halved_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Shape of the next level: rows and columns halved and rounded up, bands kept."""
    return -(-shape[0] // 2), -(-shape[1] // 2), *shape[2:]


def level_shape(shape: tuple[int, ...], level: int) -> tuple[int, ...]:
    """Shape of a level of a pyramid whose level 0 has `shape`."""
    for _ in range(level):
        shape = halved_shape(shape)
    return shape


def level_count(shape: tuple[int, ...], below: int = 512) -> int:
    """Number of levels of a pyramid whose last one has fewer than `below` pixels on its longer side."""
    levels = 1
    while max(shape[:2]) >= below:
        shape, levels = halved_shape(shape), levels + 1
    return levels


def level_to_full(pixels: np.ndarray, level: int) -> np.ndarray:
    """Pixel coordinates of level 0 from those of a level."""
    return pixels * 2**level + (2**level - 1) / 2


def full_to_level(pixels: np.ndarray, level: int) -> np.ndarray:
    """Pixel coordinates of a level from those of level 0."""
    return (pixels - (2**level - 1) / 2) / 2**level


def source_window(window: Window, shape: tuple[int, ...]) -> Window:
    """The pixels of a level of `shape` from which `halved_window` computes `window` of the next level."""
    return window.scaled(2).grown(1).clipped(shape)


def halved_window(pixels: np.ndarray, window: Window) -> np.ndarray:
    """The pixels `window` of the next level.

    pixels: `source_window(window, shape)` of the level below, (rows, cols) or (rows, cols, bands), uint8 or uint16. Rows or
    columns that are missing there lie outside the image and are repeated from its border.
    """
    # An odd last row or column has no partner below it; it is repeated like the pixels beyond any other border.
    top, left = int(window.row == 0), int(window.col == 0)
    bottom = 2 * window.height + 2 - top - pixels.shape[0]
    right = 2 * window.width + 2 - left - pixels.shape[1]
    padding = [(top, bottom), (left, right)] + [(0, 0)] * (pixels.ndim - 2)
    padded = np.pad(pixels, padding, mode="edge").astype(np.float32)
    rows = padded[0:-2:2] + padded[3::2] + 3.0 * (padded[1:-1:2] + padded[2::2])
    both = rows[:, 0:-2:2] + rows[:, 3::2] + 3.0 * (rows[:, 1:-1:2] + rows[:, 2::2])
    # Halves are rounded up, not to even: a mean brightness must not depend on the parity of the sum.
    return np.floor(both / 64.0 + 0.5).astype(pixels.dtype)


def halved(pixels: np.ndarray) -> np.ndarray:
    """The next level of a whole image."""
    return halved_window(pixels, Window(0, 0, *halved_shape(pixels.shape)[:2]))
