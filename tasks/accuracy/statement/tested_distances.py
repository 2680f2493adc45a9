"""What measured distances to check points say of a block: they took no part in it, and test its scale.

A distance that contradicts the block while the others agree with it is named and left out: 3 m in one of 100 m are no scale.
"""

import numpy as np

from orthomill.schemas.accuracy.accuracy_statement import DistanceFigure
from orthomill.schemas.orientation import DistanceResidual

_ALONE = 4.0
"""promised standard errors beyond which a distance contradicts the block"""
_AGREE = 2.0
"""root mean square of the others in promised standard errors, at most: otherwise the block is wrong, and not the distance"""


def tested_distances(distances: tuple[DistanceResidual, ...]) -> DistanceFigure | None:
    """The differences (m) of all distances and the scale that they share; None without one."""
    if not distances:
        return None
    differences, promised, lengths = np.array([(d.difference, d.predicted, d.length) for d in distances]).T
    alone = _contradicting(differences / promised)
    words = "; ".join(_named(distance) for distance, out in zip(distances, alone, strict=True) if out)
    differences, promised, lengths = (values[~alone] for values in (differences, promised, lengths))
    fit, ratio = (float(np.sqrt((values**2).mean())) for values in (differences, differences / promised))
    # The block's own scale and errors of single distances are not told apart: the former leaves the larger standard error.
    scale, sigma = (float(1e6 * values.sum() / lengths.sum()) for values in (differences, promised))
    count = "1 distance" if len(distances) == 1 else f"{len(distances)} distances"
    opening = (
        f"Tested at {count} to check points, the"
        if not words
        else f"Of {count} to check points, {words}. Without {'it' if alone.sum() == 1 else 'them'} the"
    )
    return DistanceFigure(
        distances=len(distances),
        contradicting=tuple(f"{d.first} to {d.second}" for d, out in zip(distances, alone, strict=True) if out),
        fit=fit,
        promised=ratio,
        scale=scale,
        scale_sigma=sigma,
        sentence=f"{opening} block is {_off(scale)} than measured (standard error at most {sigma:.0f} ppm); differences are "
        f"{1000 * fit:.0f} mm (RMS), {ratio:.1f} times what is promised.",
    )


def _contradicting(ratios: np.ndarray) -> np.ndarray:
    """(N,) bool: those far off, where the others agree; ratios: differences in promised standard errors."""
    far = np.abs(ratios) > _ALONE
    rest = ratios[~far]
    known = len(rest) >= far.sum() and np.sqrt((rest**2).mean()) <= _AGREE if len(rest) else False
    return far if known else np.zeros(len(ratios), bool)


def _named(distance: DistanceResidual) -> str:
    times = abs(distance.difference / distance.predicted)
    name = f"{distance.first} to {distance.second}"
    return f"{name} contradicts the block by {distance.difference:+.2f} m, {times:.0f} times what is promised"


def _off(scale: float) -> str:
    """parts per million, in words."""
    return f"{abs(scale):.0f} ppm {'longer' if scale >= 0 else 'shorter'}"
