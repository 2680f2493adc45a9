"""The adjustment and the promises of errors as tables and a diagram of the report."""

from collections.abc import Iterator

from orthomill.schemas.accuracy.adjustment_statement import AdjustmentStatement, InteriorStatement, SurveyedReliability
from orthomill.schemas.accuracy.promised_errors import EXPECTED, MULTIPLES, KeptPromises, Reliability
from orthomill.schemas.stage_report import Chart, Figure, Grid


def promise_grid(reliability: Reliability) -> Grid:
    """Shares within 1, 2, 3 promised errors, by kind; without a row where nothing was promised or found."""
    return Grid(
        title="Promised errors beside what was found",
        columns=("observations", "number", "within 1 (%)", "95 % interval", "within 2 (%)", "within 3 (%)", "factor", "holds"),
        rows=tuple(map(_promise_row, reliability.kinds)),
        note="Of normal errors 68.3, 95.4 and 99.7 % lie within 1, 2 and 3 of the promised standard errors. Factor: what the "
        "promised errors would have to be multiplied with; it is offered, not applied. Left out in turn: each against all others. "
        "What took part can show that errors are larger than promised, not that the whole is in its place.",
    )


def _promise_row(kind: KeptPromises) -> tuple[float | int | str | None, ...]:
    one, two, three = (round(100 * share, 1) for share in kind.within)
    sure = f"{100 * kind.low[0]:.0f} to {100 * kind.high[0]:.0f}"
    holds = "yes" if kind.holds else "no: too sure" if kind.too_sure else "no: wider than needed"
    return kind.kind, kind.items, one, sure, two, three, round(kind.factor, 2), holds


_CHARTS = ((True, "independent observations"), (False, "what took part, left out in turn"))
_LINES = 5
"""kinds of a chart beside the normal errors: it has six colours"""


def promise_chart(reliability: Reliability) -> tuple[Chart, ...]:
    """The reliability diagrams; none where there is nothing to draw."""
    charts = []
    for independent, words in _CHARTS:
        kinds = [kind for kind in reliability.kinds if kind.independent == independent]
        for first in range(0, len(kinds), _LINES):
            title = f"Reliability of the promised errors: {words}{', continued' if first else ''}"
            charts.append(_diagram(title, kinds[first : first + _LINES]))
    return tuple(charts)


def _diagram(title: str, kinds: list[KeptPromises]) -> Chart:
    series = {"normal errors": EXPECTED, **{kind.kind: kind.within for kind in kinds}}
    return Chart(
        title=title,
        style="lines",
        x_label="promised standard errors",
        y_label="share within (%)",
        x=MULTIPLES,
        series={name: tuple(round(100 * share, 1) for share in shares) for name, shares in series.items()},
        caption="Below the line of normal errors: promised too well. Intervals are in the table.",
    )


def promise_figures(reliability: Reliability) -> Iterator[Figure]:
    """Share and factor by kind."""
    for kind in reliability.kinds:
        name = kind.kind.lower().replace(", ", "_").replace(" ", "_")
        share = round(100 * kind.within[0], 1)
        words = f"Share within one promised standard error ({kind.kind}); 68.3 % of normal errors."
        yield Figure(name=f"{name}_within_1", value=share, unit="%", sentence=words, detail=True)
        factor = f"What the promised errors must be multiplied with for that ({kind.kind}); not applied."
        yield Figure(name=f"{name}_factor", value=round(kind.factor, 3), sentence=factor, detail=True)


def promise_warnings(reliability: Reliability) -> Iterator[str]:
    """Kinds whose errors were promised too well, or may have been."""
    yield from (_too_sure(kind) for kind in reliability.kinds if kind.too_sure)


def promise_doubts(reliability: Reliability) -> Iterator[str]:
    """Those of them that are beyond chance."""
    yield from (_too_sure(kind) for kind in reliability.kinds if kind.broken)


def _too_sure(kind: KeptPromises) -> str:
    found = (
        f"promised too well ({kind.kind}): {100 * kind.within[0]:.0f} % instead of 68 % lie within one of them (at most "
        f"{100 * kind.high[0]:.0f} %, by {kind.items})"
    )
    if kind.broken:
        return f"Errors were {found}. Standard errors {kind.factor:.1f} times as large would hold; none is changed."
    return (
        f"Errors may have been {found}; where all are right, so few are found in one of {1 / (kind.chance or 1.0):.0f} such sets "
        "by chance. None is changed."
    )


def adjustment_grids(adjustment: AdjustmentStatement) -> Iterator[Grid]:
    """A correlation matrix for each camera, and the reliability of control and distances."""
    yield from map(_interior_grid, adjustment.cameras)
    surveyed = (*adjustment.control, *adjustment.distances, *adjustment.check_distances)
    if surveyed:
        yield _surveyed_grid(surveyed)


def _surveyed_grid(surveyed: tuple[SurveyedReliability, ...]) -> Grid:
    return Grid(
        title="Reliability of control and distances",
        columns=("point", "axis", "sigma (m)", "redundancy number", "smallest error found (m)", "its effect, not found (m)"),
        rows=tuple(
            (c.point, c.axis, c.sigma, round(c.redundancy, 3), _millimetres(c.detectable), _millimetres(c.effect)) for c in surveyed
        ),
        note="Smallest error found: 4.13 sigma / sqrt(r), by a test at 0.1 % with 80 % probability (Baarda). Its effect: (1 - r) "
        "times that on the adjusted coordinate or length; distances to check points have none, for they take no part. GNSS "
        "positions: products/surveyed_reliability.csv; groups of observations: the table of the orientation, and "
        "products/adjustment.json.",
    )


def _millimetres(value: float | None) -> float | None:
    return None if value is None else round(value, 4)


def _interior_grid(camera: InteriorStatement) -> Grid:
    rows = tuple(
        (name, value, sigma, *(round(c, 3) for c in row))
        for name, value, sigma, row in zip(camera.parameters, camera.values, camera.sigmas, camera.correlations, strict=True)
    )
    return Grid(
        title=f"Interior orientation of {camera.camera}: standard errors and correlations",
        columns=("parameter", "value", "standard error", *camera.parameters),
        rows=rows,
        note="c, x0, y0 in px, the others without unit. Each exterior orientation: products/exterior_precision.csv; pairs of "
        "parameters: products/interior_correlation.csv.",
    )
