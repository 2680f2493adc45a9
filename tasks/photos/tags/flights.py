"""Flights: photographs of one receiver without a long break, which share the constant errors of its positions.

A break of twenty minutes is a new flight: batteries last as long. A shorter one is, where the drone measured its heights from
another start afterwards: the difference of its two heights, the height of the place of take-off, is then another one.
"""

from collections import defaultdict

import numpy as np

from orthomill.schemas.photo import Photo

_BREAK, _PAUSE = 20 * 60.0, 60.0
"""s: a break that is always one between flights, and the shortest in which a battery can be changed"""
_USUAL = 5.0
"""A pause is longer than so many usual intervals"""
_RESTARTED = 0.5
"""m: change of the height of the take-off that a drift of the air pressure does not make in a pause"""


def with_flights(photos: list[Photo]) -> list[Photo]:
    """The photographs with the numbers of their flights, in the order of time; those without a time belong to the first of their
    receiver."""
    receivers: defaultdict[str, list[int]] = defaultdict(list)
    for i, photo in enumerate(photos):
        receivers[photo.serial or ""].append(i)
    number = np.zeros(len(photos), int)
    after = 0
    for own in receivers.values():
        numbers = after + _flights([photos[i] for i in own])
        number[own], after = numbers, int(numbers.max()) + 1
    return [photo.model_copy(update={"flight": int(k)}) for photo, k in zip(photos, number, strict=True)]


def _flights(photos: list[Photo]) -> np.ndarray:
    """(N,) numbers from 0 of photographs of one receiver."""
    number = np.zeros(len(photos), int)
    seconds = np.array([photo.seconds for photo in photos])
    known = np.flatnonzero(np.isfinite(seconds))
    if len(known) < 2:
        return number
    order = known[np.argsort(seconds[known], kind="stable")]
    gaps = np.diff(seconds[order])
    start = np.array([_start_height(photos[i]) for i in order])
    # Unknown heights compare as False.
    restarted = np.abs(np.diff(start)) > _RESTARTED
    usual = float(np.median(gaps))
    new = (gaps > max(_BREAK, _USUAL * usual)) | ((gaps > max(_PAUSE, _USUAL * usual)) & restarted)
    number[order] = np.concatenate([[0], np.cumsum(new)])
    return number


def _start_height(photo: Photo) -> float:
    """Height of the place of take-off, m; NaN where it is not told, or the two heights come from two instruments."""
    if photo.altitude is None or photo.relative_height is None or photo.height_kind != "barometric":
        return np.nan
    return photo.altitude - photo.relative_height
