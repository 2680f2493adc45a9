"""Places that a receiver gave again and again: one measurement, however many photographs carry it.

A receiver that lost its satellites, or a telephone that is not asked for its place, repeats the last one to the last digit. Taken
as a measurement of each photograph these would determine place, scale and azimuth by the root of their number too well.
"""

from collections import Counter

from orthomill.schemas.photo import Photo
from orthomill.tasks.photos.tags.fixes import Sigma

LEAST = 3
"""Photographs in one place to the last digit, which is no chance in flight"""


def repetitions(photos: list[Photo]) -> dict[str, int]:
    """How many photographs share the place of each, by its path: 1 where fewer than `LEAST` do, or where there is none."""
    placed = [photo for photo in photos if photo.longitude is not None]
    count = Counter((photo.longitude, photo.latitude) for photo in placed)
    found = {photo.path: count[photo.longitude, photo.latitude] for photo in placed}
    return {photo.path: number if (number := found.get(photo.path, 1)) >= LEAST else 1 for photo in photos}


def counted_once(sigma: dict[str, Sigma], times: dict[str, int]) -> dict[str, Sigma]:
    """Standard errors (m, by path) with which the photographs of one place weigh as much together as one."""
    return {path: (x * times[path] ** 0.5, y * times[path] ** 0.5, z * times[path] ** 0.5) for path, (x, y, z) in sigma.items()}
