"""A section of the evaluation report: what one kind of result contributes to it."""

from typing import NamedTuple

from orthomill.schemas.stage_report import Chart, Figure, Grid, Picture


class ReportSection(NamedTuple):
    """Parts of a report in the order in which they are to be read."""

    figures: tuple[Figure, ...] = ()
    grids: tuple[Grid, ...] = ()
    charts: tuple[Chart, ...] = ()
    pictures: tuple[Picture, ...] = ()
    warnings: tuple[str, ...] = ()


def share_of(part: float, whole: float, unit: float = 100.0) -> float | None:
    """`part` of `whole` in `unit` (percent), rounded; None where there is nothing to share."""
    return round(unit * part / whole, 4) if whole else None
