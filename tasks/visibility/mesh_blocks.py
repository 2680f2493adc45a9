"""What is seen of a mesh in blocks, as jobs are planned from it: boxes about blocks, the blocks that photographs and tiles show."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.raster import Window
from orthomill.schemas.solid.frames import Vector

CELL = 128
"""side of the squares of a photograph for which the blocks that they show are listed, px"""


class BlockBox(BaseModel):
    """The box about a block of triangles, m relative to the mesh's origin."""

    model_config = ConfigDict(frozen=True)

    low: Vector
    high: Vector

    @property
    def corners(self) -> np.ndarray:
        """(8, 3)"""
        x, y, z = np.meshgrid(*zip(self.low, self.high, strict=True), indexing="ij")
        return np.column_stack([x.ravel(), y.ravel(), z.ravel()])


def box_about(boxes: Sequence[BlockBox]) -> BlockBox:
    """The box about some boxes."""
    low, high = np.min([box.low for box in boxes], axis=0).tolist(), np.max([box.high for box in boxes], axis=0).tolist()
    return BlockBox(low=tuple(low), high=tuple(high))


class MeshBlocks(BaseModel):
    """The boxes of all blocks of a mesh."""

    model_config = ConfigDict(frozen=True)

    boxes: tuple[BlockBox, ...]
    areas: tuple[float, ...]
    """of the triangles of each block, m2"""

    # Cached: every tile of every output asks which of them it may show.
    @cached_property
    def corners(self) -> np.ndarray:
        """(blocks, 8, 3) of the boxes."""
        return np.array([box.corners for box in self.boxes]).reshape(-1, 8, 3)


class PhotoDepth(BaseModel):
    """What a photograph shows of the mesh: pixels of fronts and of backs, and by square the blocks in sight."""

    model_config = ConfigDict(frozen=True)

    pixels: int
    fronts: int
    backs: int
    cells: tuple[tuple[int, ...], ...]
    """blocks by square, rows of squares first"""
    cells_across: int

    def blocks_in(self, window: Window) -> frozenset[int]:
        """Blocks that a window of the raster shows."""
        part = window.reduced(CELL).clipped((len(self.cells) // self.cells_across, self.cells_across))
        rows, cols = range(part.row, part.row + part.height), range(part.col, part.col + part.width)
        return frozenset(number for r in rows for c in cols for number in self.cells[r * self.cells_across + c])


class TileSurface(BaseModel):
    """What a tile of an output shows of the mesh."""

    model_config = ConfigDict(frozen=True)

    covered: int
    """pixels"""
    blocks: tuple[int, ...] = ()
    low: Vector = (0.0, 0.0, 0.0)
    high: Vector = (0.0, 0.0, 0.0)
    """box about the points in it, m relative to the mesh's origin"""
    near: tuple[float, float] = (0.0, 0.0)
    """lowest and highest nearness"""

    @property
    def box(self) -> BlockBox:
        """About the points of the surface."""
        return BlockBox(low=self.low, high=self.high)


class ShownSurfaces(BaseModel):
    """What the tiles of all outputs show of the mesh, in one table: planning waits for it once, and not for every tile."""

    model_config = ConfigDict(frozen=True)

    tiles: tuple[TileSurface, ...]
