"""How far an edge departs from a straight line, from where it was found in profiles across it."""

import numpy as np


def peak_between(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """By how many steps, -0.5 to 0.5 (...,), the top of the parabola through `values` (..., S) lies behind the steps `at` (...,),
    which are 1 to S - 2; 0 where there is no top."""
    low, middle, high = (np.take_along_axis(values, (at + k)[..., None], axis=-1)[..., 0] for k in (-1, 0, 1))
    bend = low - 2 * middle + high
    return np.where(bend < 0, np.clip(0.5 * (low - high) / np.where(bend < 0, bend, -1.0), -0.5, 0.5), 0.0)


def without_line(away: np.ndarray) -> np.ndarray:
    """Displacements (pieces, profiles) less the straight line through the known ones of each piece; NaN stays NaN."""
    known = np.isfinite(away)
    along = np.broadcast_to(np.arange(away.shape[1], dtype=float), away.shape)
    count = np.maximum(known.sum(axis=1, keepdims=True), 1)
    middle = np.where(known, along, 0).sum(axis=1, keepdims=True) / count
    mean = np.where(known, away, 0).sum(axis=1, keepdims=True) / count
    place = along - middle
    spread = np.where(known, place**2, 0).sum(axis=1, keepdims=True)
    slope = np.where(known, place * (away - mean), 0).sum(axis=1, keepdims=True) / np.maximum(spread, 1e-9)
    return np.asarray(away - mean - slope * place)
