"""Findings about control in words."""

import numpy as np

from orthomill.schemas.errors import some_of
from orthomill.schemas.findings.control_findings import (
    ControlElsewhere,
    ControlFinding,
    HeightsAllZero,
    MeasurementsOfOriginals,
    PhotographsAbsent,
)
from orthomill.schemas.observations import Control

GEOGRAPHIC = "EPSG:4326"
ELSEWHERE = 100.0
"""A factor of standard errors from which on it says nothing: what was surveyed is not where the block sees it."""


def control_sentence(finding: ControlFinding) -> str:
    """A whole sentence, with what to do."""
    if isinstance(finding, ControlElsewhere):
        return (
            f"The {finding.points} control points, read as {finding.crs}, are {finding.distance_m / 1000:.0f} km from where the "
            f"photographs were taken; {_advice(finding)}. They were set aside and took no part in the adjustment."
        )
    if isinstance(finding, PhotographsAbsent):
        return _about_absent(finding)
    if isinstance(finding, HeightsAllZero):
        return (
            f"All {finding.points} surveyed points have the height 0. Unless they lie at sea level, their heights are missing, and "
            "the block is tilted and put to heights that are not its own. Give them, or state a standard error of the heights (100 "
            "m) that says that they are unknown."
        )
    if isinstance(finding, MeasurementsOfOriginals):
        (width, height), (now_width, now_height) = finding.original, finding.reduced
        return (
            f"{finding.outside} of {finding.measurements} control measurements lie outside of the photographs, but all of them "
            f"inside of the originals, which were reduced ({width} x {height} to {now_width} x {now_height} px by their tags): "
            "they were read as pixels of the originals. Compare one with its photograph."
        )
    return f"Heights of control points were not transformed: only {finding.crs} defines a vertical datum."


def worse_control(control: Control, factor: float) -> str:
    """That the coordinates of the control are `factor` times worse than stated, and what that means."""
    stated = _median([np.sqrt(np.mean(np.square(point.sigma))) for point in control.points if point.role == "control"])
    good = factor * stated
    if factor >= ELSEWHERE:
        return (
            f"The ground control is not where the block sees it: it differs by about {_digits(good)} m, where {_digits(stated)} m "
            "are stated. Compare its reference system and heights with those of the positions, and the names of its points."
        )
    return (
        f"The ground control is worse than stated: its standard errors were enlarged {factor:.1f} times. It is good to "
        f"{_digits(good)} m, not the {_digits(stated)} m stated, and the result is as good as the control. State its true standard "
        "errors, or survey it more precisely."
    )


def worse_marks(control: Control, factor: float) -> str:
    """That the measurements of surveyed points in the photographs are `factor` times worse than stated, and what that means."""
    stated = _median([measured[2] for point in control.points if point.role != "check" for measured in point.measurements.values()])
    if factor >= ELSEWHERE:
        return (
            "The surveyed points are not where the block sees them in the photographs: their measurements fit worse than stated by "
            f"about {_digits(factor * stated)} px. They may be those of other photographs, another size or other points."
        )
    return (
        f"The marks of the control points are good to {_digits(factor * stated)} px, not the {_digits(stated)} px stated; the "
        f"measurements fit worse than stated, and their standard errors were enlarged {factor:.1f} times. Mark them more "
        "precisely, or state what they are good to."
    )


def _median(values: list[float]) -> float:
    return float(np.median(values)) if values else 1.0


def _digits(value: float) -> str:
    """Two digits, as a standard error has no more."""
    return f"{float(f'{value:.2g}'):g}"


def is_grave(finding: ControlFinding) -> bool:
    """Whether the block lacks what its user relies on; measurements of points that others measure as well are no such loss."""
    if isinstance(finding, MeasurementsOfOriginals):
        return False
    return not isinstance(finding, PhotographsAbsent) or bool(finding.lost)


def _about_absent(finding: PhotographsAbsent) -> str:
    are = "is" if len(finding.lost) == 1 else "are"
    lost = f"; {some_of(finding.lost)} {are} measured in no other and left out" if finding.lost else ""
    were = "measurement of control points was" if finding.measurements == 1 else "measurements of control points were"
    return (
        f"{finding.measurements} {were} skipped, as the project does not have the photographs {some_of(finding.photos)}{lost}. "
        "Set absent: refuse below control if no photograph may be missing."
    )


def _advice(finding: ControlElsewhere) -> str:
    if finding.fits is None:
        return "check the reference system, the order of the axes and the zone"
    system = "" if finding.fits == finding.crs else f"in {finding.fits}"
    # In degrees people exchange latitude and longitude, on a map X and Y.
    axes = "latitude before longitude" if finding.fits == GEOGRAPHIC else "X and Y exchanged"
    return " ".join(word for word in ("they would be there", system, f"with {axes}" if finding.exchanged else "") if word)
