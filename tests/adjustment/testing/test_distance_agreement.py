"""Distances compared with each other in the scale of a model."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.tasks.adjustment.testing.distance_agreement import DEFORMATION, agreement

MODEL = np.array([10.0, 20.0, 15.0, 30.0, 12.0])
SIGMA, MODEL_SIGMA = np.full(5, 0.01), np.full(5, 1e-3)


def compared(length, count=5, limit=4.0):
    return agreement(length[:count], SIGMA[:count], MODEL[:count], MODEL_SIGMA[:count], limit)


@settings(max_examples=40, deadline=None)
@given(scale=st.floats(1e-3, 1e3))
def test_agreeing_distances_give_the_scale_of_the_model(scale):
    found = agreement(scale * MODEL, scale * SIGMA, MODEL, MODEL_SIGMA, 4.0)
    assert found.scale == pytest.approx(scale)
    assert not found.wrong.any() and (found.sigma == scale * SIGMA).all() and found.misfit == pytest.approx(np.zeros(5), abs=1e-6)


@pytest.mark.parametrize("wrong", range(5))
@pytest.mark.parametrize("count", [3, 5])
def test_one_wrong_distance_of_three_or_more_is_identified(wrong, count):
    length = 2.0 * MODEL
    length[wrong % count] += 1.0
    found = compared(length, count)
    assert list(np.flatnonzero(found.wrong)) == [wrong % count]
    assert found.scale == pytest.approx(2.0) and found.misfit[wrong % count] > 4.0
    assert (found.sigma == SIGMA[:count]).all()


def test_two_wrong_ones_that_mask_each_other_are_enlarged_instead_of_guessed():
    length = 2.0 * MODEL
    length[[1, 4]] += [3.0, -5.0]
    found = compared(length)
    assert not found.wrong.any() and found.scale == pytest.approx(2.0), "the median is right all the same"
    assert (found.sigma[[1, 4]] > 1.0).all() and (found.sigma[[0, 2, 3]] == SIGMA[0]).all()


def test_of_two_that_disagree_both_are_enlarged():
    found = compared(2.0 * MODEL + [0.0, 2.0, 0.0, 0.0, 0.0], 2)
    assert not found.wrong.any()
    assert (found.sigma > 20 * SIGMA[:2]).all()
    assert found.scale == pytest.approx(2.05) and found.sigma == pytest.approx([0.5, 1.0])


def test_a_tie_between_suspects_rejects_none():
    length = 2.0 * MODEL[:4]
    length[:2] *= 1.05
    found = compared(length, 4)
    assert not found.wrong.any() and (found.sigma > SIGMA[:4]).all()


def test_the_deformation_of_an_uncontrolled_block_is_no_contradiction():
    length = MODEL * (1.0 + DEFORMATION * np.array([1.0, -1.0, 1.0, -1.0, 1.0]))
    found = compared(length)
    assert not found.wrong.any() and (found.sigma == SIGMA).all() and found.misfit.max() < 4.0


def test_distances_that_the_model_lacks_are_left_out():
    model = MODEL.copy()
    model[2] = np.nan
    found = agreement(2.0 * MODEL + [0, 0, 9.0, 0, 0], SIGMA, model, MODEL_SIGMA, 4.0)
    assert not found.wrong.any() and found.misfit[2] == 0.0 and found.scale == pytest.approx(2.0)


def test_without_any_model_length_there_is_no_scale():
    found = agreement(MODEL, SIGMA, np.full(5, np.nan), MODEL_SIGMA, 4.0)
    assert found.scale == 1.0 and not found.wrong.any() and not found.misfit.any()


@pytest.mark.parametrize(("limit", "rejected"), [(4.0, True), (1e4, False)])
def test_the_limit_decides_what_is_a_contradiction(limit, rejected):
    length = 2.0 * MODEL
    length[1] += 1.0
    assert compared(length, limit=limit).wrong.any() == rejected
