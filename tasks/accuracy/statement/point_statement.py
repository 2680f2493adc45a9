"""The statement about the products of a project, from the tests at its points."""

import math
from collections.abc import Iterator

import numpy as np

from orthomill.schemas.accuracy.accuracy_statement import AccuracyFigure, AccuracyKind, AccuracyStatement, NamedError
from orthomill.schemas.accuracy.point_tests import HeightTest, PointTest, PointTests
from orthomill.schemas.accuracy.promised_errors import PromisedHeights
from orthomill.schemas.orientation import GroundResiduals
from orthomill.tasks.accuracy.statement.named_errors import heights_in_feet, named_errors
from orthomill.tasks.accuracy.statement.tested_accuracy import accuracy_of
from orthomill.tasks.accuracy.statement.tested_distances import tested_distances


def collect_tests(
    tests: tuple[PointTest, ...], ground: GroundResiduals, promised: tuple[PromisedHeights, ...], area_km2: float
) -> PointTests:
    """All points in one table, the distances to them, and what the surface promises elsewhere."""
    sigma = np.concatenate([np.zeros(0), *(part.sigma for part in promised)])
    return PointTests(
        points=tests,
        distances=tuple(d for d in ground.distances if d.role == "check"),
        area_km2=area_km2,
        surface_promised=float(np.sqrt((sigma**2).mean())) if len(sigma) else None,
    )


def statement_of(tests: PointTests) -> AccuracyStatement:
    """Figures of all kinds, shared errors by name, and what was not tested."""
    figures = tuple(filter(None, (_horizontal(tests), *_heights(tests), _space(tests))))
    return AccuracyStatement(
        figures=figures,
        named=_named(tests.points),
        distances=tested_distances(tests.distances),
        untested=tuple(_untested(tests.points)),
        level="tested" if figures else "promised",
    )


def _horizontal(tests: PointTests) -> AccuracyFigure | None:
    points = [p for p in tests.points if p.place_difference is not None]
    predicted = [p.place_predicted for p in points]
    promised = np.array(predicted) if predicted and all(p is not None for p in predicted) else None
    difference, survey = np.array([p.place_difference for p in points]), np.array([p.sigma[:2] for p in points])
    found = accuracy_of("horizontal", difference, survey, promised, tests.area_km2)
    return found and _less_measuring(found, points)


def _less_measuring(found: AccuracyFigure, points: list[PointTest]) -> AccuracyFigure:
    """With what measuring the places has in the differences: marks and matching are no error of the orthoimage, and how much of the
    differences they made nobody knows. The low end of the interval is what is left without them."""
    known = [p.place.sigma for p in points if p.place and p.place.sigma]
    if not known:
        return found
    measuring = float(np.sqrt((np.array(known) ** 2).sum(axis=1).mean()))
    left = math.sqrt(max(found.low**2 - found.survey**2 - measuring**2, 0.0))
    return found.model_copy(update={"measuring": measuring, "low": math.hypot(left, found.survey)})


def _heights(tests: PointTests) -> Iterator[AccuracyFigure | None]:
    """Of the surface and of the bare ground. A surface shows crowns: under vegetation it is tested only where no ground is made."""
    open_ground, under = ([p for p in tests.points if p.vegetated == vegetated] for vegetated in (False, True))
    yield _vertical("nva", [(p, p.height) for p in open_ground], tests.area_km2, tests.surface_promised)
    yield _vertical("vva", [(p, p.height) for p in under if not p.terrain], tests.area_km2)
    yield _vertical("nva_terrain", [(p, p.terrain) for p in open_ground], tests.area_km2)
    yield _vertical("vva_terrain", [(p, p.terrain) for p in under], tests.area_km2)


def _vertical(
    kind: AccuracyKind, heights: list[tuple[PointTest, HeightTest | None]], area_km2: float, everywhere: float | None = None
) -> AccuracyFigure | None:
    tested = [(point, height) for point, height in heights if point.difference(height) is not None]
    difference = np.array([[point.difference(height)] for point, height in tested])
    predicted = [point.predicted(height) for point, height in tested]
    promised = np.array(predicted)[:, None] if predicted and None not in predicted else None
    own = [height.sigma for _, height in tested if height and height.sigma is not None]
    surface = None
    if everywhere is not None and own and len(own) == len(tested):
        surface = float(np.sqrt((np.array(own) ** 2).mean())), everywhere
    return accuracy_of(kind, difference, np.array([point.sigma[2:] for point, _ in tested]), promised, area_km2, surface)


def _space(tests: PointTests) -> AccuracyFigure | None:
    points = [p for p in tests.points if p.place_difference and p.height_difference is not None and not p.vegetated]
    difference = np.array([(*(p.place_difference or ()), p.height_difference) for p in points])
    found = accuracy_of("three_dimensional", difference, np.array([p.sigma for p in points]), None, tests.area_km2)
    return found and _less_measuring(found, points)


def _named(points: tuple[PointTest, ...]) -> tuple[NamedError, ...]:
    if not points:
        return ()
    places = np.array([p.surveyed[:2] for p in points]).reshape(-1, 2)
    # Under vegetation a surface shows crowns: their height is no error that the whole has.
    open_ground = [None if p.vegetated else p.height_difference for p in points]
    height = np.array([math.nan if difference is None else difference for difference in open_ground])
    plan = np.array([p.place_difference or (math.nan, math.nan) for p in points]).reshape(-1, 2)
    sigma = np.array([p.sigma for p in points]).reshape(-1, 3)
    survey = float(np.sqrt((sigma[:, :2] ** 2).mean())), float(np.sqrt((sigma[:, 2] ** 2).mean()))
    surveyed = np.array([p.surveyed[2] for p in points])
    feet = heights_in_feet(surveyed, surveyed + height, survey[1])
    # Feet leave what looks like a shift and a tilt of the whole: the cause is told alone.
    named = named_errors(
        places, height * math.nan if feet else height, plan, survey, (_promised_place(points), _promised_datum(points)), surveyed
    )
    return (feet, *named) if feet else named


def _promised_place(points: tuple[PointTest, ...]) -> float | None:
    """Standard error (radial, m) that is promised for places in the orthoimage, over all points; None where one has none."""
    known = [p.place.promised if p.place else None for p in points if p.place_difference is not None]
    return float(np.sqrt((np.array(known) ** 2).sum(axis=1).mean())) if known and None not in known else None


def _promised_datum(points: tuple[PointTest, ...]) -> float | None:
    """Standard error (m) that the surface states for what its heights share; None where it states none."""
    known = [p.height.datum if p.height else None for p in points if p.height_difference is not None and not p.vegetated]
    return float(np.sqrt((np.array(known) ** 2).mean())) if known and None not in known else None


def _untested(points: tuple[PointTest, ...]) -> Iterator[tuple[str, str]]:
    for point in points:
        if point.height and not point.height.tested:
            yield point.name, f"height: {point.height.reason}"
        if point.terrain and not point.terrain.tested:
            yield point.name, f"ground: {point.terrain.reason}"
        if point.place and not point.place.tested:
            yield point.name, f"place: {point.place.reason}"
