"""Robust weights: observations that disagree with the rest lose influence, but are not rejected before they are tested."""

import numpy as np


def huber_weights(size: np.ndarray, limit: float) -> np.ndarray:
    """Factors (N,) for the weights of observations with standardised residuals `size` (N,): 1 up to `limit`, then limit / size.

    Source: Huber 1964.
    """
    return np.where(size <= limit, 1.0, limit / np.maximum(size, 1e-300))


def huber_losses(size: np.ndarray, limit: float) -> np.ndarray:
    """Twice Huber's loss: size^2 inside the limit, 2 limit size - limit^2 outside."""
    # Twice, so that without a limit it is the sum of squares of ordinary least squares. An infinite limit would make inf - inf.
    return np.where(size <= limit, size**2, 2.0 * limit * size - limit**2 if np.isfinite(limit) else 0.0)


def huber_cost(size: np.ndarray, limit: float) -> float:
    """The sum of twice Huber's losses."""
    return float(huber_losses(size, limit).sum())


def spread(size: np.ndarray) -> float:
    """Standard error of one coordinate from the lengths (N,) of two-dimensional residuals, robust against almost half of
    outliers."""
    # The length follows Rayleigh's distribution, whose median is sqrt(2 ln 2) = 1.1774 standard errors.
    return float(np.median(size) / 1.1774) if len(size) else np.nan
