"""What measured distances to check points say of a block: they took no part in it, and test its scale."""

import numpy as np

from orthomill.schemas.accuracy.accuracy_statement import DistanceFigure
from orthomill.schemas.orientation import DistanceResidual


def tested_distances(distances: tuple[DistanceResidual, ...]) -> DistanceFigure | None:
    """The differences (m) of all distances and the scale that they share; None without one."""
    if not distances:
        return None
    differences, promised, lengths = np.array([(d.difference, d.predicted, d.length) for d in distances]).T
    fit, ratio = (float(np.sqrt((values**2).mean())) for values in (differences, differences / promised))
    # The block's own scale and errors of single distances are not told apart: the former leaves the larger standard error.
    scale, sigma = (float(1e6 * values.sum() / lengths.sum()) for values in (differences, promised))
    count = "1 distance" if len(distances) == 1 else f"{len(distances)} distances"
    return DistanceFigure(
        distances=len(distances),
        fit=fit,
        promised=ratio,
        scale=scale,
        scale_sigma=sigma,
        sentence=f"Tested at {count} to check points, the block is {_off(scale)} than measured (standard error at most "
        f"{sigma:.0f} ppm); differences are {1000 * fit:.0f} mm (RMS), {ratio:.1f} times what is promised.",
    )


def _off(scale: float) -> str:
    """parts per million, in words."""
    return f"{abs(scale):.0f} ppm {'longer' if scale >= 0 else 'shorter'}"
