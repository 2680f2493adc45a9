"""Points of known height in the report of the evaluation."""

from collections.abc import Iterator

from orthomill.schemas.stage_report import Figure, Grid
from orthomill.tasks.evaluation.accuracy import SIGMAS
from orthomill.tasks.evaluation.point_accuracy import PointGroup, PointsSummary
from orthomill.tasks.evaluation.report.report_section import ReportSection

_MEASURES = (
    ("bias", "mean difference from the points"),
    ("sd", "standard deviation of the differences"),
    ("rmse", "root mean square difference"),
    ("nmad", "normalised median absolute deviation"),
    ("largest", "the largest difference"),
)
_LEAST = 30
"""points from which shares within standard errors say something"""
_TOO_FEW = 90.0
"""% within two standard errors below which they are called too small; a normal law has 95.4"""


def points_section(summary: PointsSummary) -> ReportSection:
    """Differences at the points, and their shares within n standard errors."""
    columns = ("heights", "points", "mean", "SD", "RMS", "NMAD", "largest", *(f"< {k:.0f} s %" for k in SIGMAS))
    rows = tuple((g.words, g.points, g.bias, g.sd, g.rmse, g.nmad, g.largest, *g.within) for g in summary.groups)
    grid = Grid(
        title="Surface model at points of known height",
        columns=columns,
        rows=rows,
        note=f"{summary.inside} of {summary.given} points lie on the surface model. Lengths in m. s: the standard error of each "
        "difference, of the surface and of the point together; a normal law has 68.3, 95.4 and 99.7 % within 1, 2 and 3.",
    )
    return ReportSection(figures=tuple(_figures(summary)), grids=(grid,), warnings=tuple(_warnings(summary)))


def _figures(summary: PointsSummary) -> Iterator[Figure]:
    yield Figure(name="points_given", value=summary.given, sentence="Points of the reference.")
    yield Figure(name="points_inside", value=summary.inside, sentence="Those that lie on the surface model.")
    for group in summary.groups:
        head = "points" if group.name == "all" else f"points_{group.name}"
        yield Figure(name=f"{head}_compared", value=group.points, sentence=f"Points compared, {group.words}.")
        for key, words in _MEASURES:
            yield Figure(name=f"{head}_{key}", value=getattr(group, key), unit="m", sentence=f"At points, {group.words}: {words}.")
        for k, share in zip(SIGMAS, group.within, strict=True):
            sentence = f"At points, {group.words}: within {k:.0f} standard errors of the difference."
            yield Figure(name=f"{head}_within_{k:.0f}_sigma", value=share, unit="%", sentence=sentence)


def _warnings(summary: PointsSummary) -> Iterator[str]:
    if not summary.groups:
        yield (
            f"None of the {summary.given} reference points could be compared, {summary.inside} lie on the surface model: check "
            "their system and their unit."
        )
    for group in summary.groups:
        within = _within_2(group)
        if group.name == "measured" and group.points >= _LEAST and within is not None and within < _TOO_FEW:
            yield (
                f"Only {within:.0f} % of the measured heights lie within two standard errors of the reference points: those of the "
                "surface or of the points are too small."
            )


def _within_2(group: PointGroup) -> float | None:
    return group.within[SIGMAS.index(2.0)]
