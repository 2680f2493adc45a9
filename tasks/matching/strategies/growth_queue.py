"""The order in which regions grow: a queue of seven priorities per region, and the rules for its entries.

Strategy. Neighbours of a solved node wait with the priority of their distance and direction: at one step 2 along the column and 3
along the row, at two steps 4 and 5, at three 6 and 7; seeds have 1. The smallest number is served first, and of equals the earliest
entry. A node that was tried is never tried again; one that waits is only moved to a better priority, so that its predicted position
never gets worse. The lists of all priorities are linked in one table of successors; stale entries are skipped when they are
reached. Neighbours along the column are preferred because the shift across the base varies slowly, while parallax jumps with the
relief.

Source: Otto & Chau 1989, as modified by Skarlatos (sources/matching.md#region-growing).
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit

SEED = 1
PRIORITIES = 8
"""0 is not used: it means not waiting."""
_TRIED = 255


class Queues(NamedTuple):
    """Nodes are numbered row by row, regions too. All arrays are changed in place."""

    region: np.ndarray
    """(nodes,) int32: the region of every node"""
    waiting: np.ndarray
    """(nodes,) uint8: the priority of a waiting node, 0 for none, 255 once it was tried"""
    after: np.ndarray
    """(nodes, PRIORITIES) int32: the next node in the list of a priority, -1 at its end"""
    first: np.ndarray
    last: np.ndarray
    """(regions, PRIORITIES) int32: ends of the lists, -1 when empty"""
    start: np.ndarray
    """(nodes, 2) float64: predicted right positions, px"""
    affine: np.ndarray
    """(nodes, 4) float64: predicted affines"""


def queues_for(region: np.ndarray) -> Queues:
    """Empty queues for nodes (N,) of regions 0 to n - 1."""
    count, regions = len(region), int(region.max(initial=-1)) + 1
    return Queues(
        region=region.astype(np.int32),
        waiting=np.zeros(count, np.uint8),
        after=np.full((count, PRIORITIES), -1, np.int32),
        first=np.full((regions, PRIORITIES), -1, np.int32),
        last=np.full((regions, PRIORITIES), -1, np.int32),
        start=np.full((count, 2), np.nan),
        affine=np.tile([1.0, 0.0, 0.0, 1.0], (count, 1)),
    )


@njit()
def push(queues, node, priority, col, row, affine):
    """Enter a node with its prediction, unless it was tried or waits with the same or a better priority."""
    if queues.waiting[node] == _TRIED or 0 < queues.waiting[node] <= priority:
        return
    queues.waiting[node] = priority
    queues.start[node, 0], queues.start[node, 1] = col, row
    for k in range(4):
        queues.affine[node, k] = affine[k]
    # Its entry under the former priority stays in that list and is skipped: unlinking would need two-way links.
    region = queues.region[node]
    queues.after[node, priority] = -1
    end = queues.last[region, priority]
    if end < 0:
        queues.first[region, priority] = node
    else:
        queues.after[end, priority] = node
    queues.last[region, priority] = node


@njit()
def pop_each(queues, regions, out):
    """Take the best node of every region of a list (M,) that has one; returns their number. `regions` shrinks in place."""
    count = 0
    for i in range(regions.size):
        region = regions[i]
        taken = -1
        for priority in range(1, PRIORITIES):
            while taken < 0 and queues.first[region, priority] >= 0:
                node = queues.first[region, priority]
                queues.first[region, priority] = queues.after[node, priority]
                if queues.first[region, priority] < 0:
                    queues.last[region, priority] = -1
                # Stale: the node waits, or waited, with a better priority.
                if queues.waiting[node] == priority:
                    taken = node
            if taken >= 0:
                break
        if taken >= 0:
            queues.waiting[taken] = _TRIED
            out[count], regions[count] = taken, region
            count += 1
    return count


@njit()
def push_neighbours(queues, cols, step, levels, nodes, right, affine, across):
    """Enter the neighbours of solved nodes (M,) with the prediction of right (M, 2) and affine (M, 4).

    cols: nodes in a row; step: their distance, px. `across`: neighbours in other regions only, instead of those in the same one.
    """
    rows = queues.waiting.size // cols
    for i in range(nodes.size):
        r, c, a = nodes[i] // cols, nodes[i] % cols, affine[i]
        for level in range(1, levels + 1):
            for side in range(4):
                along_row = side // 2
                # Down, up, right, left: the published order decides among equal priorities.
                move = level if side % 2 == 0 else -level
                y, x = (r, c + move) if along_row else (r + move, c)
                if not (0 <= y < rows and 0 <= x < cols):
                    continue
                node = y * cols + x
                if (queues.region[node] != queues.region[nodes[i]]) != across:
                    continue
                dx, dy = (x - c) * step, (y - r) * step
                push(
                    queues,
                    node,
                    2 * level + along_row,
                    right[i, 0] + (a[0] * dx + a[1] * dy),
                    right[i, 1] + (a[2] * dx + a[3] * dy),
                    a,
                )
