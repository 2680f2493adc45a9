"""The heights in the report: accuracy by class of place, shares within n sigma, roofs, buildings and water."""

from collections.abc import Iterator
from statistics import median

from orthomill.schemas.stage_report import Chart, Figure, Grid, Picture
from orthomill.tasks.evaluation.accuracy import BINS_PER_CELL, SIGMAS
from orthomill.tasks.evaluation.report.codes_section import code_figures, code_grids
from orthomill.tasks.evaluation.report.report_section import ReportSection
from orthomill.tasks.evaluation.tile_sums import LEAST_ROOF, GroupMeasures, HeightsSummary, rounded

DH = "evaluation/dh"
"""float32 m: surface model minus reference, NaN where either is missing"""
_WORST = 12
"""buildings in the table of the largest median differences"""
_NORMAL_3 = 95.0
"""% within three reported sigma below which the precision is called too optimistic; a normal law has 99.7, but height errors have
heavier tails, and a warning on every surface would be ignored"""

_MOSTLY = 80.0
"""% of the measured heights within three expected standard errors below which surface or reference is in doubt"""

_MEASURES = (
    ("bias", "m", "mean difference from the reference"),
    ("sd", "m", "standard deviation of the differences"),
    ("rmse", "m", "root mean square difference"),
    ("median", "m", "median difference"),
    ("nmad", "m", "normalised median absolute deviation (a standard deviation that blunders do not affect)"),
    ("q68", "m", "68 % of the absolute differences are below this"),
    ("q95", "m", "95 % of the absolute differences are below this"),
    ("fgdc95", "m", "1.96 RMSE, the 95 % of the normal law"),
)
"""figure and field of `Measures`, unit, meaning"""
_GRID_COLUMNS = (
    ("cells", "cells"),
    ("completeness_seen_twice", "complete %"),
    ("bias", "bias"),
    ("sd", "SD"),
    ("rmse", "RMSE"),
    ("median", "median"),
    ("nmad", "NMAD"),
    ("median_absolute", "median |dh|"),
    ("q68", "68 %"),
    ("q95", "95 %"),
    ("lowest", "lowest"),
    ("highest", "highest"),
)
"""field of `Measures` and head of its column"""


def heights_section(summary: HeightsSummary) -> ReportSection:
    """Everything on the heights of the surface model."""
    # colours saturate at two cells: noise stays pale, wrong roofs and trees are conspicuous
    reach = 2 * summary.cell
    caption = "Red and blue: too high or too low by two cells' length or more."
    return ReportSection(
        figures=tuple(_height_figures("dsm", summary, full=True)),
        grids=(
            _height_grid("Surface model against the reference", summary),
            _sigma_grid(summary),
            *code_grids("Surface model", summary),
            *_building_grid(summary),
        ),
        charts=(_height_chart("Height differences", summary),),
        pictures=(
            Picture(
                title="Surface model minus reference",
                raster=DH,
                style="diverging",
                unit="m",
                low=-reach,
                high=reach,
                caption=caption,
            ),
        ),
        warnings=tuple(_warnings(summary)),
    )


def before_check_section(summary: HeightsSummary) -> ReportSection:
    """The main measures of the surface model as it was before its check."""
    return ReportSection(
        figures=tuple(_height_figures("dsm_before_check", summary, full=False)),
        grids=(_height_grid("Surface model before its check", summary), *code_grids("Surface model before its check", summary)),
    )


def _height_figures(prefix: str, summary: HeightsSummary, full: bool) -> Iterator[Figure]:
    """Figures `<prefix>_<group>_<measure>`; the group `all` has no name of its own."""
    for group in summary.groups:
        head = prefix if group.name == "all" else f"{prefix}_{group.name}"
        # before the check only the main groups: the figures are for comparison, not for study
        if full or group.name in ("all", "open_ground", "roof"):
            yield from _measure_figures(head, group)
        yield from _completeness_figures(head, group)
        if full:
            yield from _sigma_figures(head, group)
    yield from code_figures(prefix, summary, full)
    groups = {group.name: group for group in summary.groups}
    if "roof" in groups:
        yield _roof_figure(prefix, groups["roof"])
    if summary.buildings:
        yield from _building_figures(prefix, summary)
    if "water" in groups:
        yield _water_figure(prefix, groups["water"])
    if summary.expected_sigma is not None:
        sentence = "Expected standard error of a height: (H/B) times ground pixel times parallax error."
        yield Figure(name=f"{prefix}_expected_sigma", value=summary.expected_sigma, unit="m", sentence=sentence)


def _measure_figures(head: str, group: GroupMeasures) -> Iterator[Figure]:
    for key, unit, words in _MEASURES:
        sentence = f"Heights, {group.words}: {words}."
        yield Figure(name=f"{head}_{key}", value=group.numbers[key], unit=unit, sentence=sentence)


def _completeness_figures(head: str, group: GroupMeasures) -> Iterator[Figure]:
    # Completeness proper: ground that fewer than two photographs show cannot be measured, whatever the method.
    yield Figure(
        name=f"{head}_completeness",
        value=group.numbers["completeness_seen_twice"],
        unit="%",
        sentence=f"Heights, {group.words}: cells that have a measured height, of those visible in two photographs or more.",
    )
    yield Figure(
        name=f"{head}_completeness_all",
        value=group.numbers["completeness"],
        unit="%",
        sentence=f"Heights, {group.words}: cells that have a measured height, of all cells of the grid.",
    )
    yield Figure(
        name=f"{head}_measured_unseen",
        value=group.numbers["measured_unseen"],
        unit="%",
        sentence=f"Heights, {group.words}: cells called measured, of those that fewer than two photographs truly see.",
    )
    cells = group.numbers["cells"]
    yield Figure(name=f"{head}_cells", value=None if cells is None else round(cells), sentence=f"Cells, {group.words}.")


def _sigma_figures(head: str, group: GroupMeasures) -> Iterator[Figure]:
    kinds = (
        ("sigma", group.within, "of their own reported standard errors"),
        ("expected_sigma", group.within_expected, "of the expected standard error (H/B) sigma_p"),
    )
    for number, k in enumerate(SIGMAS):
        for name, shares, words in kinds:
            if shares:
                sentence = f"Heights, {group.words}: within {k:.0f} {words}."
                yield Figure(name=f"{head}_within_{k:.0f}_{name}", value=shares[number], unit="%", sentence=sentence)


def _roof_figure(prefix: str, roofs: GroupMeasures) -> Figure:
    sentence = "Median of the absolute height differences on all roof cells."
    return Figure(name=f"{prefix}_roof_median_error", value=roofs.numbers["median_absolute"], unit="m", sentence=sentence)


def _building_figures(prefix: str, summary: HeightsSummary) -> Iterator[Figure]:
    # Building by building: on all roof cells together a few large halls would decide.
    medians = [abs(row[2]) for row in summary.buildings]
    yield Figure(
        name=f"{prefix}_buildings_judged", value=len(medians), sentence=f"Buildings with {LEAST_ROOF} measured roof cells or more."
    )
    yield Figure(
        name=f"{prefix}_buildings_median_error",
        value=rounded(median(medians)),
        unit="m",
        sentence="Median over the buildings of their absolute median difference.",
    )
    yield Figure(
        name=f"{prefix}_buildings_within_half_metre",
        value=rounded(100 * (sum(one <= 0.5 for one in medians) / len(medians)), 2),
        unit="%",
        sentence="Buildings whose median difference is 0.5 m or less.",
    )


def _water_figure(prefix: str, water: GroupMeasures) -> Figure:
    # Water has no texture that stays in place: a measured height there is a wrong match, an empty or estimated cell is right.
    measured = water.numbers["completeness"]
    empty = None if measured is None else rounded(100 - measured, 2)
    return Figure(
        name=f"{prefix}_water_left_empty",
        value=empty,
        unit="%",
        sentence="Water cells without a measured height, as they should be.",
    )


def _height_grid(title: str, summary: HeightsSummary) -> Grid:
    return Grid(
        title=title,
        columns=("where", *(head for _, head in _GRID_COLUMNS)),
        rows=tuple((g.words, *(g.numbers[key] for key, _ in _GRID_COLUMNS)) for g in summary.groups),
        note="Measured heights only. Lengths in m. Complete: of the cells visible in two photographs or more. Median, NMAD and "
        f"quantiles from a histogram of {100 * summary.cell / BINS_PER_CELL:g} cm bins; beyond 20 cells they count as 20 there.",
    )


def _sigma_grid(summary: HeightsSummary) -> Grid:
    heads = tuple(f"{word} {k:.0f}" for word in ("reported", "expected") for k in SIGMAS)
    # without epipolar pairs nothing is expected; the columns stay, so that reports of different runs can be compared
    blank = (None,) * len(SIGMAS)
    return Grid(
        title="Shares of height differences within n standard errors, %",
        columns=("where", *heads),
        rows=tuple((g.words, *g.within, *(g.within_expected or blank)) for g in summary.groups),
        note="A normal law has 68.3 within 1 and 99.7 within 3. The share beyond 10 is the difference of the columns 10 to 100. "
        "Reported: each cell's own standard error. Expected: one value from flying height, base and parallax error.",
    )


def _height_chart(title: str, summary: HeightsSummary) -> Chart:
    return Chart(
        title=title,
        style="lines",
        x_label="surface model minus reference, m",
        y_label="% of cells",
        x=summary.chart_x,
        series=summary.chart,
    )


def _building_grid(summary: HeightsSummary) -> tuple[Grid, ...]:
    if not summary.buildings:
        return ()
    # the worst ones only: these deserve an inspection one by one
    worst = sorted(summary.buildings, key=lambda row: -abs(row[2]))[:_WORST]
    columns = ("building", "roof cells", "median difference m")
    return (Grid(title="Buildings with the largest median difference", columns=columns, rows=tuple(worst)),)


def _warnings(summary: HeightsSummary) -> Iterator[str]:
    groups = {group.name: group for group in summary.groups}
    # open ground where classes are known: in trees and at walls the reference itself is debatable
    ground = groups.get("open_ground") or groups.get("all")
    if ground is None:
        yield "No cell of the surface model lies within the reference: nothing was compared. Check the CRS of both."
    elif ground.within and (within := ground.within[SIGMAS.index(3.0)]) is not None and within < _NORMAL_3:
        yield (
            f"Only {within:.0f} % of the heights ({ground.words}) lie within three of their own reported "
            "standard errors (a normal law has 99.7): the reported precision is too optimistic."
        )
    if (near := near_share(summary)) is not None and near < _MOSTLY:
        yield (
            f"Only {near:.0f} % of the measured heights lie within {3 * (summary.expected_sigma or 0.0):.2g} m of the reference, "
            "three times what its photographs allow (H/B times ground pixel times parallax error): surface or reference is wrong."
        )


def near_share(summary: HeightsSummary) -> float | None:
    """% of all measured heights within three expected standard errors; None where none is expected, or nothing was compared."""
    whole = next((group for group in summary.groups if group.name == "all"), None)
    return whole.within_expected[SIGMAS.index(3.0)] if whole and whole.within_expected else None
