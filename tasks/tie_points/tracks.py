"""Tracks: features of many photographs joined to one tie point through their pairwise matches.

Features at the same place of a photograph (SIFT may assign two directions to a point) count as one. A track is a connected
component of the matches; one that meets a photograph in two places contains a false match and is dropped. The reference of a track
is the photograph that shows it nearest to its centre: there distortion and obliqueness are smallest. The features of the
photographs stream by and only those that were matched and kept (matched_features.py) stay, so that memory follows the matches,
which are counted beforehand.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from orthomill.schemas.errors import GeometryError
from orthomill.schemas.memory import array_bytes
from orthomill.tasks.imagery.photograph_rows import rows_of_photos
from orthomill.tasks.tie_points.match_records import (
    Features,
    Links,
    MatchCounts,
    MatchedFeatures,
    Observations,
    PairMatches,
    PairSummary,
)
from orthomill.tasks.tie_points.matched_features import kept_matches
from orthomill.tasks.tie_points.repeated_photographs import repeated_photographs


def observation_key(photo: int) -> str:
    """The name under which `build_tracks` returns the observations of a photograph."""
    return f"observations_{photo}"


def track_scratch(counts: MatchCounts) -> int:
    """Working memory of `build_tracks`, bytes."""
    # A place with its photograph, pixels, labels and the keys by which they are sorted; a match in two tables, as an edge of the
    # graph, and as SciPy turns that graph over.
    return array_bytes(200, counts.features) + array_bytes(40, counts.matches)


def tracks_of_kept(
    features: Iterator[Features],
    matches: Iterator[PairMatches],
    summaries: tuple[PairSummary, ...],
    kept: MatchedFeatures,
    pairs: tuple[tuple[int, int], ...],
    sizes: tuple[tuple[int, int], ...],
) -> dict[str, Links | Observations]:
    """`build_tracks` from those matches whose features are `kept`."""
    return build_tracks(features, tuple(kept_matches(matches, pairs, kept)), pairs, sizes, summaries)


def build_tracks(
    features: Iterator[Features],
    matches: tuple[PairMatches, ...],
    pairs: tuple[tuple[int, int], ...],
    sizes: tuple[tuple[int, int], ...],
    summaries: tuple[PairSummary, ...] = (),
) -> dict[str, Links | Observations]:
    """`links` between photographs, and the observations of every photograph under its `observation_key`.

    features: one table per photograph; matches, summaries: one per pair of photograph numbers; sizes: (width, height) of the
    photographs. Raises GeometryError without usable matches.
    """
    matches = _without_repeated(matches, pairs, summaries, len(sizes))
    if not any(len(found) for found in matches):
        raise GeometryError(
            f"None of the {len(pairs)} pairs of the {len(sizes)} photographs shows common ground: too few points agree in any "
            "of them. Photographs of a block must overlap by half or more and show more than a repetitive pattern."
        )
    places = list(map(_places, features, _matched(matches, pairs, len(sizes))))
    nodes = _nodes(places)
    node, track, conflicts = _tracks(nodes, _edges(places, nodes.starts, matches, pairs))
    if not len(track):
        raise GeometryError(
            f"All {conflicts} tracks of tie points are contradictory: each meets a photograph in two places, so the photographs "
            "show too many objects that look alike. Lower the setting ratio of tie_points."
        )
    photo = nodes.photo[node]
    reference = _references(nodes, node, track, np.array(sizes, dtype=float))
    found: dict[str, Links | Observations] = {"links": _links(photo, track, reference, conflicts)}
    for number, (own, here) in enumerate(zip(places, rows_of_photos(photo, len(places)), strict=True)):
        found[observation_key(number)] = _observations(own.first, node[here] - nodes.starts[number], track[here], reference)
    return found


def _without_repeated(
    matches: tuple[PairMatches, ...], pairs: tuple[tuple[int, int], ...], summaries: tuple[PairSummary, ...], photos: int
) -> tuple[PairMatches, ...]:
    """The matches without those of photographs that repeat another one: their measurements would repeat those of the other, errors
    included."""
    found = repeated_photographs(pairs[: len(summaries)], summaries, photos)
    repeated, nothing = {photo for others in found.values() for photo in others}, np.zeros(0, dtype=np.int64)
    return tuple(own.take(nothing) if repeated & set(pair) else own for own, pair in zip(matches, pairs, strict=True))


@dataclass(frozen=True, eq=False)
class _MatchedPlaces:
    """Where a photograph has matched features. matched: their numbers, ascending; place: of each of them the number of its place;
    first: the first feature of every place."""

    matched: np.ndarray
    place: np.ndarray
    first: Features


@dataclass(frozen=True, eq=False)
class _Nodes:
    """The places of all photographs in sequence: photograph, and position (N, 2) px."""

    starts: np.ndarray
    """number of the first place of every photograph"""
    photo: np.ndarray
    pixels: np.ndarray


def _ends(matches: Iterable[PairMatches], pairs: tuple[tuple[int, int], ...]) -> Iterator[tuple[int, np.ndarray]]:
    """Photograph and numbers of its features, for either side of the matches of every pair."""
    for found, (left, right) in zip(matches, pairs, strict=True):
        yield left, found.left
        yield right, found.right


def _matched(matches: tuple[PairMatches, ...], pairs: tuple[tuple[int, int], ...], photos: int) -> list[np.ndarray]:
    """The numbers of the features of every photograph that some pair has matched, ascending."""
    found: list[list[np.ndarray]] = [[np.zeros(0, np.int32)] for _ in range(photos)]
    for photo, own in _ends(matches, pairs):
        found[photo].append(own)
    return [np.unique(np.concatenate(numbers)) for numbers in found]


def _places(features: Features, matched: np.ndarray) -> _MatchedPlaces:
    # Equal coordinates, not nearly equal ones: SIFT repeats a point with another direction at exactly the same position.
    pixels = np.column_stack([features.col[matched], features.row[matched]])
    _, first, place = np.unique(pixels, axis=0, return_index=True, return_inverse=True)
    return _MatchedPlaces(matched, place.ravel().astype(np.int32), features.take(matched[first]))


def _nodes(places: list[_MatchedPlaces]) -> _Nodes:
    counts = [len(own.first) for own in places]
    pixels = np.column_stack([np.concatenate([getattr(own.first, name) for own in places]) for name in ("col", "row")])
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    return _Nodes(starts, np.repeat(np.arange(len(places), dtype=np.int32), counts), pixels)


def _edges(
    places: list[_MatchedPlaces], starts: np.ndarray, matches: tuple[PairMatches, ...], pairs: tuple[tuple[int, int], ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Both ends (N,) int32 of every match, by the number of the node."""

    def ends(photo: int, numbers: np.ndarray) -> np.ndarray:
        own = places[photo]
        return (starts[photo] + own.place[np.searchsorted(own.matched, numbers)]).astype(np.int32)

    found = [(ends(left, match.left), ends(right, match.right)) for match, (left, right) in zip(matches, pairs, strict=True)]
    left, right = (np.concatenate([pair[side] for pair in found]) for side in (0, 1))
    return left, right


def _tracks(nodes: _Nodes, edges: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray, int]:
    """Places that belong to tracks and the tracks' numbers, sorted by track, then photograph; and the number of dropped tracks."""
    count = len(nodes.photo)
    _, label = connected_components(coo_array((np.ones(len(edges[0]), bool), edges), shape=(count, count)), directed=False)
    members = np.bincount(label)
    # A component with more places than photographs meets one of them twice. Which of its matches is false cannot be known.
    photos = len(nodes.starts)
    distinct = np.bincount(np.unique(label * np.int64(photos) + nodes.photo) // photos, minlength=len(members))
    good = (members >= 2) & (distinct == members)
    node = np.flatnonzero(good[label])
    track = np.unique(label[node], return_inverse=True)[1].ravel()
    order = np.lexsort((nodes.photo[node], track))
    return node[order], track[order], int(((members >= 2) & (distinct < members)).sum())


def _references(nodes: _Nodes, node: np.ndarray, track: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """The reference photograph of every track: the one that shows it nearest to its centre, in units of the longer side."""
    size = sizes[nodes.photo[node]]
    off_centre = np.hypot(*((nodes.pixels[node] - (size - 1) / 2) / size.max(axis=1, keepdims=True)).T)
    order = np.lexsort((off_centre, track))
    _, first = np.unique(track[order], return_index=True)
    return nodes.photo[node][order][first]


def _observations(features: Features, number: np.ndarray, track: np.ndarray, reference: np.ndarray) -> Observations:
    return Observations(
        track=track.astype(np.int32),
        reference=reference[track].astype(np.int32),
        col=features.col[number],
        row=features.row[number],
        size=features.size[number],
        angle=features.angle[number],
    )


def _links(photo: np.ndarray, track: np.ndarray, reference: np.ndarray, conflicts: int) -> Links:
    other = photo != reference[track]
    pairs = np.unique(np.column_stack([reference[track[other]], photo[other]]), axis=0)
    joined = sorted({(min(pair), max(pair)) for pair in pairs.tolist()})
    return Links(pairs=tuple(joined), tracks=len(reference), conflicts=conflicts)
