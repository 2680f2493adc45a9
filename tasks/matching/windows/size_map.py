"""Maps of window sizes: the window of every pixel of an image, computed in tiles.

Strategy: a tile is read with a halo of the largest window, and every pixel of its core is a point. A window that exceeds the halo
would leave the image, so a tile gives what the whole image gives.

Source: Skarlatos (sources/matching.md#size-map).
"""

import numpy as np

from orthomill.schemas.raster import Window
from orthomill.tasks.matching.windows.sizes import GreyLevels, window_sizes
from orthomill.tasks.matching.windows.window_settings import WindowSizing

_ROWS = 64
"""rows of a tile that are sized at a time"""


def halo(sizing: WindowSizing) -> int:
    """Pixels needed around a tile: half of the largest window, and one more for gradients."""
    return sizing.halves[-1] + 1


def size_map(image: GreyLevels, core: Window, sizing: WindowSizing) -> np.ndarray:
    """(height, width) uint8 half sizes of the pixels of `core` in an image that reaches `halo` px beyond it; 0 without a window."""
    cols = np.arange(core.col, core.col + core.width)
    out = np.zeros(core.shape, np.uint8)
    # In batches of rows, for every point has one number per size and measure: a tile at once would need gigabytes.
    for start in range(0, core.height, _ROWS):
        rows = np.arange(core.row + start, core.row + min(start + _ROWS, core.height))
        points = np.column_stack([np.tile(cols, len(rows)), np.repeat(rows, len(cols))])
        out[start : start + len(rows)] = window_sizes(image, points, sizing).half.reshape(len(rows), len(cols))
    return out


def published_levels(half: np.ndarray, sizing: WindowSizing) -> np.ndarray:
    """Grey levels uint8 of half sizes, spread evenly: 0 is the smallest window of the method, 255 is none.

    K sizes have the levels floor(255 k / K), k = 0 ... K - 1: up to 13 x 13 they are 0, 63, 127 and 191.
    """
    halves = sizing.halves
    levels = np.full(256, 255, np.uint8)
    levels[list(halves)] = 255 * np.arange(len(halves)) // len(halves)
    return levels[half]
