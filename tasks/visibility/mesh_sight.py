"""How photographs see points of a mesh: exactly at their image points, among the triangles that are drawn around them.

Strategy. The depth raster of a photograph, without its lens distortion, tells the triangles at the four pixels around the image of
a point. Each of them, apart from the point's own, is met by the ray from the projection centre or not: one that is met nearer than
the point hides it. Rounding the image point to a pixel would hide points of fine meshes behind their own neighbours.

Where none of the four is the point's own triangle and none is met (triangles smaller than a pixel), the point is hidden if it lies
behind all four pixels. A back face is never seen.

Source: Petsa et al. 2007 (sources/blending.md, M5; the depth break of M9).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.geometry.view import FIELD_MARGIN, View, framed_point
from orthomill.tasks.visibility.output_frame import ORIGIN
from orthomill.tasks.visibility.scanline import NearestTriangles, central_projection
from orthomill.tasks.visibility.sight import PlaceSight
from orthomill.tasks.visibility.triangle_blocks import PER_BLOCK, TrianglesAtHand


@dataclass(frozen=True)
class SightTolerance:
    """In pixels of the photograph on the surface: `depth` that a ray may dip into another triangle, `rough` where no triangle is
    met exactly, `break_` from which neighbouring depths differ so much that one hides the other."""

    depth: float = 1.0
    rough: float = 3.0
    break_: float = 20.0


@dataclass(frozen=True, eq=False)
class MeshPlaces:
    """Places on a mesh: points (N, 3) on the triangles `own` (N,), NOTHING for none; all relative to the mesh's origin.

    `rasters`: depth and triangle of photographs without distortion, around the images of the points; a photograph without one does
    not show them. `facing`: -1 for a mesh whose triangles face inwards.
    """

    points: np.ndarray
    own: np.ndarray
    rasters: Mapping[str, NearestTriangles]
    at_hand: TrianglesAtHand
    tolerance: SightTolerance
    facing: float = 1.0

    def sights(self, view: View) -> np.ndarray:
        """uint8 (N,) codes of PlaceSight; `view` relative to the mesh's origin as well."""
        out = np.where(self.own >= 0, np.uint8(PlaceSight.OUTSIDE), np.uint8(PlaceSight.NOWHERE))
        if not len(self.points) or view.name not in self.rasters:
            return out
        raster = self.rasters[view.name]
        placed = np.array(self.own, np.int32)
        _place(view.numbers, np.ascontiguousarray(self.points, np.float64), FIELD_MARGIN * view.field, placed)
        corner = raster.window.row, raster.window.col
        limits = np.array([self.tolerance.depth, self.tolerance.rough, self.tolerance.break_]) / view.camera.c
        matrix, centre = central_projection(view, ORIGIN).matrix, np.asarray(view.centre, np.float64)
        arrays = np.ascontiguousarray(self.points, np.float64), placed, np.ascontiguousarray(matrix), centre
        rasters = np.ascontiguousarray(raster.nearness), np.ascontiguousarray(raster.triangle), corner
        _see(*arrays, *rasters, self.at_hand.places, self.at_hand.corners, limits, float(self.facing), out)
        return out


@njit()
def _place(n, points, widest, own):
    """Takes their triangles from points that are not in the frame of the view `n`."""
    for i in range(own.size):
        if own[i] >= 0 and not framed_point(n, points[i, 0], points[i, 1], points[i, 2], widest)[3] >= -0.5:
            own[i] = -1


@njit(inline="always")
def _corner(corners, at, k):
    """Corner k of the triangle at the place `at` of corners (T, 3, 3), in float64."""
    return np.float64(corners[at, k, 0]), np.float64(corners[at, k, 1]), np.float64(corners[at, k, 2])


@njit()
def _met(corners, at, centre, dx, dy, dz):
    """Share of the way from the centre along (dx, dy, dz) at which a triangle is met; -1 without (Moeller, Trumbore 1997)."""
    ax, ay, az = _corner(corners, at, 0)
    bx, by, bz = _corner(corners, at, 1)
    cx, cy, cz = _corner(corners, at, 2)
    ux, uy, uz = bx - ax, by - ay, bz - az
    vx, vy, vz = cx - ax, cy - ay, cz - az
    px, py, pz = dy * vz - dz * vy, dz * vx - dx * vz, dx * vy - dy * vx
    det = ux * px + uy * py + uz * pz
    if not abs(det) > 0.0:
        return -1.0
    tx, ty, tz = centre[0] - ax, centre[1] - ay, centre[2] - az
    u = (tx * px + ty * py + tz * pz) / det
    qx, qy, qz = ty * uz - tz * uy, tz * ux - tx * uz, tx * uy - ty * ux
    v = (dx * qx + dy * qy + dz * qz) / det
    if u < 0.0 or v < 0.0 or u + v > 1.0:
        return -1.0
    return (vx * qx + vy * qy + vz * qz) / det


@njit()
def _see(points, own, m, centre, nearness, triangle, corner, places, corners, limits, facing, out):
    """Fills the codes `out` (N,) of points (N, 3) on the triangles `own` (N,), -1 for none, from the view with the matrix m (3, 4).

    nearness, triangle (rows, cols): its raster, whose first row and column are `corner`; places, corners: as of `TrianglesAtHand`;
    limits (3,): as of `SightTolerance`, but as shares of the depth; facing: -1 for a mesh whose triangles face inwards.
    """
    height, width = nearness.shape
    for i in range(points.shape[0]):
        if own[i] < 0:
            continue
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        at = places[own[i] // PER_BLOCK] + own[i] % PER_BLOCK
        ax, ay, az = _corner(corners, at, 0)
        bx, by, bz = _corner(corners, at, 1)
        cx, cy, cz = _corner(corners, at, 2)
        nx, ny, nz = (
            (by - ay) * (cz - az) - (bz - az) * (cy - ay),
            (bz - az) * (cx - ax) - (bx - ax) * (cz - az),
            (bx - ax) * (cy - ay) - (by - ay) * (cx - ax),
        )
        dx, dy, dz = x - centre[0], y - centre[1], z - centre[2]
        if facing * (nx * dx + ny * dy + nz * dz) >= 0.0:
            out[i] = PlaceSight.AWAY
            continue
        depth = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
        col = (m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]) / depth
        row = (m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]) / depth
        c0, r0 = int(np.floor(col)) - corner[1], int(np.floor(row)) - corner[0]
        hidden, own_shown, met, behind = False, False, False, True
        # Outside of the raster nothing is drawn: such places are beyond the rim of the photograph.
        for r in range(max(r0, 0), min(r0 + 2, height)):
            for c in range(max(c0, 0), min(c0 + 2, width)):
                other = triangle[r, c]
                if other < 0 or depth * nearness[r, c] <= 1.0 + limits[1]:
                    behind = False
                if other < 0:
                    continue
                if other == own[i]:
                    own_shown = True
                    continue
                if other // PER_BLOCK >= places.size or places[other // PER_BLOCK] < 0:
                    continue
                share = _met(corners, places[other // PER_BLOCK] + other % PER_BLOCK, centre, dx, dy, dz)
                if share > 0.0:
                    met = True
                    if share < 1.0 - limits[0]:
                        hidden = True
        if hidden or (behind and not own_shown and not met):
            out[i] = PlaceSight.HIDDEN
            continue
        nearest, farthest = 0.0, np.inf
        for r in range(max(r0 - 1, 0), min(r0 + 3, height)):
            for c in range(max(c0 - 1, 0), min(c0 + 3, width)):
                near = max(nearness[r, c], np.float32(0.0))
                nearest, farthest = max(nearest, near), min(farthest, near)
        # 1 / near - 1 / far over the depth: differences of the order of a pixel are counted in pixels at this depth.
        at_break = farthest <= 0.0 or 1.0 / farthest - 1.0 / nearest > limits[2] * depth
        out[i] = PlaceSight.AT_BREAK if at_break else PlaceSight.SEEN
