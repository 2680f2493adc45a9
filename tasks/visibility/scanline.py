"""Depth and triangle number of every pixel of a projection of a triangle mesh, by scanline conversion.

Strategy: every triangle is filled row by row between its two edges, and each pixel keeps the triangle that is nearest there. What
is stored is the *nearness*: the inverse depth of a central projection, the negative distance of a parallel one. It is linear over
the image of a triangle, so two products per pixel give it exactly.

Where the edges meet a row is computed from the same two vertices in the same order for both triangles beside an edge, and every
pixel in rows and columns of the whole projection: no gap opens between neighbours, and a window holds what the whole raster holds.
Of triangles that are equally near at a pixel the one with the lowest number stays, whatever the order of processing.

Parts of triangles beside and behind a projection centre are cut off before the division.

Source: Petsa et al. 2007 (sources/blending.md, M2b, M3 and M5).
"""

import math
from dataclasses import dataclass

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.raster import Window
from orthomill.tasks.geometry.view import View

NOTHING = -1
"""the triangle number of a pixel that shows no triangle"""
_FRONT = 1e-4
"""A triangle is cut at this share of its own greatest depth: what is nearer to the centre is left out."""


@dataclass(frozen=True, eq=False)
class Projection:
    """How space is projected: `matrix` (3, 4) on (X, Y, Z, 1), relative to `origin`.

    central: (depth * col, depth * row, depth); parallel: (col, row, nearness).
    """

    matrix: np.ndarray
    central: bool
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class NearestTriangles:
    """What the pixels of `window` show. Columns and rows count in the whole projection and may be negative."""

    window: Window
    nearness: np.ndarray
    """(rows, cols) float32: 1 / depth (central) or minus the distance (parallel), m; -infinite where there is nothing"""
    triangle: np.ndarray
    """(rows, cols) int32, NOTHING where there is nothing"""


def central_projection(view: View, origin: tuple[float, float, float]) -> Projection:
    """The projection of a photograph without its lens distortion, of points relative to `origin` (m).

    Its pixels are those that an ideal lens of the same interior orientation would show.
    """
    n = view.numbers
    u, v, w = view.rotation
    depth = -w
    rows = np.array([n.c * u + n.col0 * depth, n.row0 * depth - n.c * v, depth])
    return Projection(np.column_stack([rows, rows @ (np.array(origin) - view.centre)]), True, origin)


def empty_raster(window: Window) -> NearestTriangles:
    """A raster that shows nothing yet."""
    return NearestTriangles(window, np.full(window.shape, -np.inf, np.float32), np.full(window.shape, NOTHING, np.int32))


def add_triangles(
    raster: NearestTriangles, projection: Projection, vertices: np.ndarray, triangles: np.ndarray, numbers: np.ndarray
) -> None:
    """Fills into `raster` what of it the triangles show.

    vertices (V, 3) m relative to the projection's origin, triangles (T, 3) int32; numbers (T,) int32: what the raster calls them.
    """
    if not len(triangles):
        return
    projected = np.empty((len(vertices), 3))
    _project(np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(projection.matrix, np.float64), projected)
    corner = raster.window.row, raster.window.col
    arrays = np.ascontiguousarray(triangles, np.int32), np.ascontiguousarray(numbers, np.int32)
    fill = _fill_central if projection.central else _fill_parallel
    fill(projected, *arrays, corner, raster.nearness, raster.triangle)


def add_projected(raster: NearestTriangles, corners: np.ndarray, numbers: np.ndarray) -> None:
    """Fills into `raster` triangles (T, 3, 3) whose corners are (col, row, nearness) already."""
    triangles = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    corner = raster.window.row, raster.window.col
    flat = np.ascontiguousarray(corners, np.float64).reshape(-1, 3)
    _fill_parallel(flat, triangles, np.ascontiguousarray(numbers, np.int32), corner, raster.nearness, raster.triangle)


@njit(nogil=True)
def _project(points, m, out):
    """Fills `out` (N, 3) with the images of points (N, 3) by the matrix m (3, 4)."""
    # No matrix product of a library: its rounding depends on the number of points.
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for k in range(3):
            out[i, k] = m[k, 0] * x + m[k, 1] * y + m[k, 2] * z + m[k, 3]


@njit(nogil=True, error_model="numpy")
def _scan(a, b, c, number, corner, nearness, triangle):
    """Draws the triangle `number` into nearness and triangle (rows, cols), whose first row and column are `corner`; a, b, c: its
    vertices as (col, row, nearness)."""
    (xa, ya, na), (xb, yb, nb), (xc, yc, nc) = a, b, c
    row0, col0 = corner
    height, width = nearness.shape
    lowest, highest = min(ya, yb, yc), max(ya, yb, yc)
    # Rows between the integers that lie on the triangle; comparisons before conversion: an integer cannot hold a far vertex.
    if highest < row0 or lowest > row0 + height - 1 or max(xa, xb, xc) < col0 or min(xa, xb, xc) > col0 + width - 1:
        return
    area = (xb - xa) * (yc - ya) - (xc - xa) * (yb - ya)
    # Seen edge-on, or NaN.
    if not abs(area) > 0.0:
        return
    first, last = math.ceil(max(lowest, float(row0))), math.floor(min(highest, float(row0 + height - 1)))
    if first > last:
        return
    by_col = ((nb - na) * (yc - ya) - (nc - na) * (yb - ya)) / area
    by_row = ((nc - na) * (xb - xa) - (nb - na) * (xc - xa)) / area
    x0, y0, x1, y1, x2, y2 = xa, ya, xb, yb, xc, yc
    # Sorted by row, and by column where rows are equal: both triangles at an edge then compute it alike.
    if y0 > y1 or (y0 == y1 and x0 > x1):
        x0, y0, x1, y1 = x1, y1, x0, y0
    if y1 > y2 or (y1 == y2 and x1 > x2):
        x1, y1, x2, y2 = x2, y2, x1, y1
    if y0 > y1 or (y0 == y1 and x0 > x1):
        x0, y0, x1, y1 = x1, y1, x0, y0
    along = (x2 - x0) / (y2 - y0) if y2 > y0 else 0.0
    upper = (x1 - x0) / (y1 - y0) if y1 > y0 else 0.0
    lower = (x2 - x1) / (y2 - y1) if y2 > y1 else 0.0
    left, right = float(col0), float(col0 + width - 1)
    for row in range(first, last + 1):
        one = x0 + along * (row - y0)
        if row < y1:
            two = x0 + upper * (row - y0)
        elif y2 > y1:
            two = x1 + lower * (row - y1)
        else:
            two = x1
        if one > two:
            one, two = two, one
        if one > right or two < left:
            continue
        start, end = math.ceil(max(one, left)), math.floor(min(two, right))
        i = row - row0
        base = na + by_row * (row - ya)
        for col in range(start, end + 1):
            near = np.float32(base + by_col * (col - xa))
            j = col - col0
            if near > nearness[i, j] or (near == nearness[i, j] and number < triangle[i, j]):
                nearness[i, j] = near
                triangle[i, j] = number


@njit(nogil=True)
def _fill_parallel(p, triangles, numbers, corner, nearness, triangle):
    """Draws triangles (T, 3) of points p (N, 3), given as (col, row, nearness), by their numbers (T,)."""
    for t in range(triangles.shape[0]):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        first, second, third = (p[a, 0], p[a, 1], p[a, 2]), (p[b, 0], p[b, 1], p[b, 2]), (p[c, 0], p[c, 1], p[c, 2])
        _scan(first, second, third, numbers[t], corner, nearness, triangle)


@njit(nogil=True, error_model="numpy")
def _fill_central(p, triangles, numbers, corner, nearness, triangle):
    """Draws triangles (T, 3) of points p (N, 3), given as (col, row, 1) times their depth, by their numbers (T,)."""
    for t in range(triangles.shape[0]):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        da, db, dc = p[a, 2], p[b, 2], p[c, 2]
        deepest, nearest = max(da, db, dc), min(da, db, dc)
        if not deepest > 0.0:
            continue
        # A vertex beside or behind the centre has no image, or one from behind.
        if nearest <= _FRONT * deepest:
            _fill_cut(p, a, b, c, _FRONT * deepest, numbers[t], corner, nearness, triangle)
            continue
        ia, ib, ic = 1.0 / da, 1.0 / db, 1.0 / dc
        first, second = (p[a, 0] * ia, p[a, 1] * ia, ia), (p[b, 0] * ib, p[b, 1] * ib, ib)
        _scan(first, second, (p[c, 0] * ic, p[c, 1] * ic, ic), numbers[t], corner, nearness, triangle)


@njit(nogil=True, error_model="numpy")
def _fill_cut(p, a, b, c, front, number, corner, nearness, triangle):
    """Fills the part of a triangle that is deeper than `front`: three or four corners."""
    kept = np.empty((4, 3))
    count = 0
    order = (a, b, c)
    for k in range(3):
        here, there = order[k], order[(k + 1) % 3]
        if p[here, 2] > front:
            depth = p[here, 2]
            kept[count, 0], kept[count, 1], kept[count, 2] = p[here, 0] / depth, p[here, 1] / depth, 1.0 / depth
            count += 1
        if (p[here, 2] > front) != (p[there, 2] > front):
            # From the deeper end, so that the triangle beyond this edge is cut at the same place.
            deep, shallow = (here, there) if p[here, 2] > front else (there, here)
            share = (p[deep, 2] - front) / (p[deep, 2] - p[shallow, 2])
            for m in range(2):
                kept[count, m] = (p[deep, m] + share * (p[shallow, m] - p[deep, m])) / front
            kept[count, 2] = 1.0 / front
            count += 1
    for k in range(1, count - 1):
        second, third = (kept[k, 0], kept[k, 1], kept[k, 2]), (kept[k + 1, 0], kept[k + 1, 1], kept[k + 1, 2])
        _scan((kept[0, 0], kept[0, 1], kept[0, 2]), second, third, number, corner, nearness, triangle)
