"""Trends of height differences: a bend is found with its size, and neither noise, tilts nor slow drifts are taken for one."""

import numpy as np
import pytest

from orthomill.tasks.adjustment.testing.position_trend import LEAST, height_trend, without_bend


def grid(strips=3, per_strip=8, base=10.0, apart=30.0):
    """A flight in strips, there and back, in the order of exposure."""
    rows = []
    for strip in range(strips):
        along = base * np.arange(per_strip)
        rows += [(x, apart * strip) for x in (along if strip % 2 == 0 else along[::-1])]
    return np.array(rows)


def test_a_bend_is_found_with_its_size():
    xy, rng = grid(), np.random.default_rng(0)
    radius = np.linalg.norm(xy - xy.mean(axis=0), axis=1)
    found = height_trend(xy, 3.0 + 0.01 * xy[:, 0] - 0.4 * (radius / radius.max()) ** 2 + rng.normal(0, 0.01, len(xy)))
    assert found.is_bent and found.bend == pytest.approx(-0.4, abs=0.03)
    assert found.scatter == pytest.approx(0.01, rel=0.4) and found.radius == pytest.approx(radius.max())


def test_a_bend_of_one_strip_is_found():
    xy = np.column_stack([10.0 * np.arange(12), np.zeros(12)])
    away = xy[:, 0] - xy[:, 0].mean()
    found = height_trend(xy, 0.3 * (away / away.max()) ** 2 + np.random.default_rng(1).normal(0, 0.01, 12))
    assert found.is_bent and found.bend == pytest.approx(0.3, abs=0.05)


@pytest.mark.parametrize("sigma", [0.01, 0.3, 5.0])
def test_noise_shift_and_tilt_are_no_bend(sigma):
    xy = grid()
    for seed in range(200):
        noise = np.random.default_rng(seed).normal(0, sigma, len(xy))
        assert not height_trend(xy, 47.2 + 0.05 * xy[:, 0] - 0.02 * xy[:, 1] + noise).is_bent


@pytest.mark.parametrize(("strips", "per_strip", "most"), [(4, 10, 3), (2, 10, 5), (1, 24, 9)])
def test_the_drift_of_a_receiver_or_a_barometer_is_hardly_ever_a_bend(strips, per_strip, most):
    """Errors that are correlated over ten photographs. In 300 flights; a drift along one strip is most like a bend."""
    xy, bent = grid(strips=strips, per_strip=per_strip), 0
    for seed in range(300):
        rng, drift = np.random.default_rng(seed), [0.0]
        for step in rng.normal(0, np.sqrt(1 - 0.9**2), len(xy) - 1):
            drift.append(0.9 * drift[-1] + step)
        bent += height_trend(xy, np.array(drift) + rng.normal(0, 0.05, len(xy))).is_bent
    assert bent <= most


def test_too_few_positions_and_positions_in_one_place_have_no_trend():
    assert height_trend(grid()[: LEAST - 1], np.zeros(LEAST - 1)) is None
    assert height_trend(np.zeros((12, 2)), np.arange(12.0)) is None


def test_what_is_left_without_a_bend_is_the_noise():
    xy, noise = grid(), np.random.default_rng(3).normal(0, 0.01, 24)
    radius = np.linalg.norm(xy - xy.mean(axis=0), axis=1)
    assert np.std(without_bend(xy, noise - 0.5 * (radius / radius.max()) ** 2)) < 0.02
    assert without_bend(xy, noise) is noise
