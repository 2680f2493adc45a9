"""Photographs of a flat textured ground with known cameras: every homologous point is known."""

import numpy as np
from scipy.ndimage import gaussian_filter

from orthomill.schemas.camera import Camera, Cameras
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View
from orthomill.tasks.imagery.resampling import sample_cubic

CAMERA = Camera(name="cam", width=448, height=384, c=420, x0=3.0, y0=-2.0, k1=-0.04)
PIXEL = 0.1
"""m on the ground per texture pixel, close to a photograph's own"""
NAMES = ("a", "b", "c")


def texture(seed: int = 0, side: int = 1100) -> np.ndarray:
    """Noise at several scales, 20 to 235."""
    generator = np.random.default_rng(seed)
    total = sum(scale * gaussian_filter(generator.normal(size=(side, side)), scale) for scale in (1.2, 2.5, 5.0, 12.0))
    return 20 + 215 * (total - total.min()) / np.ptp(total)


def views() -> tuple[View, ...]:
    """Three photographs in a row, 62 % overlap, rotated and tilted against each other; flying height 42 m."""
    angles = ((0.02, -0.03, 0.05), (-0.03, 0.02, 0.45), (0.01, 0.04, -0.2))
    return tuple(
        View(name, CAMERA, rotation_matrix(*angle), np.array([17.0 * number - 17.0, 1.5 * number, 42.0]))
        for number, (name, angle) in enumerate(zip(NAMES, angles, strict=True))
    )


def cameras() -> Cameras:
    return Cameras(cameras={"cam": CAMERA}, of_photo=dict.fromkeys(NAMES, "cam"))


def ground_to_texture(ground: np.ndarray, side: int = 1100) -> np.ndarray:
    return ground[:, :2] / PIXEL * [1, -1] + side / 2


def photograph(view: View, image: np.ndarray, seed: int = 1) -> np.ndarray:
    """(rows, cols, 1) uint8 with noise of 1.5 grey levels."""
    col, row = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    ground = view.at_height(np.column_stack([col.ravel(), row.ravel()]), 0.0)
    values = sample_cubic(image, ground_to_texture(ground)).reshape(row.shape)
    noise = np.random.default_rng(seed).normal(0, 1.5, values.shape)
    return np.clip(np.rint(np.nan_to_num(values) + noise), 0, 255).astype(np.uint8)[:, :, None]


def true_partner(left: View, right: View, pixels: np.ndarray) -> np.ndarray:
    """Where the ground under `pixels` (N, 2) of one photograph lies in another."""
    return right.project(left.at_height(pixels, 0.0))
