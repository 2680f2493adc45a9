"""In which order the unknowns of a block are eliminated, so that little fill-in arises: nested dissection of the photographs.

Photographs that share points are neighbours. A row of photographs across the block (a separator) is put last; what it parts is
dissected in the same way. Every separator, and every part too small to be cut, is a front: its groups are eliminated together, as a
dense matrix with the groups of later fronts that they touch (its boundary). What is no photograph (a camera, a kept point, shift
and lever arm) joins the first front from which all that it touches can be seen: the camera of the whole block comes last of all.

Source: George 1973, "Nested dissection of a regular finite element mesh"; George and Liu 1981, chapter 8.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from orthomill.tasks.adjustment.sparse.block_matrix import Pattern

LEAF = 12
"""Photographs in a part that is not cut any more."""
EVEN = 0.25
"""Least share of the photographs on either side of a cut."""
CUTS = 50
"""About how many cuts of a part are compared at most."""
WORTH = 0.5
"""A separator that holds a larger share of the photographs than this is no gain: the part stays whole."""


@dataclass(frozen=True, eq=False)
class Front:
    """Groups `own` that are eliminated together, groups `boundary` of later fronts that these touch then, the number of the front
    `parent` that takes over what is left (-1: the last front)."""

    own: np.ndarray
    boundary: np.ndarray
    parent: int


def dissected(pattern: Pattern, photos: int, last: np.ndarray) -> tuple[Front, ...]:
    """The fronts in the order of elimination; the first `photos` groups of the pattern are photographs, groups `last` go to the
    last front."""
    graph = _graph(pattern)
    inner = np.setdiff1d(np.arange(photos), last)
    own, parent = _listed((last, (_parted(graph, inner),)) if len(last) else _parted(graph, inner))
    front_of = np.full(len(pattern.start) - 1, len(own) - 1)
    for number, groups in enumerate(own):
        front_of[groups] = number
    earliest = _earliest(parent)
    for group in range(photos, len(front_of)):
        touched = graph.indices[graph.indptr[group] : graph.indptr[group + 1]]
        front_of[group] = _meeting(front_of[touched[touched < group]], parent, earliest)
    return _fronts(graph, front_of, parent)


def _graph(pattern: Pattern) -> csr_array:
    """(G, G) bool: which groups have a block with which others."""
    rows, columns = pattern.rows, pattern.partner
    off = rows != columns
    both = np.concatenate([rows[off], columns[off]]), np.concatenate([columns[off], rows[off]])
    groups = len(pattern.start) - 1
    graph = csr_array((np.ones(len(both[0])), both), shape=(groups, groups))
    graph.sort_indices()
    return graph


def _parted(graph: csr_array, nodes: np.ndarray) -> tuple:
    """The tree (own, children) of the `nodes`, ascending."""
    if len(nodes) <= LEAF:
        return nodes, ()
    inside = graph[nodes][:, nodes]
    count, label = connected_components(inside, directed=False)
    if count > 1:
        return nodes[:0], tuple(_parted(graph, nodes[label == k]) for k in range(count))
    side = _cut(inside)
    if (side == 0).mean() > WORTH:
        return nodes, ()
    return nodes[side == 0], tuple(_parted(graph, nodes[side == k]) for k in (-1, 1))


def _cut(inside: csr_array) -> np.ndarray:
    """(n,) 0 for the separator of a connected graph, -1 and 1 for the two sides of it.

    Nodes are ordered by how much nearer they are to one end of the graph than to the other, which makes straight cuts.
    """
    end = int(_steps(inside, 0).argmax())
    from_end = _steps(inside, end)
    along = from_end - _steps(inside, int(from_end.argmax()))
    row, column = inside.nonzero()
    best = None
    for left in _halves(along):
        crossing = left[row] & ~left[column]
        for touching in (row[crossing], column[crossing]):
            side = np.where(left, -1, 1)
            side[touching] = 0
            if best is None or (side == 0).sum() < (best == 0).sum():
                best = side
    return best


def _halves(along: np.ndarray) -> list[np.ndarray]:
    """The cuts between different values that leave enough on either side; where there is none, the one in the middle."""
    values = np.unique(along)
    cuts = [along <= value for value in values[:: max(1, len(values) // CUTS)]]
    even = [left for left in cuts if EVEN <= left.mean() <= 1.0 - EVEN]
    if even:
        return even
    left = np.zeros(len(along), bool)
    left[np.argsort(along, kind="stable")[: len(along) // 2]] = True
    return [left]


def _steps(graph: csr_array, node: int) -> np.ndarray:
    return dijkstra(graph, directed=False, indices=node, unweighted=True)


def _listed(tree: tuple) -> tuple[list[np.ndarray], np.ndarray]:
    """The own groups of the fronts, children before parents, and the parents (F,)."""
    own: list[np.ndarray] = []
    parent: list[int] = []

    def visit(node: tuple) -> int:
        children = [visit(child) for child in node[1]]
        own.append(node[0])
        parent.append(-1)
        for child in children:
            parent[child] = len(own) - 1
        return len(own) - 1

    visit(tree)
    return own, np.array(parent)


def _earliest(parent: np.ndarray) -> np.ndarray:
    """(F,) the first front below every front: those below front f are earliest[f] to f."""
    earliest = np.arange(len(parent))
    for front, above in enumerate(parent):
        if above >= 0:
            earliest[above] = min(earliest[above], earliest[front])
    return earliest


def _meeting(fronts: np.ndarray, parent: np.ndarray, earliest: np.ndarray) -> int:
    """The first front that has each of `fronts` below or above it."""
    if not len(fronts):
        return len(parent) - 1
    fronts = np.unique(fronts)
    front = int(fronts[0])
    while not (((earliest[front] <= fronts) & (fronts <= front)) | ((earliest[fronts] <= front) & (front <= fronts))).all():
        front = int(parent[front])
    return front


def _fronts(graph: csr_array, front_of: np.ndarray, parent: np.ndarray) -> tuple[Front, ...]:
    own = [np.flatnonzero(front_of == number) for number in range(len(parent))]
    left: list[list[np.ndarray]] = [[] for _ in own]
    fronts = []
    for number, groups in enumerate(own):
        touched = [graph.indices[graph.indptr[g] : graph.indptr[g + 1]] for g in groups]
        boundary = np.unique(np.concatenate([*touched, *left[number], groups[:0]]))
        boundary = boundary[front_of[boundary] > number]
        fronts.append(Front(groups, boundary, int(parent[number])))
        if parent[number] >= 0:
            left[parent[number]].append(boundary)
    return tuple(fronts)
