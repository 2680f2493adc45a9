"""Promised errors against what was found, and the reliability of control."""

import numpy as np
import pytest

from orthomill.schemas.accuracy.point_tests import PointTests
from orthomill.schemas.accuracy.promised_errors import Reliability
from orthomill.schemas.epipolar import EpipolarPair, EpipolarPairs
from orthomill.schemas.orientation import DistanceResidual, GroundResidual, GroundResiduals
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import SurfacePoints
from orthomill.tasks.accuracy.adjustment.adjustment_statement_of import correlations_of
from orthomill.tasks.accuracy.promises.disjoint_pairs import CheckedPart, pair_differences
from orthomill.tasks.accuracy.promises.kept_promises import kept, reliability_of
from orthomill.tasks.accuracy.report.adjustment_words import promise_chart, promise_doubts, promise_warnings

RNG = np.random.default_rng(7)


def pairs(count, times):
    return [[(float(d), 1.0)] for d in times * RNG.normal(0, 1, count)]


@pytest.mark.parametrize(("times", "holds", "too_sure"), [(1.0, True, False), (3.0, False, True), (0.2, False, False)])
def test_promises_that_hold_and_others_are_told_apart(times, holds, too_sure):
    found = kept("points", True, pairs(200, times))
    assert found.holds is holds and found.too_sure is too_sure
    assert found.factor == pytest.approx(times, rel=0.15)
    assert bool(list(promise_warnings(Reliability(kinds=(found,))))) is too_sure


@pytest.mark.parametrize(("inside", "count", "doubts"), [(6, 14, 0), (0, 3, 0), (2, 14, 1)])
def test_what_may_be_chance_is_a_warning_and_no_doubt(inside, count, doubts):
    found = Reliability(kinds=(kept("distances", True, [[(0.5 if i < inside else 1.5, 1.0)] for i in range(count)]),))
    (sentence,) = promise_warnings(found)
    assert len(list(promise_doubts(found))) == doubts
    assert ("Errors may have been promised too well" in sentence) == (not doubts)
    assert inside != 6 or "in one of 23 such sets by chance" in sentence


def test_few_points_prove_little():
    few = kept("points", True, pairs(4, 1.0))
    assert few.high[0] - few.low[0] > 0.5


def test_observations_that_nothing_checks_are_no_proof():
    assert kept("distances", False, [[(0.0, 0.0)]]) is None
    row = GroundResidual(name="a", role="position", difference=(0.1, 0.1, 0.1), predicted=(0.1, 0.2, 0.0), photos=1)
    (found,) = reliability_of(PointTests(), GroundResiduals(points=(row,))).kinds
    assert found.values == 2 and found.items == 1 and not found.independent


def test_distances_to_check_points_are_independent_and_those_that_took_part_are_not():
    known = {"first": "a", "second": "b", "length": 10.0, "predicted": 0.01}
    rows = tuple(DistanceResidual(**known, difference=d, role=role) for d, role in ((0.005, "check"), (0.02, "control")))
    checks, used = reliability_of(PointTests(), GroundResiduals(distances=rows)).kinds
    assert (checks.kind, checks.independent, checks.within[0]) == ("distances to check points", True, 1.0)
    assert (used.kind, used.independent, used.within[0]) == ("measured distances, left out in turn", False, 0.0)


def test_correlations_come_from_covariances():
    found = correlations_of(np.array([[4.0, -3.0, 0.0], [-3.0, 9.0, 0.0], [0.0, 0.0, 0.0]]))
    assert found[0, 1] == pytest.approx(-0.5) and found[0, 0] == 1 and not found[2].any()


def pair(name: str, left: str, right: str) -> EpipolarPair:
    row, three = (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    sizes = dict.fromkeys(("c", "base", "base_height"), 1.0) | dict.fromkeys(("rows", "left_cols", "right_cols"), 9)
    zero = dict.fromkeys(("row0", "left_col0", "right_col0", "parallax_low", "parallax_high", "row_sigma"), 0.0)
    return EpipolarPair(
        name=name, left=left, right=right, rotation=(row, row, row), left_centre=three, right_centre=three, **sizes, **zero
    )


PAIRS = EpipolarPairs(pairs=(pair("a-b", "a", "b"), pair("c-d", "c", "d"), pair("b-c", "b", "c")))
GRID = MapGrid(west=0.0, north=600.0, cell=1.0, rows=600, cols=600)


def slope() -> np.ndarray:
    x, y = GRID.centres(Window(0, 0, 600, 600))
    return 100.0 + 0.5 * x[None, :] + 0.2 * y[:, None]


def matched(window: Window, sources: tuple[int, ...]) -> SurfacePoints:
    """Points of pairs anywhere in the cells of a window, off a slope by errors of 0.1 m."""
    rng = np.random.default_rng(window.row)
    x, y = (np.repeat(a.ravel(), len(sources)) for a in np.meshgrid(*GRID.centres(window)))
    x, y = x + rng.uniform(-0.4, 0.4, len(x)), y + rng.uniform(-0.4, 0.4, len(x))
    z = 100.0 + 0.5 * x + 0.2 * y + rng.normal(0, 0.1, len(x))
    ones = np.ones(len(x))
    source = np.tile(np.array(sources, np.uint16), len(x) // len(sources))
    return SurfacePoints(x, y, z, 0.1 * ones.astype(np.float32), (2 * ones).astype(np.uint8), (2 * ones).astype(np.uint8), source)


def test_two_pairs_without_a_common_photograph_test_each_others_heights_on_a_slope():
    window = Window(60, 0, 480, 600)
    part = CheckedPart(GRID, window.grown(1).clipped(GRID.shape))
    heights = slope()[part.window.slices]
    found = pair_differences(matched(window, (3, 1, 2)), heights, PAIRS, part)
    assert len(found) == 40 * 50 and found.promised == pytest.approx(0.1 * 2**0.5, rel=1e-5)
    (kind,) = reliability_of(PointTests(), GroundResiduals(), (found,)).kinds
    assert kind.holds and kind.items == 2000 and not kind.independent and kind.factor == pytest.approx(1.0, abs=0.06)
    assert not len(pair_differences(matched(window, (3, 1)), heights, PAIRS, part)), "b is in both"


def test_a_reliability_diagram_has_a_colour_for_each_line():
    """Eleven kinds in six colours could not be told apart."""
    kinds = [kept(f"kind {i}", i < 7, [[(0.5, 1.0)]]) for i in range(9)]
    charts = promise_chart(Reliability(kinds=tuple(kinds)))
    assert [len(chart.series) for chart in charts] == [6, 3, 3] and len({chart.title for chart in charts}) == 3
    assert [name for chart in charts for name in chart.series if name != "normal errors"] == [kind.kind for kind in kinds]
    assert promise_chart(Reliability()) == ()
