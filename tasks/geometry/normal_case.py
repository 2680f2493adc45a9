"""The normal case of a pair of photographs: the geometry of its epipolar images, and the mapping between these and the photographs.

Strategy. The x axis of both epipolar images is the base. The rotation about the base, which the epipolar condition leaves free, is
chosen so that the images look along the mean viewing direction of both photographs; a mean of directions, unlike a mean of omegas,
also holds for strips flown in opposite directions and for any kappa. The images are pure central projections with one camera
constant, not smaller than that of either photograph. Rows and columns are limited to ground that both photographs can see between
two heights.

Source: Karfis 2009, chapter 5 (sources/epipolar.md#epipolar-images to #row-band), with the corrected order of the
rotations (#misprint-m1): R_b = R_Omega R_K R_Phi, phi_b = -arctan(Bz / Bx), kappa_b = arctan(By / sqrt(Bx^2 + Bz^2)).
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import cv2
import numpy as np

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.raster import Window
from orthomill.tasks.geometry.distortion import LensNumbers, image_to_pixel, pixel_to_image
from orthomill.tasks.geometry.view import View

Side = Literal["left", "right"]

_EDGE = 17
"""points along each edge of a photograph that represent its border, which distortion bends"""
_BEHIND = -0.05
"""Cosine between a ray and the axis of the normal image, about 87 degrees: flatter rays have image coordinates of any size."""
_LEAST_ACROSS = 1e-6
"""Sine of the angle between base and viewing direction below which no plane through the base is defined."""


@dataclass(frozen=True)
class HeightRange:
    """Lowest and highest ground to be seen, m."""

    low: float
    high: float

    @property
    def mean(self) -> float:
        """Middle of the range, m."""
        return (self.low + self.high) / 2


def base_rotation(base: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) world to base system: x along `base` (3,), z as near to `direction` (3,) as that allows.

    `direction` points from the ground to the camera. Raises GeometryError when it is parallel to the base.
    """
    # R_b = R_Omega R_K R_Phi. The order that the source prints leaves 0.017 of the base in z, a y-parallax of 8 px.
    phi, kappa = -np.arctan2(base[2], base[0]), np.arctan2(base[1], np.hypot(base[0], base[2]))
    sp, cp, sk, ck = np.sin(phi), np.cos(phi), np.sin(kappa), np.cos(kappa)
    turned = np.array([[ck, sk, 0.0], [-sk, ck, 0.0], [0.0, 0.0, 1.0]]) @ np.array([[cp, 0.0, -sp], [0.0, 1.0, 0.0], [sp, 0.0, cp]])
    _, y, z = turned @ direction
    if np.hypot(y, z) < _LEAST_ACROSS * np.linalg.norm(direction):
        raise GeometryError("The photographs look along their base: such a pair has no epipolar images.")
    omega = np.arctan2(-y, z)
    so, co = np.sin(omega), np.cos(omega)
    return np.array([[1.0, 0.0, 0.0], [0.0, co, so], [0.0, -so, co]]) @ turned


def mean_direction(left: View, right: View) -> np.ndarray:
    """Unit vector (3,) from the ground to the cameras: the mean of both viewing directions.

    Raises GeometryError when the photographs look in opposite directions.
    """
    direction = left.rotation[2] + right.rotation[2]
    length = np.linalg.norm(direction)
    if length < 1e-3:
        raise GeometryError(f"The photographs {left.name} and {right.name} look in opposite directions.")
    return direction / length


def in_order(first: View, second: View) -> tuple[View, View]:
    """(left, right): the base points east, or north where it runs rather north than east."""
    base = second.centre - first.centre
    along = base[0] if abs(base[0]) >= abs(base[1]) else base[1]
    return (first, second) if along >= 0 else (second, first)


def frame_polygon(view: View, rotation: np.ndarray, c: float) -> np.ndarray:
    """The border of a photograph (N, 2) in normal image coordinates (px, y up): its convex hull, anticlockwise.

    Raises GeometryError when a part of the photograph looks away from the normal image.
    """
    rays = view.rays(border_pixels(view)) @ rotation.T
    if (rays[:, 2] > _BEHIND).any():
        raise GeometryError(f"The photograph {view.name} is tilted too far against the normal case of its pair.")
    return convex(-c * rays[:, :2] / rays[:, 2:])


def border_pixels(view: View) -> np.ndarray:
    """Pixels (N, 2) along the border of a photograph, in order around it."""
    edge = np.linspace(0.0, 1.0, _EDGE)[:-1]
    right, bottom = view.camera.width - 1.0, view.camera.height - 1.0
    zero = np.zeros_like(edge)
    return np.concatenate(
        [
            np.column_stack([right * edge, zero]),
            np.column_stack([zero + right, bottom * edge]),
            np.column_stack([right * (1 - edge), zero + bottom]),
            np.column_stack([zero, bottom * (1 - edge)]),
        ]
    )


def convex(points: np.ndarray) -> np.ndarray:
    """The convex hull (M, 2) of points (N, 2)."""
    # OpenCV works in float32: about their mean, coordinates keep a thousandth of a pixel.
    origin = points.mean(axis=0)
    return cv2.convexHull((points - origin).astype(np.float32)).reshape(-1, 2).astype(np.float64) + origin


def common_polygon(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The intersection (M, 2) of two convex polygons; (0, 2) where they do not meet."""
    origin = first.mean(axis=0)
    area, common = cv2.intersectConvexConvex((first - origin).astype(np.float32), (second - origin).astype(np.float32))
    if common is not None and area > 0:
        return common.reshape(-1, 2).astype(np.float64) + origin
    # OpenCV finds no area of some polygons that overlap widely.
    return _clipped(first - origin, second - origin) + origin


def _clipped(polygon: np.ndarray, by: np.ndarray) -> np.ndarray:
    """The part (M, 2) of a convex polygon inside another; (0, 2) where there is none. Source: Sutherland and Hodgman 1974."""
    following = np.roll(by, -1, axis=0)
    turn = np.sign((by[:, 0] * following[:, 1] - following[:, 0] * by[:, 1]).sum())
    for a, b in zip(by, following, strict=True):
        side = turn * ((b[0] - a[0]) * (polygon[:, 1] - a[1]) - (b[1] - a[1]) * (polygon[:, 0] - a[0]))
        corners = []
        for k, (here, one) in enumerate(zip(polygon, side, strict=True)):
            there, other = polygon[(k + 1) % len(polygon)], side[(k + 1) % len(polygon)]
            if one >= 0:
                corners.append(here)
            if one * other < 0:
                corners.append(here + (there - here) * one / (one - other))
        polygon = np.array(corners).reshape(-1, 2)
    return polygon if polygon_area(polygon) > 0 else np.empty((0, 2))


def polygon_area(polygon: np.ndarray) -> float:
    """Area of a polygon (N, 2) in the square of its unit."""
    if len(polygon) < 3:
        return 0.0
    # Centred, because the products of ground coordinates of millions of metres leave few digits for their differences.
    x, y = (polygon - polygon.mean(axis=0)).T
    return float(abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2)


def parallax_range(left: View, right: View, rotation: np.ndarray, c: float, heights: HeightRange) -> tuple[float, float]:
    """Least and greatest x-parallax (px) of ground between two heights that both photographs see.

    Raises GeometryError when they see no common ground.
    """
    # Both photographs are searched, because a coarse grid of one may miss a narrow overlap; a tenth of the frame beyond the border
    # is admitted, so that the range is not too narrow between the points of the grid.
    base = float(np.linalg.norm(right.centre - left.centre))
    found = []
    for view, other in ((left, right), (right, left)):
        for z in (heights.low, heights.high):
            ground = view.at_height(_grid_pixels(view), z)
            seen = other.contains(other.project(ground), margin=-0.1 * other.camera.width)
            depth = -((ground[seen] - left.centre) @ rotation[2])
            found.append(base * c / depth[depth > 0])
    values = np.concatenate(found)
    if not len(values):
        raise GeometryError(f"The photographs {left.name} and {right.name} see no common ground.")
    return float(values.min()), float(values.max())


def normal_case(left: View, right: View, heights: HeightRange, level: int = 0) -> EpipolarPair:
    """The epipolar images of a pair: common rotation, camera constant and rows, and the columns of ground that both see.

    level: of the photographs' pyramids, in whose pixels the images are. `base_height` is the base over the mean depth; `row_sigma`
    is left at 0. Raises GeometryError when the photographs share no
    ground between the heights, or cannot be rotated to the normal case.
    """
    # The larger camera constant: a smaller one would resample the other photograph to a coarser scale and lose information.
    base = right.centre - left.centre
    rotation, c = base_rotation(base, mean_direction(left, right)), max(left.camera.c, right.camera.c) / 2**level
    parallax = parallax_range(left, right, rotation, c, heights)
    seen = _seen_by_both(frame_polygon(left, rotation, c), frame_polygon(right, rotation, c), parallax)
    if not len(seen):
        raise GeometryError(f"The photographs {left.name} and {right.name} see no common ground.")
    (x_left, y_low, x_right), (x_left_high, y_high, x_right_high) = np.floor(seen.min(axis=0)), np.ceil(seen.max(axis=0))
    return EpipolarPair(
        name=f"{left.name}-{right.name}",
        left=left.name,
        right=right.name,
        level=level,
        rotation=tuple(map(tuple, rotation.tolist())),
        left_centre=tuple(left.centre.tolist()),
        right_centre=tuple(right.centre.tolist()),
        base=float(np.linalg.norm(base)),
        c=c,
        row0=float(y_high),
        left_col0=float(-x_left),
        right_col0=float(-x_right),
        rows=int(y_high - y_low) + 1,
        left_cols=int(x_left_high - x_left) + 1,
        right_cols=int(x_right_high - x_right) + 1,
        parallax_low=parallax[0],
        parallax_high=parallax[1],
        base_height=sum(parallax) / 2 / c,
        row_sigma=0.0,
    )


def corner_rays(pair: EpipolarPair, side: Side) -> np.ndarray:
    """World directions (4, 3) of the corners of an epipolar image, scaled so that their depth in the base system is c."""
    col0, cols = (pair.left_col0, pair.left_cols) if side == "left" else (pair.right_col0, pair.right_cols)
    x, y = np.array([0, cols - 1]) - col0, pair.row0 - np.array([0, pair.rows - 1])
    corners = np.stack(np.meshgrid(x, y, [-pair.c]), axis=-1).reshape(-1, 3)
    return corners @ np.array(pair.rotation)


def _grid_pixels(view: View) -> np.ndarray:
    """9 x 9 pixels (81, 2) spread over a photograph."""
    col, row = np.meshgrid(np.linspace(0, view.camera.width - 1, 9), np.linspace(0, view.camera.height - 1, 9))
    return np.column_stack([col.ravel(), row.ravel()])


def _seen_by_both(left: np.ndarray, right: np.ndarray, parallax: tuple[float, float]) -> np.ndarray:
    """Corners (N, 3) as (x_left, y, x_right) of the overlap of both frames, for parallaxes over the whole range."""
    corners = []
    # The overlap at a given parallax is a polygon; nine of them bracket the one of any height in between.
    for p in np.linspace(*parallax, 9):
        common = common_polygon(left, right + np.array([p, 0.0]))
        corners.append(np.column_stack([common, common[:, 0] - p]))
    return np.concatenate(corners)


class EpipolarNumbers(NamedTuple):
    """The mapping from an epipolar image to its photograph for kernels."""

    t11: float
    t12: float
    t13: float
    t21: float
    t22: float
    t23: float
    t31: float
    t32: float
    t33: float
    """rotation, base system to photograph"""
    c: float
    col0: float
    row0: float
    """camera constant and principal point of the epipolar image, px"""
    photo_c: float
    photo_col0: float
    photo_row0: float
    """the same of the photograph"""
    lens: LensNumbers


@dataclass(frozen=True, eq=False)
class EpipolarView:
    """One epipolar image of a pair together with its photograph: the mapping between their pixels, both ways."""

    view: View
    turn: np.ndarray
    """(3, 3): rotation, base system to photograph"""
    rotation: np.ndarray
    """(3, 3): rotation, world to base system"""
    c: float
    col0: float
    row0: float
    shape: tuple[int, int]

    def to_photo(self, pixels: np.ndarray) -> np.ndarray:
        """Epipolar pixels (N, 2) (col, row) to observed pixels of the photograph (N, 2); NaN behind the camera."""
        rays = np.column_stack([pixels[:, 0] - self.col0, self.row0 - pixels[:, 1], np.full(len(pixels), -self.c)]) @ self.turn.T
        camera = self.view.camera
        with np.errstate(divide="ignore", invalid="ignore"):
            xy = -camera.c * rays[:, :2] / rays[:, 2:]
        xy[rays[:, 2] >= 0] = np.nan
        return image_to_pixel(camera, xy)

    def from_photo(self, pixels: np.ndarray) -> np.ndarray:
        """Observed pixels of the photograph (N, 2) (col, row) to epipolar pixels (N, 2); NaN behind the camera."""
        xy = pixel_to_image(self.view.camera, pixels)
        return self._pixels(np.column_stack([xy, np.full(len(xy), -self.view.camera.c)]) @ self.turn)

    def _pixels(self, rays: np.ndarray) -> np.ndarray:
        """Epipolar pixels (N, 2) of directions (N, 3) in the base system; NaN for those that look backwards."""
        with np.errstate(divide="ignore", invalid="ignore"):
            xy = -self.c * rays[:, :2] / rays[:, 2:]
        xy[rays[:, 2] >= 0] = np.nan
        return np.column_stack([xy[:, 0] + self.col0, self.row0 - xy[:, 1]])

    def photo_window(self, window: Window, margin: int = 4) -> Window:
        """The window of the photograph that the epipolar window `window` shows, `margin` px wider, clipped to the photograph."""
        # A grid and not only the corners: distortion bends the edges, and corners may lie behind the camera.
        col = np.linspace(window.col, window.col + window.width - 1, 9)
        row = np.linspace(window.row, window.row + window.height - 1, 9)
        pixels = self.to_photo(np.stack(np.meshgrid(col, row), axis=-1).reshape(-1, 2))
        pixels = pixels[np.isfinite(pixels).all(axis=1)]
        if not len(pixels):
            return Window(0, 0, 0, 0)
        left, top = np.floor(pixels.min(axis=0)).astype(int) - margin
        right, bottom = np.ceil(pixels.max(axis=0)).astype(int) + 1 + margin
        photo = self.view.camera.height, self.view.camera.width
        return Window(int(top), int(left), int(bottom - top), int(right - left)).clipped(photo)

    @property
    def numbers(self) -> EpipolarNumbers:
        """The mapping as kernels take it."""
        photo = self.view.numbers
        own = map(float, (*self.turn.ravel(), self.c, self.col0, self.row0))
        return EpipolarNumbers._make((*own, photo.c, photo.col0, photo.row0, photo.lens))


def epipolar_view(pair: EpipolarPair, side: Side, view: View) -> EpipolarView:
    """The left or right image of a pair; `view` is that side's photograph."""
    rotation = np.array(pair.rotation)
    left = side == "left"
    return EpipolarView(
        view=view,
        turn=view.rotation @ rotation.T,
        rotation=rotation,
        c=pair.c,
        col0=pair.left_col0 if left else pair.right_col0,
        row0=pair.row0,
        shape=epipolar_shape(pair, side),
    )


def epipolar_shape(pair: EpipolarPair, side: Side) -> tuple[int, int]:
    """(rows, cols) of the left or right image."""
    return pair.rows, pair.left_cols if side == "left" else pair.right_cols


def intersect_pair(pair: EpipolarPair, left_pixels: np.ndarray, parallax: np.ndarray) -> np.ndarray:
    """Ground points (N, 3) m of left epipolar pixels (N, 2) with parallax x_left - x_right (N,) px; NaN where it is not positive.

    Source: Karfis 2009, normal case (sources/epipolar.md#base-system, #intersection).
    """
    # Similar triangles: the depth is c B / p, and all three coordinates scale with it.
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(parallax > 0, pair.base / parallax, np.nan)
    xyz = np.column_stack([left_pixels[:, 0] - pair.left_col0, pair.row0 - left_pixels[:, 1], np.full(len(parallax), -pair.c)])
    return (xyz * scale[:, None]) @ np.array(pair.rotation) + np.array(pair.left_centre)


def row_partials(xy: np.ndarray, c: float) -> np.ndarray:
    """(N, 3): derivatives of the image coordinate y (px) by small rotations (rad) about the axes x, y, z of the image.

    xy (N, 2) px. Source: Karfis 2009 (sources/epipolar.md#row-band): c (1 + y^2 / c^2), -x y / c, x.
    """
    x, y = xy[:, 0], xy[:, 1]
    return np.column_stack([c * (1 + y**2 / c**2), -x * y / c, x])
