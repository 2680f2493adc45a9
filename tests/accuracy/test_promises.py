"""Promised errors against what was found, and the reliability of control."""

import numpy as np
import pytest

from orthomill.schemas.accuracy.point_tests import PointTests
from orthomill.schemas.accuracy.promised_errors import Reliability
from orthomill.schemas.orientation import GroundResidual, GroundResiduals
from orthomill.tasks.accuracy.adjustment.adjustment_statement_of import correlations_of
from orthomill.tasks.accuracy.promises.kept_promises import kept, reliability_of
from orthomill.tasks.accuracy.report.adjustment_words import promise_warnings

RNG = np.random.default_rng(7)


def pairs(count, times):
    return [[(float(d), 1.0)] for d in times * RNG.normal(0, 1, count)]


@pytest.mark.parametrize(("times", "holds", "too_sure"), [(1.0, True, False), (3.0, False, True), (0.2, False, False)])
def test_promises_that_hold_and_others_are_told_apart(times, holds, too_sure):
    found = kept("points", True, pairs(200, times))
    assert found.holds is holds and found.too_sure is too_sure
    assert found.factor == pytest.approx(times, rel=0.15)
    assert bool(list(promise_warnings(Reliability(kinds=(found,))))) is too_sure


def test_few_points_prove_little():
    few = kept("points", True, pairs(4, 1.0))
    assert few.high[0] - few.low[0] > 0.5


def test_observations_that_nothing_checks_are_no_proof():
    assert kept("distances", False, [[(0.0, 0.0)]]) is None
    row = GroundResidual(name="a", role="position", difference=(0.1, 0.1, 0.1), predicted=(0.1, 0.2, 0.0), photos=1)
    (found,) = reliability_of(PointTests(), GroundResiduals(points=(row,))).kinds
    assert found.values == 2 and found.items == 1 and not found.independent


def test_correlations_come_from_covariances():
    found = correlations_of(np.array([[4.0, -3.0, 0.0], [-3.0, 9.0, 0.0], [0.0, 0.0, 0.0]]))
    assert found[0, 1] == pytest.approx(-0.5) and found[0, 0] == 1 and not found[2].any()
