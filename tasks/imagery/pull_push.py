"""Gaps closed from their surroundings, however large they are: pull and push.

Strategy. Pull: means of the known values over blocks of 2, 4, 8 ... cells. Push: from coarse to fine, a block without a value takes
that of the coarser level, interpolated bilinearly.

Source: Gortler et al. 1996 (The Lumigraph, section 3.4), with blocks that are either known or not.
"""

import numpy as np


def halved(values: np.ndarray) -> np.ndarray:
    """Means (rows / 2, cols / 2) of the known values in blocks of 2 x 2, NaN where none is; odd edges are padded."""
    padded = np.pad(values, [(0, values.shape[0] % 2), (0, values.shape[1] % 2)], constant_values=np.nan)
    shape = padded.shape[0] // 2, padded.shape[1] // 2
    total, count = np.zeros(shape), np.zeros(shape)
    # Four slices of single cells: a sum over two short axes would take ten times as long.
    for quarter in (padded[row::2, col::2] for row in (0, 1) for col in (0, 1)):
        known = ~np.isnan(quarter)
        total += np.where(known, quarter, 0)
        count += known
    with np.errstate(invalid="ignore"):
        return (total / count).astype(np.float32)


def doubled(coarse: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """The level below `coarse`, of `shape`, interpolated bilinearly; constant beyond the outer blocks."""
    # Centres of the finer blocks lie a quarter of a block before and behind that of the coarser one.
    for axis in (0, 1):
        before = np.take(coarse, np.maximum(np.arange(coarse.shape[axis]) - 1, 0), axis)
        after = np.take(coarse, np.minimum(np.arange(coarse.shape[axis]) + 1, coarse.shape[axis] - 1), axis)
        pair = np.stack([0.75 * coarse + 0.25 * before, 0.75 * coarse + 0.25 * after], axis + 1)
        coarse = pair.reshape([2 * n if k == axis else n for k, n in enumerate(coarse.shape)])
    return coarse[: shape[0], : shape[1]]


def filled(values: np.ndarray) -> np.ndarray:
    """The values (rows, cols) float32 with every gap closed; all NaN only where there is no value at all."""
    levels = [values.astype(np.float32)]
    while max(levels[-1].shape) > 1:
        levels.append(halved(levels[-1]))
    whole = levels.pop()
    while levels:
        whole = pushed(levels.pop(), whole)
    return whole.astype(np.float32)


def pushed(known: np.ndarray, coarser: np.ndarray) -> np.ndarray:
    """The known values (rows, cols), with those of the level above where there are none."""
    return np.where(np.isnan(known), doubled(coarser, known.shape), known).astype(np.float32)
