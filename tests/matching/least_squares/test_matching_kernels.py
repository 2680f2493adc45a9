"""One iteration of every formulation against plain NumPy: design matrix, lstsq, dense correlation of the residuals."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from orthomill.tasks.matching.least_squares.least_squares_settings import Forward, LeastSquaresMatching
from orthomill.tasks.matching.least_squares.matching import PreparedImage, match_points
from orthomill.tasks.matching.least_squares.model import GRADIENTS
from orthomill.tasks.matching.least_squares.small_systems import factor, solve

HALF, PIXEL, START = 4, np.array([30, 28]), np.array([31.3, 27.6])
AFFINE = np.array([1.02, -0.03, 0.01, 0.98])
ONE_STEP = LeastSquaresMatching(
    window=2 * HALF + 1, smoothing=0.8, interpolation="bilinear", max_iterations=1, stop=1.0, min_correlation=-1.0
)


@pytest.fixture(scope="module")
def pair():
    """Two images (60, 60) float32 that are near to each other, but not the same."""
    random = np.random.default_rng(4)
    left = 120 + 60 * gaussian_filter(random.standard_normal((60, 60)), 2.0) * 3
    right = 0.8 * np.roll(left, (-1, 1), axis=(0, 1)) + 25 + gaussian_filter(random.standard_normal((60, 60)), 1.0)
    return left.astype(np.float32), right.astype(np.float32)


def window():
    y, x = np.mgrid[-HALF : HALF + 1, -HALF : HALF + 1].astype(float)
    return x.ravel(), y.ravel()


def bilinear(image, x, y):
    return map_coordinates(image.astype(float), [y, x], order=1)


def right_window(image, x, y):
    return bilinear(image, START[0] + AFFINE[0] * x + AFFINE[1] * y, START[1] + AFFINE[2] * x + AFFINE[3] * y)


def design(gx, gy, x, y, geometry):
    return np.column_stack([gx, gy] if geometry == "shift" else [gx, gx * x, gx * y, gy, gy * x, gy * y])


def as_affine(d, geometry):
    """Corrections (6,) of a solution whose first unknowns are geometric."""
    return np.array([d[0], 0, 0, d[1], 0, 0]) if geometry == "shift" else d[:6]


def one_step(pair, **changes):
    settings = ONE_STEP.model_copy(update=changes)
    return match_points(*(PreparedImage(image) for image in pair), PIXEL[None], START[None], settings, AFFINE[None])


@pytest.mark.parametrize("geometry", ["shift", "affine"])
@pytest.mark.parametrize("radiometry", ["none", "normalised", "estimated"])
def test_inverse_compositional_agrees_with_its_twin(pair, geometry, radiometry):
    left, right = pair
    if radiometry == "none":
        right = ((right - 25) / 0.8).astype(np.float32)
    x, y = window()
    col, row = (PIXEL[0] + x).astype(int), (PIXEL[1] + y).astype(int)
    f, g = left[row, col].astype(float), right_window(right, x, y)
    gx, gy = (left[row, col + 1] - left[row, col - 1]) / 2.0, (left[row + 1, col] - left[row - 1, col]) / 2.0
    a = design(gx, gy, x, y, geometry)
    scale = f.std() / g.std()
    if radiometry == "estimated":
        a, difference = np.column_stack([a, f, np.ones_like(f)]), scale * g
    else:
        difference = scale * (g - g.mean()) - (f - f.mean()) if radiometry == "normalised" else g - f
    d = as_affine(np.linalg.lstsq(a, difference, rcond=None)[0], geometry)
    step = np.array([[1 + d[1], d[2], d[0]], [d[4], 1 + d[5], d[3]], [0, 0, 1]])
    before = np.array([[AFFINE[0], AFFINE[1], START[0]], [AFFINE[2], AFFINE[3], START[1]], [0, 0, 1]])
    after = before @ np.linalg.inv(step)
    found = one_step((left, right), geometry=geometry, radiometry=radiometry)
    assert found.converged.all() and found.iterations[0] == 1
    assert np.abs(found.position[0] - after[:2, 2]).max() < 2e-4
    assert np.abs(found.affine[0] - after[:2, :2].ravel()).max() < 1e-4
    assert found.correlation[0] == pytest.approx(np.corrcoef(f, g)[0, 1], abs=1e-5)
    gain = np.polyfit(f, g, 1)
    assert np.abs(found.radiometry[0] - gain).max() < 2e-3 * np.abs(gain).max()


def test_covariance_agrees_with_its_twin(pair):
    left = pair[0]
    x, y = window()
    col, row = (PIXEL[0] + x).astype(int), (PIXEL[1] + y).astype(int)
    f = left[row, col].astype(float)
    gx, gy = (left[row, col + 1] - left[row, col - 1]) / 2.0, (left[row + 1, col] - left[row - 1, col]) / 2.0
    a = np.column_stack([design(gx, gy, x, y, "affine"), f, np.ones_like(f)])
    influence = np.linalg.pinv(a)[[0, 3]]
    kernel = np.array([1.0, np.exp(-1 / (4 * 0.64)), np.exp(-4 / (4 * 0.64)), *np.zeros(20)])
    dx, dy = np.abs(x[:, None] - x).astype(int), np.abs(y[:, None] - y).astype(int)
    cofactors = influence @ (kernel[dx] * kernel[dy]) @ influence.T
    found = one_step(pair)
    turn = found.affine[0].reshape(2, 2)
    assert np.allclose(found.covariance[0], found.sigma0[0] ** 2 * turn @ cofactors @ turn.T, rtol=2e-3)


def slopes(image, x, y, alone):
    """Differences of `image`(x, y) along both axes: central, but alone where the window ends one-sided."""
    found = []
    for i, j in ((1, 0), (0, 1)):
        place, last = (x, x.max()) if i else (y, y.max())
        ahead, back = np.ones_like(x), np.ones_like(x)
        if alone:
            ahead, back = (place < last).astype(float), (place > -last).astype(float)
        found.append((image(x + i * ahead, y + j * ahead) - image(x - i * back, y - j * back)) / (ahead + back))
    return found


@pytest.mark.parametrize("geometry", ["shift", "affine"])
@pytest.mark.parametrize("radiometry", ["none", "normalised", "estimated"])
@pytest.mark.parametrize("gradients", GRADIENTS)
def test_forward_agrees_with_its_twin(pair, geometry, radiometry, gradients):
    left, right = pair
    x, y = window()
    turn = AFFINE.reshape(2, 2)
    if gradients.endswith("right"):
        f, g = left[(PIXEL[1] + y).astype(int), (PIXEL[0] + x).astype(int)].astype(float), right_window(right, x, y)
        gx, gy = slopes(lambda u, v: right_window(right, u, v), x, y, gradients == "window_right")
        if gradients == "resampled_right":
            gx, gy = np.linalg.inv(turn).T @ np.array([gx, gy])
    else:

        def left_window(u, v):
            shifted = np.array([centre[0] + u, centre[1] + v]) - START[:, None]
            return bilinear(left, *(PIXEL[:, None] + np.linalg.inv(turn) @ shifted))

        centre, u, v = np.floor(START + 0.5), x, y
        col, row = (centre[0] + u).astype(int), (centre[1] + v).astype(int)
        x, y = np.linalg.inv(turn) @ (np.array([col, row]) - START[:, None])
        f, g = left_window(u, v), right[row, col].astype(float)
        gx, gy = (right[row, col + 1] - right[row, col - 1]) / 2.0, (right[row + 1, col] - right[row - 1, col]) / 2.0
        if gradients == "resampled_left":
            gx, gy = slopes(left_window, u, v, False)
    if radiometry == "normalised":
        scale = f.std() / g.std()
        g, gx, gy = scale * (g - g.mean()) + f.mean(), scale * gx, scale * gy
    a = design(gx, gy, x, y, geometry)
    if radiometry == "estimated":
        a = np.column_stack([a, g, np.ones_like(g)])
    d = np.linalg.lstsq(a, f - g, rcond=None)[0]
    residual = ((f - g - a @ d) ** 2).sum() / (len(f) - a.shape[1])
    if radiometry == "estimated":
        gain, offset = 1 + d[-2], d[-1]
    limited = as_affine(d, geometry)
    limited = np.clip(limited, [-3, -0.1, -0.1, -3, -0.1, -0.1], [3, 0.1, 0.1, 3, 0.1, 0.1])
    found = one_step(pair, formulation=Forward(gradients=gradients), geometry=geometry, radiometry=radiometry, stop=100.0)
    assert found.converged.all()
    assert np.abs(found.position[0] - START - limited[[0, 3]]).max() < 1e-4
    assert np.abs(found.affine[0] - AFFINE - limited[[1, 2, 4, 5]]).max() < 1e-4
    assert found.sigma0[0] ** 2 == pytest.approx(residual, rel=1e-4)
    rows = [0, 1] if geometry == "shift" else [0, 3]
    assert np.allclose(found.covariance[0], residual * np.linalg.inv(a.T @ a)[np.ix_(rows, rows)], rtol=1e-3)
    if radiometry == "estimated":
        assert np.allclose(found.radiometry[0], [1 / gain, -offset / gain], rtol=1e-3)


def test_small_systems_agree_with_their_twins():
    a = np.random.default_rng(1).normal(size=(20, 6))
    normal, lower, right_side = a.T @ a, np.empty((6, 6)), np.arange(6.0)
    assert factor(normal, 6, lower)
    solve(lower, 6, right_side)
    assert np.allclose(right_side, np.linalg.solve(normal, np.arange(6.0)))
    assert factor(normal, 2, lower) and not factor(np.ones((6, 6)), 6, lower) and not factor(np.full((2, 2), np.nan), 2, lower)
