"""A view: one photograph with its interior and exterior orientation, and the collinearity equations both ways.

Source: Karfis 2009, section 3.3; x = x0 - c (r11 dX + r12 dY + r13 dZ) / (r31 dX + r32 dY + r33 dZ), y with row 2.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.camera import Camera
from orthomill.schemas.orientation import Block, ExteriorOrientation
from orthomill.tasks.geometry.distortion import (
    BROWN,
    LensNumbers,
    distort_brown,
    distort_point,
    image_to_pixel,
    lens_of,
    pixel_to_image,
    principal_place,
)
from orthomill.tasks.geometry.rotation import rotation_matrix

FIELD_MARGIN = 1.05
"""on the squared tangent of the field angle (`View.field`), for `framed_point`"""


class ViewNumbers(NamedTuple):
    """A view for kernels: every number of its collinearity equations by name. numba takes named tuples as arguments."""

    r11: float
    r12: float
    r13: float
    r21: float
    r22: float
    r23: float
    r31: float
    r32: float
    r33: float
    """rotation, world to image"""
    xc: float
    yc: float
    zc: float
    """projection centre, m"""
    c: float
    col0: float
    row0: float
    """camera constant and principal point, px"""
    lens: LensNumbers
    width: float
    height: float
    """size of the photograph, px"""

    def row(self) -> tuple[float, ...]:
        """All numbers in one row, for tables of views (`view_of_row`)."""
        return (*self[:15], *self.lens, self.width, self.height)


@njit(inline="always")
def view_of_row(n):
    """The view of `ViewNumbers.row`, for kernels: numba makes no tuple of a variable length."""
    lens = LensNumbers(n[15], n[16], n[17], n[18], n[19], n[20], n[21], n[22], n[23], n[24], n[25], n[26], n[27], n[28], n[29])
    return ViewNumbers(
        n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8], n[9], n[10], n[11], n[12], n[13], n[14], lens, n[30], n[31]
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class View:
    """A photograph with known position and attitude. `rotation` (3, 3) world to image, `centre` (3,) m."""

    name: str
    camera: Camera
    rotation: np.ndarray
    centre: np.ndarray

    def project(self, points: np.ndarray) -> np.ndarray:
        """Ground points (N, 3) m to observed pixels (N, 2) (col, row); NaN behind the camera."""
        u = (np.asarray(points, dtype=np.float64) - self.centre) @ self.rotation.T
        with np.errstate(divide="ignore", invalid="ignore"):
            xy = -self.camera.c * u[:, :2] / u[:, 2:3]
        # The equations hold behind the camera as well, mirrored: such points would appear in the photograph.
        xy[u[:, 2] >= 0] = np.nan
        return image_to_pixel(self.camera, xy)

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """Unit directions in the ground system (N, 3) of the rays of observed pixels (N, 2) (col, row)."""
        xy = pixel_to_image(self.camera, pixels)
        directions = np.column_stack([xy, np.full(len(xy), -self.camera.c)]) @ self.rotation
        return directions / np.linalg.norm(directions, axis=1, keepdims=True)

    def at_height(self, pixels: np.ndarray, z: np.ndarray | float) -> np.ndarray:
        """Ground points (N, 3) where the rays of `pixels` (N, 2) reach the heights `z` (m); NaN where they point away from them."""
        rays = self.rays(pixels)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (z - self.centre[2]) / rays[:, 2]
        t = np.where(t > 0, t, np.nan)
        return self.centre + rays * t[:, None]

    def contains(self, pixels: np.ndarray, margin: float = 0.0) -> np.ndarray:
        """(N,) bool: pixels (N, 2) inside the photograph by `margin` px or more; NaN is outside."""
        return self.within(pixels) >= margin

    def within(self, pixels: np.ndarray) -> np.ndarray:
        """(N,) px by which pixels (N, 2) lie inside the nearest edge of the photograph, negative outside; -infinite for NaN."""
        far = np.array([self.camera.width - 1, self.camera.height - 1])
        return np.nan_to_num(np.minimum(pixels, far - pixels).min(axis=1), nan=-np.inf)

    @cached_property
    def field(self) -> float:
        """Squared tangent of the angle between the axis and the ray of the photograph's farthest corner; infinite where a corner
        has none."""
        right, bottom = self.camera.width - 1.0, self.camera.height - 1.0
        corners = pixel_to_image(self.camera, np.array([[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]])) / self.camera.c
        # The corners of a fisheye's frame may lie beyond its field of view.
        return float(np.nan_to_num((corners**2).sum(axis=1), nan=np.inf).max())

    @cached_property
    def numbers(self) -> ViewNumbers:
        """The view as kernels take it."""
        camera = self.camera
        principal = principal_place(camera)
        placed = map(float, (*self.rotation.ravel(), *self.centre, camera.c, *principal))
        return ViewNumbers._make((*placed, lens_of(camera), float(camera.width), float(camera.height)))


@njit(inline="always")
def project_point(n, x, y, z):
    """(col, row, depth) of a ground point; `n` is `View.numbers`. A depth <= 0 is behind the camera (col, row are then NaN)."""
    dx, dy, dz = x - n.xc, y - n.yc, z - n.zc
    u = n.r11 * dx + n.r12 * dy + n.r13 * dz
    v = n.r21 * dx + n.r22 * dy + n.r23 * dz
    w = n.r31 * dx + n.r32 * dy + n.r33 * dz
    # Without this test a point behind the camera projects into the photograph, mirrored through the projection centre.
    if w >= 0.0:
        return np.nan, np.nan, -w
    xd, yd = distort_point(-u / w, -v / w, n.lens)
    return n.col0 + n.c * xd, n.row0 - n.c * yd, -w


@njit(inline="always")
def framed_point(n, x, y, z, widest):
    """(col, row, depth, border) of a ground point in a photograph; `n` is `View.numbers`, `widest` the squared tangent of the
    largest field angle, `border`: px to the nearest border, negative or NaN outside."""
    col, row, depth = project_point(n, x, y, z)
    border = min(min(col, n.width - 1.0 - col), min(row, n.height - 1.0 - row))
    # Outside the field of view the distortion polynomial may fold back into the photograph.
    reach = (n.xc - x) ** 2 + (n.yc - y) ** 2 + (n.zc - z) ** 2
    if depth <= 0.0 or reach > (1.0 + widest) * depth * depth:
        border = -1.0
    return col, row, depth, border


class FramedRow(NamedTuple):
    """Points (N,) of a row in a photograph, float64: column and row, px; the inverse depth along the axis, 1/m; px to the nearest
    border, -1 for points outside the frame, behind the camera or without height."""

    col: np.ndarray
    row: np.ndarray
    inverse: np.ndarray
    border: np.ndarray


@njit()
def empty_row(count):
    """A `FramedRow` to be filled."""
    return FramedRow(np.empty(count), np.empty(count), np.empty(count), np.empty(count))


# A kernel that asks for one point after the other spends most of its time on branches: which lens, behind the camera, outside the
# field of view. Here the lens is asked for once and nothing in the loop branches, so that compilers use vector instructions.
@njit(error_model="numpy", fastmath={"contract"}, inline="always")
def _fill_row(n, x, y, z, widest, brown, out):
    """Project a row of the ground, `x` (n,) m at `y`, with heights `z` (n,), into `out`. widest: squared tangent of the field of
    view; brown: whether the lens is of Brown's model, whose formula is then compiled into the loop."""
    half_width, half_height = 0.5 * (n.width - 1.0), 0.5 * (n.height - 1.0)
    dy = y - n.yc
    across, along, away = n.r12 * dy, n.r22 * dy, n.r32 * dy
    for j in range(x.size):
        dx, dz = x[j] - n.xc, z[j] - n.zc
        depth = -(n.r33 * dz + (n.r31 * dx + away))
        inverse = 1.0 / depth
        u, v = (n.r13 * dz + (n.r11 * dx + across)) * inverse, (n.r23 * dz + (n.r21 * dx + along)) * inverse
        xd, yd = distort_brown(u, v, n.lens) if brown else distort_point(u, v, n.lens)
        col, row = n.col0 + n.c * xd, n.row0 - n.c * yd
        border = min(half_width - abs(col - half_width), half_height - abs(row - half_height))
        # Outside the field of view the distortion polynomial may fold back into the photograph.
        inside = (border >= 0.0) & (depth > 0.0) & (u * u + v * v <= widest)
        out.col[j], out.row[j], out.inverse[j] = col, row, inverse
        out.border[j] = border if inside else -1.0


@njit(error_model="numpy", fastmath={"contract"})
def frame_row(n, x, y, z, widest, out):
    """Fills `out` as `framed_point` would, several points at a time, for ground points x (N,), y, z (N,) m, NaN for no point;
    n is `View.numbers`, `widest` the squared tangent of the largest field angle."""
    if n.lens.model == BROWN:
        _fill_row(n, x, y, z, widest, True, out)
    else:
        _fill_row(n, x, y, z, widest, False, out)


@njit()
def _frame(n, x, y, z, widest, out):
    """Whether the photograph shows the ground at `x` (c,), `y` (r,), `z` (r, c), m, into `out` (r, c)."""
    line = empty_row(x.size)
    for i in range(y.size):
        frame_row(n, x, y[i], z[i], widest, line)
        for j in range(x.size):
            out[i, j] = line.border[j] >= 0.0


def in_frame(view: View, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """bool (R, C): ground points in the frame of the photograph, hidden or not; x (C,), y (R,), z (R, C) m, NaN for no point."""
    out = np.zeros(z.shape, np.bool_)
    _frame(view.numbers, np.asarray(x, np.float64), np.asarray(y, np.float64), z, FIELD_MARGIN * view.field, out)
    return out


def view_of(orientation: ExteriorOrientation, camera: Camera) -> View:
    """The view of a stored orientation."""
    return View(orientation.photo, camera, rotation_matrix(*np.radians(orientation.omega_phi_kappa)), np.array(orientation.centre))


def block_view(block: Block, name: str) -> View:
    """The view of a photograph of a block."""
    return view_of(block.of(name), block.camera_of(name))
