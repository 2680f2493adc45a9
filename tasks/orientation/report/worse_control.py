"""What is told of control whose coordinates or measurements are worse than stated."""

from math import sqrt
from statistics import median

from orthomill.schemas.findings.finding import two_digits
from orthomill.schemas.observations import Control

ELSEWHERE = 100.0
"""A factor of standard errors from which on it says nothing: what was surveyed is not where the block sees it."""


def worse_control(control: Control, factor: float) -> str:
    """That the coordinates of the control are `factor` times worse than stated, and what that means."""
    stated = _median(
        [
            sqrt(sum(sigma * sigma for sigma in point.sigma) / len(point.sigma))
            for point in control.points
            if point.role == "control"
        ]
    )
    good = factor * stated
    if factor >= ELSEWHERE:
        return (
            f"The ground control is not where the block sees it: it differs by about {two_digits(good)} m, where "
            f"{two_digits(stated)} m are stated. Compare its reference system and heights with those of the positions, and the "
            "names of its points."
        )
    return (
        f"The ground control is worse than stated: its standard errors were enlarged {factor:.1f} times. It is good to "
        f"{two_digits(good)} m, not the {two_digits(stated)} m stated, and the result is as good as the control. State its true "
        "standard errors, or survey it more precisely."
    )


def worse_marks(control: Control, factor: float) -> str:
    """That the measurements of surveyed points in the photographs are `factor` times worse than stated, and what that means."""
    stated = _median([measured[2] for point in control.points if point.role != "check" for measured in point.measurements.values()])
    if factor >= ELSEWHERE:
        return (
            "The surveyed points are not where the block sees them in the photographs: their measurements fit worse than stated by "
            f"about {two_digits(factor * stated)} px. They may be those of other photographs, another size or other points."
        )
    return (
        f"The marks of the control points are good to {two_digits(factor * stated)} px, not the {two_digits(stated)} px stated; "
        f"the measurements fit worse than stated, and their standard errors were enlarged {factor:.1f} times. Mark them more "
        "precisely, or state what they are good to."
    )


def _median(values: list[float]) -> float:
    return median(values) if values else 1.0
