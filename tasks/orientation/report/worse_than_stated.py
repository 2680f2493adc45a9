"""What is told of positions and control whose coordinates or measurements are worse than stated."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import sqrt
from statistics import median

from orthomill.schemas.errors import some_of
from orthomill.schemas.findings.contradiction_findings import UnitContradicted
from orthomill.schemas.findings.finding import two_digits
from orthomill.schemas.observations import Control
from orthomill.schemas.orientation import BlockPrecision
from orthomill.tasks.adjustment.testing.adjustment_result import ObservationKind
from orthomill.tasks.orientation.examined.block_facts import Facts, heights_missing

CONTRADICTED = 3.0
"""A factor of standard errors from which on what was stated and the block contradict each other: no chance makes it."""
ELSEWHERE = 100.0
"""A factor of standard errors from which on it says nothing: what was surveyed is not where the block sees it."""


@dataclass(frozen=True)
class Worse:
    """Coordinates whose standard errors the adjustment enlarged `factor` times, and what is said of it."""

    factor: float
    sentence: str


def worse_than_stated(facts: Facts) -> Iterator[Worse]:
    """Of the control, and of the positions of photographs."""
    precision = facts.precision
    # Standard errors that a wrong unit has enlarged say nothing of positions or control.
    if any(isinstance(finding, UnitContradicted) for finding in precision.findings):
        return
    if precision.position_factor > 1.0:
        yield Worse(precision.position_factor, _worse_positions(precision))
    # Control without heights is worse than anything that was stated of it, and is told as such.
    if precision.control_factor > 1.0 and not heights_missing(facts.control):
        yield Worse(precision.control_factor, worse_control(facts.control, precision.control_factor))


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


def _worse_positions(precision: BlockPrecision) -> str:
    parts = [group for group in precision.groups if group.name == ObservationKind.POSITIONS and group.part]
    worse, advice = [group for group in parts if group.factor > 1.0], "State their true precision, or look for single wrong ones."
    if len(worse) == len(parts):
        factor = precision.position_factor
        return f"The GNSS positions are worse than stated: their standard errors were enlarged {factor:.1f} times. {advice}"
    listed = some_of([f"{group.part} ({group.factor:.1f} times)" for group in worse])
    return (
        f"Some groups of GNSS positions are worse than stated, and their standard errors were enlarged: {listed}. Those of the "
        f"others hold. {advice}"
    )


def _median(values: list[float]) -> float:
    return median(values) if values else 1.0
