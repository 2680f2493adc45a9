"""Exposures without names to photographs: by the numbers in the names of these, or in their order, where times or places agree.

A wrong assignment shifts the block by a base, and nothing in the files would ever say so: what is not confirmed is refused.
"""

import re
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.photo import Photo
from orthomill.tasks.photos.position_files.event_files import is_trajectory
from orthomill.tasks.photos.position_files.listed_positions import ListedPosition

_SECONDS = 1.6
"""s by which times of tags may differ from those of events after their common shift: tags have whole seconds"""
_NEAREST = 0.9
"""of the photographs must have their own event nearest to the place of their tags"""
_SAME = 3.0
"""m: an event that is so near to the place of the tags need not be the nearest one (photographs taken on the spot)"""
_SHOT = re.compile(r"_?(\d{3,5})(?:_[A-Za-z]{1,3})?$")
"""number of an exposure at the end of a name, as in DJI_0012, 100_0085_0012 and DJI_20230517_0012_V"""

Places = Callable[[list[ListedPosition]], np.ndarray]
"""longitude and latitude (n, 2) of events"""


class Matched(NamedTuple):
    """Lines by the name of their photograph, how they were matched, and what confirms it (None: there was nothing to compare)."""

    of_photo: dict[str, ListedPosition]
    by: Literal["name", "number", "order"]
    confirmed: Literal["times", "places"] | None


def match_events(events: list[ListedPosition], photos: list[Photo], places: Places) -> Matched:
    """Which event belongs to which photograph. Raises WorkflowError where numbers do not agree or times and places contradict."""
    attempts: list[tuple[Literal["number", "order"], dict[str, ListedPosition]]] = []
    if numbered := _by_number(events, photos):
        attempts.append(("number", numbered))
    if len(events) == len(photos):
        attempts.append(("order", _in_order(events, photos)))
    if not attempts:
        raise WorkflowError(_counts(len(events), len(photos)))
    contradicted = []
    for by, pairs in attempts:
        checks = (("times", _times_agree(pairs, photos)), ("places", _places_agree(events, pairs, photos, places)))
        confirmed = next((word for word, agrees in checks if agrees), None)
        if confirmed or all(agrees is None for _, agrees in checks):
            return Matched(pairs, by, confirmed)  # type: ignore[arg-type]
        contradicted.append(next(word for word, agrees in checks if agrees is False))
    what = "times of exposure in the tags" if contradicted[-1] == "times" else "places in the GPS tags"
    raise WorkflowError(
        f"The {len(events)} exposures of the positions file cannot be assigned to the photographs: in their order the {what} "
        "contradict it. Give a file with the names of the photographs, or take out photographs and lines that have no partner."
    )


def _counts(events: int, photographs: int) -> str:
    if is_trajectory(events, photographs):
        return (
            f"The positions file holds {events} epochs of a trajectory, the project {photographs} photographs; give the file "
            "of the exposures (..._events.pos), or one with the names of the photographs."
        )
    return (
        f"The positions file holds {events} exposures without names, the project {photographs} photographs: which belongs to which "
        "is unknown. Take out test shots, or give a file with the names of the photographs."
    )


def _by_number(events: list[ListedPosition], photos: list[Photo]) -> dict[str, ListedPosition] | None:
    """Events by the numbers at the end of the names of the photographs; None where one has no event of its own."""
    of_number = {one.number: one for one in events if one.number}
    if len(of_number) < len(events) or not events:
        return None
    shots = {photo.name: int(match[1]) for photo in photos if (match := _SHOT.search(photo.name))}
    if len(shots) < len(photos) or len(set(shots.values())) < len(photos) or not set(shots.values()) <= of_number.keys():
        return None
    return {name: of_number[shot] for name, shot in shots.items()}


def _in_order(events: list[ListedPosition], photos: list[Photo]) -> dict[str, ListedPosition]:
    """Events in their order, photographs by their times of exposure where all have one, and by name."""
    timed = all(photo.time for photo in photos)
    ordered = sorted(photos, key=lambda photo: ((photo.time or "") if timed else "", _natural(photo.name)))
    by_time = sorted(events, key=lambda one: one.time) if all(one.time is not None for one in events) else events  # type: ignore[arg-type,return-value]
    return {photo.name: one for photo, one in zip(ordered, by_time, strict=True)}


def _natural(name: str) -> tuple[tuple[str, int], ...]:
    """Names in the order of their numbers: a2 before a10."""
    return tuple((words, int(digits or 0)) for words, digits in re.findall(r"(\D*)(\d*)", name))


def _times_agree(pairs: dict[str, ListedPosition], photos: list[Photo]) -> bool | None:
    """Whether all photographs were taken the same time after their event; None without times that differ."""
    timed = [
        (_seconds(photo.time), pairs[photo.name].time) for photo in photos if photo.time and pairs[photo.name].time is not None
    ]
    if len(timed) < max(2, len(photos)) or len({taken for taken, _ in timed}) < 2:
        return None
    late = np.array([taken - event for taken, event in timed if event is not None])
    return bool(np.abs(late - np.median(late)).max() <= _SECONDS)


def _seconds(time: str | None) -> float:
    return float(np.datetime64(time, "s").astype("int64")) if time else 0.0


def _places_agree(
    events: list[ListedPosition], pairs: dict[str, ListedPosition], photos: list[Photo], places: Places
) -> bool | None:
    """Whether photographs have their own event nearest to the place of their tags; None without such tags."""
    tagged = [photo for photo in photos if photo.longitude is not None and photo.latitude is not None]
    if len(tagged) < max(2, len(photos) // 2):
        return None
    degrees = np.array([(photo.longitude, photo.latitude) for photo in tagged], float)
    metres = 111_200.0 * np.array([np.cos(np.radians(np.median(degrees[:, 1]))), 1.0])
    at = places(events) * metres
    number = {id(one): i for i, one in enumerate(events)}
    own = np.array([number[id(pairs[photo.name])] for photo in tagged])
    distance = np.linalg.norm(degrees[:, None] * metres - at[None], axis=2)
    # The shift of a cheap receiver is common to all photographs, and must not make a neighbour the nearest.
    shift = np.median(degrees * metres - at[own], axis=0)
    shifted = np.linalg.norm(degrees[:, None] * metres - shift - at[None], axis=2)
    best = np.minimum(distance, shifted) if np.linalg.norm(shift) < 15.0 else distance
    mine = best[np.arange(len(own)), own]
    return bool(np.mean((mine <= best.min(axis=1)) | (mine < _SAME)) >= _NEAREST)
