"""Patches: the neighbourhood of every observation, extracted once, so that refinement does not read photographs again.

A strip of a photograph (a tile high, with a halo) gives the patches of the observations whose pixel lies in it. Patches are square,
8 bits, centred on the pixel nearest to the observation; 0 is outside the photograph or masked, real grey values are 1 or more.
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from orthomill.schemas.raster import Window
from orthomill.tasks.imagery.pyramid import full_to_level
from orthomill.tasks.imagery.radiometry import grey_range, real_grey
from orthomill.tasks.tie_points.match_records import Observations, Values

_ROWS = 64  # rows whose grey values are computed at a time: as floating-point numbers they take twelve times the memory


@dataclass(frozen=True)
class Strip:
    """Rows [row, row + height) of a pyramid level of `shape`, and the half side of the patches."""

    level: int
    shape: tuple[int, int]
    row: int
    height: int
    half: int

    @property
    def window(self) -> Window:
        """The window of the level that has to be read."""
        rows = Window(self.row - self.half, 0, self.height + 2 * self.half, self.shape[1])
        return rows.clipped(self.shape)


def nearest_pixels(observations: Observations, level: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions (N, 2) (col, row) in a pyramid level, and the integer pixels (N, 2) nearest to them."""
    positions = full_to_level(np.column_stack([observations.col, observations.row]), level)
    return positions, np.rint(positions).astype(np.int64)


def strip_patches(pixels: np.ndarray, overview: np.ndarray, observations: Observations, strip: Strip) -> Values:
    """Patches of the observations in the strip, in their order. pixels: `strip.window`; overview: the coarsest level."""
    _, centres = nearest_pixels(observations, strip.level)
    inside = (centres[:, 1] >= strip.row) & (centres[:, 1] < strip.row + strip.height)
    local = centres[inside] - [0, strip.window.row]
    side = 2 * strip.half + 1
    windows = sliding_window_view(_bordered(pixels, strip.half + 1, grey_range(overview)), (side, side))
    return Values(windows[local[:, 1] + 1, local[:, 0] + 1].ravel())


def _bordered(pixels: np.ndarray, border: int, limits: tuple[float, float]) -> np.ndarray:
    """Grey values, 1 to 255, with a border of 0 on all sides."""
    rows, cols = pixels.shape[:2]
    grey = np.zeros((rows + 2 * border, cols + 2 * border), np.uint8)
    for row in range(0, rows, _ROWS):
        part = pixels[row : row + _ROWS]
        grey[border + row : border + row + len(part), border:-border] = real_grey(part, limits)
    return grey


def chosen_patches(
    strips: tuple[Values, ...], observations: Observations, rows: np.ndarray, level: int, tile: int, half: int
) -> np.ndarray:
    """The patches (R, side, side) of the observations `rows` (R,) of a photograph, from those of its strips of `tile` rows."""
    side = 2 * half + 1
    _, centres = nearest_pixels(observations, level)
    strip = centres[:, 1] // tile
    # Every strip kept the order of its observations.
    order = np.argsort(strip, kind="stable")
    place = np.empty(len(strip), np.int64)
    place[order] = np.arange(len(strip)) - np.searchsorted(strip[order], strip[order])
    patches = np.empty((len(rows), side, side), np.uint8)
    for number, stored in enumerate(strips):
        own = np.flatnonzero(strip[rows] == number)
        patches[own] = stored.rows(side * side)[place[rows[own]]].reshape(-1, side, side)
    return patches
