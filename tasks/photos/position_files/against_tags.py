"""What the GPS tags of the photographs say of the positions of a file: another unit, another surface, another site.

Tags are metres off at best, and some say nonsense: only what no receiver explains is told, and only what ruins the block is
refused.
"""

from typing import NamedTuple

import numpy as np

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.photo import Photo
from orthomill.tasks.geometry.coordinate_ranges import in_feet

_ENOUGH = 3
_HIGH = 30.0
"""m: above the sea, below which feet and metres are mistaken for each other by chance"""
BEYOND_GEOIDS = 120.0
"""m: no geoid is so far from the ellipsoid"""
_ELSEWHERE = 100.0
"""m in plan: no receiver in flight is so wrong"""
_OTHER_SITE = 20_000.0
"""m: nor is a datum"""


_SHIFTS = (1, -1, 2, -2)
"""photographs by which lines are moved where test shots were counted, or the first exposure was not"""
_ROW = 5
"""photographs that show it"""
_OFF = 5.0
"""m in plan: receivers of drones are seldom farther off"""
_STEP = 15.0
"""m in height: receivers of one flight do not jump so against each other"""
_PART = 2
"""photographs whose heights are off by one amount together: a single one is an error of its own"""
_BETTER = 4.0
"""times nearer to the tags, for which another order is the right one"""


class OffTags(NamedTuple):
    """By how much (m, medians) positions are off the tags in plan, and above them; None: what receivers and surfaces explain;
    `moved`: by how many photographs the positions have to be moved to fit the tags (0: they fit, or in no order); `stepped`: names
    of the photographs whose heights are off the tags by another amount than those of the others, and by how much more, m."""

    plan: float | None = None
    above: float | None = None
    moved: int = 0
    stepped: tuple[tuple[str, ...], float] | None = None


NOTHING_TO_COMPARE = OffTags()


def off_tags(xyz: np.ndarray, tagged: list[Photo], tags: np.ndarray, system: str) -> OffTags:
    """How far positions (N, 3) are off the places (N, 2; NaN: none) of the tags of their photographs, in the project's system;
    `system`: what the positions were read as. Raises WorkflowError for heights in feet and for positions of another site."""
    heights = np.array([np.nan if photo.altitude is None else photo.altitude for photo in tagged])
    known = np.isfinite(heights) & np.isfinite(xyz[:, 2])
    placed = np.isfinite(tags).all(axis=1)
    above = _above(xyz[known, 2], heights[known]) if known.sum() >= _ENOUGH else None
    stepped = _stepped(xyz[:, 2] - heights, [photo.name for photo in tagged])
    if placed.sum() < _ENOUGH:
        return OffTags(None, above, stepped=stepped)
    away = float(np.median(np.linalg.norm(xyz[placed, :2] - tags[placed], axis=1)))
    if away > _OTHER_SITE:
        raise WorkflowError(
            f"The positions file, read as {system[:60]}, puts the photographs {away / 1000:.0f} km from where their GPS tags say "
            "that they were taken: state what its coordinates are in (positions > crs), or give the file of this flight."
        )
    order = [i for i in np.argsort([photo.name for photo in tagged], kind="stable") if placed[i]]
    return OffTags(away if away > _ELSEWHERE else None, above, _moved(xyz[order, :2], tags[order]), stepped)


def _moved(xy: np.ndarray, tags: np.ndarray) -> int:
    """By how many photographs positions (N, 2) have to be moved to be far nearer to the tags (N, 2)."""
    if len(xy) < _ROW:
        return 0
    away = {k: _away(xy[max(k, 0) : len(xy) + min(k, 0)], tags[max(-k, 0) : len(tags) - max(k, 0)]) for k in (0, *_SHIFTS)}
    best = min(_SHIFTS, key=away.__getitem__)
    return best if away[0] > _OFF and away[best] * _BETTER < away[0] else 0


def _stepped(above: np.ndarray, names: list[str]) -> tuple[tuple[str, ...], float] | None:
    """The photographs beyond the widest gap of what heights are `above` (N,) the tags, the fewer ones, and the step to them; None
    where both parts are not alike within themselves, as heights in two systems or of two flights are."""
    known = np.flatnonzero(np.isfinite(above))
    order = known[np.argsort(above[known])]
    if len(order) <= _ENOUGH:
        return None
    at = int(np.diff(above[order]).argmax()) + 1
    low, high = order[:at], order[at:]
    step = float(np.median(above[high]) - np.median(above[low]))
    if min(len(low), len(high)) < _PART or step < _STEP or max(np.ptp(above[low]), np.ptp(above[high])) > step / 3.0:
        return None
    part = min(low, high, key=len)
    return tuple(names[i] for i in sorted(part)), step if part is high else -step


def _away(xy: np.ndarray, tags: np.ndarray) -> float:
    return float(np.median(np.linalg.norm(xy - tags, axis=1)))


def _above(z: np.ndarray, heights: np.ndarray) -> float | None:
    above, middle = float(np.median(z - heights)), float(np.median(heights))
    if abs(middle) > _HIGH and abs(above) > _HIGH and in_feet(z, heights):
        raise WorkflowError(
            f"The heights of the positions file are 3.28 times those of the GPS tags ({np.median(z):.0f} for {middle:.0f} m): they "
            "are in feet. Say so in the name of their column, as altitude (ft), or convert them."
        )
    return above if abs(above) > _STEP else None
