"""Tracks: features of many photographs joined to one tie point through their pairwise matches.

Features at the same place of a photograph (SIFT may give a point two directions) count as one. A track is a connected
component of the matches; one that meets a photograph in two places contains a false match somewhere and is dropped. The
reference of a track is the photograph that shows it nearest to its centre: there distortion and obliqueness are smallest.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.tie_points.match_records import Features, Links, Observations, PairMatches, PairSummary


def observation_key(photo: int) -> str:
    """Under which name `build_tracks` returns the observations of a photograph."""
    return f"observations_{photo}"


def build_tracks(
    features: tuple[Features, ...],
    matches: tuple[PairMatches, ...],
    pairs: tuple[tuple[int, int], ...],
    sizes: tuple[tuple[int, int], ...],
    summaries: tuple[PairSummary, ...] = (),
) -> dict[str, Any]:
    """Observations of every photograph and the links between photographs.

    matches, summaries: one per pair of photograph numbers; sizes: (width, height) of the photographs. Of two photographs that stand
    still against each other the second is left out: its measurements would repeat those of the first, errors and all. Raises
    GeometryError without matches.
    """
    twins = {right for (_, right), summary in zip(pairs, summaries, strict=False) if summary.alike}
    matches = tuple(found.take(slice(0)) if twins & set(pair) else found for found, pair in zip(matches, pairs, strict=True))
    if not any(len(found) for found in matches):
        raise GeometryError(
            f"None of the {len(pairs)} pairs of the {len(features)} photographs shows common ground: too few points "
            "agree in any of them; photographs of a block must overlap by half or more, and show more than one pattern that "
            "repeats itself."
        )
    nodes = _nodes(features)
    node, track, conflicts = _tracks(nodes, matches, pairs)
    if not len(track):
        raise GeometryError(
            f"All {conflicts} tracks of tie points contradict themselves; the photographs show too many alike things."
        )
    photo = nodes.photo[node]
    reference = _references(nodes, node, track, np.array(sizes, dtype=float))
    tables = {
        observation_key(number): _observations(
            features[number], nodes.feature[node[photo == number]], track[photo == number], reference
        )
        for number in range(len(features))
    }
    return {"links": _links(photo, track, reference, conflicts), **tables}


@dataclass(frozen=True)
class _Nodes:
    """Places of all photographs. of_feature: number of the place of every feature, all photographs behind each other."""

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
    _, first, of_feature = np.unique(np.column_stack([photo, pixels]), axis=0, return_index=True, return_inverse=True)
    return _Nodes(of_feature.ravel(), starts, photo[first], first - starts[photo[first]], pixels[first])


def _tracks(
    nodes: _Nodes, matches: tuple[PairMatches, ...], pairs: tuple[tuple[int, int], ...]
) -> tuple[np.ndarray, np.ndarray, int]:
    """Places that belong to tracks and the tracks' numbers, sorted by track, then photograph; and how many tracks were dropped."""
    left, right = (
        np.concatenate(
            [nodes.of_feature[nodes.starts[pair[side]] + getattr(found, name)] for found, pair in zip(matches, pairs, strict=True)]
        )
        for side, name in enumerate(("left", "right"))
    )
    count = len(nodes.photo)
    _, label = connected_components(coo_array((np.ones(len(left)), (left, right)), shape=(count, count)), directed=False)
    members = np.bincount(label)
    distinct = np.bincount(np.unique(np.column_stack([label, nodes.photo]), axis=0)[:, 0], minlength=len(members))
    good = (members >= 2) & (distinct == members)
    node = np.flatnonzero(good[label])
    track = np.unique(label[node], return_inverse=True)[1].ravel()
    order = np.lexsort((nodes.photo[node], track))
    return node[order], track[order], int(((members >= 2) & (distinct < members)).sum())


def _references(nodes: _Nodes, node: np.ndarray, track: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """The reference photograph of every track."""
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
