"""The report of `accuracy`: what the products are worth by independent points, in the standard's words and in plain ones."""

from collections import Counter
from collections.abc import Iterator

from orthomill.schemas.accuracy.accuracy_statement import AccuracyFigure, AccuracyKind, AccuracyStatement
from orthomill.schemas.accuracy.adjustment_statement import AdjustmentStatement
from orthomill.schemas.accuracy.point_tests import HeightTest, PointTest, PointTests
from orthomill.schemas.accuracy.promised_errors import Reliability
from orthomill.schemas.stage_report import Accuracy, Answer, Evidence, Figure, Grid, Product, StageReport, Topic, Verdict
from orthomill.tasks.accuracy.report.adjustment_words import (
    adjustment_grids,
    promise_chart,
    promise_doubts,
    promise_figures,
    promise_grid,
    promise_warnings,
)
from orthomill.tasks.accuracy.report.single_points import REALISTIC, SinglePoint, single_points

_WORDS: dict[AccuracyKind, str] = {
    "horizontal": "in plan (orthoimage)",
    "nva": "in height (surface, open ground)",
    "vva": "in height (surface, under vegetation)",
    "nva_terrain": "in height (bare ground, open)",
    "vva_terrain": "in height (bare ground under vegetation)",
    "three_dimensional": "in space",
}
_PRODUCTS: dict[AccuracyKind, tuple[Accuracy, tuple[str, ...]]] = {
    "horizontal": ("plan", ("products/ortho.tif",)),
    "nva": ("height", ("products/dsm.tif",)),
    "nva_terrain": ("height", ("products/terrain.tif",)),
}
_FILES = (
    Product(path="products/accuracy.json", purpose="What is stated of the accuracy, with its evidence"),
    Product(path="products/accuracy_points.json", purpose="The products at each check point"),
    Product(path="products/reliability.json", purpose="Promised errors beside what independent observations found"),
    Product(path="products/adjustment.json", purpose="Cameras with correlations, variance components, reliability, receivers"),
    Product(path="products/exterior_precision.csv", purpose="Standard errors and correlations of every exterior orientation"),
    Product(path="products/interior_correlation.csv", purpose="Correlations of the interior parameters"),
    Product(
        path="products/surveyed_reliability.csv",
        purpose="Smallest errors found of control, GNSS positions and distances, and their effect",
    ),
)
NOTHING = (
    "Nothing is proved: {why}. What is stated is the precision that the adjustment promises, and how well "
    "photographs and surface agree; errors that both share are in neither."
)


def accuracy_report(
    tests: PointTests, statement: AccuracyStatement, reliability: Reliability, adjustment: AdjustmentStatement
) -> StageReport:
    """Verdict, figures and tables of the products tested at the points."""
    tested = tuple(_warnings(tests, statement))
    return StageReport(
        verdict=_verdict(tests, statement),
        answers=tuple(_answers(statement)),
        products=_FILES,
        evidence=tuple(_evidence(statement)),
        figures=(*_figures(statement), *promise_figures(reliability)),
        grids=(*_grids(tests, statement), promise_grid(reliability), *adjustment_grids(adjustment)),
        charts=promise_chart(reliability),
        doubts=(*_doubts(statement, tested), *promise_doubts(reliability)),
        warnings=(*tested, *promise_warnings(reliability)),
    )


def _verdict(tests: PointTests, statement: AccuracyStatement) -> Verdict:
    if not statement.figures:
        why = "there are no check points"
        if tests.points:
            reasons = [test.reason for point in tests.points for test in (point.height, point.place) if test and not test.tested]
            most = f" (mostly: {Counter(reasons).most_common(1)[0][0].rstrip('.')})" if reasons else ""
            why = f"no product could be tested at any of {_points(len(tests.points))}{most}"
        # Without check points the block says so of itself.
        return Verdict(level="fair", sentence=NOTHING.format(why=why), weighs=bool(tests.points))
    told = "; ".join(_short(figure) for figure in statement.figures if figure.kind != "three_dimensional")
    contradicted = any(figure.promised and figure.promised > REALISTIC for figure in statement.figures)
    level = "poor" if contradicted else "good" if all(figure.formal for figure in statement.figures) else "fair"
    return Verdict(level=level, sentence=f"Products tested at independent points: {told}.", weighs=True)


def _short(figure: AccuracyFigure) -> str:
    own = figure.measuring or 0.0
    marks = f", of which the marks may be {_length(own)}" if own > 0.3 * figure.fit else ""
    return f"{_length(figure.rmse)} {_WORDS[figure.kind]} at {_points(figure.points)}{marks}"


def _answers(statement: AccuracyStatement) -> Iterator[Answer]:
    for kind, topic in (("horizontal", Topic.ACCURACY_PLAN), ("nva", Topic.ACCURACY_HEIGHT)):
        figure = statement.of(kind)  # type: ignore[arg-type]
        if figure:
            sure = f"{_length(figure.low)} to {_length(figure.high)}" if figure.high is not None else "one point tells no interval"
            product = "orthoimage" if kind == "horizontal" else "surface"
            text = f"{_length(figure.rmse)} ({product} at {_points(figure.points)}, the survey's own error in it; 95 %: {sure})"
            yield Answer(topic=topic, text=text)


def _evidence(statement: AccuracyStatement) -> Iterator[Evidence]:
    for kind, (of, products) in _PRODUCTS.items():
        if figure := statement.of(kind):
            formal = "" if figure.formal else f"; a formal statement needs {figure.needed}"
            proved = f", {figure.proved_cm} cm proved with 97.5 %" if figure.proved_cm else ""
            source = f"from {_points(figure.points)} in the product itself{proved}{formal}"
            yield Evidence(of=of, rmse=figure.rmse, source=source, products=products)


def _figures(statement: AccuracyStatement) -> Iterator[Figure]:
    yield Figure(name="level", value=statement.level, sentence="tested by independent points, or promised only.")
    if found := statement.distances:
        yield Figure(name="distances_scale", value=round(found.scale, 1), unit="ppm", sentence=found.sentence)
        yield Figure(
            name="distances_fit", value=round(found.fit, 4), unit="m", sentence="Root mean square of block minus distance."
        )
    for figure in statement.figures:
        name, words = figure.kind, _WORDS[figure.kind]
        rest = (
            ("points", figure.points, "", "Points at which it was tested."),
            ("rmse", round(figure.rmse, 4), "m", f"Accuracy {words}: root of the sum of squares of differences and survey."),
            ("rmse_low", round(figure.low, 4), "m", "Lower end of its 95 % confidence interval."),
            ("rmse_high", figure.high and round(figure.high, 4), "m", "Upper end: so few points prove no more."),
            ("fit", round(figure.fit, 4), "m", "Root mean square of the differences alone."),
            ("survey", round(figure.survey, 4), "m", "Root mean square of the survey's stated errors."),
            ("measuring", figure.measuring and round(figure.measuring, 4), "m", "Of these, what measuring the places may be."),
            ("mean", round(figure.mean, 4), "m", "Mean difference: what all share."),
            ("nmad", figure.robust and round(figure.robust, 4), "m", "Robust spread of the differences."),
            (
                "promised_here",
                figure.promised_here and round(figure.promised_here, 4),
                "m",
                "What the surface promises at these points (root mean square).",
            ),
            (
                "promised_everywhere",
                figure.promised_everywhere and round(figure.promised_everywhere, 4),
                "m",
                "The same wherever points could test it; the interval is widened by the difference.",
            ),
            ("at_68", figure.at_68 and round(figure.at_68, 4), "m", "68.3 % of the differences are no larger (counted)."),
            ("at_90", round(figure.at_90, 4), "m", "90 % of the differences are no larger (LE90, CE90, counted)."),
            ("at_95", round(figure.at_95, 4), "m", "95 % of the differences are no larger (counted)."),
            ("by_promised", figure.promised and round(figure.promised, 2), "", "Differences in units of their promised errors."),
            ("class", figure.class_cm, "cm", "Accuracy class by the formula of ASPRS edition 2."),
            ("class_proved", figure.proved_cm, "cm", "The class that the test proves with 97.5 %."),
        )
        for key, value, unit, sentence in rest:
            headline = key == "rmse"
            yield Figure(name=f"{name}_{key}", value=value, unit=unit, sentence=sentence, headline=headline, detail=not headline)


def _grids(tests: PointTests, statement: AccuracyStatement) -> Iterator[Grid]:
    if statement.figures:
        rows = tuple((_WORDS[figure.kind], figure.sentence, figure.points, figure.needed) for figure in statement.figures)
        note = "RMSE: root of the sum of squares of the differences' root mean square and the survey's, as edition 2 asks for."
        yield Grid(title="As the standard words it", columns=("accuracy", "statement", "points", "needed"), rows=rows, note=note)
    if tests.points:
        columns = (
            "point",
            "dX (m)",
            "dY (m)",
            "sigma plan (m)",
            "dZ (m)",
            "promised Z (m)",
            "dZ checked (m)",
            "dZ ground (m)",
            "block dX",
            "dY",
            "dZ",
            "note",
        )
        note = "Products minus survey; block: rays of the photographs minus survey. A note says why a product is not tested there."
        yield Grid(title="Products at the check points", columns=columns, rows=tuple(map(_row, tests.points)), note=note)


def _row(test: PointTest) -> tuple[float | int | str | None, ...]:
    plan, block = test.place_difference, test.block or (None, None, None)
    sigma = max(test.place.sigma) if plan and test.place and test.place.sigma else None
    corrected = test.corrected.counted if test.corrected else None
    checked = None if corrected is None else corrected - test.surveyed[2]
    notes = ["under vegetation"] if test.vegetated else []
    notes += [_why_not(test.height, test.surveyed[2])] if test.height and not test.height.tested else []
    notes += [f"ground: {test.terrain.reason}"] if test.terrain and not test.terrain.tested else []
    notes += [f"place: {test.place.reason}"] if test.place and not test.place.tested else []
    values = (
        *(plan or (None, None)),
        sigma,
        test.height_difference,
        test.height_predicted,
        checked,
        test.difference(test.terrain),
        *block,
    )
    return (test.name, *(None if v is None else round(v, 4) for v in values), "; ".join(notes))


def _doubts(statement: AccuracyStatement, warnings: tuple[str, ...]) -> Iterator[str]:
    """Warnings without the shared errors that are within what was promised: those are noticed, and no reason to doubt."""
    promised = {error.sentence for error in statement.named if error.is_promised}
    yield from (sentence for sentence in warnings if sentence not in promised)


def _why_not(height: HeightTest, surveyed: float) -> str:
    """The reason, and the difference all the same where there is one: what is not counted is shown."""
    there = "" if height.height is None else f" ({height.height - surveyed:+.3f} m, not counted)"
    return f"height: {height.reason}{there}"


def _warnings(tests: PointTests, statement: AccuracyStatement) -> Iterator[str]:
    yield from (error.sentence for error in statement.named)
    alone = {figure.kind: single_points(tests, figure.kind) for figure in statement.figures}
    for figure in statement.figures:
        # A point that is wrong by itself makes any factor, and says nothing of what is promised.
        if figure.promised and figure.promised > REALISTIC and not alone[figure.kind]:
            yield (
                f"Differences {_WORDS[figure.kind]} are {figure.promised:.1f} times what was promised for them: the "
                "stated standard errors are too small here, by that factor."
            )
    yield from _single(alone)
    rough = sum(bool(test.height and "edge" in test.height.reason) for test in tests.points if not test.vegetated)
    if rough > max(1, len(tests.points) / 3):
        yield (
            f"At {rough} of {len(tests.points)} check points the surface is no plane within three cells, so that its height is not "
            "tested there: points beside edges, or a surface rougher than it states. Look at them in the table."
        )


def _single(alone: dict[AccuracyKind, tuple[SinglePoint, ...]]) -> Iterator[str]:
    told: set[str] = set()
    for kind, points in alone.items():
        words = "surface" if kind in ("nva", "vva") else "bare ground"
        for point in points:
            if point.name not in told:
                yield (
                    f"At check point {point.name} the {words} is {point.difference:+.2f} m off, {point.times:.1f} times what "
                    "is promised there, while the others fit: look at its height in the survey, and at the place. It is counted."
                )
        told.update(point.name for point in points)


def _points(count: int) -> str:
    return "1 check point" if count == 1 else f"{count} check points"


def _length(metres: float) -> str:
    return f"{1000 * metres:.0f} mm" if metres < 0.1 else f"{metres:.2f} m"
