"""The matched features that tracks are made from: all of them, or in large blocks each photograph's share.

Tracks, tie points and adjustment hold all of a block at once, so that their memory follows what was matched. A photograph is
determined as well by a thousand points all over its frame as by five thousand. Where a block has more than it needs, those stay
that were matched in most pairs, for they make the longest tracks: the best of every part of the frame before the second best of
any.
"""

from collections.abc import Iterator

import numpy as np

from orthomill.tasks.tie_points.match_records import Features, KeptFeatures, MatchCounts, MatchedFeatures, PairMatches
from orthomill.tasks.tie_points.search_settings import LEAST_SHARE

_PARTS = 8
"""parts of the frame along either side"""
Pairs = tuple[tuple[int, int], ...]


def keep_matched(
    matches: Iterator[PairMatches],
    again: Iterator[PairMatches],
    features: Iterator[Features],
    pairs: Pairs,
    sizes: tuple[tuple[int, int], ...],
    most: int,
) -> KeptFeatures:
    """The features that take part, `most` in all unless `LEAST_SHARE` of every photograph are more, and how many matches join them.

    matches, again: one table per pair of photograph numbers, twice the same; features: one per photograph; sizes: (width, height).
    """
    times = _times_matched(matches, pairs, len(sizes))
    matched = [np.flatnonzero(own) for own in times]
    if sum(map(len, matched)) > most:
        share = max(LEAST_SHARE, most // len(sizes))
        matched = [
            _best_of_parts(own, numbers, times[photo][numbers], sizes[photo], share)
            for photo, (own, numbers) in enumerate(zip(features, matched, strict=True))
        ]
    photo = np.repeat(np.arange(len(sizes), dtype=np.int32), list(map(len, matched)))
    kept = MatchedFeatures(photo, np.concatenate(matched).astype(np.int32))
    joined = sum(map(len, kept_matches(again, pairs, kept)))
    return KeptFeatures(MatchCounts(matches=joined, features=len(kept)), kept)


def kept_matches(matches: Iterator[PairMatches], pairs: Pairs, kept: MatchedFeatures) -> Iterator[PairMatches]:
    """The matches of every pair of which both features are kept."""
    photos = max(map(max, pairs), default=0) + 1
    own = np.split(kept.number, np.searchsorted(kept.photo, np.arange(1, photos)))
    for found, (left, right) in zip(matches, pairs, strict=True):
        both = _among(found.left, own[left]) & _among(found.right, own[right])
        yield found.take(np.flatnonzero(both))


def _among(numbers: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """(N,) bool: numbers that are in `kept`, which ascends."""
    if not len(kept):
        return np.zeros(len(numbers), bool)
    return np.asarray(kept[np.searchsorted(kept, numbers).clip(max=len(kept) - 1)] == numbers)


def _times_matched(matches: Iterator[PairMatches], pairs: Pairs, photos: int) -> list[np.ndarray]:
    """For every photograph in how many pairs each of its features was matched, by their numbers up to the last matched one."""
    times = [np.zeros(0, np.uint16) for _ in range(photos)]
    for found, (left, right) in zip(matches, pairs, strict=True):
        for photo, numbers in ((left, found.left), (right, found.right)):
            sums = np.bincount(numbers, minlength=len(times[photo])).astype(np.uint16)
            sums[: len(times[photo])] += times[photo]
            times[photo] = sums
    return times


def _best_of_parts(features: Features, numbers: np.ndarray, times: np.ndarray, size: tuple[int, int], most: int) -> np.ndarray:
    """At most `most` of the features `numbers` (N,), ascending: of every part of the frame those that were matched most often."""
    col, row = features.col[numbers] / size[0], features.row[numbers] / size[1]
    part = (np.clip(row * _PARTS, 0, _PARTS - 1).astype(int)) * _PARTS + np.clip(col * _PARTS, 0, _PARTS - 1).astype(int)
    fewest = -times.astype(np.int64)
    order = np.lexsort((numbers, fewest, part))
    rank = np.empty(len(numbers), np.int64)
    rank[order] = np.arange(len(numbers)) - np.searchsorted(part[order], part[order])
    return np.sort(numbers[np.lexsort((numbers, fewest, rank))[:most]])
