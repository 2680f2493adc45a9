"""Simulated flights, each with errors of its own, run as a user runs them and surveyed: does what is stated of their products hold?

    python -m benchmarks surveyed_flights [FOLDER] [count=N]

FOLDER (default runs/surveyed_flights) keeps the flights: what was flown and run there is not computed again. Every flight has its
own town, camera, lens, layout, noise, receiver, control and check points, and everything that is known of these has errors. The
check points are surveys of 20, each stated by the functions that the stage `accuracy` calls; the truth is that of all places where
the surface can be tested.
"""

import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.accuracy.flight_plans import Plan, plans
from benchmarks.accuracy.flown_project import fly, process
from benchmarks.accuracy.stated_classes import GROSS, ceiling, root_mean_square, share, tested_places
from benchmarks.accuracy.true_places import shown_aside
from benchmarks.instrument.result_page import write_page
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.accuracy.accuracy_statement import AccuracyFigure, AccuracyKind, AccuracyStatement, class_of
from orthomill.schemas.accuracy.point_tests import POINT_TESTS, PointTests
from orthomill.tasks.accuracy.statement.point_statement import statement_of

FLIGHTS, POINTS = 20, 20
"""flights, and check points of a survey"""


@dataclass(frozen=True)
class Surveyed:
    """A flight that was run: the tests at its check points, and at all testable places the errors of heights, what is promised for
    them in all and by the block's place (N,), and the errors of places in the orthoimage (N, 2), NaN where it shows none; m."""

    plan: Plan
    tests: PointTests
    errors: np.ndarray
    promised: np.ndarray
    datum: np.ndarray
    aside: np.ndarray

    @property
    def surveys(self) -> list[AccuracyStatement]:
        """What each survey of 20 points states."""
        points = self.tests.points
        parts = (points[k : k + POINTS] for k in range(0, len(points) - POINTS + 1, POINTS))
        return [statement_of(self.tests.model_copy(update={"points": part})) for part in parts]

    @property
    def true_height(self) -> float:
        """Root mean square, m, of all but blunders."""
        return root_mean_square(self.errors[np.abs(self.errors) <= GROSS * self.promised])

    @property
    def true_place(self) -> float:
        """Root mean square (radial, m) of all but blunders."""
        length = np.hypot(*self.aside[np.isfinite(self.aside).all(axis=1)].T)
        return root_mean_square(length[length <= GROSS * np.median(length)])

    def truth(self, figure: AccuracyFigure) -> float:
        """What a figure should state, m: the survey is in the differences and, by the standard, added to them."""
        own, coordinates = (self.true_height, 1) if figure.kind == "nva" else (self.true_place, 2)
        return math.sqrt(own**2 + 2 * coordinates * self.plan.survey_sigma**2)


def surveyed(plan: Plan, root: Path) -> Surveyed:
    """The flight of a plan, from the folder `root` or flown and run there."""
    file = root / "found" / f"{plan.name}.json"
    if not file.exists():
        flown = fly(plan, root)
        run = process(plan, root, flown)
        places, errors, promised, datum = tested_places(run, flown)
        found = {"errors": errors, "promised": promised, "datum": datum, "aside": shown_aside(run, flown, places)}
        tests = Store(run).table(POINT_TESTS).model_dump(mode="json")
        file.parent.mkdir(exist_ok=True)
        file.write_text(json.dumps({"tests": tests, **{name: values.tolist() for name, values in found.items()}}))
    kept = json.loads(file.read_text())
    arrays = (np.array(kept[name], np.float64) for name in ("errors", "promised", "datum", "aside"))
    return Surveyed(plan, PointTests.model_validate(kept["tests"]), *arrays)


_HEAD = (
    "| statements | number | interval holds truth (%) | class range holds truth (%) | proved class better (%) "
    "| plain class right (%) | ceiling (%) | plain class better (%) |"
)


def statements_row(name: str, kind: AccuracyKind, stated: Iterable[tuple[Surveyed, AccuracyStatement]]) -> str:
    """Statements of many surveys beside the truth."""
    found = [(flight.truth(figure), figure) for flight, one in stated if (figure := one.of(kind))]
    held = [figure.low <= truth <= (figure.high or math.inf) for truth, figure in found]
    ranged = [class_of(figure.low) <= class_of(truth) <= (figure.proved_cm or math.inf) for truth, figure in found]
    better = [(figure.proved_cm or math.inf) < class_of(truth) for truth, figure in found]
    right = [figure.class_cm == class_of(truth) for truth, figure in found]
    plain = [figure.class_cm < class_of(truth) for truth, figure in found]
    best = float(np.mean([ceiling(truth, figure.points) for truth, figure in found]))
    start = f"| {name} | {len(found)} | {share(held)} | {share(ranged)} | {share(better)}"
    return f"{start} | {share(right)} | {best:.1f} | {share(plain)} |"


def flight_row(flight: Surveyed) -> str:
    """One flight: what is known of it, its true errors, and what the first survey states."""
    plan, first = flight.plan, flight.surveys[0]
    camera = "calibrated" if plan.calibrated else "by its tags"
    known = f"{plan.number} | {plan.receiver}, {plan.control} control points | {camera} | {plan.pixel:.2f}"
    mean, datum = float(np.median(flight.errors)), root_mean_square(flight.datum)
    ratio = root_mean_square(np.clip(flight.errors / flight.promised, -GROSS, GROSS))
    true = f"{1000 * flight.true_height:.0f} | {mean / datum:+.1f} | {ratio:.2f} | {_stated(first.of('nva'))}"
    named = ", ".join(error.kind for error in first.named) or "none"
    return f"| {known} | {true} | {1000 * flight.true_place:.0f} | {_stated(first.of('horizontal'))} | {named} |"


def _stated(figure: AccuracyFigure | None) -> str:
    if figure is None:
        return "-"
    high = f"{1000 * figure.high:.0f}" if figure.high else "?"
    return f"{1000 * figure.rmse:.0f} ({1000 * figure.low:.0f} to {high}; {figure.points})"


def page(flights: list[Surveyed]) -> str:
    """Shares of all surveys, then the flights."""
    every = [(flight, one) for flight in flights for one in flight.surveys]
    once = [(flight, flight.surveys[0]) for flight in flights]
    whole = [(flight, statement_of(flight.tests)) for flight in flights]
    kinds: tuple[tuple[str, AccuracyKind], ...] = (("heights", "nva"), ("places", "horizontal"))
    rows = [
        statements_row(f"{word}, {name}", kind, part)
        for word, kind in kinds
        for name, part in (
            (f"the first survey of each flight, {POINTS} points", once),
            (f"all surveys of {POINTS} points", every),
            ("all points of each flight as one survey", whole),
        )
    ]
    gross = sum(int((np.abs(flight.errors) > GROSS * flight.promised).sum()) for flight in flights)
    level = np.array([float(np.median(flight.errors)) / root_mean_square(flight.datum) for flight in flights])
    one, two = (share([bool(abs(value) <= limit) for value in level]) for limit in (1, 2))
    return "\n".join(
        [
            "# Surveyed flights: what is stated of products, and the truth",
            "",
            f"{len(flights)} simulated flights, each with its own town, camera, lens, layout, noise, receiver and control, whose",
            "errors are its own: constants off by a rounded focal length or by the calibration, no lens known or one with errors,",
            "positions with an offset, a drift and noise, control and check points with those of their survey, marks with those of",
            "a hand. Run as a user runs them, default settings, from photographs to the stage `accuracy`.",
            "",
            _HEAD,
            "| --- | --- | --- | --- | --- | --- | --- | --- |",
            *rows,
            "",
            "Class range: from the class of the interval's lower end to the proved class. Plain class: by the standard's formula",
            "alone. Ceiling: how often the most probable class is the right one at best, from so many points with normal errors.",
            "The truth is the root mean square at up to 3000 places of each surface where a point can test it, and that of the",
            "places of the orthoimage there; the survey's part is in what is stated and in it. What measuring places in an",
            "orthoimage adds, marks above all, is in the plain class, and in no interval's low end.",
            f"{gross} heights beyond {GROSS:g} promised errors are in no truth.",
            "",
            f"The level of surfaces (median error) lies within 1 and 2 standard errors of the block's place in {one} and {two} %",
            f"of flights (root mean square {root_mean_square(level):.2f}).",
            "",
            "## Flights",
            "",
            "| flight | positions, control | camera | ground pixel m | true heights mm | level / promised | errors / promised "
            "| stated by the first survey mm (interval; points) | true places mm | stated mm | named by it |",
            "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
            *map(flight_row, flights),
        ]
    )


def main(words: list[str]) -> None:
    """Fly what was not flown yet, and write the page."""
    given = dict(word.split("=") for word in words if "=" in word)
    root = Path(next((word for word in words if "=" not in word), "runs/surveyed_flights")).resolve()
    flights = []
    for plan in plans(int(given.get("count", FLIGHTS))):
        flights.append(surveyed(plan, root))
        print(flight_row(flights[-1]), flush=True)
    write_page("surveyed_flights", words, page(flights))
