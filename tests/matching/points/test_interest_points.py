"""Interest points: measures against plain NumPy, known corners, suppression, tiles, masks."""

import numpy as np
import pytest
from scipy import ndimage

from orthomill.schemas.raster import Window, tiles_of
from orthomill.tasks.matching.points.interest_points import (
    FoerstnerPoints,
    InterestPoints,
    interest_points,
    roundness,
    strength,
    structure_tensor,
)
from orthomill.tasks.matching.points.point_settings import HarrisPoints

DETECTORS = (HarrisPoints(), FoerstnerPoints())
each_detector = pytest.mark.parametrize("detector", DETECTORS, ids=lambda detector: detector.kind)


def square(row: float, col: float, side: float = 20.0, angle: float = 0.0, shape: tuple[int, int] = (80, 90)) -> np.ndarray:
    """A bright square about (row, col), averaged over pixels, so that its corners are known to a fraction of a pixel."""
    fine = (np.arange(8) + 0.5) / 8 - 0.5
    y = (np.arange(shape[0])[:, None] + fine).reshape(-1)[:, None] - row
    x = (np.arange(shape[1])[:, None] + fine).reshape(-1)[None, :] - col
    u, v = x * np.cos(angle) + y * np.sin(angle), -x * np.sin(angle) + y * np.cos(angle)
    inside = (np.abs(u) < side / 2) & (np.abs(v) < side / 2)
    return (60 + 120 * inside.reshape(shape[0], 8, shape[1], 8).mean(axis=(1, 3))).astype(np.float32)


def texture(seed: int, shape: tuple[int, int] = (130, 150)) -> np.ndarray:
    noise = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=shape), 1.5)
    return np.clip(120 + 250 * noise, 1, 255).astype(np.uint8)


def positions(points: InterestPoints) -> np.ndarray:
    return np.column_stack([points.col, points.row])


def plain_tensor(image: np.ndarray, sigma: float) -> list[np.ndarray]:
    """By SciPy, inside."""
    image = image.astype(float)
    mask = np.array([[-1, 0, 1]] * 3)
    gx, gy = ndimage.correlate(image, mask), ndimage.correlate(image, mask.T)
    weights = np.exp(-0.5 * (np.arange(-np.ceil(3 * sigma), np.ceil(3 * sigma) + 1) / sigma) ** 2)
    kernel = np.outer(weights, weights) / weights.sum() ** 2
    return [ndimage.correlate(product, kernel) for product in (gx * gx, gx * gy, gy * gy)]


@pytest.mark.parametrize("sigma", [1.0, 1.5, 2.2])
def test_measures_agree_with_plain_numpy(sigma):
    image, inside = texture(0), (slice(10, -10), slice(10, -10))
    xx, xy, yy = (part[inside] for part in plain_tensor(image, sigma))
    tensor = structure_tensor(image.astype(np.float32), sigma)
    noble = (xx * yy - xy**2) / (xx + yy)
    np.testing.assert_allclose(strength(tensor, HarrisPoints(sigma=sigma))[inside], noble, rtol=2e-3, atol=1.0)
    eigen = np.linalg.eigvalsh(np.stack([xx, xy, xy, yy], axis=-1).reshape(*xx.shape, 2, 2)) / 36 * 4 * np.pi * sigma**2
    weight = 1 / (1 / eigen).sum(axis=-1)
    np.testing.assert_allclose(strength(tensor, FoerstnerPoints(sigma=sigma))[inside], weight, rtol=2e-3, atol=0.1)
    round_by_axes = 1 - ((eigen[..., 1] - eigen[..., 0]) / eigen.sum(axis=-1)) ** 2
    np.testing.assert_allclose(roundness(tensor)[inside], round_by_axes, atol=1e-3)


@each_detector
@pytest.mark.parametrize("row, col, angle", [(40.0, 45.0, 0.0), (40.3, 44.6, 0.0), (39.7, 45.2, 0.4)])
def test_the_corners_of_a_square(detector, row, col, angle):
    found = positions(interest_points(square(row, col, angle=angle), detector))
    corners = np.array([(sx * 10, sy * 10) for sx in (-1, 1) for sy in (-1, 1)])
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    true = corners @ turn + [col, row]
    assert len(found) == 4
    distance = np.linalg.norm(found[:, None] - true[None], axis=2).min(axis=1)
    assert (distance < 1.7).all()


@each_detector
def test_a_shift_of_the_image_is_a_shift_of_its_points(detector):
    """Half a pixel, from an image of twice the resolution: the points follow without bias."""
    fine = ndimage.gaussian_filter(np.random.default_rng(3).normal(size=(400, 400)), 4.0) * 900 + 120
    one, other = (np.clip(fine[:-2, s : s - 2 or None], 1, 255) for s in (0, 1))
    reduced = [view[:, :396].reshape(199, 2, 198, 2).mean(axis=(1, 3)).astype(np.float32) for view in (one, other)]
    first, second = (positions(interest_points(v, detector)) for v in reduced)
    difference = second[:, None] - (first - [0.5, 0.0])[None]
    nearest = difference[np.arange(len(second)), np.linalg.norm(difference, axis=2).argmin(axis=1)]
    assert len(first) > 30
    assert (np.abs(np.median(nearest, axis=0)) < 0.03).all()
    assert np.median(np.linalg.norm(nearest, axis=1)) < 0.17


@each_detector
def test_edges_ramps_and_constant_images_have_no_points(detector):
    shape = (60, 60)
    for image in (np.full(shape, 90), np.where(np.arange(60) < 30, 60, 200) * np.ones(shape), np.mgrid[0:60, 0:60].sum(axis=0) + 9):
        assert len(interest_points(image.astype(np.float32), detector)) == 0


@each_detector
def test_no_two_points_within_the_radius_and_none_missed(detector):
    image = texture(5)
    found = interest_points(image, detector)
    measure = strength(structure_tensor(image.astype(np.float32), detector.sigma), detector)
    limit = detector.min_strength if detector.kind == "harris" else detector.min_weight
    known = np.nan_to_num(measure)
    peaks = (known == ndimage.maximum_filter(known, size=2 * detector.radius + 1)) & (known > limit)
    if detector.kind == "foerstner":
        peaks &= roundness(structure_tensor(image.astype(np.float32), detector.sigma)) > detector.min_roundness
    assert len(found) == peaks.sum() > 20
    assert sorted(found.strength) == sorted(measure[peaks])


@each_detector
def test_equal_neighbours_give_one_point_each(detector):
    """A pattern made by a machine has many equal maxima, and pairs of them side by side."""
    image = np.kron((np.indices((9, 9)).sum(axis=0) % 2), np.ones((12, 12))) * 120 + 60
    found = positions(interest_points(image.astype(np.uint8), detector.model_copy(update={"radius": 5})))
    inner = found[((found > 12) & (found < 95)).all(axis=1)]
    corners = np.array([(12 * i - 0.5, 12 * j - 0.5) for i in range(2, 8) for j in range(2, 8)])
    distance = np.linalg.norm(corners[:, None] - inner[None], axis=2)
    assert ((distance < 1.0).sum(axis=1) == 1).all()


@each_detector
@pytest.mark.parametrize("size", [37, 64])
def test_tiles_give_the_points_of_the_image(detector, size):
    image = texture(6)
    image[40:60, 70:75] = 0
    whole = interest_points(image, detector)
    parts = []
    for tile in tiles_of(image.shape, size):
        read = tile.window.grown(detector.reach).clipped(image.shape)
        core = Window(tile.window.row - read.row, tile.window.col - read.col, *tile.window.shape)
        found = interest_points(image[read.slices], detector, core=core)
        parts.append(np.column_stack([found.col + read.col, found.row + read.row, found.strength]))
    joined = np.concatenate(parts)
    expected = np.column_stack([whole.col, whole.row, whole.strength])
    np.testing.assert_allclose(joined[np.lexsort(joined.T)], expected[np.lexsort(expected.T)], rtol=0, atol=1e-12)


@each_detector
def test_the_edge_of_a_mask_is_no_edge(detector):
    smooth = np.full((70, 70), 100, np.uint8)
    mask = np.ones((70, 70), bool)
    mask[20:40, 20:40] = False
    gaps = np.where(mask, 100.0, np.nan)
    zeros = np.where(mask, 100, 0).astype(np.uint8)
    assert not len(interest_points(smooth, detector, mask)) and not len(interest_points(gaps, detector))
    assert not len(interest_points(zeros, detector))
    textured = interest_points(texture(1), detector, np.zeros((130, 150), bool))
    assert len(textured) == 0


@each_detector
def test_16_bits_and_tiny_images(detector):
    eight = interest_points(texture(2), detector)
    wide = interest_points(texture(2).astype(np.uint16), detector)
    assert (positions(eight) == positions(wide)).all()
    for shape in ((0, 0), (2, 9), (3, 3)):
        assert len(interest_points(np.ones(shape, np.uint8), detector)) == 0


def test_round_points_are_fewer():
    image = texture(7)
    counts = [len(interest_points(image, FoerstnerPoints(min_weight=300.0, min_roundness=q))) for q in (0.0, 0.75, 0.95)]
    assert counts[0] > counts[1] > counts[2] > 0
