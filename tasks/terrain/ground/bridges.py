"""The bare ground of blocks: as measured, corrected beside objects, and bridged under them.

Strategy. Beside a wall or a tree a matching window sees both surfaces, and ground comes out too high over its width: by as much as
the block tells of itself is taken off. What is left and the height that follows from the ground farther away are averaged by their
standard errors: on smooth land the latter decides, on broken land the former. Gaps are then filled from their corrected border,
with the bend that ground beyond it announces.
"""

from typing import NamedTuple

import numpy as np

from orthomill.tasks.terrain.ground.learned_errors import FillErrors
from orthomill.tasks.terrain.ground.mean_value_fill import GapFill, fill_gaps

BANDS = 4


class BareBlocks(NamedTuple):
    """bare (rows, cols, 4) float32 m: height of the ground, its standard error among neighbours, that of the datum, and what was
    added to measured heights beside objects; open_side (rows, cols) uint8: the widest angle without ground, in the directions of
    `mean_value_fill`, 0 where ground was measured."""

    bare: np.ndarray
    open_side: np.ndarray


def bridge(
    blocks: np.ndarray, rings: np.ndarray, expected: np.ndarray, errors: FillErrors, core: tuple[slice, slice], reach: int
) -> BareBlocks:
    """The bare ground of the blocks `core`.

    blocks (rows, cols, 3) as of `block_heights`; rings (rows, cols) uint8 and expected (rows, cols, 4) as of `told_by_ground`;
    `reach` in blocks.
    """
    ground = rings > 0
    corrected = corrected_ground(blocks, rings, expected, errors)
    wanted = np.zeros(ground.shape, bool)
    wanted[core] = ~ground[core]
    # Beyond the surface only holes in it are filled.
    whole = fill_gaps(corrected, ground, wanted, reach, holes=np.isnan(blocks[..., 1]))
    fill, here = GapFill(*(band[core] for band in whole)), ground[core]
    added, error = errors.at(fill)
    sigma = np.where(here, corrected[core][..., 1], np.hypot(fill.values[..., 1], error))
    bare = np.stack([fill.values[..., 0] + np.where(here, 0, added), sigma, fill.values[..., 2], fill.values[..., 3]], axis=-1)
    return BareBlocks(bare.astype(np.float32), fill.open_side)


def corrected_ground(blocks: np.ndarray, rings: np.ndarray, expected: np.ndarray, errors: FillErrors) -> np.ndarray:
    """The blocks (rows, cols, 4), and what was added to them: beside objects the mean of their heights, without what lifts them
    there, and the expected ones, by their standard errors."""
    where = np.isfinite(expected[..., 2])
    height, border, distance, bend = (expected[where, k] for k in range(expected.shape[-1]))
    inside = np.zeros(len(height), np.uint8)
    near = GapFill(values=height[:, None], distance=distance, open_side=inside, beside=inside.astype(np.float32), bend=bend)
    added, error = errors.at(near)
    lifted = np.array([0.0, *errors.lifted])[np.minimum(rings[where], len(errors.lifted))]
    own, other = blocks[where, 1].astype(np.float64) ** 2, np.hypot(border, error).astype(np.float64) ** 2
    off = blocks[where, 0].astype(np.float64) - lifted - (height + added)
    share = other / (own + other)
    # Where both contradict each other the mean is worth as much less.
    torn = np.maximum(np.abs(off) / np.sqrt(own + other), 1.0)
    out = np.concatenate([blocks, np.zeros_like(blocks[..., :1])], axis=-1)
    out[where, 0] = height + added + share * off
    out[where, 1] = torn * np.sqrt(share * own)
    out[..., 3] = np.where(where, out[..., 0] - blocks[..., 0], out[..., 3])
    return out
