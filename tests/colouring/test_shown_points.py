"""Where photographs show points, with which weight and how far from their middle: the kernel beside a plain NumPy twin."""

import numpy as np
import pytest

from orthomill.schemas.camera import Camera
from orthomill.tasks.colouring.sampling.photograph_colours import LEAST_WEIGHT
from orthomill.tasks.colouring.sampling.surface_sampling import _show
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View

CAMERA = Camera(name="c", width=320, height=240, c=250.0, x0=3.0, y0=-2.0, k1=-0.06, k2=0.02, p1=1e-3, p2=-5e-4)
VIEW = View("v", CAMERA, rotation_matrix(0.2, -0.3, 1.1), np.array([0.5, -0.4, 6.0]))


def surface() -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) in, beside and behind the view, and unit normals (N, 3), some of which look away."""
    rng = np.random.default_rng(7)
    pixels = rng.uniform((-60, -60), (380, 300), (4000, 2))
    points = VIEW.centre + VIEW.rays(pixels) * rng.uniform(-4.0, 9.0, (4000, 1))
    normals = rng.normal(0, 1, (4000, 3))
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def twin(points: np.ndarray, normals: np.ndarray, facing: float, soft: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """c^2 (n d) / w^3, made soft over `soft` px of border; r^2 of the corners is 1."""
    offset = VIEW.centre - points
    depth = offset @ VIEW.rotation[2]
    pixels = VIEW.project(points)
    share = np.clip((VIEW.within(pixels) + 0.5) / soft, 0.0, 1.0)
    area = CAMERA.c**2 * facing * (normals * offset).sum(axis=1) / depth**3
    middle = np.array([CAMERA.width - 1, CAMERA.height - 1]) / 2
    r2 = ((pixels - middle) ** 2).sum(axis=1) / (middle**2).sum()
    return pixels, np.maximum(area * (3 * share**2 - 2 * share**3), LEAST_WEIGHT), r2


@pytest.mark.parametrize(("facing", "soft"), [(1.0, 36.0), (-1.0, 36.0), (1.0, 1e-9)])
def test_pixels_weights_and_radii_agree_with_their_plain_twin(facing, soft):
    points, normals = surface()
    chosen = np.arange(0, len(points), 3)
    pixels, weight, r2 = np.empty((len(chosen), 2)), np.empty(len(chosen), np.float32), np.empty(len(chosen), np.float32)
    _show(VIEW.numbers, points, normals, chosen, facing, soft, pixels, weight, r2)
    expected = twin(points[chosen], normals[chosen], facing, soft)
    behind = np.isnan(expected[0][:, 0])
    assert 0.1 < behind.mean() < 0.6 and (expected[1] > 1.0).mean() > 0.1 and (expected[1] <= LEAST_WEIGHT).mean() > 0.2
    np.testing.assert_allclose(pixels, expected[0], atol=1e-9)
    np.testing.assert_allclose(weight, expected[1], rtol=1e-6)
    np.testing.assert_allclose(r2, expected[2], rtol=1e-5)
