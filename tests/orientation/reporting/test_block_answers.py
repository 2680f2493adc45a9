"""What a client is told about the block: lengths with honest digits, and a verdict that check points decide."""

import pytest

from orthomill.schemas.orientation import GroundResidual
from orthomill.tasks.orientation.reporting.block_answers import accuracy, length


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
