"""Blending: the published numbers, rejection, best N, and the plain twin."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.tasks.colouring.blending.blending import Blend, blend
from orthomill.tasks.colouring.blending.rejection import Rejection

PLAIN = Blend(Rejection("none"))


def one_pixel(values, weights=None, how=PLAIN):
    """Blends grey values (or colours) of one pixel."""
    values = np.array(values, np.float32).reshape(len(values), 1, 1, -1)
    weights = np.ones(len(values)) if weights is None else np.array(weights)
    return blend(values, weights.astype(np.float32).reshape(-1, 1, 1), how)


@pytest.mark.parametrize(("power", "expected"), [(1, 175.0), (2, 190.0)])
def test_weights_by_area_and_squared_area(power, expected, record_property):
    result = one_pixel([100, 200], [1, 3], Blend(Rejection("none"), power))
    record_property("found", f"power {power}: {result.colour[0, 0, 0]:g}")
    assert result.colour[0, 0, 0] == pytest.approx(expected)


@pytest.mark.parametrize("centre", ["mean", "median", "deviation"])
def test_a_gross_error_among_five_is_rejected(centre, record_property):
    result = one_pixel([100, 101, 99, 100, 250], how=Blend(Rejection(centre, 1.0, 2.0)))
    record_property("found", f"about the {centre}: {result.colour[0, 0, 0]:g}, {result.rejected[0, 0]} rejected")
    assert result.colour[0, 0, 0] == pytest.approx(100.0)
    assert result.rejected[0, 0] == 1 and result.used[0, 0] == 4


def test_the_published_rule_has_no_floor():
    result = one_pixel([100, 101, 99, 100, 250], how=Blend(Rejection("mean", 1.0, 0.0)))
    assert result.rejected[0, 0] == 1
    assert one_pixel([100, 100, 103], how=Blend(Rejection("mean", 1.0, 0.0))).colour[0, 0, 0] == pytest.approx(100.0)


@pytest.mark.parametrize("centre", ["mean", "median", "deviation"])
def test_fewer_than_three_values_are_never_rejected(centre):
    assert one_pixel([0, 250], how=Blend(Rejection(centre))).colour[0, 0, 0] == pytest.approx(125.0)


@pytest.mark.parametrize("centre", ["mean", "median", "deviation"])
@pytest.mark.parametrize("vehicle", [0.0, 30.0, 180.0, 255.0])
def test_of_three_values_the_vehicle_goes(centre, vehicle):
    result = one_pixel([102.0, vehicle, 98.0], how=Blend(Rejection(centre, 1.0 if centre != "deviation" else 3.0, 8.0)))
    assert abs(result.colour[0, 0, 0] - 100) < 1e-4
    assert result.rejected[0, 0] == 1


def test_a_vehicle_of_the_roads_brightness_goes_by_its_colour():
    road, red = [100, 100, 100], [190, 55, 55]
    result = one_pixel([road, red, road], how=Blend(Rejection("mean", 1.0, 12.0)))
    assert result.colour[0, 0].tolist() == [100, 100, 100]


def test_the_robust_rule_tolerates_two_different_vehicles_among_five():
    values = [100, 101, 99, 250, 180]
    robust = one_pixel(values, how=Blend(Rejection("deviation", 3.0, 8.0)))
    assert robust.colour[0, 0, 0] == pytest.approx(100.0) and robust.rejected[0, 0] == 2


def test_noise_below_the_floor_stays():
    assert one_pixel([96, 100, 104], how=Blend(Rejection("mean", 1.0, 12.0))).used[0, 0] == 3


def test_a_large_k_rejects_nothing(record_property):
    values = [10, 20, 200, 250]
    found = one_pixel(values, how=Blend(Rejection("mean", 1e9)))
    record_property("found", f"{found.rejected[0, 0]} of {len(values)} rejected without a limit")
    assert found.colour[0, 0, 0] == pytest.approx(np.mean(values))


def test_best_n(record_property):
    values, weights = [10, 20, 30, 40], [1, 4, 3, 2]
    full = one_pixel(values, weights).colour[0, 0, 0]
    one, four = (one_pixel(values, weights, Blend(Rejection("none"), best=best)).colour[0, 0, 0] for best in (1, 4))
    record_property("found", f"the best one {one:g} of 20; the best four {four:g}, all {full:g}")
    assert one == 20 and four == full
    assert one_pixel(values, weights, Blend(Rejection("none"), best=2)).colour[0, 0, 0] == pytest.approx((4 * 20 + 3 * 30) / 7)


def test_two_values_that_disagree():
    how = Blend(Rejection("mean"), two_limit=40.0)
    assert one_pixel([100, 180], [2, 1], how).colour[0, 0, 0] == 100
    assert one_pixel([100, 130], [1, 1], how).colour[0, 0, 0] == 115


def test_reserves_are_used_only_where_there_is_nothing_better():
    assert one_pixel([100, 200], [1.0, 1e-3]).colour[0, 0, 0] == 100
    assert one_pixel([100, 200], [1e-3, 1e-3]).colour[0, 0, 0] == 150


def test_a_pixel_without_any_weight():
    result = one_pixel([100, 200], [0, 0])
    assert result.used[0, 0] == 0 and result.colour[0, 0, 0] == 0 and np.isnan(result.difference[0, 0])


def _twin(values: np.ndarray, weights: np.ndarray, rule: Rejection, power: int) -> np.ndarray:
    """One pixel in plain NumPy: values (N, bands)."""
    keep = weights > 0.01 * weights.max()
    values, weights = values[keep], weights[keep]
    if len(values) >= 3 and rule.centre != "none":
        centre = values.mean(0) if rule.centre == "mean" else np.median(values, axis=0)
        distance = np.sqrt(((values - centre) ** 2).mean(1))
        sigma = 1.4826 * np.median(distance) if rule.centre == "deviation" else np.sqrt((distance**2).mean())
        good = distance <= max(rule.k * sigma * (1 + 1e-9) + 1e-9, rule.least)
        if good.any():
            values, weights = values[good], weights[good]
    return (weights[:, None] ** power * values).sum(0) / (weights**power).sum()


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    photos=st.integers(1, 9),
    centre=st.sampled_from(["none", "mean", "median", "deviation"]),
    power=st.sampled_from([1, 2]),
    bands=st.sampled_from([1, 3]),
)
def test_the_kernel_agrees_with_its_plain_twin(seed, photos, centre, power, bands):
    rng = np.random.default_rng(seed)
    colours = rng.uniform(0, 255, (photos, 3, 4, bands)).astype(np.float32)
    weights = rng.uniform(0.1, 3, (photos, 3, 4)).astype(np.float32)
    rule = Rejection(centre, 1.0, 5.0)
    result = blend(colours, weights, Blend(rule, power))
    for r in range(3):
        for c in range(4):
            expected = _twin(colours[:, r, c].astype(np.float64), weights[:, r, c].astype(np.float64), rule, power)
            np.testing.assert_allclose(result.colour[r, c], expected, rtol=1e-4)
    assert result.share.sum() == pytest.approx(12.0, rel=1e-5)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), photos=st.integers(3, 8), best=st.integers(1, 8))
def test_the_best_are_those_of_the_greatest_weight(seed, photos, best):
    rng = np.random.default_rng(seed)
    values, weights = rng.uniform(0, 255, photos), rng.uniform(1, 3, photos)
    kept = np.argsort(-weights)[:best]
    result = one_pixel(values, weights, Blend(Rejection("none"), best=best))
    assert result.used[0, 0] == len(kept) and result.rejected[0, 0] == 0
    assert result.colour[0, 0, 0] == pytest.approx(np.average(values[kept], weights=weights[kept]), rel=1e-4)


def test_the_least_deviation_decides_what_may_be_rejected():
    values = [100, 100, 100, 109]
    for centre in ("mean", "median", "deviation"):
        counts = [one_pixel(values, how=Blend(Rejection(centre, 1.0, least))).rejected[0, 0] for least in (0.0, 5.0, 12.0)]
        assert counts == [1, 1, 0]


def test_rejection_with_a_tiny_k_keeps_all_rather_than_none():
    assert one_pixel([10, 100, 250], how=Blend(Rejection("mean", 1e-6))).used[0, 0] == 3


def test_more_photographs_than_a_pixel_may_have_are_ignored():
    result = one_pixel(np.r_[np.full(64, 50.0), np.full(6, 250.0)])
    assert result.used[0, 0] == 64 and result.colour[0, 0, 0] == 50


def test_the_difference_is_the_mean_distance_from_the_blend():
    result = one_pixel([100, 110, 130], [1, 1, 2])
    blend_of = (100 + 110 + 260) / 4
    assert result.difference[0, 0] == pytest.approx(np.abs(np.array([100, 110, 130]) - blend_of).mean(), rel=1e-5)
    assert np.isnan(one_pixel([100]).difference[0, 0])


def test_shares_are_those_of_the_weights():
    result = one_pixel([100, 110, 130], [1, 1, 2])
    assert result.share.tolist() == [0.25, 0.25, 0.5]


def test_of_two_that_disagree_the_one_at_a_break_of_its_depth_goes():
    colours = np.array([[[[100.0], [100.0], [100.0], [100.0]]], [[[200.0], [200.0], [200.0], [110.0]]]])
    weights = np.array([[[3.0, 3.0, 3.0, 3.0]], [[1.0, 1.0, 1.0, 1.0]]])
    broken = np.array([[[True, False, True, True]], [[False, False, True, False]]])
    found = blend(colours, weights, Blend(Rejection("none"), two_limit=20.0), broken)
    # The heavier one is at the break; none is; both are; they agree.
    assert found.colour[0, :, 0].tolist() == [200.0, 125.0, 125.0, 102.5]
    assert found.rejected[0].tolist() == [1, 0, 0, 0]
