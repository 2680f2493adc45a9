"""Photographs that show the same picture: copies, and views from one place.

They have no parallax between them, and would only count the same measurements again. Of each group one takes part: the one with
most matches in photographs outside of it, for that is what ties it to the block.
"""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from orthomill.tasks.tie_points.match_records import PairSummary


def repeated_photographs(
    pairs: Sequence[tuple[int, int]], summaries: Sequence[PairSummary], photos: int
) -> dict[int, tuple[int, ...]]:
    """Numbers of the photographs that stay -> those that are left out because they repeat them. pairs: numbers of the photographs
    of each of the `summaries`."""
    alike = np.array([pair for pair, summary in zip(pairs, summaries, strict=True) if summary.alike], int).reshape(-1, 2)
    graph = coo_array((np.ones(len(alike), bool), alike.T), shape=(photos, photos))
    _, group = connected_components(graph, directed=False)
    outside = np.zeros(photos, int)
    for (left, right), summary in zip(pairs, summaries, strict=True):
        if group[left] != group[right]:
            outside[[left, right]] += summary.inliers
    members = [np.flatnonzero(group == number) for number in np.unique(group[alike])]
    # argmax takes the first of equals: of plain copies the first stays.
    kept = [own[np.argmax(outside[own])] for own in members]
    return {int(stays): tuple(map(int, own[own != stays])) for stays, own in zip(kept, members, strict=True)}
