"""A depth map of a pair at the scale of leaves: every pixel of the reduced left image by itself, whatever other photographs show.

Strategy: in a crown no height fits all photographs at once, for leaves move, hide one another and are seen from other sides. Two
photographs taken close together still see the same leaves. They are compared alone, reduced until a pixel is as large as a spray of
leaves, in both directions; what the right image does not confirm, or what stands alone among its neighbours, is not kept.

Source: as tasks/matching/dense/pair_start.py; Fua 1993 (both directions).
"""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.raster import Window
from orthomill.tasks.matching.dense.blocks import ParallaxRange, placed, reduced, searched_window
from orthomill.tasks.matching.dense.pair_start import PAIR_VOLUME, pair_start
from orthomill.tasks.matching.smoothing import with_gaps

LEVEL = 2
"""times that the sides of the images are halved"""
STEP = 2**LEVEL
"""px of the left image per pixel of a depth map"""
SIDE = 256
"""pixels of a depth map along the side of a block"""
_AROUND = 24
"""pixels around a block that its paths run through"""
NARROW = 0.35
"""base over height up to which two photographs see the same leaves; in woods, pairs of 0.45 confirm one place of ten"""
_CONFIRMED = 1.0
"""px of the depth map by which the two directions may differ"""
_ALONG = 0.5
"""share of the 9 x 9 pixels around that must go along"""


@dataclass(frozen=True)
class DepthBlock:
    """A block of the depth map of a pair: its pixels `window`."""

    pair: EpipolarPair
    window: Window

    @property
    def parallaxes(self) -> ParallaxRange:
        """The column parallaxes that can occur, px."""
        offset = self.pair.column_offset
        return ParallaxRange.around(self.pair.parallax_low + offset, self.pair.parallax_high + offset)

    @property
    def whole_left(self) -> Window:
        """The pixels of the left image that are compared; may leave it."""
        return Window(self.window.row, self.window.col, SIDE, SIDE).grown(_AROUND).scaled(STEP)

    @property
    def whole_right(self) -> Window:
        """The pixels of the right image where they can be; may leave it."""
        return searched_window(self.whole_left, self.parallaxes)

    @property
    def left(self) -> Window:
        """The window that is read of the left image."""
        return self.whole_left.clipped((self.pair.rows, self.pair.left_cols))

    @property
    def right(self) -> Window:
        """The window that is read of the right image; empty where all of it lies beyond."""
        return self.whole_right.clipped((self.pair.rows, self.pair.right_cols))

    @property
    def scratch(self) -> int:
        """Working memory of `depth_block`, bytes."""
        pixels = self.whole_right.cells
        # Both images in float32 with what they are reduced from; of the reduced pixels signatures, results and packed candidates.
        return array_bytes(16, pixels) + array_bytes(3 * PAIR_VOLUME.widest + 100, 2 * pixels // STEP**2)


def depth_block(block: DepthBlock, left: np.ndarray, right: np.ndarray | None = None) -> np.ndarray:
    """Parallaxes (rows, cols) float32 of the pixels `block.window`, px of the epipolar images; NaN where there is none.

    left, right: uint8 (rows, cols), the windows `block.left` and `block.right`; None where there is nothing to read.
    """
    if right is None:
        return np.full(block.window.shape, np.nan, np.float32)
    images = (placed(left, block.left, block.whole_left), placed(right, block.right, block.whole_right))
    small_left, small_right = (reduced(with_gaps(image), LEVEL) for image in images)
    range_ = block.parallaxes
    # The right window begins farther to the left by the greatest parallax.
    found = confirmed(small_left, small_right, (range_.low - range_.high) / STEP, 0.0)
    inside = slice(_AROUND, _AROUND + block.window.height), slice(_AROUND, _AROUND + block.window.width)
    return (found[inside] * STEP + np.float32(range_.high - block.pair.column_offset)).astype(np.float32)


def confirmed(left: np.ndarray, right: np.ndarray, low: float, high: float) -> np.ndarray:
    """Parallaxes (column left - column right) of a left image between `low` and `high` px that the right image confirms; (H, W)
    float32, NaN elsewhere.

    left (H, W), right (H, W'): float32, NaN without data, rows homologous.
    """
    wider = right.shape[1] - left.shape[1]
    there = pair_start(left, right, low, high)
    mirrored = pair_start(np.ascontiguousarray(right[:, ::-1]), np.ascontiguousarray(left[:, ::-1]), low + wider, high + wider)
    back = mirrored.parallax[:, ::-1] - np.float32(wider)
    rows, cols = np.arange(left.shape[0])[:, None], np.arange(left.shape[1])
    met = np.rint(np.nan_to_num(cols - there.parallax)).astype(np.int64)
    inside = np.isfinite(there.parallax) & (met >= 0) & (met < right.shape[1])
    apart = np.abs(back[rows, np.where(inside, met, 0)] - there.parallax)
    kept = inside & (apart <= _CONFIRMED) & (there.coherence >= _ALONG)
    return np.where(kept, there.parallax, np.float32(np.nan))
