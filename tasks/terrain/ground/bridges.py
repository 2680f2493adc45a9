"""The bare ground of blocks: as measured, corrected beside objects, and bridged under them.

Strategy. Beside a wall or a tree a matching window sees both surfaces, and ground comes out too high over its width. There the
measured height and the one that follows from the ground farther away are averaged by their standard errors: on smooth land the
latter decides, on broken land the former. Gaps are then filled from their corrected border.
"""

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from orthomill.tasks.terrain.ground.learned_errors import ErrorCurve
from orthomill.tasks.terrain.ground.mean_value_fill import fill_gaps

BANDS = 4
CONTRADICTION = 3.0
"""standard errors of their difference by which a measured height and an expected one contradict each other"""


class BareBlocks(NamedTuple):
    """bare (rows, cols, 4) float32 m: height of the ground, its standard error among neighbours, that of the datum, and what was
    added to measured heights beside objects; open_side
    (rows, cols) uint8: the widest angle without ground, in the directions of `mean_value_fill`, 0 where ground was measured."""

    bare: np.ndarray
    open_side: np.ndarray


def anchors_of(ground: np.ndarray, margin: int) -> np.ndarray:
    """The `ground` (rows, cols) bool that is farther than `margin` cells from everything else."""
    size = 2 * margin + 1
    row, col = np.ogrid[-margin : margin + 1, -margin : margin + 1]
    disc = row**2 + col**2 <= margin**2
    return ndimage.minimum_filter(ground, footprint=disc, mode="nearest") if size > 1 else ground


def bridge(blocks: np.ndarray, ground: np.ndarray, anchors: np.ndarray, curve: ErrorCurve, reach: int) -> BareBlocks:
    """The bare ground of blocks (rows, cols, 3) as of `block_heights`; ground, anchors (rows, cols) bool; `reach` in blocks: cells
    nearer than twice that to the border of the arrays are not what they are in the whole."""
    margin = ground & ~anchors
    beside = fill_gaps(blocks, anchors, margin, reach)
    corrected = _averaged(blocks, beside.values, curve.at(beside), margin & np.isfinite(beside.distance))
    fill = fill_gaps(corrected, ground, ~ground, reach)
    sigma = np.where(ground, corrected[..., 1], np.hypot(fill.values[..., 1], curve.at(fill)))
    bare = np.stack([fill.values[..., 0], sigma, fill.values[..., 2], fill.values[..., 3]], axis=-1)
    return BareBlocks(bare.astype(np.float32), fill.open_side)


def _averaged(blocks: np.ndarray, expected: np.ndarray, error: np.ndarray, where: np.ndarray) -> np.ndarray:
    """The blocks with the mean of their heights and the `expected` ones (rows, cols, 3), by their standard errors; what that
    added."""
    own, other = blocks[where, 1].astype(np.float64) ** 2, np.hypot(expected[where, 1], error[where]).astype(np.float64) ** 2
    off = blocks[where, 0].astype(np.float64) - expected[where, 0]
    # Where both contradict each other the ground is rougher than what was hidden elsewhere: then the measurement stands.
    share = np.where(off**2 > CONTRADICTION**2 * (own + other), 1.0, other / (own + other))
    out = blocks.copy()
    out[where, 0] = expected[where, 0] + share * off
    out[where, 1] = np.sqrt(share * own)
    return np.concatenate([out, (out[..., :1] - blocks[..., :1])], axis=-1)
