"""Blunders among the image measurements: data snooping with standardised residuals (Baarda 1968)."""

import numpy as np

from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment


def ray_blunders(result: Adjustment, limit: np.ndarray) -> np.ndarray:
    """(M,) bool: the worst ray of every point whose standardised residual exceeds its `limit` (M,)."""
    # NaN marks rays that took no part.
    worst = np.nan_to_num(np.abs(result.standardised).max(axis=1))
    highest = np.zeros(len(result.state.point))
    np.maximum.at(highest, result.rays.point, worst)
    # One ray of a point at a time: a wrong one spreads its error over the others, which are often right.
    return (worst > limit) & (worst == highest[result.rays.point])
