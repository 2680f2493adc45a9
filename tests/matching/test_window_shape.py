"""Windows of least-squares matching: the published rule for the pixels of an ellipse, and how many they are."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tasks.matching.least_squares.model import Ellipse, Square, reach_of_window
from tasks.matching.least_squares.window_shape import ellipse_axes, ellipse_window, pixels_of, square_window


def members(half, ratio, angle, offset=(0.0, 0.0)):
    """Pixels (n, 2) of an ellipse from the kernel's spans."""
    spans = np.zeros((400, 2), np.int64)
    reach_x, reach_y = ellipse_window(half, (ratio, np.cos(angle), np.sin(angle)), *offset, spans)
    pixels = [(x, j - reach_y) for j in range(2 * reach_y + 1) for x in range(spans[j, 0], spans[j, 1] + 1)]
    assert pixels_of(spans, 2 * reach_y + 1) == len(pixels)
    assert all(abs(x) <= reach_x and abs(y) <= reach_y for x, y in pixels)
    return pixels


@settings(max_examples=60, deadline=None)
@given(half=st.integers(2, 20), ratio=st.floats(1.0, 8.0), angle=st.floats(0.0, np.pi),
       dx=st.floats(-0.5, 0.5), dy=st.floats(-0.5, 0.5))
def test_a_pixel_belongs_when_its_distances_from_the_foci_sum_up_to_less_than_the_long_axis(half, ratio, angle, dx, dy):
    area = (2 * half + 1) ** 2
    a = np.sqrt(area * ratio / np.pi)
    focus = np.sqrt(a * a - area / (np.pi * ratio)) * np.array([np.cos(angle), np.sin(angle)]) if ratio > 1.0 else np.zeros(2)
    y, x = np.mgrid[-70:71, -70:71]
    total = np.hypot(x - dx - focus[0], y - dy - focus[1]) + np.hypot(x - dx + focus[0], y - dy + focus[1])
    found = np.zeros(x.shape, bool)
    for px, py in members(half, ratio, angle, (dx, dy)):
        found[py + 70, px + 70] = True
    clear = np.abs(total - 2 * a) > 1e-7
    assert (found == (total < 2 * a))[clear].all()


@pytest.mark.parametrize(("half", "tolerance"), [(3, 0.09), (7, 0.035), (10, 0.02), (13, 0.02), (17, 0.02)])
def test_the_number_of_pixels_is_that_of_the_square(half, tolerance):
    """Published: within 2 % in 99 % of the cases, worse for small ellipses."""
    random = np.random.default_rng(half)
    cases = zip(random.uniform(1, 4, 400), random.uniform(0, np.pi, 400), random.uniform(-0.5, 0.5, (400, 2)), strict=True)
    counts = np.array([len(members(half, ratio, angle, tuple(offset))) for ratio, angle, offset in cases])
    deviation = np.abs(counts / (2 * half + 1) ** 2 - 1)
    assert np.quantile(deviation, 0.99) <= tolerance
    assert deviation.max() > 0


def test_the_long_axis_follows_the_uncertainty_and_is_capped():
    for angle in np.linspace(0.05, np.pi - 0.05, 9):
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, -s], [s, c]])
        covariance = turn @ np.diag([4.0, 1.0]) @ turn.T
        ratio, cos, sin = ellipse_axes(covariance[0, 0], covariance[1, 1], covariance[0, 1], 10.0, False)
        assert ratio == pytest.approx(2.0) and abs(cos * s - sin * c) < 1e-9
        _, cos, sin = ellipse_axes(covariance[0, 0], covariance[1, 1], covariance[0, 1], 10.0, True)
        assert abs(cos * c + sin * s) < 1e-9
    assert ellipse_axes(1.0, 0.0, 0.0, 4.0, False)[0] == 4.0
    assert ellipse_axes(100.0, 1.0, 0.0, 4.0, False)[0] == 4.0


def test_a_circle_when_both_shifts_are_as_sure_and_a_square_is_a_square():
    ratio, _, _ = ellipse_axes(0.3, 0.3, 0.0, 4.0, False)
    assert ratio == 1.0
    spans = np.zeros((21, 2), np.int64)
    assert square_window(10, spans) == (10, 10) and pixels_of(spans, 21) == 441


@settings(max_examples=40, deadline=None)
@given(half=st.integers(2, 30), share=st.floats(0.0, 1.0), cap=st.floats(1.0, 8.0), angle=st.floats(0.0, np.pi))
def test_no_window_is_larger_than_what_is_reserved(half, share, cap, angle):
    shape = Ellipse(max_axis_ratio=cap)
    spans = np.zeros((400, 2), np.int64)
    axes = 1.0 + share * (cap - 1.0), np.cos(angle), np.sin(angle)
    assert max(ellipse_window(half, axes, 0.5, -0.5, spans)) <= reach_of_window(half, shape)
    assert reach_of_window(half, Square()) == half
