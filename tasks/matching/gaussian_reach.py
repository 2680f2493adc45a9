"""How far the weights of a Gaussian reach."""

import numpy as np


def reach_of(sigma: float) -> int:
    """Radius of the weights of `gaussian_weights`, px: beyond 3 sigma lies 0.3 % of the Gaussian."""
    return int(np.ceil(3.0 * sigma)) if sigma > 0.0 else 0
