"""A view: one photograph with its interior and exterior orientation, and the collinearity equations both ways.

Source: Karfis 2009, section 3.3; x = x0 - c (r11 dX + r12 dY + r13 dZ) / (r31 dX + r32 dY + r33 dZ), y with row 2.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from orthomill.schemas.camera import Camera
from orthomill.schemas.orientation import Block, ExteriorOrientation
from orthomill.tasks.geometry.distortion import distort_point, image_to_pixel, pixel_to_image
from orthomill.tasks.geometry.rotation import rotation_matrix


@dataclass(frozen=True, eq=False)
class View:
    """A photograph that knows where it is. `rotation` (3, 3) world to image, `centre` (3,) m."""

    name: str
    camera: Camera
    rotation: np.ndarray
    centre: np.ndarray

    def project(self, points: np.ndarray) -> np.ndarray:
        """Ground points (N, 3) m to observed pixels (N, 2) (col, row); NaN behind the camera."""
        u = (np.asarray(points, dtype=np.float64) - self.centre) @ self.rotation.T
        with np.errstate(divide="ignore", invalid="ignore"):
            xy = -self.camera.c * u[:, :2] / u[:, 2:3]
        xy[u[:, 2] >= 0] = np.nan
        return image_to_pixel(self.camera, xy)

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """Unit directions in the world (N, 3) of observed pixels (N, 2) (col, row)."""
        xy = pixel_to_image(self.camera, pixels)
        directions = np.column_stack([xy, np.full(len(xy), -self.camera.c)]) @ self.rotation
        return directions / np.linalg.norm(directions, axis=1, keepdims=True)

    def at_height(self, pixels: np.ndarray, z: np.ndarray | float) -> np.ndarray:
        """Ground points (N, 3) where the rays of `pixels` (N, 2) meet the heights `z` (m); NaN when they never do."""
        rays = self.rays(pixels)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (z - self.centre[2]) / rays[:, 2]
        t = np.where(t > 0, t, np.nan)
        return self.centre + rays * t[:, None]

    def contains(self, pixels: np.ndarray, margin: float = 0.0) -> np.ndarray:
        """Which pixels (N, 2) lie inside the photograph by `margin` px or more; NaN is outside."""
        with np.errstate(invalid="ignore"):
            return (
                (pixels[:, 0] >= margin)
                & (pixels[:, 0] <= self.camera.width - 1 - margin)
                & (pixels[:, 1] >= margin)
                & (pixels[:, 1] <= self.camera.height - 1 - margin)
            )

    @property
    def numbers(self) -> np.ndarray:
        """(22,) float64 for kernels: rotation row by row, centre, c, centre column, centre row, k1, k2, k3, p1, p2, width, height.

        Centre column and row are the principal point in pixels.
        """
        camera = self.camera
        return np.concatenate(
            [
                self.rotation.ravel(),
                self.centre,
                [camera.c, camera.x0 + (camera.width - 1) / 2, (camera.height - 1) / 2 - camera.y0],
                [camera.k1, camera.k2, camera.k3, camera.p1, camera.p2, camera.width, camera.height],
            ]
        )


@njit(cache=True, inline="always")
def project_point(n, x, y, z):
    """(col, row, depth) of a ground point; `n` is `View.numbers`. depth <= 0 is behind the camera (col, row are then NaN)."""
    dx, dy, dz = x - n[9], y - n[10], z - n[11]
    u = n[0] * dx + n[1] * dy + n[2] * dz
    v = n[3] * dx + n[4] * dy + n[5] * dz
    w = n[6] * dx + n[7] * dy + n[8] * dz
    if w >= 0.0:
        return np.nan, np.nan, -w
    xd, yd = distort_point(-u / w, -v / w, n[15], n[16], n[17], n[18], n[19])
    return n[13] + n[12] * xd, n[14] - n[12] * yd, -w


def view_of(orientation: ExteriorOrientation, camera: Camera) -> View:
    """The view of a stored orientation."""
    return View(orientation.photo, camera, rotation_matrix(*np.radians(orientation.omega_phi_kappa)), np.array(orientation.centre))


def block_view(block: Block, name: str) -> View:
    """The view of a photograph of a block."""
    return view_of(block.of(name), block.camera_of(name))
