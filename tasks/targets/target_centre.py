"""A centre that was found, by whatever model of a target."""

from dataclasses import dataclass

import numpy as np

CORRELATED = 2.0
"""Grey values of neighbouring pixels share their errors (blur, demosaicing): standard errors of white ones, times this."""
LEAST_SIGMA = 0.02
"""px: what the interpolation between pixels leaves"""


@dataclass(frozen=True, eq=False)
class TargetCentre:
    """`place` (2,) (col, row) px, its standard error, and what of the patch's variance the model leaves `unexplained`, 0 to 1."""

    place: np.ndarray
    sigma: float
    unexplained: float
