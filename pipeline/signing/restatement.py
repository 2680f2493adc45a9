"""Whether the statement of accuracy in the products is the one that follows from the tests at the points beside it."""

from collections.abc import Callable
from pathlib import Path

from pydantic import ValidationError

from orthomill.schemas.accuracy.accuracy_statement import AccuracyStatement
from orthomill.schemas.accuracy.point_tests import PointTests

STATED, TESTS = "products/accuracy.json", "products/accuracy_points.json"


def restated(folder: Path, statement_of: Callable[[PointTests], AccuracyStatement]) -> str:
    """Computes the statement again; a sentence where it differs, "" where it is the same or there is none."""
    stated, tests = folder / STATED, folder / TESTS
    if not (stated.exists() and tests.exists()):
        return ""
    try:
        again = statement_of(PointTests.model_validate_json(tests.read_bytes()))
        same = again == AccuracyStatement.model_validate_json(stated.read_bytes())
    except (OSError, ValidationError):
        return f"{STATED} or {TESTS} cannot be read; write them again with: orthomill export"
    return "" if same else f"{STATED} does not follow from the tests in {TESTS}: one of them was changed, or is of another version"
