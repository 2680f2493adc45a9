"""Findings about control in words."""

import numpy as np

from orthomill.schemas.errors import some_of
from orthomill.schemas.findings.control_findings import (
    ControlElsewhere,
    ControlExchanged,
    ControlFinding,
    ControlInDegrees,
    ControlRead,
    CoordinatesRounded,
    DatumApart,
    HeightsAllZero,
    HeightsInFeet,
    HeightsOfTwoSystems,
    HeightsUnknown,
    MeasurementsOfOriginals,
    MeasurementsReduced,
    PhotographsAbsent,
)
from orthomill.schemas.observations import Control
from orthomill.tasks.orientation.control.control_heights import with_vertical

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
        return _about_zero(finding)
    if isinstance(finding, HeightsUnknown | HeightsInFeet | HeightsOfTwoSystems):
        return height_sentence(finding)
    if isinstance(finding, MeasurementsReduced):
        return (
            f"{finding.outside} of {finding.measurements} control measurements lie outside of the photographs, but all inside, "
            f"some near the border, when they are divided by {finding.factor:.4g}: they were read as pixels of photographs that "
            "were reduced by this factor since. Compare one with its photograph."
        )
    if isinstance(finding, ControlExchanged):
        return (
            f"The northing (or latitude) of the {finding.points} surveyed points comes first in their file: they were read so, "
            f"because only then are they where the photographs were taken, in {finding.crs}."
        )
    if isinstance(finding, ControlInDegrees):
        return (
            f"The coordinates of the {finding.points} surveyed points are degrees, and were read as longitude and latitude "
            "(EPSG:4326); name the system if it is another (control > crs)."
        )
    if isinstance(finding, DatumApart):
        return (
            f"The surveyed points, read as {finding.crs}, lie {finding.distance_m:.0f} m beside the photographs that show them; in "
            f"{finding.fits} they would lie amid them. If that is what they were surveyed in, state it (control > crs)."
        )
    if isinstance(finding, CoordinatesRounded):
        return _about_rounding(finding)
    if isinstance(finding, MeasurementsOfOriginals):
        (width, height), (now_width, now_height) = finding.original, finding.reduced
        return (
            f"{finding.outside} of {finding.measurements} control measurements lie outside of the photographs, but all of them "
            f"inside of the originals, which were reduced ({width} x {height} to {now_width} x {now_height} px by their tags): "
            "they were read as pixels of the originals. Compare one with its photograph."
        )
    return f"Heights of control points were not transformed: only {finding.crs} defines a vertical datum."


def control_read_sentence(read: ControlRead) -> str:
    """Which format the control has, how much of it there is, and what was assumed."""
    points = f"{read.points} points{f' ({read.checks} of them check points)' * bool(read.checks)}"
    said = [f"Control: {read.format}, {points}, {read.measurements} measurements, in {read.crs[:60]}."]
    if read.skipped:
        said.append(f"{read.skipped} points without coordinates were skipped.")
    if read.corner:
        said.append("Its pixels count from the corner of the upper-left one: half a pixel was taken off.")
    if read.encoding == "Windows-1252":
        said.append("It is not in UTF-8 and was read as Windows-1252; check names with letters beyond A to Z.")
    return " ".join(said)


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
    if isinstance(
        finding, MeasurementsOfOriginals | MeasurementsReduced | ControlExchanged | ControlInDegrees | CoordinatesRounded
    ):
        return False
    if isinstance(finding, HeightsInFeet):
        return not finding.converted
    if isinstance(finding, HeightsOfTwoSystems):
        return finding.shift_m is None
    if isinstance(finding, HeightsUnknown):
        return bool(finding.left_out)
    return not isinstance(finding, PhotographsAbsent) or bool(finding.lost)


def _about_rounding(finding: CoordinatesRounded) -> str:
    steps = ((finding.plan_m, "coordinates"), (finding.height_m, "heights"))
    said = " and ".join(f"{what} to {_digits(step)} m" for step, what in steps if step)
    return (
        f"The {finding.points} surveyed points are rounded, {said}: their standard errors were enlarged by what that takes away. "
        "Give them as they were measured; spreadsheets show fewer digits than they hold."
    )


def _about_zero(finding: HeightsAllZero) -> str:
    if finding.freed:
        return (
            f"All {finding.points} surveyed points have the height 0, which was taken as unknown: they hold the block in plan, the "
            "positions of the photographs hold it in height. Give their heights; points at sea level get them as 0.001."
        )
    return (
        f"All {finding.points} surveyed points have the height 0. Unless they lie at sea level, their heights are missing, and "
        "the block is tilted and put to heights that are not its own. Give them, or NaN where they are unknown."
    )


def height_sentence(finding: HeightsUnknown | HeightsInFeet | HeightsOfTwoSystems) -> str:
    """What was found about heights of surveyed points."""
    if isinstance(finding, HeightsUnknown):
        why = "have the height 0 among others that are far from it" if finding.zero else "have no height"
        lost = f" {some_of(finding.left_out)}, as check points, were left out." if finding.left_out else ""
        return f"Surveyed points that {why} are used in plan only: {some_of(finding.points)}.{lost}"
    if isinstance(finding, HeightsInFeet) and finding.converted:
        return (
            f"{finding.crs} is in feet, and the heights of the surveyed points were taken as feet, too ({finding.unit_m:.7f} m). "
            "If they are metres, name a system with a vertical part in metres (control > crs), as "
            f"{with_vertical(finding.crs, 5703)}."
        )
    if isinstance(finding, HeightsInFeet):
        return (
            "The surveyed points lie above all cameras as metres, and below them as feet: their heights seem to be in feet. "
            f"Convert them, or name a system with a vertical part in feet (control > crs), as {with_vertical(finding.crs, 6360)}."
        )
    if finding.shift_m is None:
        return (
            f"Heights of control are {finding.control}, those of the positions are above {finding.positions}: they differ by tens "
            f"of metres and could not be brought together. State crs: {finding.crs} and install the grid that PROJ asks for, or "
            "give both in one system."
        )
    return (
        f"Heights of control ({finding.control}) were raised by {finding.shift_m:.2f} m to those of the positions, above "
        f"{finding.positions}, which are the heights of all products. For heights of the control state crs: {finding.crs}."
    )


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
