"""Which pairs of photographs are compared.

Few photographs: every pair. Many: each with those that show the nearest ground, as far as positions are known, and with its
neighbours in the order of the flight, so that the work grows with the number of photographs and not with its square. An oblique
photograph does not show the ground below itself: where its attitude is known, the ground on its axis counts. Photographs without a
position are paired by appearance (`appearance.py`).
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.geometry.rotation import rotation_matrix

# Flying height in units of the distance between neighbours, for heights above the ground are unknown before the block is: with c
# equal to the frame's side, overlaps of 60 to 80 % have bases of 0.4 to 0.2 flying heights.
_SPACINGS = 3.0
# An axis that goes farther sideways than this many flying heights points to the horizon; its place is not moved any farther.
_STEEPEST = 3.0
_IN_SEQUENCE = 2  # the next photograph may be blurred: the one after it then continues the strip


@dataclass(frozen=True)
class Neighbourhood:
    """All pairs up to `all_up_to` photographs; for more photographs the `nearest` to each by position or by appearance."""

    all_up_to: int
    nearest: int


def needs_appearance(photos: Photos, neighbourhood: Neighbourhood) -> bool:
    """Whether there are too many photographs for all pairs and some have no position."""
    return len(photos.photos) > neighbourhood.all_up_to and any(photo.position is None for photo in photos.photos)


def candidate_pairs(photos: Photos, neighbourhood: Neighbourhood) -> tuple[tuple[int, int], ...]:
    """Pairs (left, right) of photograph numbers, left < right, sorted; of many photographs by position and sequence only."""
    count = len(photos.photos)
    if count <= neighbourhood.all_up_to:
        return tuple((left, right) for left in range(count) for right in range(left + 1, count))
    return tuple(sorted(_near_in_plan(photos, neighbourhood.nearest) | _near_in_sequence(count)))


def _near_in_plan(photos: Photos, nearest: int) -> set[tuple[int, int]]:
    placed = [number for number, photo in enumerate(photos.photos) if photo.position is not None]
    if len(placed) < 2:
        return set()
    places = viewed_ground([photos.photos[number] for number in placed])
    # One more than asked for: every photograph is its own nearest neighbour.
    _, found = cKDTree(places).query(places, k=min(nearest + 1, len(placed)))
    pairs = {(placed[i], placed[j]) for i, row in enumerate(found.reshape(len(placed), -1)) for j in row if i != j}
    return {(min(pair), max(pair)) for pair in pairs}


def viewed_ground(photos: list[Photo]) -> np.ndarray:
    """(N, 2) ground points, m, on the optical axes of photographs with a position; below them where the attitude is unknown."""
    centres = np.array([photo.position for photo in photos], dtype=float)
    spacing = cKDTree(centres[:, :2]).query(centres[:, :2], k=2)[0][:, 1] if len(centres) > 1 else np.zeros(1)
    height = _SPACINGS * float(np.median(spacing))
    return centres[:, :2] + height * np.array([_sideways(photo) for photo in photos])


def _sideways(photo: Photo) -> np.ndarray:
    """(2,) horizontal displacement along the optical axis per unit of depth."""
    if photo.attitude is None:
        return np.zeros(2)
    # The camera looks along -z; the third row of the rotation is the z axis of the image in the world.
    axis = -rotation_matrix(*np.radians(photo.attitude))[2]
    level = axis[:2] / max(-float(axis[2]), 1e-9)
    return level * min(1.0, _STEEPEST / max(float(np.linalg.norm(level)), 1e-9))


def _near_in_sequence(count: int) -> set[tuple[int, int]]:
    return {(i, j) for i in range(count) for j in range(i + 1, min(i + _IN_SEQUENCE + 1, count))}
