"""The centre of symmetry beside a plain least squares of the same patch."""

import cv2
import numpy as np
import pytest

from benchmarks.marking.drawn_targets import drawn
from orthomill.tasks.targets.symmetric_centre import STEPS, symmetric_centre
from orthomill.tasks.targets.target_centre import CORRELATED, LEAST_SIGMA


def plain_centre(grey, start, radius):
    """Place, standard error and asymmetry by arrays, without any of the reasons to stop early."""
    half = int(np.ceil(radius))
    x, y = np.meshgrid(np.arange(-half, half + 1), np.arange(-half, half + 1))
    w = np.clip(radius + 0.5 - np.hypot(x, y), 0, 1).ravel()
    place = np.array(start, float)
    for _ in range(STEPS):
        patch = cv2.getRectSubPix(grey, (2 * half + 3, 2 * half + 3), tuple(map(float, place))).astype(float)
        gy, gx = (plane[1:-1, 1:-1] for plane in np.gradient(patch))
        middle = patch[1:-1, 1:-1]
        difference = (middle - middle[::-1, ::-1]).ravel()
        A = np.stack([(g - g[::-1, ::-1]).ravel() for g in (gx, gy)], axis=1)
        normal = A.T @ (w[:, None] * A)
        step = -np.linalg.solve(normal, A.T @ (w * difference))
        place += step
    variance = (w * (difference + A @ step) ** 2).sum() / (w.sum() - 4)
    spread = (w * (middle.ravel() - np.average(middle.ravel(), weights=w)) ** 2).sum() / w.sum()
    return place, CORRELATED * np.sqrt(2 * variance * np.linalg.eigvalsh(np.linalg.inv(normal))[-1]), variance / (2 * spread)


@pytest.mark.parametrize("kind", ["chequered", "cross"])
def test_the_kernel_gives_what_plain_arrays_give(kind):
    for seed in range(4):
        grey, centre = drawn(kind, np.random.default_rng(seed))
        start = np.round(centre)
        found, (place, sigma, asymmetry) = symmetric_centre(grey, start, 6.5), plain_centre(grey, start, 6.5)
        assert found is not None
        np.testing.assert_allclose(found.place, place, atol=2e-3)
        np.testing.assert_allclose(found.sigma, max(sigma, LEAST_SIGMA), rtol=0.02, atol=1e-4)
        np.testing.assert_allclose(found.unexplained, asymmetry, rtol=0.02, atol=1e-4)


def test_a_straight_edge_and_even_ground_have_no_centre():
    edge = np.repeat(np.where(np.arange(60) < 30, 40.0, 200.0)[None].astype(np.float32), 60, axis=0)
    assert symmetric_centre(edge, np.array([30.0, 30.0]), 8.0) is None
    assert symmetric_centre(np.full((60, 60), 90.0, np.float32), np.array([30.0, 30.0]), 8.0) is None


def test_a_patch_that_leaves_the_image_has_no_centre():
    grey, _ = drawn("chequered", np.random.default_rng(0))
    for start in ((4.0, 40.0), (40.0, 4.0), (grey.shape[1] - 5.0, 40.0), (40.0, grey.shape[0] - 5.0)):
        assert symmetric_centre(grey, np.array(start), 8.0) is None
