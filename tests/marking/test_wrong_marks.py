"""The wrong mark is named, and nothing else."""

import numpy as np
import pytest

from benchmarks.marking.planted_marks import KINDS, answer_to, cases
from benchmarks.marking.simulated_marks import simulated_block, simulated_marks
from orthomill.schemas.marks import Marks
from orthomill.tasks.marking.judging import judged

BLOCK = simulated_block(2, 6, seed=5)


def test_planted_mistakes_are_named_and_nothing_else():
    answers = {kind: [] for kind in KINDS}
    for block, case in cases(20, seed=11):
        answers[case.kind].append((case, judged(block.belief, case.marks)))
    told = [answer_to(*one) for each in answers.values() for one in each]
    assert np.mean([one.named for one in told]) >= 0.95
    assert np.mean([not one.else_named for one in told]) >= 0.975
    for case, found in answers["names exchanged"]:
        assert all(one.swapped for one in found.wrong if (one.point, one.photo) in case.wrong)
    for case, found in answers["another target"]:
        wrong = next(one for one in found.wrong if (one.point, one.photo) in case.wrong)
        assert wrong.instead is not None and not wrong.swapped


@pytest.mark.parametrize("size", [3.0, 40.0])
def test_how_far_a_wrong_mark_is_off(size):
    marks = simulated_marks(BLOCK, 4, points=4)
    first = marks.points[0]
    photo, mark = list(first.marks.items())[1]
    moved = first.model_copy(update={"marks": {**first.marks, photo: mark.model_copy(update={"col": mark.col + size})}})
    wrong = judged(BLOCK.belief, Marks(points=(moved, *marks.points[1:]))).wrong
    assert [(one.point, one.photo) for one in wrong] == [(first.name, photo)]
    assert wrong[0].off == pytest.approx((size, 0.0), abs=1.5)


def test_wrong_coordinates_are_not_blamed_on_a_mark():
    marks = simulated_marks(BLOCK, 9, points=5)
    x, y, z = marks.points[0].xyz
    moved = marks.points[0].model_copy(update={"xyz": (x + 1.0, y, z), "role": "control"})
    wrong = judged(BLOCK.belief, Marks(points=(moved, *marks.points[1:]))).wrong
    assert [(one.point, one.photo) for one in wrong] == [(moved.name, None)]


def test_the_only_mark_there_is_may_be_wrong():
    point = simulated_marks(BLOCK, 9, points=1).points[0].model_copy(update={"role": "control"})
    photo, mark = next(iter(point.marks.items()))
    only = point.model_copy(update={"marks": {photo: mark.model_copy(update={"col": 5.0, "row": 6.0})}})
    found = judged(BLOCK.belief, Marks(points=(only,)))
    assert [one.point for one in found.wrong] == [point.name]


def test_a_check_point_never_moves_the_block():
    marks = simulated_marks(BLOCK, 10, points=4)
    x, y, z = marks.points[2].xyz
    assert marks.points[2].role == "check"
    moved = marks.points[2].model_copy(update={"xyz": (x + 5.0, y, z)})
    found = judged(BLOCK.belief, Marks(points=(*marks.points[:2], moved, marks.points[3])))
    assert not found.wrong
    placed = next(point for point in found.points if point.name == moved.name)
    assert placed.difference[0] == pytest.approx(-5.0, abs=0.3)


def test_two_marks_that_contradict_each_other_are_both_shown():
    marks = simulated_marks(BLOCK, 12, points=1)
    point = marks.points[0].model_copy(update={"role": "tie", "xyz": None})
    two = dict(list(point.marks.items())[:2])
    photo = list(two)[1]
    # Across the base two rays of a known block must meet: an error there is seen, but not whose it is.
    for change in ({"col": two[photo].col + 60.0}, {"row": two[photo].row + 60.0}):
        moved = {**two, photo: two[photo].model_copy(update=change)}
        for one in judged(BLOCK.belief, Marks(points=(point.model_copy(update={"marks": moved}),))).wrong:
            assert {one.photo, *one.others} == set(two)


def test_marks_that_scatter_more_than_stated_are_judged_by_how_they_scatter():
    marks = simulated_marks(BLOCK, 13, points=6, sigma=1.5)
    stated = tuple(
        point.model_copy(update={"marks": {name: mark.model_copy(update={"sigma": 0.3}) for name, mark in point.marks.items()}})
        for point in marks.points
    )
    found = judged(BLOCK.belief, Marks(points=stated))
    assert found.unit > 2.5
    assert len(found.wrong) <= 1
