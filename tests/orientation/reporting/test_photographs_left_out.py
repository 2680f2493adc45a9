"""Sentences about photographs that joined no block."""

from orthomill.schemas.orientation import Unoriented
from orthomill.tasks.orientation.report.photographs_left_out import left_out_sentences


def reasons(*pairs):
    return tuple(Unoriented(photo=name, reason=f"{name} {rest}") for name, rest in pairs)


def test_a_reason_of_several_photographs_is_said_once():
    said = list(left_out_sentences(reasons(("a", "has no tie points."), ("b", "is a copy of d."), ("c", "has no tie points."))))
    assert said == ["Each of a, c has no tie points.", "b is a copy of d."]


def test_reasons_of_many_photographs_stay_one_readable_sentence():
    (said,) = left_out_sentences(reasons(*((f"p{i:02}", "has no tie points.") for i in range(20))))
    assert said.endswith("p07 and 12 more has no tie points.") and said.startswith("Each of p00, ")


def test_a_single_photograph_keeps_its_sentence():
    assert list(left_out_sentences(reasons(("a", "has no tie points.")))) == ["a has no tie points."]
    assert not list(left_out_sentences(()))
