"""The report of a surface from vertical lines."""

from orthomill.schemas.outcome import Outcome
from orthomill.schemas.stage_report import Chart, Figure, Grid, Picture, StageReport
from orthomill.schemas.surface import Surface
from orthomill.tasks.densification.line_locus.locus_block import CORRELATION_CLASSES, LineStatistics
from orthomill.tasks.densification.line_locus.node_markers import MARKERS
from orthomill.tasks.densification.precision.class_medians import median_correlation
from orthomill.tasks.densification.report.surface_words import (
    HEADLINES,
    SURFACE_FIGURES,
    precision_chart,
    provenance_grid,
    rounded,
    share,
    surface_doubts,
    surface_pictures,
    surface_values,
    surface_warnings,
)
from orthomill.tasks.densification.surface_tile import SurfaceStatistics

_LINE_FIGURES = (
    ("nodes", "", "Vertical lines that two or more photographs show."),
    ("nodes_matched", "", "Nodes whose correlation passes its limit."),
    ("completeness_nodes", "", "Share of the nodes that were accepted."),
    ("correlation_median", "", "Median absolute correlation of the accepted nodes."),
    ("limit_median", "", "Median of the correlations from which on nodes counted as found."),
)
_OF_PAIRS = ("pairs", "nodes", "nodes_matched", "completeness_nodes", "parallax_precision_median", "share_agreed", "share_disputed")
"""figures that lines do not have, or state in words of their own"""


def line_report(surface: Surface, lines: LineStatistics, cells: SurfaceStatistics) -> StageReport:
    """The report of a surface from vertical lines."""
    values = _line_values(lines) | surface_values(surface, cells)
    figures = (*_LINE_FIGURES, *(figure for figure in SURFACE_FIGURES if figure[0] not in _OF_PAIRS))
    rows = tuple((outcome.sentence, lines.outcomes[outcome]) for outcome in Outcome if lines.outcomes[outcome])
    return StageReport(
        figures=tuple(
            Figure(name=name, value=values[name], unit=unit, sentence=sentence, headline=name in HEADLINES)
            for name, unit, sentence in figures
        ),
        grids=(Grid(title="Outcomes of the nodes", columns=("outcome", "nodes"), rows=rows), provenance_grid(cells)),
        charts=(_correlation_chart(lines), precision_chart(surface, cells)),
        pictures=(*surface_pictures(), _marker_picture()),
        doubts=tuple(surface_doubts(cells)),
        warnings=tuple(surface_warnings(cells)),
    )


def _line_values(lines: LineStatistics) -> dict[str, float | int | None]:
    tried = sum(lines.outcomes) - lines.outcomes[Outcome.OUTSIDE]
    return {
        "nodes": tried,
        "nodes_matched": lines.outcomes[Outcome.CONVERGED],
        "completeness_nodes": share(lines.outcomes[Outcome.CONVERGED], tried),
        "correlation_median": rounded(median_correlation(lines.accepted), 3),
        "limit_median": rounded(median_correlation(lines.limits), 3),
    }


def _correlation_chart(lines: LineStatistics) -> Chart:
    width = 1.0 / CORRELATION_CLASSES
    return Chart(
        title="Correlation of the nodes",
        style="bars",
        x_label="absolute correlation",
        y_label="nodes",
        x=tuple(round((k + 0.5) * width, 3) for k in range(CORRELATION_CLASSES)),
        series={"accepted": tuple(map(float, lines.accepted)), "rejected": tuple(map(float, lines.rejected))},
        caption="Every node is compared with a limit of its own, unless the threshold is fixed.",
    )


def _marker_picture() -> Picture:
    caption = "Black: a height was accepted. White: it was rejected."
    return Picture(
        title="Nodes over the photographs", raster=MARKERS, style="ramp", low=0.0, high=255.0, colours="gray", caption=caption
    )
