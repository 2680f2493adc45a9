"""RMSE, classes, intervals and wording of products that were tested at points."""

import numpy as np
import pytest

from orthomill.tasks.accuracy.statement.tested_accuracy import accuracy_of, carried_over, interval, points_needed, wording

RNG = np.random.default_rng(39)


def accuracy(kind, difference, survey=0.0, promised=None, area=1.0):
    difference = np.asarray(difference, float)
    return accuracy_of(kind, difference, np.full(difference.shape, survey), promised, area)


def test_the_survey_of_the_points_is_part_of_the_accuracy():
    found = accuracy("nva", [[0.029], [-0.029]] * 10, survey=0.02)
    assert found.fit == pytest.approx(0.029) and found.rmse == pytest.approx(0.03523, abs=1e-5)
    assert found.class_cm == 4, "29 mm of differences at points of 20 mm are no class of 3 cm"


def test_horizontal_accuracy_is_radial():
    found = accuracy("horizontal", [[0.03, 0.04], [-0.03, 0.04]], survey=0.01)
    assert found.fit == pytest.approx(0.05) and found.survey == pytest.approx(np.sqrt(2) * 0.01)
    assert found.mean == pytest.approx(0.04) and found.robust is None


def test_too_few_points_have_the_wording_that_the_standard_prescribes():
    assert "for an 8-cm" in wording("nva", 0.08, 30, 30) and "meet an 11-cm" in wording("nva", 0.11, 3, 30)
    few, many = wording("nva", 0.035, 29, 30), wording("horizontal", 0.035, 30, 30)
    assert "using ONLY 29 checkpoints" in few and "was produced to meet a 4-cm" in few and "NVA" in few
    assert "tested to meet" in many and "ONLY" not in many and many.endswith("RMSE_H = 3.5 cm.")


@pytest.mark.parametrize(("area", "needed"), [(0.1, 30), (1000, 30), (1001, 40), (9500, 120), (1e6, 120)])
def test_larger_areas_need_more_points(area, needed):
    assert points_needed(area) == needed


@pytest.mark.parametrize("dimensions", [1, 2, 3])
@pytest.mark.parametrize("bias", [0.0, 1.5])
def test_the_interval_holds_the_truth_as_often_as_it_says(dimensions, bias):
    truth = np.sqrt(dimensions * (1 + bias**2))
    bounds = [interval(RNG.normal(bias, 1, (20, dimensions))) for _ in range(1500)]
    assert np.mean([low <= truth <= high for low, high in bounds]) >= 0.93
    assert np.mean([high < truth for _, high in bounds]) <= 0.045


def test_the_interval_is_that_of_the_surface_where_few_points_meet_what_is_worse():
    """Two of a hundred places have, and promise, six times the error of the others."""
    promised = np.where(np.arange(2000) < 40, 0.3, 0.05)
    truth, held, plain, too_good = np.sqrt((promised**2).mean()), [], [], []
    for _ in range(1500):
        own = promised[RNG.choice(len(promised), 20, replace=False)]
        found = interval(RNG.normal(0, own)[:, None])
        low, high = carried_over(found, (np.sqrt((own**2).mean()), truth))
        held.append(low <= truth <= high)
        plain.append(found[0] <= truth <= found[1])
        too_good.append(high < truth)
    assert np.mean(held) > 0.93 and np.mean(too_good) < 0.045 and np.mean(plain) < 0.8


def test_what_points_and_surface_promise_alike_leaves_the_interval():
    assert carried_over((0.02, 0.05), (0.03, 0.03)) == pytest.approx((0.02, 0.05))
    assert carried_over((0.02, 0.05), (0.05, 0.01)) == pytest.approx((0.0, 0.05)), "points on the worst ground prove no less"


def test_one_point_proves_nothing():
    found = accuracy("nva", [[0.01]])
    assert found.low == 0 and found.high is None and found.proved_cm is None and not found.formal
    assert accuracy_of("nva", np.zeros((0, 1)), np.zeros((0, 1)), None, 1.0) is None


def test_what_was_promised_is_held_against_what_was_found():
    found = accuracy("nva", [[0.1], [-0.1]], promised=np.full((2, 1), 0.02))
    assert found.promised == pytest.approx(5)
