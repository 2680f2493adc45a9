"""Normalised correlation: against plain NumPy, known shifts, invariance, matching back, outcomes, bad input."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy import ndimage

from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.points.correlation import correlate, correlation_surface
from orthomill.tasks.matching.points.point_settings import TemplateCorrelation
from orthomill.tasks.matching.points.sub_pixel import paraboloid_peaks

SETTINGS = TemplateCorrelation(template=15, search=45)


def texture(seed: int = 0, shape: tuple[int, int] = (160, 180), sigma: float = 1.6) -> np.ndarray:
    noise = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=shape), sigma)
    return np.clip(120 + 40 * noise / noise.std(), 1, 255)


def moved(image: np.ndarray, dx: float, dy: float) -> np.ndarray:
    """The image with its contents moved by (dx, dy) px."""
    return np.clip(ndimage.shift(image, (dy, dx), order=5, mode="reflect"), 1, 255)


def outcome_of(left: np.ndarray, right: np.ndarray, point: tuple, start: tuple, chosen: TemplateCorrelation = SETTINGS) -> Outcome:
    found = correlate(left, right, np.array([point], float), np.array([start], float), chosen)
    assert np.isnan(found.col[0]) == np.isnan(found.row[0]) == (not found.converged[0])
    return Outcome(found.outcome[0])


@given(st.integers(0, 10**6), st.sampled_from([5, 9, 15]), st.sampled_from([16, 25, 70]))
@settings(max_examples=15, deadline=None)
def test_the_surface_agrees_with_plain_numpy(seed, side, search):
    rng = np.random.default_rng(seed)
    area, template = (texture(seed + k, (n, n)).astype(np.float32) for k, n in enumerate((search, side)))
    assume(template.std() > 2.0)  # flat templates are refused before they get here
    area[: search // 3, : search // 3] = 90.0
    area[rng.integers(search), rng.integers(search)] = np.nan
    surface = correlation_surface(template, area, 2.0)
    windows = np.lib.stride_tricks.sliding_window_view(area.astype(float), (side, side))
    t = template.astype(float) - template.mean(dtype=float)
    w = windows - windows.mean(axis=(2, 3), keepdims=True)
    power = (w**2).sum(axis=(2, 3))
    with np.errstate(invalid="ignore", divide="ignore"):
        plain = (w * t).sum(axis=(2, 3)) / np.sqrt(power * (t**2).sum())
    flat = power < side**2 * 4.0
    assert (np.isnan(surface) == np.isnan(power)).all() and (np.isneginf(surface) == flat).all()
    good = np.isfinite(surface)
    np.testing.assert_allclose(surface[good], plain[good], atol=2e-4)


def test_a_window_is_itself_and_its_negative_the_opposite():
    window = texture()[:31, :31].astype(np.float32)
    assert correlation_surface(window, window, 2.0)[0, 0] == pytest.approx(1.0, abs=1e-5)
    assert correlation_surface(window, 255 - window, 2.0)[0, 0] == pytest.approx(-1.0, abs=1e-5)
    assert correlation_surface(window, 0.5 * window + 40, 2.0)[0, 0] == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("dx, dy", [(0.0, 0.0), (3.0, -2.0), (7.3, 1.6), (-4.5, 0.25)])
def test_known_shifts_under_other_brightness_and_contrast(dx, dy):
    left = texture()
    right = 0.8 * moved(left, dx, dy) + 30
    points = np.array([(col, row) for col in (50.0, 80.4, 120.6) for row in (50.0, 75.3, 100.0)])
    found = correlate(left, right, points, points, SETTINGS)
    assert found.converged.all() and (found.correlation > 0.9).all()
    np.testing.assert_allclose(np.column_stack([found.col, found.row]) - points, np.tile([dx, dy], (9, 1)), atol=0.15)
    assert np.sqrt((np.hypot(found.col - points[:, 0] - dx, found.row - points[:, 1] - dy) ** 2).mean()) < 0.06


def test_a_slanting_ridge_peaks_where_it_does():
    x, y = np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0])
    u, v = x - 0.3, y + 0.4
    ridge = 1 - (u**2 + 1.6 * u * v + v**2)
    np.testing.assert_allclose(paraboloid_peaks(ridge[None]), [[0.3, -0.4]], atol=1e-12)
    none = np.stack([np.ones((3, 3)), -ridge, np.where(x == y, np.nan, ridge), np.where(x == y, -np.inf, ridge)])
    assert (paraboloid_peaks(none) == 0).all()
    assert np.abs(paraboloid_peaks(np.random.default_rng(0).random((500, 3, 3)))).max() <= 1


def test_8_and_16_bits_agree():
    left, right = (np.rint(image) for image in (texture(), moved(texture(), 2.0, 1.0)))
    points = np.array([[60.0, 60.0], [90.0, 80.0]])
    eight = correlate(left.astype(np.uint8), right.astype(np.uint8), points, points, SETTINGS)
    wide = correlate(left.astype(np.uint16) * 100, right.astype(np.uint16) * 100, points, points, SETTINGS)
    np.testing.assert_allclose(eight.col, wide.col, atol=1e-3)
    np.testing.assert_allclose(eight.row, wide.row, atol=1e-3)


def test_matching_back_rejects_what_is_seen_once_only():
    """A template that the right image does not hold finds something like it; matching back ends elsewhere."""
    left, right = texture(0), texture(50)
    points = np.array([(col, row) for col in range(40, 140, 10) for row in range(40, 120, 10)], dtype=float)
    easy = TemplateCorrelation(template=9, search=61, min_correlation=0.5, max_return=None)
    once = correlate(left, right, points, points, easy)
    back = correlate(left, right, points, points, easy.model_copy(update={"max_return": 2.0}))
    assert once.converged.mean() > 0.5 and back.converged.mean() < 0.5 * once.converged.mean()
    rejected = once.converged & ~back.converged
    assert (back.outcome[rejected] == Outcome.INCONSISTENT).all()


def test_matching_back_leaves_fewer_wrong_matches_on_a_periodic_texture():
    """Check 6 of sources/epipolar.md: nearly the same pattern every 20 px, searched over five periods."""
    periodic = np.tile(texture(3, (20, 20), 1.0), (8, 9)) + 0.08 * (texture(4) - 120.0)
    left, right = (periodic + np.random.default_rng(seed).normal(0, 6.0, periodic.shape) for seed in (0, 1))
    right = moved(right, 3.0, -2.0)
    points = np.array([(col, row) for col in range(65, 116, 3) for row in range(62, 98, 3)], dtype=float)
    wide = TemplateCorrelation(template=15, search=115, min_correlation=0.5, max_return=None)

    def right_and_wrong(chosen: TemplateCorrelation) -> tuple[int, int]:
        found = correlate(left, right, points, points, chosen)
        apart = np.hypot(found.col - points[:, 0] - 3.0, found.row - points[:, 1] + 2.0)[found.converged]
        return int((apart < 1.0).sum()), int((apart >= 1.0).sum())

    (kept, wrong), (left_over, still_wrong) = map(right_and_wrong, (wide, wide.model_copy(update={"max_return": 2.0})))
    assert wrong > 0.3 * len(points) and still_wrong < 0.3 * wrong and left_over > 0.7 * kept


def test_a_repeated_pattern_ends_where_it_should_when_the_search_window_is_narrow():
    image = np.tile(texture(3, (20, 20), 1.0), (8, 8))
    found = correlate(image, image, np.array([[70.0, 70.0]]), np.array([[72.0, 69.0]]), TemplateCorrelation(template=15, search=31))
    assert found.converged[0] and (found.col[0], found.row[0]) == pytest.approx((70.0, 70.0), abs=0.1)


def test_outcomes_say_why():
    left, flat = texture(), np.full((160, 180), 100.0)
    assert outcome_of(left, left, (80, 80), (80, 80)) == Outcome.CONVERGED
    assert outcome_of(flat, left, (80, 80), (80, 80)) == Outcome.LOW_TEXTURE
    assert outcome_of(left, flat, (80, 80), (80, 80)) == Outcome.LOW_TEXTURE
    assert outcome_of(left, texture(9), (80, 80), (80, 80)) == Outcome.LOW_CORRELATION
    assert outcome_of(left, left, (3, 80), (80, 80)) == Outcome.OUTSIDE
    assert outcome_of(left, left, (80, 80), (400, 80)) == Outcome.OUTSIDE
    assert outcome_of(left, left, (80, 80), (80 - SETTINGS.reach, 80)) == Outcome.MOVED_TOO_FAR
    assert outcome_of(left, left, (7, 80), (9, 80)) == Outcome.OUTSIDE
    for bad in ((np.nan, 80), (80, np.inf), (-1e300, 80)):
        assert outcome_of(left, left, bad, (80, 80)) == outcome_of(left, left, (80, 80), bad) == Outcome.OUTSIDE


@pytest.mark.parametrize("gap", [0.0, np.nan])
def test_pixels_without_data(gap):
    left, right = texture(), texture()
    left[70:75, 70:75] = gap
    right[100:150, 100:150] = gap
    assert outcome_of(left, right, (72, 72), (72, 72)) == Outcome.OUTSIDE
    assert outcome_of(left, right, (120, 120), (120, 120)) != Outcome.CONVERGED
    assert outcome_of(left, right, (120, 50), (120, 50)) == Outcome.CONVERGED
    assert outcome_of(left, np.full((160, 180), gap), (120, 50), (120, 50)) == Outcome.OUTSIDE


def test_images_of_different_size_and_no_points():
    left = texture()
    found = correlate(left, left[30:, 50:], np.array([[100.0, 90.0]]), np.array([[52.0, 61.0]]), SETTINGS)
    assert found.converged[0] and (found.col[0], found.row[0]) == pytest.approx((50.0, 60.0), abs=0.1)
    assert len(correlate(left, left, np.empty((0, 2)), np.empty((0, 2)), SETTINGS).col) == 0
    assert outcome_of(left, np.empty((0, 0)), (80, 80), (80, 80)) == Outcome.OUTSIDE
    assert outcome_of(left, left[:10, :10], (80, 80), (5, 5)) == Outcome.OUTSIDE


def test_a_tile_gives_what_the_image_gives():
    left, right = texture(), moved(texture(), 1.3, 0.4)
    points = np.array([(col, row) for col in range(60, 100, 6) for row in range(60, 90, 6)], dtype=float)
    whole = correlate(left, right, points, points, SETTINGS)
    offset = np.array([13.0, 7.0])
    part = correlate(left[7:, 13:], right[7:, 13:], points - offset, points - offset, SETTINGS)
    assert (whole.outcome == part.outcome).all() and whole.converged.all()
    np.testing.assert_allclose(np.column_stack([part.col, part.row]) + offset, np.column_stack([whole.col, whole.row]), atol=1e-9)
