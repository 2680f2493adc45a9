"""Marks without a person: what is proposed is taken where nothing speaks against it, and what the block then contradicts is taken
back."""

from collections.abc import Callable
from typing import Protocol

from orthomill.schemas.marks import ExpectedSight, Mark, MarkedPoint, MarkJudgement, MarkProposal, Marks
from orthomill.tasks.marking.belief import Belief
from orthomill.tasks.marking.expected_targets import TargetsOf, coded_marks, unexpected_targets
from orthomill.tasks.marking.proposals import ReadGrey

ROUNDS = 3
"""Each round expects points more exactly than the one before."""
NEAR = 6.0
"""px within which a target is a point that is marked already"""


class Proposes(Protocol):
    """Whoever judges and proposes marks."""

    def judged(self, marks: Marks) -> MarkJudgement:
        """All marks against the block and each other."""

    def sights(self, marks: Marks, point: str) -> tuple[ExpectedSight, ...]:
        """The photographs that should show a point and have no mark of it."""

    def proposals(self, marks: Marks, name: str, read: ReadGrey) -> tuple[MarkProposal, ...]:
        """The marks of a point carried to the photographs that should show it."""


def automatic_marks(
    who: Proposes, belief: Belief, marks: Marks, read: ReadGrey, targets_of: TargetsOf, told: Callable[[str], None]
) -> Marks:
    """The marks with all that need nobody; those that were there stay as they are. `told` is called with what is done next."""
    by_hand = {(point.name, photo) for point in marks.points for photo in point.marks}
    found = _with_coded(marks, belief, targets_of)
    for turn in range(1, ROUNDS + 1):
        before = found
        told(f"round {turn} of at most {ROUNDS}: points are looked for where the marks so far expect them")
        for point in found.points:
            if point.role != "unused":
                taken = {one.photo: _mark(one) for one in who.proposals(found, point.name, read) if not one.refused}
                found = _with_marks(found, point.name, taken)
        found = _without_wrong(who, found, by_hand)
        if found == before:
            break
    if belief.oriented:
        found = _without_wrong(who, _with_unexpected(found, belief, targets_of), by_hand)
    return found


def _mark(one: MarkProposal) -> Mark:
    return Mark(col=round(one.place[0], 3), row=round(one.place[1], 3), sigma=max(round(one.sigma, 3), 0.001), by=one.by)


def _with_marks(marks: Marks, name: str, taken: dict[str, Mark]) -> Marks:
    """The marks with some more of a point; those that are there stay."""
    points = tuple(
        point.model_copy(update={"marks": dict(sorted({**taken, **point.marks}.items()))}) if point.name == name else point
        for point in marks.points
    )
    return marks.model_copy(update={"points": points})


def _with_coded(marks: Marks, belief: Belief, targets_of: TargetsOf) -> Marks:
    here = {point.name for point in marks.points}
    for name, shown in coded_marks(belief.names, targets_of).items():
        if name not in here and len(shown) < 2:
            continue
        if name not in here:
            marks = marks.model_copy(update={"points": (*marks.points, MarkedPoint(name=name, role="tie"))})
        taken = {
            photo: Mark(col=round(one.place[0], 3), row=round(one.place[1], 3), sigma=one.sigma, by="target")
            for photo, one in shown.items()
        }
        marks = _with_marks(marks, name, taken)
    return marks


def _with_unexpected(marks: Marks, belief: Belief, targets_of: TargetsOf) -> Marks:
    names = {point.name for point in marks.points}
    number = 0
    for shown in unexpected_targets(belief, targets_of):
        taken = {
            photo: Mark(col=round(one.place[0], 3), row=round(one.place[1], 3), sigma=round(one.sigma, 3), by="target")
            for photo, one in shown.items()
        }
        if any(_near(point, taken) for point in marks.points):
            continue
        number = next(n for n in range(number + 1, number + len(names) + 2) if f"target{n}" not in names)
        names.add(f"target{number}")
        marks = marks.model_copy(update={"points": (*marks.points, MarkedPoint(name=f"target{number}", role="tie", marks=taken))})
    return marks


def _near(point: MarkedPoint, taken: dict[str, Mark]) -> bool:
    """Whether a point is marked within a few pixels in any of the photographs."""
    return any(
        abs(point.marks[photo].col - mark.col) < NEAR and abs(point.marks[photo].row - mark.row) < NEAR
        for photo, mark in taken.items()
        if photo in point.marks
    )


def _without_wrong(who: Proposes, marks: Marks, by_hand: set[tuple[str, str]]) -> Marks:
    """Without marks of this file that the block contradicts; what a person marked is theirs to judge."""
    wrong = {(one.point, photo) for one in who.judged(marks).wrong for photo in (one.photo, *one.others) if photo} - by_hand
    points = tuple(
        point.model_copy(update={"marks": {photo: mark for photo, mark in point.marks.items() if (point.name, photo) not in wrong}})
        for point in marks.points
    )
    return marks.model_copy(update={"points": points})
