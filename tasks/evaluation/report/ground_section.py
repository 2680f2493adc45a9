"""The terrain in the report of the evaluation."""

from collections.abc import Iterator

from orthomill.schemas.stage_report import Figure, Grid
from orthomill.tasks.evaluation.ground_accuracy import SIGMAS, GroundGroup, GroundSummary
from orthomill.tasks.evaluation.report.report_section import ReportSection

LEAST_WITHIN = 90.0
"""% within two standard errors below which they are called too small; a normal law has 95.4"""
LEAST_CELLS = 500


def ground_section(summary: GroundSummary) -> ReportSection:
    """Accuracy and honesty of the terrain by code and place."""
    columns = ("ground", "cells", "share %", "bias m", "RMSE m", "> 1 m %", *(f"< {k:.0f} s %" for k in SIGMAS))
    rows = tuple((g.words, g.cells, g.share, g.bias, g.rmse, g.far, *g.within) for g in summary.groups)
    grid = Grid(
        title="The terrain against the true ground",
        columns=columns,
        rows=rows,
        note="s: the standard error that the terrain gives itself; a normal law has 68.3, 95.4 and 99.7 % within 1, 2 and 3.",
    )
    return ReportSection(figures=tuple(_figures(summary)), grids=(grid,), warnings=tuple(_warnings(summary)))


def _figures(summary: GroundSummary) -> Iterator[Figure]:
    for group in summary.groups:
        head = "_".join(part for part in ("terrain", group.code, group.place) if part)
        words = f"Terrain, {group.words}"
        yield Figure(name=f"{head}_rmse", value=group.rmse, unit="m", sentence=f"{words}: root mean square error.")
        yield Figure(name=f"{head}_bias", value=group.bias, unit="m", sentence=f"{words}: mean difference from the truth.")
        yield Figure(name=f"{head}_beyond_1_m", value=group.far, unit="%", sentence=f"{words}: off by more than 1 m.")
        for k, share in zip(SIGMAS, group.within, strict=True):
            name = f"{head}_within_{k:.0f}_sigma"
            yield Figure(name=name, value=share, unit="%", sentence=f"{words}: within {k:.0f} of their own standard errors.")
    missed = "Measured cells of open ground that are not called ground."
    yield Figure(name="terrain_type_1", value=summary.type_1, unit="%", sentence=missed)
    objects = "Cells called ground that lie more than 1.5 m above it."
    yield Figure(name="terrain_type_2", value=summary.type_2, unit="%", sentence=objects)


def _warnings(summary: GroundSummary) -> Iterator[str]:
    poor = [g for g in summary.groups if not g.place and g.code and g.cells >= LEAST_CELLS and _within_2(g) < LEAST_WITHIN]
    for group in poor:
        name = group.code.replace("_", " ")
        yield (
            f"Only {_within_2(group):.0f} % of the terrain that is {name} lies within two of its own "
            "standard errors of the true ground: they are too small."
        )


def _within_2(group: GroundGroup) -> float:
    return group.within[SIGMAS.index(2.0)]
