"""Invented ground without the grain of its invention.

Strategy. Every invented block looks around for itself, along a bounded number of cones: where those of one block meet a patch of
ground and those of the next one half of it, rays run through the gap, finer near the patch and wider away from it. Ground has none.
Diffusion among the invented blocks takes them away; measured blocks stay and hold the border. Along each axis a block moves only
where both of its neighbours are known, so that planes stay as they are up to every border; what the diffusion took of a hill is put
back by diffusing what it took once more (twicing), so that wide bends stay as well. It reaches a bounded number of blocks, whatever
the tile.

Source of the twicing: Tukey 1977, Exploratory Data Analysis.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit

ROUNDS = 32
"""steps of diffusion, each with the weights 1, 2, 1: a Gaussian of four blocks"""
REACH = 2 * ROUNDS
"""blocks around a block that its evened height depends on"""


def evened(values: np.ndarray, fixed: np.ndarray) -> np.ndarray:
    """The values (rows, cols) float32 m, NaN where there are none, evened but for the `fixed` ones (rows, cols) bool."""
    if fixed.all():
        return values
    start = values.astype(np.float64)
    once = _diffused(start, fixed)
    # What was taken of fixed values is nothing, so that they hold this border as well.
    return (once + _diffused(start - once, fixed)).astype(np.float32)


def _diffused(values: np.ndarray, fixed: np.ndarray) -> np.ndarray:
    values = values.copy()
    _diffuse(values, ~fixed, ROUNDS)
    return values


@njit()
def _diffuse(values, free, rounds):
    """Diffuses the `free` cells (rows, cols) bool of the values (rows, cols) along one axis after the other, in place."""
    rows, cols = values.shape
    before = np.empty(cols)
    for _ in range(rounds):
        before[:] = values[0]
        for r in range(1, rows - 1):
            for c in range(cols):
                here = values[r, c]
                bend = values[r + 1, c] - 2.0 * here + before[c]
                before[c] = here
                if free[r, c] and np.isfinite(bend):
                    values[r, c] = here + 0.25 * bend
        for r in range(rows):
            last = values[r, 0]
            for c in range(1, cols - 1):
                here = values[r, c]
                bend = values[r, c + 1] - 2.0 * here + last
                last = here
                if free[r, c] and np.isfinite(bend):
                    values[r, c] = here + 0.25 * bend
