"""Working memory that jobs declare, in one vocabulary: so many bytes for each cell of a window, a grid, a shape or a table.

The engine plans memory before a job runs. What a plan writes is what a reader can check against the arrays of the function:
`array_bytes(24, tile.window)` are three float64 arrays of the tile.
"""

from math import prod
from typing import Protocol

KIB, MIB, GIB = 2**10, 2**20, 2**30


class Counted(Protocol):
    """A window or a grid."""

    @property
    def cells(self) -> int:
        """How many cells it has."""


def array_bytes(each: int, *extents: Counted | tuple[int, ...] | int) -> int:
    """Bytes of all arrays that together take `each` bytes a cell, over the product of `extents`: windows, grids, shapes, counts."""
    return each * prod(_cells(extent) for extent in extents)


def _cells(extent: Counted | tuple[int, ...] | int) -> int:
    if isinstance(extent, int):
        return extent
    return prod(extent) if isinstance(extent, tuple) else extent.cells
