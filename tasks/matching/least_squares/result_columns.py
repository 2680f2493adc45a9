"""What the kernels are given point by point, and the table in which they leave their results; outcomes as plain integers."""

from typing import NamedTuple

import numpy as np

from orthomill.schemas.outcome import Outcome

COL, ROW, REFERENCE_COL, REFERENCE_ROW, VAR_COL, VAR_ROW, COVARIANCE = range(7)
SIGMA0, CORRELATION, GAIN, OFFSET, A12, A21, B12, B21 = range(7, 15)
COLUMNS = 15

# Kernels compare with plain integers: numba would compile every IntEnum member as an object of its own type.
CONVERGED, LOW_TEXTURE, OUTSIDE = int(Outcome.CONVERGED), int(Outcome.LOW_TEXTURE), int(Outcome.OUTSIDE)
NOT_CONVERGED, MOVED_TOO_FAR = int(Outcome.NOT_CONVERGED), int(Outcome.MOVED_TOO_FAR)
SINGULAR, LOW_CORRELATION = int(Outcome.SINGULAR), int(Outcome.LOW_CORRELATION)
INCONSISTENT, NOT_TRIED = int(Outcome.INCONSISTENT), int(Outcome.NOT_TRIED)


class Attempts(NamedTuple):
    """Points to match, one row each."""

    points: np.ndarray
    """(N, 2) float64 (col, row) in the left image, px"""
    starts: np.ndarray
    """(N, 2) float64: where to start in the right image, px"""
    affine: np.ndarray
    """(N, 4) float64: start values of a12, a21, b12, b21"""
    half: np.ndarray
    """(N,) int64: half sides of the windows, px"""


class Found(NamedTuple):
    """Results, one row per point, filled by a kernel."""

    values: np.ndarray
    """(N, COLUMNS) float64"""
    outcome: np.ndarray
    """(N,) uint8"""
    iterations: np.ndarray
    """(N,) uint8"""
