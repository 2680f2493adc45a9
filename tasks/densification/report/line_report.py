"""The report of a surface from vertical lines: that of any surface, and how the nodes were found."""

from collections.abc import Iterator

from orthomill.schemas.outcome import Outcome
from orthomill.schemas.stage_report import Chart, Grid, Picture, Product, StageReport
from orthomill.schemas.surface import Surface
from orthomill.tasks.densification.line_locus.locus_block import CORRELATION_CLASSES, LineStatistics
from orthomill.tasks.densification.line_locus.node_markers import MARKERS
from orthomill.tasks.densification.precision.class_medians import median_correlation
from orthomill.tasks.densification.precision.tie_points import TieCounts
from orthomill.tasks.densification.report.surface_report import figures_of, rounded, share, surface_report
from orthomill.tasks.densification.surface_tile import SurfaceStatistics

_FIGURES = (
    ("nodes", "", "Vertical lines that two or more photographs show."),
    ("nodes_matched", "", "Nodes whose correlation passes its limit."),
    ("completeness_nodes", "", "Share of the nodes that were accepted."),
    ("correlation_median", "", "Median absolute correlation of the accepted nodes."),
    ("limit_median", "", "Median of the correlations from which on nodes counted as found."),
)
_OF_PAIRS = ("share_agreed", "share_disputed")
"""figures of surfaces that lines do not have"""
_ACCEPTED_ENOUGH = 0.7
"""share of the nodes below which the rest is worth a warning"""
_PERMISSIVE = 0.3
"""median limit below which windows of different ground pass as well"""
_PRODUCTS = (
    Product(path="products/line_locus.xyz", purpose="Nodes of vertical line locus that were accepted: X, Y, Z"),
    Product(path="products/line_locus_nodes.tif", purpose="Nodes over the photographs: black accepted, white rejected"),
)


def line_report(surface: Surface, lines: LineStatistics, cells: SurfaceStatistics, ties: TieCounts) -> StageReport:
    """The report of a surface from vertical lines."""
    whole, values = surface_report(surface, cells, ties, _OF_PAIRS, wall_blind=True), _line_values(lines)
    warnings = tuple(_warnings(values))
    rows = tuple((outcome.sentence, lines.outcomes[outcome]) for outcome in Outcome if lines.outcomes[outcome])
    return whole.model_copy(
        update={
            "products": (*whole.products, *_PRODUCTS),
            "losses": (*whole.losses, *warnings),
            "figures": (*figures_of(_FIGURES, values), *whole.figures),
            "grids": (Grid(title="Outcomes of the nodes", columns=("outcome", "nodes"), rows=rows), *whole.grids),
            "charts": (_correlation_chart(lines), *whole.charts),
            "pictures": (*whole.pictures, _marker_picture()),
            "warnings": (*warnings, *whole.warnings),
        }
    )


def _warnings(values: dict[str, float | int | None]) -> Iterator[str]:
    accepted, limit = values["completeness_nodes"], values["limit_median"]
    if accepted is not None and accepted < _ACCEPTED_ENOUGH:
        yield (
            f"Only {100 * accepted:.0f} % of the nodes were accepted; look for water, wood or blank ground, or set a larger window."
        )
    if limit is not None and limit < _PERMISSIVE:
        yield (
            f"Half of the nodes counted as found from a correlation of {limit:.2f} on, which different ground reaches as well: "
            "wrong heights pass. The threshold that counts independent pixels (threshold: {kind: independent_pixels}) refuses them."
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
