"""The published critical correlations, and what the thresholds promise."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage
from scipy import stats as distributions

from orthomill.tasks.geometry.distortion import NO_LENS
from orthomill.tasks.geometry.view import ViewNumbers
from orthomill.tasks.matching.line_locus.height_search_settings import (
    FixedThreshold,
    HeightSearch,
    IndependentPixelsThreshold,
    TTestThreshold,
)
from orthomill.tasks.matching.line_locus.line_locus import NodeLines, found_heights
from orthomill.tasks.matching.line_locus.node_order import visits
from orthomill.tasks.matching.line_locus.thresholds import critical_correlation, threshold_limits
from orthomill.tasks.matching.line_locus.window_correlation import GreyImage, GreyImages

PUBLISHED = {25: (0.1313, 0.1234), 45: (0.0731, 0.0686), 65: (0.0506, 0.0475), 85: (0.0387, 0.0363)}


@pytest.mark.parametrize(("side", "expected"), PUBLISHED.items())
def test_critical_correlations_are_the_published_ones(side, expected):
    for value, sides in zip(expected, ("two", "one"), strict=True):
        assert float(critical_correlation(side**2, 0.001, sides)) == pytest.approx(value, abs=1e-4)
        assert threshold_limits(TTestThreshold(error_probability=0.001, sides=sides), side**2).max() == pytest.approx(
            value, abs=1e-4
        )


@given(st.integers(3, 100000), st.floats(1e-6, 0.4))
@settings(deadline=None, max_examples=50)
def test_the_t_value_of_a_critical_correlation_is_critical(pixels, error):
    limit = float(critical_correlation(pixels, error))
    t = limit * np.sqrt(pixels - 2) / np.sqrt(1 - limit**2) if limit < 1 else np.inf
    assert t == pytest.approx(distributions.t.isf(error / 2, pixels - 2), rel=1e-4) or limit > 1 - 1e-9


def test_the_critical_correlation_falls_to_zero_and_two_pixels_say_nothing():
    assert float(critical_correlation(1e12, 0.001)) < 1e-5
    assert float(critical_correlation(2, 0.001)) == 1.0
    assert (threshold_limits(FixedThreshold(value=0.7), 625) == 0.7).all()


def test_fewer_independent_pixels_and_more_trials_ask_for_more():
    limits = threshold_limits(IndependentPixelsThreshold(error_probability=0.01), 625)
    assert (np.diff(limits, axis=1) <= 0).all() and (np.diff(limits, axis=0) >= 0).all()


def unrelated(smoothing: float, threshold, window: int = 25):
    """Outcomes of nodes over two images that have nothing in common."""
    side, images = 420, []
    for seed, x in ((1, -80.0), (2, 80.0)):
        grey = ndimage.gaussian_filter(np.random.default_rng(seed).normal(0, 1, (side, side)), smoothing)
        image = (120 + 20 * grey / grey.std()).astype(np.float32)
        images.append(GreyImage(image, vertical(x, side)))
    nodes = np.linspace(-45, 45, 30)
    lines = NodeLines(nodes, nodes[::-1].copy(), np.full((30, 30), 100.0), 50.0, 150.0)
    asked = HeightSearch(window=window, threshold=threshold)
    return found_heights(GreyImages.of(images), lines, visits(30, 30, (0, 0), "rows"), asked, 1.7).outcome


def vertical(x: float, side: int) -> ViewNumbers:
    half, c = (side - 1) / 2, 2362.0
    # The base is wider than the images: their frames are moved so that all of them show the ground about X = 0.
    placed = map(float, (1, 0, 0, 0, 1, 0, 0, 0, 1, x, 0, 900, c, half + x * c / 800, half))
    return ViewNumbers._make((*placed, NO_LENS, float(side), float(side)))


@pytest.mark.parametrize("smoothing", [0.0, 1.0, 2.0, 4.0])
def test_chance_passes_rarely_whatever_the_texture_and_mostly_the_published_test(smoothing):
    own = unrelated(smoothing, IndependentPixelsThreshold(error_probability=0.02))
    assert (own == 1).mean() < 0.06
    published = unrelated(smoothing, TTestThreshold())
    assert (published == 1).mean() > (0.7 if smoothing > 1 else 0.04)
