"""The map of the nodes over the photograph: black where a height was accepted, white where it was rejected.

Every cell is shown as a small picture of its ground, as the best photograph of the block shows it, with a marker in its middle.

Source: Tumska, Procyk, Janczak (sources/line_locus.md#v1-8).
"""

from collections.abc import Sequence

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.line_locus.line_locus import FoundHeights, NodeLines
from orthomill.tasks.matching.line_locus.window_correlation import GreyImage, GreyImages, holds, image_place

MARKERS = "densification/markers/nodes"
"""uint8, the photographs on finer cells with black (accepted) and white (rejected) nodes"""
BLACK, WHITE = 1, 255
"""accepted and rejected nodes; 0 is no picture"""
_DARKEST, _LIGHTEST = 48, 207
"""grey values of the photograph, so that markers stand out from it"""
_MOST, _LEAST = 31, 3
_ACCEPTED = np.uint8(Outcome.CONVERGED)


def marker_factor(cell: float, pixel: float) -> int:
    """Pixels of the picture along the side of a cell: odd, so that it has a middle; cell and ground pixel in m."""
    return int(np.clip(2 * round((cell / pixel - 1) / 2) + 1, _LEAST, _MOST))


def marked_picture(images: Sequence[GreyImage], lines: NodeLines, cell: float, found: FoundHeights, factor: int) -> np.ndarray:
    """The picture (rows * factor, cols * factor) uint8 of a block of nodes; images: the best one first."""
    out = np.zeros((found.height.shape[0] * factor, found.height.shape[1] * factor), np.uint8)
    if images:
        # A height of its own for every cell, and the mean one where there is none: the ground beneath a rejected node is shown too.
        known = np.isfinite(found.height)
        middle = np.float32(found.height[known].mean() if known.any() else (lines.low + lines.high) / 2)
        _ground(GreyImages.of(images[:1]), lines.x, lines.y, cell, np.where(known, found.height, middle), factor, out)
    side = max(1, factor // 5)
    first = (factor - side) // 2
    for shift in np.ndindex(side, side):
        rows, cols = (slice(first + offset, None, factor) for offset in shift)
        out[rows, cols] = np.where(found.outcome == _ACCEPTED, BLACK, WHITE)
    return out


@njit(error_model="numpy")
def _ground(image, x, y, cell, height, factor, out):
    """Grey values 0 to 255 of a photograph on the ground at `height` (r, c), m, `factor` by `factor` for every cell, into `out`."""
    stride = image.frames[0, 2]
    for r in range(height.shape[0]):
        for c in range(height.shape[1]):
            for j in range(factor):
                for i in range(factor):
                    right, up = ((i + 0.5) / factor - 0.5) * cell, (0.5 - (j + 0.5) / factor) * cell
                    col, row = image_place(image, 0, x[c] + right, y[r] + up, height[r, c])
                    if not holds(image, 0, col, row, 0):
                        continue
                    value = image.pixels[int(row + 0.5) * stride + int(col + 0.5)]
                    if value == value:
                        share = min(max(value / 255.0, 0.0), 1.0)
                        out[r * factor + j, c * factor + i] = np.uint8(_DARKEST + share * (_LIGHTEST - _DARKEST))
