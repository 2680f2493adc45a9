"""An order of elimination with little fill-in: nested dissection of the photographs.

Photographs that share points are neighbours. A row of photographs across the block (a separator) comes last; the two parts that it
separates are dissected in the same way. Every separator, and every part too small to be cut, is a front: its groups are eliminated
together, as a dense matrix with the groups of later fronts that they are connected with (its boundary). Other groups (a camera, a
kept point, shift and lever arm) join the first front that has all their neighbours below or above it: the camera of the whole block
comes last of all.

Source: George 1973, "Nested dissection of a regular finite element mesh"; George and Liu 1981, chapter 8.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from orthomill.tasks.adjustment.sparse.block_matrix import Pattern

# A front of 12 photographs has some 72 rows: smaller ones cost more in calls than their zeros save.
LEAF = 12
"""Photographs in a part that is not cut further."""
# Without a bound the smallest separator cuts off a corner, and the tree becomes a chain.
LEAST_SIDE = 0.25
"""Least share of the photographs on either side of a cut."""
CUTS = 50
"""Approximate largest number of cuts of a part that are compared."""
LARGEST_SEPARATOR = 0.5
"""A part whose separator would hold a larger share of its photographs than this is not cut."""


@dataclass(frozen=True, eq=False)
class Front:
    """Groups `own` that are eliminated together, groups `boundary` of later fronts that they are connected with by then, and the
    number of the front `parent` that takes their contribution (-1: the last front)."""

    own: np.ndarray
    boundary: np.ndarray
    parent: int


@dataclass(frozen=True, eq=False)
class Tree:
    """Groups `own` that are eliminated after those of the `children`."""

    own: np.ndarray
    children: tuple["Tree", ...] = ()


def dissected(pattern: Pattern, photos: int, last: np.ndarray) -> tuple[Front, ...]:
    """The fronts in the order of elimination; the first `photos` groups of the pattern are photographs, groups `last` go to the
    last front."""
    graph = _graph(pattern)
    inner = _parted(graph, np.setdiff1d(np.arange(photos), last))
    own, parent = _listed(Tree(last, (inner,)) if len(last) else inner)
    # Groups without photographs among their neighbours stay in the last front.
    front_of = np.full(len(pattern.start) - 1, len(own) - 1)
    for number, groups in enumerate(own):
        front_of[groups] = number
    earliest = _earliest(parent)
    for group in range(photos, len(front_of)):
        touched = graph.indices[graph.indptr[group] : graph.indptr[group + 1]]
        front_of[group] = _meeting(front_of[touched[touched < group]], parent, earliest)
    return _fronts(graph, front_of, parent)


def _graph(pattern: Pattern) -> csr_array:
    """(G, G) nonzero: which groups have a block with which others."""
    rows, columns = pattern.rows, pattern.partner
    off = rows != columns
    both = np.concatenate([rows[off], columns[off]]), np.concatenate([columns[off], rows[off]])
    groups = len(pattern.start) - 1
    graph = csr_array((np.ones(len(both[0])), both), shape=(groups, groups))
    graph.sort_indices()
    return graph


def _parted(graph: csr_array, nodes: np.ndarray) -> Tree:
    """The tree of the `nodes`, ascending."""
    if len(nodes) <= LEAF:
        return Tree(nodes)
    inside = graph[nodes][:, nodes]
    # Parts without common points need no separator: they are dissected side by side.
    count, label = connected_components(inside, directed=False)
    if count > 1:
        return Tree(nodes[:0], tuple(_parted(graph, nodes[label == k]) for k in range(count)))
    side = _cut(inside)
    if (side == 0).mean() > LARGEST_SEPARATOR:
        return Tree(nodes)
    return Tree(nodes[side == 0], tuple(_parted(graph, nodes[side == k]) for k in (-1, 1)))


def _cut(inside: csr_array) -> np.ndarray:
    """(n,) 0 for the separator of a connected graph, -1 and 1 for its two sides.

    Nodes are ordered by the difference of their distances from two ends of the graph, whose level lines are straight cuts.
    """
    end = int(_steps(inside, 0).argmax())
    from_end = _steps(inside, end)
    along = from_end - _steps(inside, int(from_end.argmax()))
    row, column = inside.nonzero()
    sides = []
    for left in _halves(along):
        crossing = left[row] & ~left[column]
        # The nodes next to the cut on either side of it separate the graph; the smaller set wins, the first one in case of a tie.
        for touching in (row[crossing], column[crossing]):
            side = np.where(left, -1, 1)
            side[touching] = 0
            sides.append(side)
    return min(sides, key=lambda side: int((side == 0).sum()))


def _halves(along: np.ndarray) -> list[np.ndarray]:
    """The cuts between different values that leave enough nodes on either side; the one in the middle where there is none."""
    values = np.unique(along)
    cuts = [along <= value for value in values[:: max(1, len(values) // CUTS)]]
    even = [left for left in cuts if LEAST_SIDE <= left.mean() <= 1.0 - LEAST_SIDE]
    if even:
        return even
    # All distances alike (every photograph sees every other): no cut is a straight one.
    left = np.zeros(len(along), bool)
    left[np.argsort(along, kind="stable")[: len(along) // 2]] = True
    return [left]


def _steps(graph: csr_array, node: int) -> np.ndarray:
    """(n,) the numbers of edges from a node."""
    return dijkstra(graph, directed=False, indices=node, unweighted=True)


def _listed(tree: Tree) -> tuple[list[np.ndarray], np.ndarray]:
    """The own groups of the fronts, children before parents, and the parents (F,)."""
    own: list[np.ndarray] = []
    parent: list[int] = []

    def visit(node: Tree) -> int:
        children = [visit(child) for child in node.children]
        own.append(node.own)
        parent.append(-1)
        for child in children:
            parent[child] = len(own) - 1
        return len(own) - 1

    visit(tree)
    return own, np.array(parent)


def _earliest(parent: np.ndarray) -> np.ndarray:
    """(F,) the first front below every front: the subtree of front f is earliest[f] to f, for children come before parents."""
    earliest = np.arange(len(parent))
    for front, above in enumerate(parent):
        if above >= 0:
            earliest[above] = min(earliest[above], earliest[front])
    return earliest


def _meeting(fronts: np.ndarray, parent: np.ndarray, earliest: np.ndarray) -> int:
    """The first front that has each of `fronts` in its subtree or among its ancestors."""
    if not len(fronts):
        return len(parent) - 1
    fronts = np.unique(fronts)
    front = int(fronts[0])
    while not (((earliest[front] <= fronts) & (fronts <= front)) | ((earliest[fronts] <= front) & (front <= fronts))).all():
        front = int(parent[front])
    return front


def _fronts(graph: csr_array, front_of: np.ndarray, parent: np.ndarray) -> tuple[Front, ...]:
    """The fronts with their boundaries, which the contributions of the fronts below enlarge (the fill-in)."""
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
