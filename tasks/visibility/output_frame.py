"""A surface in an output: the rays of its pixels, and depth and triangle of each pixel, for planes, cylinders and cameras alike.

Planes and cameras without distortion are scanned as they are. For a camera with distortion the ideal picture is scanned, and each
pixel takes the triangle at its ideal place; its own ray then meets the plane of that triangle. A cylinder is unrolled first:
triangles wide enough to bend are divided until they are flat to a ten thousandth of the radius, and keep their numbers.

All coordinates here are relative to the origin of the mesh.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from orthomill.schemas.camera import Camera
from orthomill.schemas.raster import Window
from orthomill.schemas.solid.frames import AnyFrame, CylinderFrame, FlatFrame, ViewFrame
from orthomill.tasks.geometry.distortion import lens_of, pixel_to_image, principal_place
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View
from orthomill.tasks.visibility.scanline import (
    NearestTriangles,
    Projection,
    add_projected,
    add_triangles,
    central_projection,
    empty_raster,
)

ORIGIN = (0.0, 0.0, 0.0)
_WIDEST = np.radians(1.6)
"""angle of an unrolled triangle: its chord then deviates by 1e-4 of the radius"""


def frame_view(frame: ViewFrame, origin: np.ndarray) -> View:
    """The view of a frame, relative to `origin` (3,)."""
    return View(frame.name, frame.camera, rotation_matrix(*np.radians(frame.omega_phi_kappa)), np.array(frame.centre) - origin)


def moved(view: View, origin: np.ndarray) -> View:
    """A view in coordinates relative to `origin` (3,)."""
    return replace(view, centre=np.asarray(view.centre, np.float64) - origin)


def plane_projection(frame: FlatFrame, origin: np.ndarray) -> Projection:
    """The parallel projection of a plane; the nearness of a point is its distance from the plane along the rays."""
    towards, normal = np.array(frame.towards), np.array(frame.normal)
    far = normal / (towards @ normal)
    # Along oblique rays a point lies on the plane where it is seen, not at its foot.
    right, up = (axis - (axis @ towards) * far for axis in (np.array(frame.right), np.array(frame.up)))
    rows = np.array([right / frame.pixel, -up / frame.pixel, far])
    return Projection(np.column_stack([rows, rows @ (origin - frame.corner) - [0.5, 0.5, 0.0]]), central=False)


def ideal_places(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """Where (N, 2) an ideal lens of the same interior orientation would show what is at `pixels` (N, 2)."""
    xy = pixel_to_image(camera, pixels)
    col, row = principal_place(camera)
    return np.column_stack([col + xy[:, 0], row - xy[:, 1]])


def ideal_window(camera: Camera, window: Window | None = None, margin: int = 2) -> Window:
    """The pixels of an ideal lens that hold all that `window` (None: the whole photograph) of a camera shows."""
    return _ideal_window(camera, window or Window(0, 0, camera.height, camera.width)).grown(margin)


# A plan asks it of a few cameras and windows, for every tile and every photograph.
@lru_cache(maxsize=4096)
def _ideal_window(camera: Camera, part: Window) -> Window:
    col = np.linspace(part.col - 0.5, part.col + part.width - 0.5, 33)
    row = np.linspace(part.row - 0.5, part.row + part.height - 0.5, 33)
    border = [np.column_stack([col, np.full(33, r)]) for r in (row[0], row[-1])]
    border += [np.column_stack([np.full(33, c), row]) for c in (col[0], col[-1])]
    places = ideal_places(camera, np.vstack(border))
    # A lens that folds back has no ideal place in its corners; three times the photograph is more than any usable one shows.
    most = np.array([camera.width, camera.height])
    places = np.clip(np.nan_to_num(places, nan=0.0), -most, 2.0 * most)
    (left, top), (right, bottom) = np.floor(places.min(axis=0)).astype(int), np.ceil(places.max(axis=0)).astype(int)
    return Window(int(top), int(left), int(bottom - top) + 1, int(right - left) + 1)


@dataclass(frozen=True, eq=False)
class PixelRays:
    """PixelRays (N, 3) from `start`, m, in the unit direction `along`, as a viewer looks."""

    start: np.ndarray
    along: np.ndarray


def pixel_rays(frame: AnyFrame, pixels: np.ndarray, origin: np.ndarray) -> PixelRays:
    """The rays of pixels (N, 2) (col, row). They start on the plane, at the camera, on the axis or far outside of the cylinder."""
    if isinstance(frame, ViewFrame):
        view = frame_view(frame, origin)
        return PixelRays(np.broadcast_to(view.centre, (len(pixels), 3)), view.rays(pixels))
    across, down = (pixels[:, 0] + 0.5) * frame.pixel, (pixels[:, 1] + 0.5) * frame.pixel
    if isinstance(frame, FlatFrame):
        start = np.array(frame.corner) - origin + across[:, None] * np.array(frame.right) - down[:, None] * np.array(frame.up)
        return PixelRays(start, np.broadcast_to(-np.array(frame.towards), start.shape))
    angle = (across - 0.5 * frame.cols * frame.pixel) / frame.radius * (1.0 if frame.outside else -1.0)
    side = np.cross(frame.axis, frame.middle)
    out = np.cos(angle)[:, None] * np.array(frame.middle) + np.sin(angle)[:, None] * side
    foot = np.array(frame.foot) - origin + (frame.top - down)[:, None] * np.array(frame.axis)
    return PixelRays(foot + 2.0 * (frame.radius + frame.reach) * out, -out) if frame.outside else PixelRays(foot, out)


def points_on(rays: PixelRays, corners: np.ndarray) -> np.ndarray:
    """Points (N, 3) where rays meet triangles (N, 3, 3); where one passes beside its triangle, the point of it nearest in share."""
    a, first, second = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(first, second)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = np.einsum("ni,ni->n", a - rays.start, normal) / np.einsum("ni,ni->n", rays.along, normal)
        inner = rays.start + along[:, None] * rays.along - a
        # Shares of the corners: a ray half a pixel beside a grazing triangle would meet its plane far away.
        square = np.einsum("ni,ni->n", normal, normal)
        v = np.einsum("ni,ni->n", np.cross(inner, second), normal) / square
        w = np.einsum("ni,ni->n", np.cross(first, inner), normal) / square
    share = np.clip(np.nan_to_num(np.stack([1.0 - v - w, v, w], axis=1), nan=1.0), 0.0, 1.0)
    share /= share.sum(axis=1, keepdims=True)
    return np.einsum("nk,nki->ni", share, corners)


def shown_points(frame: AnyFrame, pixels: np.ndarray, nearness: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Points (N, 3) that pixels (N, 2) show, from their `nearness` (N,) alone: as exact as float32 is."""
    rays = pixel_rays(frame, pixels, origin)
    near = nearness.astype(np.float64)
    if isinstance(frame, FlatFrame):
        far = -near
    elif isinstance(frame, ViewFrame):
        far = 1.0 / near / -(rays.along @ frame_view(frame, origin).rotation[2])
    else:
        far = 2.0 * (frame.radius + frame.reach) - near if frame.outside else -near
    return rays.start + far[:, None] * rays.along


def window_pixels(window: Window) -> np.ndarray:
    """(rows * cols, 2) (col, row) of all pixels of a window, rows first."""
    row, col = np.indices(window.shape)
    return np.column_stack([col.ravel() + window.col, row.ravel() + window.row]).astype(np.float64)


def scan_frame(
    frame: AnyFrame, window: Window, blocks: Iterable[tuple[np.ndarray, np.ndarray]], origin: np.ndarray
) -> NearestTriangles:
    """Depth and triangle of the pixels `window` of a frame from blocks of (corners (T, 3, 3), numbers (T,))."""
    if isinstance(frame, ViewFrame):
        return _scan_view(frame_view(frame, origin), window, blocks)
    raster = empty_raster(window)
    if isinstance(frame, FlatFrame):
        scan_blocks(raster, plane_projection(frame, origin), blocks)
        return raster
    for corners, numbers in blocks:
        unrolled, own = unroll(frame, corners.astype(np.float64), numbers, origin)
        add_projected(raster, unrolled, own)
    return raster


def scan_blocks(raster: NearestTriangles, projection: Projection, blocks: Iterable[tuple[np.ndarray, np.ndarray]]) -> None:
    """Fills blocks of (corners (T, 3, 3), numbers (T,)) into a raster of a projection."""
    for corners, numbers in blocks:
        triangles = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
        add_triangles(raster, projection, corners.reshape(-1, 3), triangles, numbers)


def _scan_view(view: View, window: Window, blocks: Iterable[tuple[np.ndarray, np.ndarray]]) -> NearestTriangles:
    projection = central_projection(view, ORIGIN)
    if not any(lens_of(view.camera)):
        raster = empty_raster(window)
        scan_blocks(raster, projection, blocks)
        return raster
    ideal = empty_raster(ideal_window(view.camera, window))
    scan_blocks(ideal, projection, blocks)
    return _through_lens(view, window, ideal)


def _through_lens(view: View, window: Window, ideal: NearestTriangles) -> NearestTriangles:
    """The picture of a lens with distortion: every pixel shows the triangle of the ideal pixel nearest to its own ideal place."""
    places = ideal_places(view.camera, window_pixels(window))
    near = np.floor(np.nan_to_num(places, nan=-1e6) + 0.5).astype(int) - (ideal.window.col, ideal.window.row)
    inside = ((near >= 0) & (near < ideal.nearness.shape[::-1])).all(axis=1)
    out = empty_raster(window)
    col, row = near[inside].T
    out.nearness.ravel()[inside], out.triangle.ravel()[inside] = ideal.nearness[row, col], ideal.triangle[row, col]
    return out


def unroll(frame: CylinderFrame, corners: np.ndarray, numbers: np.ndarray, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (T, 3, 3) as (col, row, nearness) of the unrolled cylinder, divided where they bend, and their numbers.

    Those that cross the line opposite to the middle column come twice, once on either side.
    """
    low, high = frame.radius - frame.reach, frame.radius + frame.reach
    for _ in range(12):
        angle, height, radius = _polar(frame, corners, origin)
        # A triangle whose corners are all inside or all outside of the band is not shown; NaN compares as False.
        shown = (radius.min(axis=1) <= high) & (radius.max(axis=1) >= low)
        corners, numbers, angle, height, radius = (v[shown] for v in (corners, numbers, angle, height, radius))
        wide = np.ptp(angle, axis=1) > _WIDEST
        if not wide.any():
            break
        halves = np.concatenate([corners[~wide], _quarters(corners[wide])])
        numbers = np.concatenate([numbers[~wide], np.repeat(numbers[wide], 4)])
        corners = halves
    inside = (radius >= low).all(axis=1) & (radius <= high).all(axis=1)
    angle, height, radius, numbers = (values[inside] for values in (angle, height, radius, numbers))
    turn = 1.0 if frame.outside else -1.0
    col = turn * angle * frame.radius / frame.pixel + 0.5 * (frame.cols - 1)
    row = (frame.top - height) / frame.pixel - 0.5
    once = np.stack([col, row, turn * radius], axis=2)
    shift = np.array([2.0 * np.pi * frame.radius / frame.pixel, 0.0, 0.0])
    return np.concatenate([once, once + shift, once - shift]), np.tile(numbers, 3)


def _polar(frame: CylinderFrame, corners: np.ndarray, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angle from the middle column (rad, within pi of the first corner's), height and radius (T, 3) of corners."""
    offset = corners - (np.array(frame.foot) - origin)
    side = np.cross(frame.axis, frame.middle)
    x, y = offset @ np.array(frame.middle), offset @ side
    angle = np.arctan2(y, x)
    apart = angle - angle[:, :1]
    return angle[:, :1] + (apart + np.pi) % (2 * np.pi) - np.pi, offset @ np.array(frame.axis), np.hypot(x, y)


def _quarters(corners: np.ndarray) -> np.ndarray:
    """Each triangle as four, by the middles of its sides; the four follow each other."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    parts = [np.stack(corner, axis=1) for corner in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    return np.stack(parts, axis=1).reshape(-1, 3, 3)
