"""Wrong marks planted among right ones: is the wrong one named, and nothing else? And how long an answer takes.

    python -m benchmarks planted_marks [CASES] [PHOTOGRAPHS]

Cases in turn: a mark off by 2 to 500 px, a mark on another point of the list, two names exchanged in a photograph.
"""

import sys
import time
from dataclasses import dataclass

import numpy as np

from benchmarks.instrument.result_page import write_page
from benchmarks.marking.simulated_marks import SimulatedBlock, simulated_block, simulated_marks
from orthomill.schemas.marks import MarkedPoint, MarkJudgement, Marks
from orthomill.tasks.marking.judging import judged, sights

STUDY = "planted_marks"
PREFACE = (
    "Simulated blocks of 12 to 40 photographs (c 3000 px, positions by RTK), 5 to 11 points in up to 10 photographs each, marks "
    "good to 0.3 px, coordinates to 2 cm. Named: all marks that were planted, by point and photograph."
)
KINDS = ("2 to 5 px", "5 to 500 px", "another target", "names exchanged", "nothing wrong")


@dataclass(frozen=True)
class Planted:
    """Marks with a mistake of a kind, and the marks (point, photo) that are wrong."""

    kind: str
    marks: Marks
    wrong: frozenset[tuple[str, str]]


def planted(block: SimulatedBlock, marks: Marks, kind: str, rng: np.random.Generator) -> Planted | None:
    """A mistake among `marks`; None where there is no room for it."""
    points = {point.name: point for point in marks.points}
    name = str(rng.choice(list(points)))
    photo = str(rng.choice(list(points[name].marks)))
    if kind == "nothing wrong":
        return Planted(kind, marks, frozenset())
    if kind.endswith("px"):
        low, high = (2.0, 5.0) if kind == KINDS[0] else (5.0, 500.0)
        size, angle = np.exp(rng.uniform(np.log(low), np.log(high))), rng.uniform(0, 2 * np.pi)
        mark = points[name].marks[photo]
        moved = mark.model_copy(update={"col": mark.col + size * np.cos(angle), "row": mark.row + size * np.sin(angle)})
        return Planted(kind, _with(marks, {(name, photo): moved}), frozenset({(name, photo)}))
    both = [
        (one, other, place)
        for one in points
        for other in points
        if one < other
        for place in points[one].marks
        if place in points[other].marks
    ]
    if not both:
        return None
    one, other, photo = both[int(rng.integers(len(both)))]
    first, second = points[one].marks[photo], points[other].marks[photo]
    if kind == "another target":
        return Planted(kind, _with(marks, {(one, photo): second}), frozenset({(one, photo)}))
    return Planted(kind, _with(marks, {(one, photo): second, (other, photo): first}), frozenset({(one, photo), (other, photo)}))


def _with(marks: Marks, changed: dict) -> Marks:
    def of(point: MarkedPoint) -> MarkedPoint:
        own = {photo: mark for (name, photo), mark in changed.items() if name == point.name}
        return point.model_copy(update={"marks": {**point.marks, **own}})

    return marks.model_copy(update={"points": tuple(map(of, marks.points))})


@dataclass(frozen=True)
class Answer:
    """Whether all planted marks were named, and whether anything else was."""

    named: bool
    else_named: bool


def answer_to(case: Planted, found: MarkJudgement) -> Answer:
    """What was said of a case."""
    said = {(one.point, one.photo) for one in found.wrong}
    return Answer(case.wrong <= said, bool(said - case.wrong))


def cases(count: int, seed: int = 1):
    """Simulated blocks of 12 to 40 photographs with a mistake each."""
    rng = np.random.default_rng(seed)
    blocks = [simulated_block(strips, each, seed + strips) for strips, each in ((2, 6), (3, 8), (4, 10))]
    made = 0
    while made < count:
        block = blocks[made % len(blocks)]
        marks = simulated_marks(block, int(rng.integers(1 << 30)), points=int(rng.integers(5, 12)))
        case = planted(block, marks, KINDS[made % len(KINDS)], rng)
        if case is not None:
            made += 1
            yield block, case


def main(words: list[str]) -> None:
    """Keeps the page of shares, and of the seconds of an answer in a block of the given number of photographs."""
    count, photographs = (int(word) for word in (*words, *("250", "200")[len(words) :]))
    told: dict[str, list[Answer]] = {kind: [] for kind in KINDS}
    for block, case in cases(count):
        told[case.kind].append(answer_to(case, judged(block.belief, case.marks)))
    lines = ["| mistake | cases | named | nothing else named |", "| --- | --- | --- | --- |"]
    for kind, answers in [*told.items(), ("all", [one for each in told.values() for one in each])]:
        share = [
            one.named for one in (answers if kind != "all" else [a for k, each in told.items() if k != KINDS[-1] for a in each])
        ]
        named = f"{100 * np.mean(share):.1f} %" if kind != KINDS[-1] else ""
        lines.append(f"| {kind} | {len(answers)} | {named} | {100 * np.mean([not one.else_named for one in answers]):.1f} % |")
    write_page(
        STUDY, words, "\n".join(["# Wrong marks planted among right ones", "", PREFACE, "", *lines, "", _timed(photographs)])
    )


def _timed(photographs: int) -> str:
    block = simulated_block(10, photographs // 10, 7)
    marks = simulated_marks(block, 3, points=30)
    judged(block.belief, marks)
    # The processor's time as well: a machine with other work to do answers later.
    begun, begun_cpu = time.perf_counter(), time.process_time()
    judged(block.belief, marks)
    middle, middle_cpu = time.perf_counter(), time.process_time()
    sights(block.belief, marks, marks.points[0].name)
    end, end_cpu = time.perf_counter(), time.process_time()
    number = sum(len(point.marks) for point in marks.points)
    return (
        f"{len(block.views)} photographs, {number} marks: {middle - begun:.2f} s ({middle_cpu - begun_cpu:.2f} s of a processor) "
        f"for all residuals and tests, {end - middle:.2f} s ({end_cpu - middle_cpu:.2f} s) for the places of a point."
    )


if __name__ == "__main__":
    main(sys.argv[1:])
