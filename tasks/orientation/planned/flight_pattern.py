"""How a block was flown, from places and times: one strip, a corridor, parallel strips, a cross flight, a circle, or free-hand.

Strips are stretches of the path without a turn. Overlaps are those on flat ground at the flying height.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from orthomill.tasks.orientation.planned.planned_block import PlannedBlock, frame_along

Pattern = Literal["strip", "corridor", "grid", "cross", "circle", "free"]
TURN = np.radians(30.0)
"""A photograph whose neighbours lie in directions that differ by more ends a strip: pilots hold a line to some degrees."""
LEAST = 3
"""photographs of a strip"""
ALIKE = np.radians(25.0)
"""Strips whose directions differ by less are parallel."""
ACROSS = np.radians(45.0)
"""Strips whose direction differs by more from that of most cross them."""
ENOUGH = 0.15
"""Share of the photographs in strips across that makes a cross flight."""
IN_STRIPS = 0.6
"""Share of the photographs in strips below which a flight is free-hand."""
ROUND, AROUND = 0.12, np.radians(240.0)
"""Scatter of places about a circle in units of its radius, and the part of its circumference that they cover."""
NARROW = 4.0
"""Length of a corridor in units of its width."""
OBLIQUE = np.radians(25.0)
"""Photographs that look farther off the vertical have no overlap that a base and a height would give."""


@dataclass(frozen=True)
class FlightPattern:
    """What was flown: number of `strips` beside each other, overlaps `forward` and `side` (shares; None: not to be told)."""

    kind: Pattern
    strips: int = 0
    forward: float | None = None
    side: float | None = None


def flight_pattern(block: PlannedBlock) -> FlightPattern:
    """How the block was flown."""
    runs = strips(block.centre[:, :2])
    upright = bool(np.arccos(np.clip(-block.axes[:, 2], -1.0, 1.0)).mean() < OBLIQUE)
    kind = _kind(block.centre[:, :2], runs)
    main = _parallel(block.centre[:, :2], runs)
    spacing = _spacing(block.centre[:, :2], main)
    forward = _forward(block, main or runs) if upright and kind != "circle" else None
    side = _side(block, main, spacing) if upright and kind in ("grid", "cross", "corridor") else None
    return FlightPattern(kind, 0 if kind in ("circle", "free") else 1 + len(spacing), forward, side)


def strips(xy: np.ndarray) -> list[np.ndarray]:
    """The strips of a path (P, 2) m, as numbers of photographs in order."""
    step = np.diff(xy, axis=0)
    length = np.linalg.norm(step, axis=1)
    heading = np.arctan2(step[:, 1], step[:, 0])
    # Photographs in one place continue whatever was flown: their direction is noise.
    moved = np.flatnonzero(length > 0.2 * np.median(length)) if len(length) else np.zeros(0, int)
    runs: list[np.ndarray] = []
    first = 0
    for i in range(1, len(moved) + 1):
        if i == len(moved) or abs(_turned(heading[moved[i]] - heading[moved[i - 1]])) > TURN:
            runs.append(np.arange(moved[first], moved[i - 1] + 2))
            first = i
    return [run for run in runs if len(run) >= LEAST]


def _turned(angle: np.ndarray | float) -> np.ndarray | float:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _directions(xy: np.ndarray, runs: list[np.ndarray]) -> np.ndarray:
    """(n,) directions of strips, 0 to pi: to and fro is one."""
    ends = np.array([xy[run[-1]] - xy[run[0]] for run in runs]).reshape(-1, 2)
    return np.arctan2(ends[:, 1], ends[:, 0]) % np.pi


def _between(angle: np.ndarray, other: float) -> np.ndarray:
    """Angles between lines, 0 to pi / 2."""
    off = np.abs(angle - other) % np.pi
    return np.minimum(off, np.pi - off)


def _parallel(xy: np.ndarray, runs: list[np.ndarray]) -> list[np.ndarray]:
    """The strips in the direction that most photographs were taken in."""
    if not runs:
        return []
    direction = _directions(xy, runs)
    size = np.array([len(run) for run in runs])
    votes = [size[_between(direction, own) < ALIKE].sum() for own in direction]
    return [run for run, off in zip(runs, _between(direction, direction[int(np.argmax(votes))]), strict=True) if off < ALIKE]


def _kind(xy: np.ndarray, runs: list[np.ndarray]) -> Pattern:
    if _is_circle(xy):
        return "circle"
    if sum(map(len, runs)) < IN_STRIPS * len(xy):
        return "strip" if _is_line(xy) else "free"
    main = _parallel(xy, runs)
    off = _between(_directions(xy, runs), float(_directions(xy, main[:1])[0]))
    if sum(len(run) for run, angle in zip(runs, off, strict=True) if angle > ACROSS) > ENOUGH * len(xy):
        return "corridor" if _goes_on(xy) else "cross"
    if not len(_spacing(xy, main)):
        return "strip"
    along, across = _extents(xy)
    return "corridor" if along > NARROW * across else "grid"


def _is_circle(xy: np.ndarray) -> bool:
    """Whether the places lie on a circle, most of whose circumference they cover."""
    if len(xy) < 6:
        return False
    design = np.column_stack([2.0 * (xy - xy.mean(axis=0)), np.ones(len(xy))])
    found, *_ = np.linalg.lstsq(design, ((xy - xy.mean(axis=0)) ** 2).sum(axis=1), rcond=None)
    away = xy - xy.mean(axis=0) - found[:2]
    distance = np.linalg.norm(away, axis=1)
    radius = distance.mean()
    angle = np.sort(np.arctan2(away[:, 1], away[:, 0]))
    largest_gap = np.diff(np.append(angle, angle[0] + 2 * np.pi)).max()
    return bool(distance.std() < ROUND * radius and 2 * np.pi - largest_gap > AROUND)


def _goes_on(xy: np.ndarray) -> bool:
    """Whether the path never comes back: a road with bends."""
    length = np.linalg.norm(np.diff(xy, axis=0), axis=1).sum()
    return bool(length < 1.7 * np.linalg.norm(np.ptp(xy, axis=0)))


def _is_line(xy: np.ndarray) -> bool:
    along, across = _extents(xy)
    return bool(across < 0.05 * along)


def _extents(xy: np.ndarray) -> tuple[float, float]:
    """m along the longest direction of the places, and across."""
    turned = (xy - xy.mean(axis=0)) @ np.linalg.svd(xy - xy.mean(axis=0), full_matrices=False)[2].T
    along, across = np.ptp(turned, axis=0)
    return float(along), float(across)


def _spacing(xy: np.ndarray, main: list[np.ndarray]) -> np.ndarray:
    """Distances, m, between neighbouring parallel strips; a strip flown twice counts once."""
    if len(main) < 2:
        return np.zeros(0)
    direction = _directions(xy, main)
    # Mean of doubled angles: 1 and 179 degrees are one direction.
    mean = 0.5 * np.angle(np.exp(2j * direction).sum())
    offset = np.sort([float(np.median(xy[run] @ (-np.sin(mean), np.cos(mean)))) for run in main])
    base = np.median(np.concatenate([np.linalg.norm(np.diff(xy[run], axis=0), axis=1) for run in main]))
    between = np.diff(offset)
    return between[between > 0.25 * base]


def _forward(block: PlannedBlock, runs: list[np.ndarray]) -> float | None:
    """The median overlap along strips; none where the flying height was guessed from it."""
    if not runs or block.height_from == "overlap":
        return None
    shares = []
    for run in runs:
        step = np.diff(block.centre[run, :2], axis=0)
        base = np.linalg.norm(step, axis=1)
        length = frame_along(block, step / np.maximum(base, 1e-9)[:, None], run[:-1])
        shares.append(1.0 - base / (block.height * length))
    return float(np.clip(np.median(np.concatenate(shares)), 0.0, 1.0))


def _side(block: PlannedBlock, main: list[np.ndarray], spacing: np.ndarray) -> float | None:
    if not len(spacing):
        return None
    ends = block.centre[main[0][-1], :2] - block.centre[main[0][0], :2]
    across = np.array([[-ends[1], ends[0]]]) / max(float(np.linalg.norm(ends)), 1e-9)
    length = float(frame_along(block, across, main[0][:1])[0])
    return float(np.clip(1.0 - np.median(spacing) / (block.height * length), 0.0, 1.0))
