"""Ground points in an epipolar image, written apart from the product, which goes from pixels to the ground only."""

import numpy as np

from orthomill.tasks.geometry.normal_case import EpipolarView


def epipolar_pixels(view: EpipolarView, points: np.ndarray) -> np.ndarray:
    """Ground points (N, 3) m to epipolar pixels (N, 2) (col, row), all before the camera."""
    rays = (points - view.view.centre) @ view.rotation.T
    return np.column_stack([view.col0 - view.c * rays[:, 0] / rays[:, 2], view.row0 + view.c * rays[:, 1] / rays[:, 2]])
