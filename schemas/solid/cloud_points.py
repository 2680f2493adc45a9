"""Points of known height of the user, in the system of a project."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class CloudPoints:
    """Points in the project's system; what was marked as noise or withheld is left out."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    """(N,) float64 m"""
    sigma: np.ndarray
    """(N,) float64 m: standard errors of the heights; NaN where the file states none"""
