"""Tracks: features of many photographs joined to one tie point through their pairwise matches.

Features at the same place of a photograph (SIFT may assign two directions to a point) count as one. A track is a connected
component of the matches; one that meets a photograph in two places contains a false match and is dropped. The reference of a track
is the photograph that shows it nearest to its centre: there distortion and obliqueness are smallest.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.tie_points.match_records import Features, Links, Observations, PairMatches, PairSummary


def observation_key(photo: int) -> str:
    """The name under which `build_tracks` returns the observations of a photograph."""
    return f"observations_{photo}"


def build_tracks(
    features: tuple[Features, ...],
    matches: tuple[PairMatches, ...],
    pairs: tuple[tuple[int, int], ...],
    sizes: tuple[tuple[int, int], ...],
    summaries: tuple[PairSummary, ...] = (),
) -> dict[str, Links | Observations]:
    """`links` between photographs, and the observations of every photograph under its `observation_key`.

    matches, summaries: one per pair of photograph numbers; sizes: (width, height) of the photographs. Raises GeometryError without
    usable matches.
    """
    matches = _without_duplicates(matches, pairs, summaries)
    if not any(len(found) for found in matches):
        raise GeometryError(
            f"None of the {len(pairs)} pairs of the {len(features)} photographs shows common ground: too few points agree in any "
            "of them. Photographs of a block must overlap by half or more and show more than a repetitive pattern."
        )
    nodes = _nodes(features)
    node, track, conflicts = _tracks(nodes, matches, pairs)
    if not len(track):
        raise GeometryError(
            f"All {conflicts} tracks of tie points are contradictory: each meets a photograph in two places, so the photographs "
            "show too many objects that look alike. Lower the setting ratio of tie_points."
        )
    photo = nodes.photo[node]
    reference = _references(nodes, node, track, np.array(sizes, dtype=float))
    found: dict[str, Links | Observations] = {"links": _links(photo, track, reference, conflicts)}
    for number, own in enumerate(features):
        here = photo == number
        found[observation_key(number)] = _observations(own, nodes.feature[node[here]], track[here], reference)
    return found


def _without_duplicates(
    matches: tuple[PairMatches, ...], pairs: tuple[tuple[int, int], ...], summaries: tuple[PairSummary, ...]
) -> tuple[PairMatches, ...]:
    """The matches without those of photographs that repeat another one: of two photographs without parallax the second is left out,
    for its measurements would repeat those of the first, errors included."""
    repeated = {right for (_, right), summary in zip(pairs, summaries, strict=False) if summary.alike}
    nothing = np.zeros(0, dtype=np.int64)
    return tuple(found.take(nothing) if repeated & set(pair) else found for found, pair in zip(matches, pairs, strict=True))


@dataclass(frozen=True)
class _Nodes:
    """Places of all photographs. of_feature: number of the place of every feature, the photographs in sequence."""

    of_feature: np.ndarray
    starts: np.ndarray
    """number of the first feature of every photograph"""
    photo: np.ndarray
    feature: np.ndarray
    """per place: photograph, and the first feature there by its number in the photograph"""
    pixels: np.ndarray


def _nodes(features: tuple[Features, ...]) -> _Nodes:
    counts = np.array([len(table) for table in features])
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    photo = np.repeat(np.arange(len(features)), counts)
    pixels = np.column_stack([np.concatenate([getattr(table, name) for table in features]) for name in ("col", "row")])
    # Equal coordinates, not nearly equal ones: SIFT repeats a point with another direction at exactly the same position.
    _, first, of_feature = np.unique(np.column_stack([photo, pixels]), axis=0, return_index=True, return_inverse=True)
    return _Nodes(of_feature.ravel(), starts, photo[first], first - starts[photo[first]], pixels[first])


def _tracks(
    nodes: _Nodes, matches: tuple[PairMatches, ...], pairs: tuple[tuple[int, int], ...]
) -> tuple[np.ndarray, np.ndarray, int]:
    """Places that belong to tracks and the tracks' numbers, sorted by track, then photograph; and the number of dropped tracks."""
    left, right = (
        np.concatenate(
            [nodes.of_feature[nodes.starts[pair[side]] + getattr(found, name)] for found, pair in zip(matches, pairs, strict=True)]
        )
        for side, name in enumerate(("left", "right"))
    )
    count = len(nodes.photo)
    _, label = connected_components(coo_array((np.ones(len(left)), (left, right)), shape=(count, count)), directed=False)
    members = np.bincount(label)
    # A component with more places than photographs meets one of them twice. Which of its matches is false cannot be known.
    distinct = np.bincount(np.unique(np.column_stack([label, nodes.photo]), axis=0)[:, 0], minlength=len(members))
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
