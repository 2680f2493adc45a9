"""Shared errors of a surface at its check points have the name of what they are."""

import numpy as np
import pytest

from orthomill.schemas.accuracy.point_tests import TESTED, HeightTest, PointTest, PointTests
from orthomill.tasks.accuracy.statement.named_errors import heights_in_feet, named_errors
from orthomill.tasks.accuracy.statement.point_statement import statement_of

RNG = np.random.default_rng(3)
PLACES = RNG.uniform(0, 1000, (20, 2)) + np.array([400_000.0, 4_000_000.0])
UNIT = (PLACES - PLACES.mean(axis=0)) / 500
NOISE, FLAT = RNG.normal(0, 0.02, 20), RNG.normal(0, 0.02, (20, 2))


@pytest.mark.parametrize(
    ("kind", "height", "plan", "words"),
    [
        ("dome", -1.3 * (UNIT**2).sum(axis=1), 0, "domed: its middle lies"),
        ("dome", 1.3 * (UNIT**2).sum(axis=1), 0, "bowl-shaped"),
        ("tilt", 0.3 * UNIT[:, 0], 0, "towards the east across the points (0.6 m per km)"),
        ("shift_up", 0.2, 0, "too high"),
        ("shift_plan", 0, np.array([0.1, 0.1]), "towards the north-east"),
        ("scale", 0, 1e-3 * (PLACES - PLACES.mean(axis=0)), "millionths too large"),
        ("turn", 0, 0.2 * UNIT[:, ::-1] * (-1, 1), "counter-clockwise"),
    ],
)
def test_an_error_is_named_for_what_it_is(kind, height, plan, words):
    found = named_errors(PLACES, NOISE + height, FLAT + plan)
    assert found[0].kind == kind
    assert words in found[0].sentence
    assert found[0].size > 5 * found[0].sigma


def test_a_scale_of_heights_is_named_where_the_ground_has_relief():
    ground = 20.0 * np.sin(np.arange(20.0) ** 2)
    (scaled,) = named_errors(PLACES, NOISE + 0.03 * (ground - ground.mean()), FLAT, ground=ground)
    assert scaled.kind == "scale_up" and "Heights are scaled: their differences are 3 % too large" in scaled.sentence
    slope = ground + 30 * UNIT[:, 0]
    (sloping,) = named_errors(PLACES, NOISE + 0.03 * (slope - slope.mean()), FLAT, ground=slope)
    assert sloping.kind == "scale_up", "what a sloping ground makes of a scale is no tilt"
    tilt, scale = named_errors(PLACES, NOISE + 0.03 * (ground - ground.mean()) + 2 * UNIT[:, 0], FLAT, ground=ground)
    assert (tilt.kind, scale.kind) == ("tilt", "scale_up")


def test_errors_of_the_survey_on_level_ground_are_no_scale():
    survey = RNG.normal(0, 0.05, 20)
    height = RNG.normal(0, 0.03, 20) - survey
    assert not named_errors(PLACES, height, FLAT, (0.05, 0.05), ground=survey)


def test_noise_alone_has_no_name():
    none = [named_errors(PLACES, RNG.normal(0, 0.05, 20), RNG.normal(0, 0.05, (20, 2))) for _ in range(60)]
    assert sum(map(len, none)) <= 3


@pytest.mark.parametrize("count", [0, 1, 2, 3, 4, 5])
def test_few_points_give_few_names(count):
    nothing = np.full(20, np.nan)
    height = np.where(np.arange(20) < count, 5.0 + NOISE, nothing)
    found = named_errors(PLACES, height, np.full((20, 2), np.nan))
    assert all(error.kind == "shift_up" for error in found)


def test_an_error_within_what_the_block_promises_is_told_and_no_reason_to_doubt():
    (allowed,) = named_errors(PLACES, NOISE + 0.2, FLAT, promised=(0.1, 0.1))
    assert allowed.is_promised and "which the standard error of the block's place (0.100 m) allows." in allowed.sentence
    (beyond,) = named_errors(PLACES, NOISE + 0.2, FLAT, promised=(0.1, 0.02))
    assert not beyond.is_promised and "9.9 times the standard error of the block's place (0.020 m)." in beyond.sentence
    (unknown,) = named_errors(PLACES, NOISE + 0.2, FLAT)
    assert not unknown.is_promised


def test_what_an_error_does_at_the_points_is_compared_and_not_its_largest_value():
    (tilt,) = named_errors(PLACES, NOISE + 0.3 * UNIT[:, 0], FLAT, promised=(None, 0.1))
    assert tilt.displaced == pytest.approx(0.3 * UNIT[:, 0].std(), rel=0.1)
    assert tilt.size > 2 * tilt.displaced and tilt.is_promised
    (scale,) = named_errors(PLACES, NOISE, 1e-3 * (PLACES - PLACES.mean(axis=0)), promised=(0.5, None))
    assert scale.displaced == pytest.approx(0.5 * np.sqrt((UNIT**2).sum(axis=1).mean()), rel=0.1) and scale.is_promised


GROUND = 80.0 + 15 * UNIT[:, 1]


@pytest.mark.parametrize(
    ("points", "product", "words"),
    [(1 / 0.3048, 1, "heights of the points are in feet"), (1, 1 / 0.3048, "heights of the product are in feet")],
)
def test_heights_in_feet_are_named_and_not_as_a_shift(points, product, words):
    tests = tuple(
        PointTest(
            name=str(i), surveyed=(*p, z * points), sigma=(0.02,) * 3, height=HeightTest(reason=TESTED, height=z * product + d)
        )
        for i, (p, z, d) in enumerate(zip(PLACES, GROUND, NOISE, strict=True))
    )
    (found,) = statement_of(PointTests(points=tests)).named
    assert found.kind == "feet" and words in found.sentence and not found.is_promised


def test_a_shift_that_feet_would_nearly_explain_is_a_shift():
    level = np.full(20, 10.0) + 0.01 * UNIT[:, 0]
    assert heights_in_feet(level, level - 7.5 + NOISE, 0.02) is None
    assert heights_in_feet(GROUND, GROUND + 0.2 + NOISE, 0.02) is None
    assert heights_in_feet(GROUND[:2], GROUND[:2] * 0.3048, 0.02) is None, "two points are too few"
