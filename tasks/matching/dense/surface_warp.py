"""The right epipolar image seen along the surfaces of the left one: what both images have at the same place of the surface.

Strategy
- The planes of the nodes give every left pixel a parallax, that of its nearest node; the right image is resampled there, once for
  all windows that the pixel belongs to.
- A window then compares contiguous pixels of the left image and of the warped one, and never resamples.
- All images have a margin without data, so that windows need no test for the border.
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.matching.dense.node_surfaces import NodeLattice
from orthomill.tasks.matching.least_squares.grey_values import cubic_weights

LANES = 8
"""Rows of a window are read in multiples of this many pixels: so many are processed by one vector instruction."""


class WarpedPair(NamedTuple):
    """A left image (H, W) and what belongs to it, each flat with a margin on all sides, float32."""

    left: np.ndarray
    warped: np.ndarray
    """grey values of the right image at the parallax of `field`"""
    gradient: np.ndarray
    """of the left image along the row, grey values per px"""
    field: np.ndarray
    """parallax, px; NaN where it or any of the others is unknown"""
    cols: int
    """of a row with its margins"""
    margin: int

    @classmethod
    def of(cls, left: np.ndarray, margin: int) -> "WarpedPair":
        """Room for a left image (H, W), NaN without data, and windows that reach `margin` px beyond it."""
        rows, cols = left.shape
        shape = rows + 2 * margin, cols + 2 * margin + LANES
        grey = np.full(shape, np.nan, np.float32)
        grey[margin : margin + rows, margin : margin + cols] = left
        warped, gradient = np.zeros((2, grey.size), np.float32)
        return cls(grey.ravel(), warped, gradient, np.full(grey.size, np.nan, np.float32), shape[1], margin)


@njit(error_model="numpy")
def _warp(pair, right, shift, lattice, planes, inside):
    """Fill warped image, gradient and field of the left pixels inside (first row, last row, first col, last col), ends excluded."""
    row0, row1, col0, col1 = inside
    left, warped, gradient, field, cols, margin = pair
    centre, unknown = lattice.step // 2, np.float32(np.nan)
    for r in range(row0, row1):
        i = (r - lattice.row + centre) // lattice.step
        y = np.float32(r - lattice.row - i * lattice.step)
        for c in range(col0, col1):
            j = (c - lattice.col + centre) // lattice.step
            k = (r + margin) * cols + c + margin
            field[k], warped[k], gradient[k] = unknown, np.float32(0.0), np.float32(0.0)
            parallax = planes[i, j, 0] + planes[i, j, 1] * np.float32(c - lattice.col - j * lattice.step) + planes[i, j, 2] * y
            if parallax != parallax:
                continue
            # Relative to the integer pixel: float32 then resolves 1e-5 px, and tiles agree.
            offset = np.float32(shift) - parallax
            whole = np.floor(offset)
            at = c + int(whole)
            if at < 1 or at >= right.shape[1] - 2:
                continue
            w0, w1, w2, w3 = cubic_weights(offset - whole)
            grey = (w0 * right[r, at - 1] + w1 * right[r, at]) + (w2 * right[r, at + 1] + w3 * right[r, at + 2])
            slope = np.float32(0.5) * (left[k + 1] - left[k - 1])
            total = grey + slope + left[k]
            if total == total:
                field[k], warped[k], gradient[k] = parallax, grey, slope


def warp(pair: WarpedPair, right: np.ndarray, shift: int, lattice: NodeLattice, planes: np.ndarray) -> None:
    """See the right image (H, W') along the planes (rows, cols, 3) of a lattice; fills `pair`.

    shift: the right column of left column c at parallax q is c + shift - q. Pixels beyond half a step around the lattice keep what
    they had.
    """
    rows, cols = len(pair.left) // pair.cols - 2 * pair.margin, pair.cols - 2 * pair.margin - LANES
    before = lattice.step // 2
    row0, col0 = max(0, lattice.row - before), max(0, lattice.col - before)
    row1 = min(rows, lattice.row - before + lattice.rows * lattice.step)
    col1 = min(cols, lattice.col - before + lattice.cols * lattice.step)
    _warp(pair, right, shift, lattice, planes, (row0, row1, col0, col1))
