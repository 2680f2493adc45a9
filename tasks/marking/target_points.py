"""Targets of several photographs brought together: which detections are the same point on the ground.

Pairs of detections whose rays meet make a point; every other photograph that should show it either has a detection there or speaks
against it. What only looks like a target from one side fails there.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.tasks.geometry.intersection import intersect_rays
from orthomill.tasks.geometry.view import View
from orthomill.tasks.marking.belief import Belief

NEIGHBOURS = 4
"""Photographs with which each is paired, the nearest ones with enough base."""
LEAST_BASE = 0.08
"""base by distance from the ground"""
NEAR = 2.0
"""px within which a detection is that of a point: what image errors and the block leave"""
LEAST_VIEWS = 3
SHARE = 0.6
"""Share of the photographs that should show a point in which it must be detected."""
BORDER = 12.0
"""px from the border within which a photograph need not show a target"""


@dataclass(frozen=True, eq=False)
class Detections:
    """Detections in one photograph: `place` (n, 2) (col, row) px, their `sigma` (n,) px and a `score` (n,)."""

    place: np.ndarray
    sigma: np.ndarray
    score: np.ndarray


@dataclass(frozen=True, eq=False)
class FoundPoint:
    """A point (3,) m, local; the number of its detection in each photograph (number -> number); the `score`, the median of theirs;
    of how many photographs it was expected in."""

    place: np.ndarray
    rows: dict[int, int]
    score: float
    expected: int


def target_points(belief: Belief, found: dict[int, Detections]) -> list[FoundPoint]:
    """The points of detections by photograph (number -> detections), the best first; no detection belongs to two of them."""
    views = belief_views(belief)
    candidates: list[FoundPoint] = []
    for first, second in _pairs(belief, sorted(found)):
        for place in _meeting(belief, first, second, found):
            candidates.append(_seen_in(place, views, found))
    good = [one for one in candidates if len(one.rows) >= max(LEAST_VIEWS, SHARE * one.expected)]
    ranked = sorted(good, key=lambda one: (-len(one.rows) / max(one.expected, 1) * one.score, -len(one.rows)))
    taken: set[tuple[int, int]] = set()
    out = []
    for one in ranked:
        own = set(one.rows.items())
        if not own & taken:
            taken |= own
            out.append(one)
    return out


def belief_views(belief: Belief) -> list[View]:
    """The photographs of a belief as views in local coordinates."""
    interior = belief.state.interior
    cameras = [camera.with_interior(values) for camera, values in zip(belief.cameras, interior, strict=True)]
    of = belief.network.camera_of
    return [View(name, cameras[of[i]], belief.state.rotation[i], belief.state.centre[i]) for i, name in enumerate(belief.names)]


def _pairs(belief: Belief, photos: list[int]) -> list[tuple[int, int]]:
    """Each photograph with its nearest neighbours that have a base."""
    centre = belief.state.centre
    pairs: set[tuple[int, int]] = set()
    for one in photos:
        others = sorted((float(np.linalg.norm(centre[other] - centre[one])), other) for other in photos if other != one)
        height = abs(centre[one, 2] - belief.ground[0]) or 1.0
        based = [other for away, other in others if away > LEAST_BASE * height][:NEIGHBOURS]
        pairs |= {(min(one, other), max(one, other)) for other in based}
    return sorted(pairs)


def _meeting(belief: Belief, first: int, second: int, found: dict[int, Detections]) -> np.ndarray:
    """(n, 3) m, local: where rays of detections in two photographs meet, not far from the heights of the ground."""
    a, b = found[first].place, found[second].place
    if not len(a) or not len(b):
        return np.zeros((0, 3))
    i, j = (index.ravel() for index in np.meshgrid(np.arange(len(a)), np.arange(len(b)), indexing="ij"))
    directions = [belief.view_of(photo).rays(found[photo].place) for photo in (first, second)]
    centres = np.broadcast_to(belief.state.centre[[first, second]][:, None], (2, len(i), 3))
    place, missed = intersect_rays(centres, np.stack([directions[0][i], directions[1][j]]))
    distance = np.linalg.norm(place - belief.state.centre[first], axis=1)
    pixel = distance / belief.camera_of(first).c
    low, high = belief.ground[0] - 4.0 * belief.ground[1] - 2.0, belief.ground[0] + 4.0 * belief.ground[1] + 2.0
    with np.errstate(invalid="ignore"):
        near = (missed < NEAR * pixel) & (place[:, 2] > low) & (place[:, 2] < high)
        near &= ((place - belief.state.centre[first]) * directions[0][i]).sum(axis=1) > 0
    return place[near]


def _seen_in(place: np.ndarray, views: list[View], found: dict[int, Detections]) -> FoundPoint:
    rows: dict[int, int] = {}
    expected = 0
    for photo, own in found.items():
        pixel = views[photo].project(place[None])
        if not views[photo].contains(pixel, BORDER)[0]:
            continue
        expected += 1
        if len(own.place):
            away = np.linalg.norm(own.place - pixel[0], axis=1)
            nearest = int(away.argmin())
            if away[nearest] < NEAR + 3.0 * own.sigma[nearest]:
                rows[photo] = nearest
    score = float(np.median([found[photo].score[row] for photo, row in rows.items()])) if rows else 0.0
    return FoundPoint(place, rows, score, expected)
