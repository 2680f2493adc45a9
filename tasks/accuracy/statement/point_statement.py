"""The statement about the products of a project, from the tests at its points."""

import math
from collections.abc import Iterator

import numpy as np

from orthomill.schemas.accuracy.accuracy_statement import AccuracyFigure, AccuracyStatement, NamedError
from orthomill.schemas.accuracy.point_tests import PointTest, PointTests
from orthomill.tasks.accuracy.statement.named_errors import named_errors
from orthomill.tasks.accuracy.statement.tested_accuracy import accuracy_of


def collect_tests(tests: tuple[PointTest, ...], area_km2: float) -> PointTests:
    """All points in one table."""
    return PointTests(points=tests, area_km2=area_km2)


def statement_of(tests: PointTests) -> AccuracyStatement:
    """Figures of all kinds, shared errors by name, and what was not tested."""
    figures = tuple(filter(None, (_horizontal(tests), _vertical(tests, False), _vertical(tests, True), _space(tests))))
    return AccuracyStatement(
        figures=figures,
        named=_named(tests.points),
        untested=tuple(_untested(tests.points)),
        level="tested" if figures else "promised",
    )


def _horizontal(tests: PointTests) -> AccuracyFigure | None:
    points = [p for p in tests.points if p.place_difference is not None]
    predicted = [p.place_predicted for p in points]
    promised = np.array(predicted) if predicted and all(p is not None for p in predicted) else None
    difference, survey = np.array([p.place_difference for p in points]), np.array([p.sigma[:2] for p in points])
    found = accuracy_of("horizontal", difference, survey, promised, tests.area_km2)
    places = np.array([p.place.sigma for p in points if p.place and p.place.sigma])
    return found and found.model_copy(update={"measuring": float(np.sqrt((places**2).sum(axis=1).mean()))})


def _vertical(tests: PointTests, vegetated: bool) -> AccuracyFigure | None:
    points = [p for p in tests.points if p.height_difference is not None and p.vegetated == vegetated]
    difference, survey = np.array([[p.height_difference] for p in points]), np.array([p.sigma[2:] for p in points])
    predicted = [p.height_predicted for p in points]
    promised = np.array(predicted)[:, None] if predicted and all(p is not None for p in predicted) else None
    return accuracy_of("vva" if vegetated else "nva", difference, survey, promised, tests.area_km2)


def _space(tests: PointTests) -> AccuracyFigure | None:
    points = [p for p in tests.points if p.place_difference and p.height_difference is not None and not p.vegetated]
    difference = np.array([(*(p.place_difference or ()), p.height_difference) for p in points])
    return accuracy_of("three_dimensional", difference, np.array([p.sigma for p in points]), None, tests.area_km2)


def _named(points: tuple[PointTest, ...]) -> tuple[NamedError, ...]:
    if not points:
        return ()
    places = np.array([p.surveyed[:2] for p in points]).reshape(-1, 2)
    height = np.array([math.nan if p.height_difference is None else p.height_difference for p in points])
    plan = np.array([p.place_difference or (math.nan, math.nan) for p in points]).reshape(-1, 2)
    sigma = np.array([p.sigma for p in points]).reshape(-1, 3)
    survey = float(np.sqrt((sigma[:, :2] ** 2).mean())), float(np.sqrt((sigma[:, 2] ** 2).mean()))
    return named_errors(places, height, plan, survey)


def _untested(points: tuple[PointTest, ...]) -> Iterator[tuple[str, str]]:
    for point in points:
        if point.height and not point.height.tested:
            yield point.name, f"height: {point.height.reason}"
        if point.place and not point.place.tested:
            yield point.name, f"place: {point.place.reason}"
