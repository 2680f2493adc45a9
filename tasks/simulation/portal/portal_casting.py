"""Ray casting against a mesh: triangles sorted into the cells of a projection, each ray against those of its cell.

The look-up by bounding boxes in a grid of cells (sources/blending.md, M2a): slower than scanline conversion, but a ray may
pass anywhere and is met exactly. It shares no code with what the photographs are projected with later.

A ray meets the nearest triangle; of two that are equally near the one with the lower number, so that the order of cells is nothing.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit

NO_TRIANGLE = -1
_NEAR = 0.05
"""m before the projection centre: triangles that reach behind it may be anywhere in the picture"""
# Rays along a common edge of two triangles pass between them in floating point numbers otherwise.
_EDGE = 1e-9


class Cells(NamedTuple):
    """Triangles by cell: those of cell i are items[first[i] : first[i + 1]], ascending. Cells of `size` begin at (`left`, `upper`),
    `cols` in a row."""

    first: np.ndarray
    items: np.ndarray
    left: float
    upper: float
    size: float
    cols: int
    rows: int


@dataclass(frozen=True, eq=False)
class Facets:
    """Triangles for the kernels: `corner` (T, 3) and the two edges `along`, `above` (T, 3) from it, m."""

    corner: np.ndarray
    along: np.ndarray
    above: np.ndarray

    @property
    def normals(self) -> np.ndarray:
        """(T, 3) unit vectors towards the front."""
        across = np.cross(self.along, self.above)
        return across / np.linalg.norm(across, axis=1, keepdims=True)


def facets_of(vertices: np.ndarray, triangles: np.ndarray) -> Facets:
    """The triangles (T, 3) of vertices (V, 3)."""
    a, b, c = (np.ascontiguousarray(vertices[triangles[:, k]]) for k in range(3))
    return Facets(a, b - a, c - a)


def cells_of(low: np.ndarray, high: np.ndarray, window: tuple[float, float, float, float], size: float) -> Cells:
    """Triangles with bounding boxes `low` to `high` (T, 2) in a projection, in the cells of a window (left, upper, right,
    lower)."""
    left, upper, right, lower = window
    cols, rows = max(int(np.ceil((right - left) / size)), 1), max(int(np.ceil((lower - upper) / size)), 1)
    begin = np.floor((low - (left, upper)) / size)
    end = np.floor((high - (left, upper)) / size)
    inside = (end >= 0).all(axis=1) & (begin < (cols, rows)).all(axis=1)
    number = np.flatnonzero(inside).astype(np.int32)
    begin = np.clip(begin[inside], 0, (cols - 1, rows - 1)).astype(np.int64)
    end = np.clip(end[inside], 0, (cols - 1, rows - 1)).astype(np.int64)
    first, items = _sorted_in(number, begin, end, cols, rows)
    return Cells(first=first, items=items, left=float(left), upper=float(upper), size=float(size), cols=cols, rows=rows)


@njit()
def _sorted_in(number, begin, end, cols, rows):
    """Items by cell: where those of each of cols x rows begin, and their numbers. begin, end (n, 2): cells (col, row) that an
    item covers."""
    first = np.zeros(cols * rows + 1, np.int64)
    for i in range(len(number)):
        for r in range(begin[i, 1], end[i, 1] + 1):
            for c in range(begin[i, 0], end[i, 0] + 1):
                first[r * cols + c + 1] += 1
    for k in range(cols * rows):
        first[k + 1] += first[k]
    place = first[:-1].copy()
    items = np.empty(first[-1], np.int32)
    for i in range(len(number)):
        for r in range(begin[i, 1], end[i, 1] + 1):
            for c in range(begin[i, 0], end[i, 0] + 1):
                items[place[r * cols + c]] = number[i]
                place[r * cols + c] += 1
    return first, items


def central_boxes(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bounding boxes (T, 2) of triangles in an ideal picture with c = 1, x to the right and y downwards; `points` (V, 3) in the
    image system. Those that reach the camera have infinite ones, those behind it empty ones."""
    depth = -points[:, 2]
    front = np.maximum(depth, _NEAR)[:, None]
    xy = np.column_stack([points[:, 0], -points[:, 1]]) / front
    corners = xy[triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    near = depth[triangles] < _NEAR
    some, every = near.any(axis=1), near.all(axis=1)
    low[some], high[some] = -np.inf, np.inf
    low[every], high[every] = np.inf, -np.inf
    return low, high


@njit()
def nearest(cells, corner, along, above, x, y, origin, ray):
    """(triangle, distance along the ray, and the shares of the second and third corner) that a ray meets first; it projects to (x,
    y). NO_TRIANGLE where it meets none."""
    best, far, share, other = NO_TRIANGLE, np.inf, 0.0, 0.0
    col, row = int(np.floor((x - cells.left) / cells.size)), int(np.floor((y - cells.upper) / cells.size))
    if col < 0 or row < 0 or col >= cells.cols or row >= cells.rows:
        return best, far, share, other
    cell = row * cells.cols + col
    for k in range(cells.first[cell], cells.first[cell + 1]):
        i = cells.items[k]
        px = ray[1] * above[i, 2] - ray[2] * above[i, 1]
        py = ray[2] * above[i, 0] - ray[0] * above[i, 2]
        pz = ray[0] * above[i, 1] - ray[1] * above[i, 0]
        det = along[i, 0] * px + along[i, 1] * py + along[i, 2] * pz
        if det == 0.0:
            continue
        sx, sy, sz = origin[0] - corner[i, 0], origin[1] - corner[i, 1], origin[2] - corner[i, 2]
        u = (sx * px + sy * py + sz * pz) / det
        if u < -_EDGE or u > 1.0 + _EDGE:
            continue
        qx = sy * along[i, 2] - sz * along[i, 1]
        qy = sz * along[i, 0] - sx * along[i, 2]
        qz = sx * along[i, 1] - sy * along[i, 0]
        v = (ray[0] * qx + ray[1] * qy + ray[2] * qz) / det
        if v < -_EDGE or u + v > 1.0 + _EDGE:
            continue
        t = (above[i, 0] * qx + above[i, 1] * qy + above[i, 2] * qz) / det
        if 1e-6 < t < far:
            best, far, share, other = i, t, u, v
    return best, far, share, other


class Shade(NamedTuple):
    """A parallel projection along a direction of light: axes across it, and the triangles in its cells."""

    right: np.ndarray
    down: np.ndarray
    towards: np.ndarray
    cells: Cells


def shade_of(vertices: np.ndarray, triangles: np.ndarray, towards: np.ndarray, size: float) -> Shade:
    """The triangles as the light from the direction `towards` (3,), a unit vector, sees them; cells of `size` m."""
    side = np.cross(towards, [0.0, 0.0, 1.0] if abs(towards[2]) < 0.9 else [0.0, 1.0, 0.0])
    right = side / np.linalg.norm(side)
    down = np.cross(towards, right)
    xy = np.column_stack([vertices @ right, vertices @ down])
    corners = xy[triangles]
    window = (*xy.min(axis=0), *xy.max(axis=0))
    return Shade(right, down, towards, cells_of(corners.min(axis=1), corners.max(axis=1), window, size))


@njit()
def is_lit(shade, corner, along, above, place):
    """Whether nothing stands between a point and the light."""
    x = place[0] * shade.right[0] + place[1] * shade.right[1] + place[2] * shade.right[2]
    y = place[0] * shade.down[0] + place[1] * shade.down[1] + place[2] * shade.down[2]
    hit, _, _, _ = nearest(shade.cells, corner, along, above, x, y, place, shade.towards)
    return hit == NO_TRIANGLE


@njit()
def lit_all(shade, corner, along, above, places):
    """(N,) bool: whether the light reaches the points (N, 3)."""
    out = np.empty(len(places), np.bool_)
    for i in range(len(places)):
        out[i] = is_lit(shade, corner, along, above, places[i])
    return out


def open_sky(vertices: np.ndarray, triangles: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(V,) the share of the light of an even sky that reaches each vertex, its normal (V, 3) considered: 48 directions."""
    facets = facets_of(vertices, triangles)
    # A hair above the surface, or its own triangles would hide the sky.
    places = np.ascontiguousarray(vertices + 0.004 * normals)
    number = np.arange(48) + 0.5
    height, angle = 1.0 - number / 48.0, number * np.pi * (3.0 - np.sqrt(5.0))
    level = np.sqrt(1.0 - height**2)
    total = np.zeros(len(vertices))
    for towards in np.column_stack([level * np.cos(angle), level * np.sin(angle), height]):
        facing = np.maximum(normals @ towards, 0.0)
        shade = shade_of(vertices, triangles, towards, 0.12)
        seen = facing > 0
        seen[seen] = lit_all(shade, facets.corner, facets.along, facets.above, places[seen])
        total += np.where(seen, facing, 0.0)
    return total / 24.0
