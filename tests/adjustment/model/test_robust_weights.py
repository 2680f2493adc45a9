"""Huber's weights and losses, and the robust spread."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.tasks.adjustment.model.robust_weights import huber_cost, huber_losses, huber_weights, spread

SIZES = st.floats(0.0, 1e6)
LIMITS = st.floats(0.1, 10.0)


@settings(deadline=None)
@given(size=SIZES, limit=LIMITS)
def test_the_weight_is_the_slope_of_the_loss_by_that_of_least_squares(size, limit):
    step = 1e-4 * max(size, 1.0)
    if abs(size - limit) > 2 * step and size > step:
        slope = (huber_losses(np.array(size + step), limit) - huber_losses(np.array(size - step), limit)) / (2 * step)
        assert huber_weights(np.array(size), limit) * 2 * size == pytest.approx(float(slope), rel=1e-4, abs=1e-6)


@settings(deadline=None)
@given(limit=LIMITS)
def test_the_loss_is_continuous_at_the_limit_and_grows_linearly_beyond(limit):
    assert huber_losses(np.array(limit * (1 + 1e-9)), limit) == pytest.approx(limit**2, rel=1e-6)
    far = huber_losses(np.array([2.0, 3.0, 4.0]) * limit, limit)
    assert np.diff(far) == pytest.approx([2 * limit**2] * 2)


def test_without_a_limit_huber_is_least_squares():
    size = np.array([0.0, 1.0, 1e3])
    assert (huber_weights(size, np.inf) == 1.0).all()
    assert (huber_losses(size, np.inf) == size**2).all()
    assert huber_cost(size, np.inf) == 1.0 + 1e6


@settings(deadline=None)
@given(size=SIZES, limit=LIMITS)
def test_weights_lie_between_zero_and_one_and_bound_the_influence(size, limit):
    weight = float(huber_weights(np.array(size), limit))
    assert 0.0 < weight <= 1.0
    assert weight * size <= limit * (1 + 1e-12) or size <= limit


@pytest.mark.parametrize("share", [0.0, 0.2, 0.4])
def test_the_spread_is_the_standard_error_of_a_coordinate_even_with_outliers(share):
    rng = np.random.default_rng(3)
    size = np.linalg.norm(0.7 * rng.standard_normal((20000, 2)), axis=1)
    size[: int(share * len(size))] = 1e3
    # The median moves within the good part: with a share s of outliers it is their quantile 0.5 / (1 - s).
    expected = 0.7 * np.sqrt(-2 * np.log(1 - 0.5 / (1 - share))) / 1.1774
    assert spread(size) == pytest.approx(expected, rel=0.03)


def test_nothing_has_no_spread():
    assert np.isnan(spread(np.zeros(0)))
