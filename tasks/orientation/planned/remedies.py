"""What to measure so that a planned block becomes better: the same adjustment with control, with corrected positions, or with a
calibrated camera, each by itself; the one that helps most for its effort."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.orientation.planned.expected_precision import ExpectedPrecision, expected_precision
from orthomill.tasks.orientation.planned.planned_block import PlannedBlock
from orthomill.tasks.orientation.planned.planned_network import NO_MEASURES, PlannedMeasures, planned_network

SURVEYED = (0.02, 0.02, 0.03)
"""m: standard errors of points surveyed with corrected GNSS, and of corrected positions of photographs"""
MARGIN = 0.1
"""Share of the block's sides between its border and control at its corners: nearer to the border photographs hardly see it."""
AS_GOOD = 1.5
"""A remedy that leaves so many times the standard errors of the best one is as good."""
FIVE = 5
"""Control points that hold a block at its corners and in its middle."""
WORTH = 0.7
"""Share of its standard error that a remedy leaves of the heights or of the bend, so that it is worth a word."""


@dataclass(frozen=True)
class Remedy:
    """What is to be done (`words`: a subject in the plural or singular, with its verb), and what it leads to."""

    words: str
    expected: ExpectedPrecision


def best_remedy(block: PlannedBlock, before: ExpectedPrecision, measures: PlannedMeasures = NO_MEASURES) -> Remedy | None:
    """The remedy of least effort among those that help most, by the error of heights and of the bend, in addition to the
    `measures` taken; None where none helps."""
    found = [remedy for remedy in _remedies(block, measures) if _share(remedy.expected, before) < WORTH]
    if not found:
        return None
    best = min(_share(remedy.expected, before) for remedy in found)
    return next(remedy for remedy in found if _share(remedy.expected, before) <= AS_GOOD * best)


def _share(after: ExpectedPrecision, before: ExpectedPrecision) -> float:
    """What is left of the errors of heights, in the worst part of the block, and of the bend: their geometric mean."""
    return float(np.sqrt(after.worst / before.worst * min(after.bend / before.bend, 1.0)))


def _remedies(block: PlannedBlock, taken: PlannedMeasures) -> Iterator[Remedy]:
    """In the order of their effort."""
    for words, measures in _choices(block, taken):
        try:
            yield Remedy(words, expected_precision(planned_network(block, measures)))
        except GeometryError:
            continue


def _choices(block: PlannedBlock, taken: PlannedMeasures) -> Iterator[tuple[str, PlannedMeasures]]:
    middle, corners = _places(block)
    if not len(taken.control):
        yield "one control point in the middle brings", with_control(block, _on_ground(block, middle))
    if len(taken.control) < FIVE:
        five = _on_ground(block, np.vstack([middle, corners]))
        yield "five control points, at the corners and in the middle, bring", with_control(block, five)
    if block.common.any():
        yield "positions with corrections (RTK or PPK) bring", replace(taken, positions=SURVEYED)
    yield "a camera calibrated before the flight brings", replace(taken, calibrated=True)


def with_control(block: PlannedBlock, points: np.ndarray | None) -> PlannedMeasures:
    """Control points (n, 3) in the project's system, as they are surveyed and measured as a rule."""
    if points is None or not len(points):
        return NO_MEASURES
    return PlannedMeasures(points - block.origin, np.tile(SURVEYED, (len(points), 1)))


def _on_ground(block: PlannedBlock, xy: np.ndarray) -> np.ndarray:
    """Places (n, 2) of the block as points (n, 3) in the project's system."""
    return np.column_stack([xy, np.full(len(xy), block.ground)]) + block.origin


def _places(block: PlannedBlock) -> tuple[np.ndarray, np.ndarray]:
    """The middle (1, 2) of the block and its corners (4, 2), in plan."""
    xy = block.centre[:, :2]
    axes = np.linalg.svd(xy - xy.mean(axis=0), full_matrices=False)[2]
    along = (xy - xy.mean(axis=0)) @ axes.T
    # Photographs see beyond their own places, a single strip on both sides.
    reach = 0.25 * block.height
    low, high = along.min(axis=0) - reach, along.max(axis=0) + reach
    u, v = (np.array([a + MARGIN * (b - a), b - MARGIN * (b - a)]) for a, b in zip(low, high, strict=True))
    square = np.array([(u[i], v[j]) for i in (0, 1) for j in (0, 1)])
    return (0.5 * (low + high) @ axes + xy.mean(axis=0))[None], square @ axes + xy.mean(axis=0)
