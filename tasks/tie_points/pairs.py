"""Which photographs are worth comparing.

Few photographs: every one with every other. Many: each with its nearest neighbours in plan, as far as positions are known, and with
its neighbours in the order of the flight, so that the work grows with the number of photographs and not with its square.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from schemas.photo import Photos


@dataclass(frozen=True)
class Neighbourhood:
    """All pairs up to `all_up_to` photographs; beyond, `nearest` neighbours each, or `nearest` in sequence without a position."""

    all_up_to: int
    nearest: int


def candidate_pairs(photos: Photos, neighbourhood: Neighbourhood) -> tuple[tuple[int, int], ...]:
    """Pairs (left, right) of photograph numbers, left < right, sorted."""
    count = len(photos.photos)
    if count <= neighbourhood.all_up_to:
        return tuple((left, right) for left in range(count) for right in range(left + 1, count))
    return tuple(sorted(_near_in_plan(photos, neighbourhood.nearest) | _near_in_sequence(photos, neighbourhood.nearest)))


def _near_in_plan(photos: Photos, nearest: int) -> set[tuple[int, int]]:
    placed = [number for number, photo in enumerate(photos.photos) if photo.position is not None]
    if len(placed) < 2:
        return set()
    centres = np.array([photos.photos[number].position for number in placed])[:, :2]
    _, found = cKDTree(centres).query(centres, k=min(nearest + 1, len(placed)))
    pairs = {(placed[i], placed[j]) for i, row in enumerate(found.reshape(len(placed), -1)) for j in row if i != j}
    return {(min(pair), max(pair)) for pair in pairs}


def _near_in_sequence(photos: Photos, nearest: int) -> set[tuple[int, int]]:
    """Two neighbours on each side for photographs with a position, `nearest` for those without."""
    count = len(photos.photos)
    reach = [2 if photo.position is not None else nearest for photo in photos.photos]
    return {(i, j) for i in range(count) for j in range(i + 1, min(i + max(reach[i], 2) + 1, count))}
