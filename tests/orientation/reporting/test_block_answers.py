"""What a client is told about the block: lengths with honest digits, and a verdict that check points decide."""

from dataclasses import replace

import pytest

from orthomill.schemas.findings.datum_findings import NoDatum, PositionsCrowded
from orthomill.schemas.orientation import GroundResidual, JointTest
from orthomill.tasks.orientation.examined.block_numbers import accuracy
from orthomill.tasks.orientation.report.block_answers import block_lengths, block_verdict, length
from orthomill.tasks.orientation.report.block_warnings import block_warnings


def residual(difference, predicted=(0.1, 0.1, 0.1)):
    return GroundResidual(name="c", role="check", difference=difference, predicted=predicted, photos=3)


def test_accuracy_is_the_root_mean_square_in_plan_and_in_height():
    found = accuracy((residual((0.3, 0.4, 0.1)), residual((0.0, 0.0, -0.1))))
    assert found.points == 2
    assert found.plan == pytest.approx(0.125**0.5) and found.height == pytest.approx(0.1)
    assert found.by_predicted == pytest.approx(((9 + 16 + 1 + 1) / 6) ** 0.5)


def test_without_check_points_there_is_no_accuracy():
    assert accuracy(()) is None


def test_a_point_without_redundancy_does_not_make_the_ratio_infinite():
    assert accuracy((residual((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),)).by_predicted == 0.0


@pytest.mark.parametrize(
    ("metres", "text"), [(0.0042, "4.2 mm"), (0.0284, "28 mm"), (0.284, "0.28 m"), (2.84, "2.84 m"), (28.4, "28 m")]
)
def test_lengths_have_two_or_three_digits(metres, text):
    assert length(metres) == text


@pytest.mark.parametrize(("scaled", "told"), [(False, "the block has no scale"), (True, "")])
def test_a_block_without_scale_states_no_metres(facts, scaled, told):
    ground = facts.ground.model_copy(update={"points": ()})
    free = replace(facts, ground=ground, precision=facts.precision.model_copy(update={"findings": (NoDatum(scaled=scaled),)}))
    assert block_lengths(free).startswith(told) and bool(block_lengths(free)) != scaled
    assert ("there is no scale" in block_verdict(free, ()).sentence) != scaled


def test_positions_that_take_no_part_are_not_told_as_missing(facts):
    findings = (NoDatum(scaled=False), PositionsCrowded())
    ground = facts.ground.model_copy(update={"points": ()})
    crowded = replace(facts, ground=ground, precision=facts.precision.model_copy(update={"findings": findings}))
    sentence = block_verdict(crowded, ()).sentence
    assert "closer together than their standard errors" in sentence and "neither positions" not in sentence


def test_without_a_ground_pixel_no_class_of_nan_pixels_is_told(facts, monkeypatch):
    """A block of another program without tie points: how large a pixel is on the ground is not known."""
    monkeypatch.setattr("orthomill.tasks.orientation.report.block_answers.ground_pixel", lambda facts: None)
    ground = facts.ground.model_copy(update={"points": (residual((0.3, 0.4, 0.1)), residual((0.0, 0.0, -0.1)))})
    sentence = block_verdict(replace(facts, ground=ground), ()).sentence
    assert sentence.startswith("The block at 2 check points") and "nan" not in sentence and "class" not in sentence


@pytest.mark.parametrize(("chance", "times", "contradicted"), [(1e-6, 1.9, True), (0.02, 1.9, False), (1e-6, 1.2, False)])
def test_check_points_that_chance_does_not_explain_are_told_and_make_no_good_block(facts, monkeypatch, chance, times, contradicted):
    """Below three times what is predicted it is chance that decides: of few points, or of many that share one error."""
    monkeypatch.setattr("orthomill.tasks.orientation.report.block_answers.ground_pixel", lambda facts: 1.0)
    points = (residual((0.1 * times,) * 3), residual((-0.1 * times,) * 3))
    checked = JointTest(square=30.0, coordinates=6, chance=chance)
    told = replace(facts, ground=facts.ground.model_copy(update={"points": points, "checked": checked}))
    verdict, warnings = block_verdict(told, ()), " ".join(block_warnings(told))
    assert (f"{times:.1f} times what the adjustment predicts" in verdict.sentence) == contradicted
    assert ("chance does not make that" in warnings) == contradicted
    assert verdict.level == ("fair" if contradicted else "good")


def test_one_wrong_check_point_is_named_and_the_others_are_told_apart(facts, monkeypatch):
    """A public survey has a point that is 5 m off: thirty times what is predicted, and nothing wrong with the block."""
    monkeypatch.setattr("orthomill.tasks.orientation.report.block_answers.ground_pixel", lambda facts: 1.0)
    good = tuple(residual((0.05, -0.05, 0.05)).model_copy(update={"name": f"P{k}"}) for k in range(4))
    wrong = residual((0.8, -2.0, -5.1)).model_copy(update={"name": "P9"})
    checked = JointTest(square=4000.0, coordinates=15, chance=0.0)
    told = replace(facts, ground=facts.ground.model_copy(update={"points": (*good, wrong), "checked": checked}))
    verdict, warnings = block_verdict(told, ()), list(block_warnings(told))
    assert "without P9, which is wrong by itself: 71 mm and 50 mm, 0.5 times" in verdict.sentence and verdict.level == "poor"
    (sentence,) = [text for text in warnings if "P9" in text]
    assert "by +0.80, -2.00, -5.10 m, and is alone with that: the other 4 differ by 0.5 times" in sentence
    two = (*good, wrong, wrong.model_copy(update={"name": "P10"}))
    several = replace(told, ground=told.ground.model_copy(update={"points": two}))
    assert "wrong by itself" not in block_verdict(several, ()).sentence
