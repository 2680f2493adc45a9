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
    """The values (rows, cols) float64 after all rounds."""
    flat, (rows, cols) = values.ravel().copy(), values.shape
    row, col = np.nonzero(~fixed & np.isfinite(values))
    # On the first and last of an axis no neighbour tells a bend along it.
    place, upright, level = row * cols + col, (row > 0) & (row < rows - 1), (col > 0) & (col < cols - 1)
    _diffuse(flat, place[upright], place[level], cols, np.empty(len(place)), ROUNDS)
    return flat.reshape(values.shape)


@njit()
def _diffuse(values, upright, level, cols, bends, rounds):
    """Diffuses the cells at `upright` along columns and those at `level` along rows of `cols` cells, in turn and in place; places
    (N,) in the values (rows * cols,); bends: room for one of each."""
    for _ in range(rounds):
        _along(values, upright, cols, bends)
        _along(values, level, 1, bends)


@njit(inline="always")
def _along(values, places, step, bends):
    """One step of diffusion of the `values` (rows * cols,) at `places` (N,), whose neighbours lie `step` before and after them;
    bends: room for N."""
    for n in range(places.shape[0]):
        k = places[n]
        bends[n] = values[k + step] - 2.0 * values[k] + values[k - step]
    for n in range(places.shape[0]):
        if np.isfinite(bends[n]):
            values[places[n]] += 0.25 * bends[n]
