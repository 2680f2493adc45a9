"""The measured heights in square blocks of cells: ground is told from objects in steps of about a metre, not of every cell.

Strategy. A block that ground and something on it share gets the height of the ground: the mean of what is not higher than ground
can be above the lowest tenth.
"""

import numpy as np

LOWEST = 0.1
"""share of the cells of a block that may be lower than its ground"""
_LEAST = 8
"""a block needs heights in one of so many of its cells"""
BANDS = 3


def block_heights(
    heights: np.ndarray, sigma: np.ndarray, datum: np.ndarray, measured: np.ndarray, factor: int, rise: float
) -> np.ndarray:
    """(rows, cols, 3) float32 m of blocks of `factor` x `factor` cells: height, its standard error among neighbours, that of the
    datum; without a height where too little was measured, and there with an endless standard error, or none where there is no
    surface at all.

    heights, sigma, datum (rows, cols) m, whose last blocks may be smaller; measured (rows, cols) bool; `rise` m: how much ground
    may be higher than the lowest in the same block.
    """
    known = measured & np.isfinite(heights)
    if factor == 1:
        found = np.where(known[..., None], np.stack([heights, sigma, datum], axis=-1), np.nan).astype(np.float32)
        return _told_where_nothing_is(found, np.isfinite(heights))
    z, s, d = (_blocks(np.where(known, values, np.nan), factor) for values in (heights, sigma, datum))
    enough = np.isfinite(z).sum(axis=-1) * _LEAST >= factor * factor
    lowest = np.full(enough.shape, np.nan)
    # Sorting puts cells without a height last.
    ordered = np.sort(z[enough], axis=-1)
    place = (LOWEST * (np.isfinite(ordered).sum(axis=-1) - 1)).astype(np.int64)
    lowest[enough] = np.take_along_axis(ordered, place[:, None], axis=-1)[:, 0]
    low = np.isfinite(z) & (np.abs(z - lowest[..., None]) <= rise)
    count = np.where(low.any(axis=-1), low.sum(axis=-1), np.nan)
    means = (
        np.where(low, z, 0).sum(-1) / count,
        np.sqrt(np.where(low, s * s, 0).sum(-1) / count),
        np.where(low, d, 0).sum(-1) / count,
    )
    there = np.isfinite(_blocks(heights, factor)).any(axis=-1)
    return _told_where_nothing_is(np.stack(means, axis=-1).astype(np.float32), there)


def _told_where_nothing_is(blocks: np.ndarray, there: np.ndarray) -> np.ndarray:
    """The blocks (rows, cols, 3), their standard errors endless where the surface is `there` (rows, cols) and tells nothing."""
    blocks[..., 1] = np.where(np.isnan(blocks[..., 0]) & there, np.inf, blocks[..., 1])
    return blocks


def _blocks(values: np.ndarray, factor: int) -> np.ndarray:
    """(block rows, block cols, factor * factor) float64, NaN beyond the border."""
    rows, cols = (-(-side // factor) for side in values.shape)
    padded = np.full((rows * factor, cols * factor), np.nan)
    padded[: values.shape[0], : values.shape[1]] = values
    return padded.reshape(rows, factor, cols, factor).swapaxes(1, 2).reshape(rows, cols, factor * factor)
