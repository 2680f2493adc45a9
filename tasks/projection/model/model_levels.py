"""Coarser levels of the coloured mesh: vertices in a cell of space become one, at their mean place and in their mean colour.

The cells are the same for a whole level, so that neighbouring nodes meet; each node is made from the four below it. A level has a
quarter of the triangles of the one before, about as many in a node as in a block.

Source: vertex clustering, Rossignac and Borrel 1993.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from orthomill.schemas.job import Columns, FileBytes
from orthomill.tasks.colouring.sight.facing import MeshFacing
from orthomill.tasks.projection.model.glb import ModelPart, as_glb
from orthomill.tasks.projection.model.model_colours import UNSEEN, ColouredCorners, merged

_HALF = 2**20  # cells on either side of the origin
_CELLS = 2**21


@dataclass(frozen=True)
class MeanCells(Columns):
    """Cells of a level in the order of their codes: mean place, m, and mean colour of the corners in them."""

    code: np.ndarray
    """int64"""
    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    """float32"""
    red: np.ndarray
    green: np.ndarray
    blue: np.ndarray
    known: np.ndarray
    """uint8"""


class CoarseNode(NamedTuple):
    """A node of a level as GLB and as what the next level is made from."""

    tile: FileBytes
    corners: ColouredCorners


def cell_codes(points: np.ndarray, cell: float) -> np.ndarray:
    """(N,) int64: the cell in which points (N, 3) lie."""
    place = np.clip(np.floor(points.astype(np.float64) / cell).astype(np.int64) + _HALF, 0, _CELLS - 1)
    return (place[:, 0] * _CELLS + place[:, 1]) * _CELLS + place[:, 2]


def mean_cells(parts: Iterator[ColouredCorners], cell: float) -> MeanCells:
    """The cells of all parts of a level; parts pass one after the other."""
    codes, sums = np.zeros(0, np.int64), np.zeros((0, 8))
    for part in parts:
        points, colours = part.corners.reshape(-1, 3), part.colours.reshape(-1, 4)
        known = colours[:, 3:] > 0
        rows = np.hstack([points, np.ones((len(points), 1)), colours[:, :3] * known, known]).astype(np.float64)
        codes, numbers = np.unique(np.concatenate([codes, cell_codes(points, cell)]), return_inverse=True)
        rows = np.concatenate([sums, rows])
        sums = np.stack([np.bincount(numbers, rows[:, k], len(codes)) for k in range(8)], axis=1)
    places = (sums[:, :3] / sums[:, 3:4]).astype(np.float32)
    seen = sums[:, 7] > 0
    colours = np.where(seen[:, None], np.rint(sums[:, 4:7] / np.maximum(sums[:, 7:], 1)), UNSEEN).astype(np.uint8)
    (x, y, z), (red, green, blue) = places.T, colours.T
    return MeanCells(code=codes, x=x, y=y, z=z, red=red, green=green, blue=blue, known=np.where(seen, 255, 0).astype(np.uint8))


def coarse_node(
    children: tuple[ColouredCorners, ...], cells: MeanCells, facing: MeshFacing, cell: float, extras: dict[str, Any]
) -> CoarseNode:
    """The triangles of some nodes between the cells of a level."""
    corners, _ = merged(iter(children))
    at = np.searchsorted(cells.code, cell_codes(corners.reshape(-1, 3), cell)).reshape(-1, 3)
    left = at[(at[:, 0] != at[:, 1]) & (at[:, 1] != at[:, 2]) & (at[:, 2] != at[:, 0])]
    # The same three cells once, whichever corner comes first; which way round stays.
    turn = np.argmin(left, axis=1) if len(left) else np.zeros(0, np.int64)
    left = np.unique(left[np.arange(len(left))[:, None], (turn[:, None] + np.arange(3)) % 3], axis=0)
    points = np.column_stack([cells.x, cells.y, cells.z])
    colours = np.column_stack([cells.red, cells.green, cells.blue, cells.known])
    used, numbers = np.unique(left, return_inverse=True)
    triangles = numbers.reshape(-1, 3)
    part = ModelPart(points[used], triangles[:, ::-1] if facing.sign < 0 else triangles, colours=colours[used][:, :3])
    content = as_glb([part] if len(left) else [], extras)
    return CoarseNode(FileBytes.of(content), ColouredCorners.of(points[left], colours[left]))
