"""An octree of points on the disk: each node has at most one point in each of its 128 cells along a side, what is left goes down.

The tree is cut at a level whose cubes hold few enough points to be sorted in memory: points are first put into a file for each such
cube (bucket), then one bucket after another is divided. A cell of any level above the cut is no larger than a bucket, so that a
bucket knows by itself which of its points belong to the nodes that it shares with others; those nodes are collected in files and
come last. Coordinates are whole steps of the header, the side of the tree is a power of two of them: no rounding anywhere.

Source: COPC 1.0 and Entwine Point Tiles 1.1 (keys of nodes); Schuetz 2016, Potree (sampling of a node by a grid).
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

SPAN_BITS = 7
"""a node has 2 to this power of cells along a side"""
MOST_LEVELS = 14
"""with the cells of a node 21 bits for a coordinate, so that three are one number of 64 bits"""
BUCKET = 2_000_000
"""points that are sorted in memory"""
FEW = 2_000
"""points below a node that become its own: files and requests for a handful cost more than they show"""


class NodeKey(NamedTuple):
    """A node: its level, and its place among those of the level along each axis."""

    level: int
    x: int
    y: int
    z: int


@dataclass(frozen=True)
class Cube:
    """The root: its lowest corner (3,) in steps, and its side, 2 to the power of `bits` steps."""

    low: np.ndarray
    bits: int

    @property
    def levels(self) -> int:
        """The deepest level, at which a cell is a step or the numbers end."""
        return max(min(self.bits - SPAN_BITS, MOST_LEVELS), 0)


def cube_around(low: np.ndarray, high: np.ndarray) -> Cube:
    """The smallest cube of such a side that contains places from `low` to `high` (3,) in steps."""
    side = int((high.astype(np.int64) - low).max()) + 1
    return Cube(low.astype(np.int64), max(int(side - 1).bit_length(), SPAN_BITS))


class PointOctree:
    """The nodes of all points of `parts`; files are kept in the folder `scratch`."""

    def __init__(self, parts: Iterable[np.ndarray], scratch: Path, bucket: int = BUCKET) -> None:
        self.scratch, self.count = scratch, 0
        low, high = np.full(3, 2**31 - 1, np.int64), np.full(3, -(2**31), np.int64)
        with (scratch / "all").open("wb") as target:
            for records in parts:
                self.dtype, self.count = records.dtype, self.count + len(records)
                places = _places(records)
                low, high = np.minimum(low, places.min(axis=0)), np.maximum(high, places.max(axis=0))
                target.write(records.tobytes())
        if self.count:
            self.low, self.high, self.cube = low, high, cube_around(low, high)
            self.cut = self._cut(bucket)

    def nodes(self) -> Iterator[tuple[NodeKey, np.ndarray]]:
        """Keys and records (N,) of all nodes, none of them empty; the same points always in the same order."""
        self._scatter()
        shared: set[NodeKey] = set()
        for path in sorted(self.scratch.glob("bucket-*")):
            records = np.fromfile(path, self.dtype)
            path.unlink()
            for key, index in _divided(_places(records) - self.cube.low, self.cube, self.cut):
                if key.level >= self.cut:
                    yield key, records[index]
                else:
                    shared.add(key)
                    with self._file_of(key).open("ab") as target:
                        target.write(records[index].tobytes())
        for key in sorted(shared):
            yield key, np.fromfile(self._file_of(key), self.dtype)
            self._file_of(key).unlink()

    def _file_of(self, key: NodeKey) -> Path:
        return self.scratch / f"node-{key.level}-{key.x}-{key.y}-{key.z}"

    def _stored(self) -> Iterator[np.ndarray]:
        together = 500_000
        with (self.scratch / "all").open("rb") as source:
            while len(data := source.read(together * self.dtype.itemsize)):
                yield np.frombuffer(data, self.dtype)

    def _cut(self, bucket: int) -> int:
        """The first level of which no node has more than `bucket` points below it, as far as there are cells for it."""
        if self.count <= bucket:
            return 0
        deepest = min(SPAN_BITS, self.cube.levels)
        counts = np.zeros((1 << deepest,) * 3, np.int64)
        for records in self._stored():
            np.add.at(counts, tuple((_places(records) - self.cube.low).T >> (self.cube.bits - deepest)), 1)
        for level in range(deepest, 0, -1):
            side = 1 << (level - 1)
            above = counts.reshape(side, 2, side, 2, side, 2).sum(axis=(1, 3, 5))
            if above.max() > bucket:
                return level
            counts = above
        return 0

    def _scatter(self) -> None:
        for records in self._stored():
            place = (_places(records) - self.cube.low) >> (self.cube.bits - self.cut)
            code = _code(place, self.cut)
            order = np.argsort(code, kind="stable")
            starts = np.flatnonzero(np.diff(code[order], prepend=-1))
            for first, last in zip(starts, [*starts[1:], len(order)], strict=True):
                with (self.scratch / f"bucket-{code[order[first]]:07d}").open("ab") as target:
                    target.write(records[order[first:last]].tobytes())
        (self.scratch / "all").unlink()


def _places(records: np.ndarray) -> np.ndarray:
    """(N, 3) int64 steps."""
    return np.column_stack([records["X"], records["Y"], records["Z"]]).astype(np.int64)


def _code(place: np.ndarray, bits: int) -> np.ndarray:
    """One number for (N, 3) places of so many bits."""
    return (place[:, 0] << (2 * bits)) | (place[:, 1] << bits) | place[:, 2]


def _divided(place: np.ndarray, cube: Cube, cut: int) -> Iterator[tuple[NodeKey, np.ndarray]]:
    """Nodes and the numbers (N,) of their points, of the points of one bucket at (N, 3) steps from the corner of the cube."""
    left = np.arange(len(place))
    for level in range(cube.levels + 1):
        if not len(left):
            return
        node = _code(place[left] >> (cube.bits - level), level)
        taken = np.ones(len(left), bool)
        if level < cube.levels:
            taken[:] = False
            cells = place[left] >> (cube.bits - level - SPAN_BITS)
            taken[np.unique(_code(cells, level + SPAN_BITS), return_index=True)[1]] = True
            # Above the cut nobody knows how many points of other buckets lie below a node.
            if level >= cut:
                names, which = np.unique(node, return_inverse=True)
                taken |= (np.bincount(which, ~taken, len(names)) <= FEW)[which]
        chosen, of_node = left[taken], node[taken]
        order = np.argsort(of_node, kind="stable")
        starts = np.flatnonzero(np.diff(of_node[order], prepend=-1))
        for first, last in zip(starts, [*starts[1:], len(order)], strict=True):
            index = chosen[order[first:last]]
            yield NodeKey(level, *(place[index[0]] >> (cube.bits - level)).tolist()), index
        left = left[~taken]
