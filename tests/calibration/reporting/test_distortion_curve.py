"""The balanced distortion curve against published constants, and as the best of its kind."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.tasks.calibration.diagnosis.distortion_curve import balanced, balancing_change, displacement


@pytest.mark.parametrize(
    ("c", "k1", "k2", "size", "expected"),
    [
        (3619.4, -3.08e-10, 3.546e-17, (5472, 3648), 3617.5),
        (3687.5, 6.237e-10, -3.482e-17, (5472, 3648), 3694.9),
        (4195.2, -8.272e-9, 4.298e-16, (4912, 3264), 4096.9),
        (4938.2, -1.248e-9, 2.816e-16, (5184, 3456), 4941.6),
    ],
)
def test_balanced_curves_are_the_published_ones(c, k1, k2, size, expected):
    radius = 0.85 * 0.5 * np.hypot(*size)
    assert c + balancing_change(c, (k1 * c**2, k2 * c**4, 0.0), radius) == pytest.approx(expected, abs=0.1)


def test_published_distortion_at_2000_px():
    c = 4195.2
    assert displacement(np.array([2000.0]), c, (-8.272e-9 * c**2, 4.298e-16 * c**4, 0.0))[0] == pytest.approx(-52.42, abs=0.01)


@settings(deadline=None, max_examples=25)
@given(k1=st.floats(-0.2, 0.2), k2=st.floats(-0.05, 0.05), k3=st.floats(-0.01, 0.01), off=st.floats(-3.0, 3.0))
def test_no_other_change_of_c_gives_less_distortion(k1, k2, k3, off):
    c, radius, r = 3000.0, 2000.0, np.linspace(0.0, 2000.0, 2001)
    best = balancing_change(c, (k1, k2, k3), radius)
    size = [np.trapezoid(balanced(r, c, (k1, k2, k3), best + d) ** 2, r) for d in (0.0, off)]
    assert size[0] <= size[1] * (1.0 + 1e-6) + 1e-6


def test_without_distortion_nothing_is_to_be_balanced():
    r = np.array([0.0, 500.0, 1000.0])
    assert balancing_change(3000.0, (0.0, 0.0, 0.0), 1000.0) == 0.0 and displacement(r, 3000.0, (0.0, 0.0, 0.0)).tolist() == [
        0,
        0,
        0,
    ]
    assert displacement(r, 1000.0, (0.1, 0.01, 0.001)) == pytest.approx([0.0, 500 * (0.025 + 0.000625 + 0.000015625), 111.0])


def test_units_of_length_do_not_matter():
    in_px = balancing_change(3000.0, (-0.1, 0.02, 0.0), 2000.0)
    assert balancing_change(3.0, (-0.1, 0.02, 0.0), 2.0) == pytest.approx(in_px / 1000.0)


def test_two_terms_are_the_published_quotient_of_integrals():
    c, k1, k2, radius = 3000.0, -0.1, 0.02, 2000.0
    r = np.linspace(0.0, radius, 200001)
    d = displacement(r, c, (k1, k2, 0.0))
    D1, D2, D3 = (np.trapezoid(value, r) for value in (d * d, d * r, r * r))
    assert balancing_change(c, (k1, k2, 0.0), radius) == pytest.approx(c * (D2 - D1) / (D1 - 2.0 * D2 + D3), rel=1e-6)


def test_a_changed_constant_images_the_same_directions_to_first_order():
    # A direction t is imaged at c (t + distortion); with c + dc the ideal radius is (c + dc) t, and the difference is the curve.
    c, k, change, t = 3000.0, (-0.1, 0.02, 0.003), 1.0, np.linspace(0.0, 0.7, 8)
    observed = c * t + displacement(c * t, c, k)
    expected = observed - (c + change) * t
    assert balanced((c + change) * t, c, k, change) == pytest.approx(expected, abs=0.15)
    assert balanced(c * t, c, k, 0.0) == pytest.approx(displacement(c * t, c, k))
