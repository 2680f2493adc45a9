"""A mesh cut into blocks of neighbouring triangles, so that a job reads those that it needs and not the whole mesh.

The mesh is halved across its longest side again and again, until each part is a block of 16384 triangles: 128 x 128 pixels of a
raster with nine bands, the corners of a triangle. A triangle's number is its place in that order, so it also tells its block.
Corners are float32 relative to an origin near the mesh: 0.03 mm over a kilometre; at a common edge triangles have the same bits.
"""

from dataclasses import dataclass

import numpy as np

SIDE = 128
PER_BLOCK = SIDE * SIDE
"""triangles of a block"""


def spatial_order(centres: np.ndarray) -> np.ndarray:
    """The order (T,) of points (T, 3) in which each `PER_BLOCK` of them lie together; equal places keep their order.

    A curve through space (Morton's, Hilbert's) leaves a surface and comes back elsewhere: the blocks across such a jump were seen
    by every photograph.
    """
    order = np.arange(len(centres))
    parts = [(0, len(centres))]
    while parts:
        first, last = parts.pop()
        if last - first <= PER_BLOCK:
            continue
        inside = order[first:last]
        places = centres[inside]
        axis = int(np.argmax(np.ptp(places, axis=0)))
        order[first:last] = inside[np.argsort(places[:, axis], kind="stable")]
        middle = first + block_count(last - first) // 2 * PER_BLOCK
        parts += [(first, middle), (middle, last)]
    return order


def block_count(triangles: int) -> int:
    """Blocks of a mesh of so many triangles."""
    return -(-triangles // PER_BLOCK)


def as_blocks(corners: np.ndarray) -> np.ndarray:
    """The raster (SIDE * blocks, SIDE, 9) float32 of ordered triangles (T, 3, 3); NaN after the last one."""
    out = np.full((block_count(len(corners)) * PER_BLOCK, 9), np.nan, np.float32)
    out[: len(corners)] = corners.reshape(-1, 9)
    return out.reshape(-1, SIDE, 9)


def block_bounds(raster: np.ndarray) -> np.ndarray:
    """(blocks, 2, 3): lowest and highest corner of each block of a raster."""
    corners = raster.reshape(-1, PER_BLOCK * 3, 3)
    return np.stack([np.nanmin(corners, axis=1), np.nanmax(corners, axis=1)], axis=1)


def block_areas(raster: np.ndarray) -> np.ndarray:
    """(blocks,) m2: the area of the triangles of each block of a raster."""
    # Block by block: differences of all corners would take twice the memory of the mesh.
    parts = raster.reshape(-1, PER_BLOCK, 3, 3)
    normals = (np.cross(one[:, 1] - one[:, 0], one[:, 2] - one[:, 0]) for one in parts)
    return np.array([0.5 * np.nansum(np.linalg.norm(normal, axis=1)) for normal in normals])


@dataclass(frozen=True, eq=False)
class TrianglesAtHand:
    """Some blocks of a mesh: `numbers` (B,) of the blocks, ascending, `corners` (B * PER_BLOCK, 3, 3) float32."""

    numbers: np.ndarray
    corners: np.ndarray

    @staticmethod
    def of(numbers: tuple[int, ...], blocks: tuple[np.ndarray, ...]) -> "TrianglesAtHand":
        """From the block numbers and their rasters (SIDE, SIDE, 9)."""
        empty = np.zeros((0, 9), np.float32)
        corners = np.concatenate([empty, *(block.reshape(-1, 9) for block in blocks)]).reshape(-1, 3, 3)
        return TrianglesAtHand(np.array(numbers, np.int64), corners)

    @property
    def places(self) -> np.ndarray:
        """int32: for every block number up to the greatest one the place of its first triangle in `corners`, -1 where absent."""
        out = np.full(int(self.numbers.max(initial=-1)) + 2, -1, np.int32)
        out[self.numbers] = np.arange(len(self.numbers)) * PER_BLOCK
        return out

    @property
    def triangles(self) -> np.ndarray:
        """Numbers (N,) int32 in the whole mesh of the triangles at hand, in the order of `corners`."""
        return (self.numbers[:, None] * PER_BLOCK + np.arange(PER_BLOCK)).ravel().astype(np.int32)

    def corners_of(self, triangles: np.ndarray) -> np.ndarray:
        """(N, 3, 3) float64 corners of triangles (N,) that are at hand."""
        triangles = np.asarray(triangles, np.int64)
        return self.corners[self.places[triangles // PER_BLOCK] + triangles % PER_BLOCK].astype(np.float64)
