"""Patches: the neighbourhood of every observation, extracted once, so that refinement does not read photographs again.

A strip of a photograph (a tile high, with a halo) gives the patches of the observations whose pixel lies in it. Patches are square,
8 bits, centred on the pixel nearest to the observation; 0 is outside the photograph, real grey values are 1 or more.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.raster import Window
from orthomill.tasks.imagery.pyramid import full_to_level
from orthomill.tasks.imagery.radiometry import grey_bytes, grey_range
from orthomill.tasks.tie_points.match_records import Observations, Values

_BATCH = 512  # patches extracted at a time: the fancy indexing below holds three copies of them


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
    limits = grey_range(overview)
    batches = [_cut(pixels, local[start : start + _BATCH], strip.half, limits) for start in range(0, len(local), _BATCH)]
    return Values(np.concatenate([batch.ravel() for batch in batches]) if batches else np.empty(0, dtype=np.uint8))


def _cut(pixels: np.ndarray, centres: np.ndarray, half: int, limits: tuple[float, float]) -> np.ndarray:
    """Patches (N, side, side) uint8 around `centres` (N, 2) (col, row) of `pixels`."""
    reach = np.arange(-half, half + 1)
    col, row = centres[:, 0, None] + reach, centres[:, 1, None] + reach
    in_col, in_row = (col >= 0) & (col < pixels.shape[1]), (row >= 0) & (row < pixels.shape[0])
    # Indices are clipped to gather anything at all beyond the border; the mask below replaces what was gathered there.
    patches = pixels[row.clip(0, pixels.shape[0] - 1)[:, :, None], col.clip(0, pixels.shape[1] - 1)[:, None, :]]
    side = len(reach)
    grey = grey_bytes(patches.reshape(-1, side, *patches.shape[3:]), limits).reshape(-1, side, side)
    return np.where(in_row[:, :, None] & in_col[:, None, :], np.maximum(grey, 1), 0).astype(np.uint8)


def joined_patches(strips: tuple[Values, ...], observations: Observations, level: int, tile: int, half: int) -> np.ndarray:
    """The patches (N, side, side) of a photograph in the order of its observations, from those of its strips of `tile` rows."""
    side = 2 * half + 1
    patches = np.concatenate([strip.rows(side * side) for strip in strips]).reshape(-1, side, side)
    _, centres = nearest_pixels(observations, level)
    # Every strip kept the order of its observations; a stable sort by strip is the order in which they were written.
    in_file = np.argsort(centres[:, 1] // tile, kind="stable")
    ordered = np.empty_like(patches)
    ordered[in_file] = patches
    return ordered
