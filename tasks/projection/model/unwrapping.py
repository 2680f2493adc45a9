"""A block of triangles laid out in a square texture, so that every triangle has texels of its own.

Strategy. Triangles take the axis of space (six directions) that they and their neighbours face; connected triangles of one
direction are a chart, seen along that axis: nothing is stretched by more than 1.7 and, but for helices, nothing overlaps. What
is buried under its own chart after all becomes a chart of its own. Charts lie on shelves, the highest ones first, with a margin
for the interpolation between texels. Where they do not fit, texels grow until they do.

A chart is never larger than a block, and no chart is shared: a tile's texture is made and read without any other.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from orthomill.schemas.raster import Window
from orthomill.tasks.visibility.scanline import NOTHING, NearestTriangles, add_projected, empty_raster

MARGIN = 2
"""texels around a chart that no other chart touches"""
_LEAST_FACING = 0.3  # cosine up to which a triangle may lie in a chart of its neighbours' direction
_GROWTH = 1.05
_LAYERS = 12  # of what lies above itself
_SMOOTHING = 3  # rounds in which neighbours agree on a direction: charts of rough surfaces would have a handful of triangles


@dataclass(frozen=True, eq=False)
class Unwrapped:
    """Places (T, 3, 2) (col, row) of the corners of triangles in a texture of `side` texels, each `texel` m; the charts (T,)."""

    places: np.ndarray
    charts: np.ndarray
    side: int
    texel: float

    def raster(self) -> NearestTriangles:
        """Which triangle each texel belongs to."""
        out = empty_raster(Window(0, 0, self.side, self.side))
        flat = np.concatenate([self.places, np.zeros((*self.places.shape[:2], 1))], axis=2)
        add_projected(out, flat, np.arange(len(flat), dtype=np.int32))
        return out


def unwrapped(corners: np.ndarray, side: int, texel: float) -> Unwrapped:
    """Triangles (T, 3, 3) m in a texture of `side` x `side` texels of `texel` m, or larger ones where these do not fit."""
    pairs = neighbours(corners)
    faces = _directions(corners, pairs)
    layer = np.zeros(len(corners), np.int64)
    for _ in range(_LAYERS):
        alike = (faces[pairs[:, 0]] == faces[pairs[:, 1]]) & (layer[pairs[:, 0]] == layer[pairs[:, 1]])
        laid = _laid_out(corners, faces, _connected(pairs[alike], len(corners)), side, texel)
        buried = _buried(laid)
        if not buried.any():
            break
        layer[buried] += 1
    return laid


def neighbours(corners: np.ndarray) -> np.ndarray:
    """Pairs (N, 2) of triangles (T, 3, 3) that share an edge."""
    _, numbers = np.unique(np.ascontiguousarray(corners + 0.0).reshape(-1, 3), axis=0, return_inverse=True)
    ends = numbers.reshape(-1, 3)
    edges = np.sort(np.concatenate([ends[:, [0, 1]], ends[:, [1, 2]], ends[:, [2, 0]]]), axis=1).astype(np.int64)
    code = edges[:, 0] * (int(numbers.max()) + 1) + edges[:, 1]
    owner = np.tile(np.arange(len(corners)), 3)
    order = np.argsort(code, kind="stable")
    same = code[order][1:] == code[order][:-1]
    return np.column_stack([owner[order][:-1][same], owner[order][1:][same]])


def _connected(pairs: np.ndarray, count: int) -> np.ndarray:
    graph = coo_matrix((np.ones(len(pairs), np.int8), pairs.T), shape=(count, count))
    _, labels = connected_components(graph, directed=False)
    return np.asarray(labels)


def _directions(corners: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """(T,) 0 to 5: the axis along which a triangle is seen, +x, +y, +z, -x, -y, -z."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    unit = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    smooth = unit.copy()
    for _ in range(_SMOOTHING):
        total = smooth.copy()
        for here, there in ((0, 1), (1, 0)):
            for axis in range(3):
                total[:, axis] += np.bincount(pairs[:, here], smooth[pairs[:, there], axis], len(corners))
        smooth = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300)
    wanted = np.argmax(np.hstack([smooth, -smooth]), axis=1)
    both = np.hstack([unit, -unit])
    fits = both[np.arange(len(unit)), wanted] >= _LEAST_FACING
    return np.where(fits, wanted, np.argmax(both, axis=1))


def _laid_out(corners: np.ndarray, faces: np.ndarray, charts: np.ndarray, side: int, texel: float) -> Unwrapped:
    """The charts (T,) on shelves."""
    rest = np.array([[1, 2], [2, 0], [0, 1]])[faces % 3]
    flat = np.take_along_axis(corners, np.repeat(rest[:, None, :], 3, axis=1), axis=2)
    count = int(charts.max()) + 1
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, charts, flat.min(axis=1))
    np.maximum.at(high, charts, flat.max(axis=1))
    size = high - low
    # Lying, so that shelves are low.
    upright = size[:, 1] > size[:, 0]
    turned = np.where(upright[:, None], size[:, ::-1], size)
    offset = flat - low[charts][:, None]
    offset = np.where(upright[charts][:, None, None], offset[..., ::-1], offset)
    texel = max(texel, float(np.sqrt(turned.prod(axis=1).sum())) / side, float(turned.max()) / (side - 2 * MARGIN - 2))
    while (corner := shelves(np.ceil(turned / texel).astype(int) + 1 + 2 * MARGIN, side)) is None:
        texel *= _GROWTH
    places = offset / texel + corner[charts][:, None] + MARGIN
    return Unwrapped(places, charts, side, float(texel))


def shelves(sizes: np.ndarray, side: int) -> np.ndarray | None:
    """Corners (N, 2) (col, row) of rectangles of `sizes` (N, 2) (width, height) on shelves in a square; None if they do not fit."""
    out = np.zeros_like(sizes)
    col, row, height = 0, 0, 0
    for k in np.lexsort((-sizes[:, 0], -sizes[:, 1])):
        wide, high = sizes[k]
        if col + wide > side:
            col, row, height = 0, row + height, 0
        height = max(height, int(high))
        if wide > side or row + height > side:
            return None
        out[k] = col, row
        col += int(wide)
    return out


def _buried(laid: Unwrapped) -> np.ndarray:
    """bool (T,): triangles that show in fewer than half of the texels that they should fill."""
    drawn = laid.raster().triangle
    shown = np.bincount(drawn[drawn != NOTHING], minlength=len(laid.places))
    a, b, c = (laid.places[:, k] for k in range(3))
    area = 0.5 * np.abs((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1]))
    # Triangles of a few texels may have no centre of a texel inside.
    return (area > 8.0) & (shown < 0.5 * area)
