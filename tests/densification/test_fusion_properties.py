"""Fusion against a plain twin, and what must not change it."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from village_pair import stack_of

from orthomill.schemas.surface import PROVENANCE_CODES, Provenance
from orthomill.tasks.densification.fusion import FusedCells, fuse
from orthomill.tasks.densification.gridding import HeightCells
from orthomill.tasks.densification.settings.surface_settings import Fusion

HEIGHTS = st.lists(st.floats(-50.0, 150.0, allow_subnormal=False), min_size=1, max_size=5)
SIGMAS = st.lists(st.sampled_from([0.05, 0.1, 0.25, 1.0]), min_size=5, max_size=5)


def fused_at(heights, sigmas, rules=None, cell=1.0) -> FusedCells:
    """One cell from heights and standard errors, one each per pair."""
    pairs = tuple(
        HeightCells(np.array([[h]], np.float64), np.array([[s]], np.float32)) for h, s in zip(heights, sigmas, strict=False)
    )
    return fuse(stack_of(*pairs), cell, rules or Fusion())


def values(cells: FusedCells) -> tuple[float, float, int, int]:
    return float(cells.height[0, 0]), float(cells.precision[0, 0]), int(cells.count[0, 0]), int(cells.provenance[0, 0])


def plain_twin(heights, sigmas, rules: Fusion, cell: float) -> tuple[float, float, int, int]:
    """The rule in words: groups of heights that agree with their seed, agreement first, weight second."""
    z, s = np.array(heights, float), np.maximum(np.array(sigmas[: len(heights)], np.float32).astype(float), 1e-4)
    groups = [
        np.abs(z - z[i]) <= np.maximum(rules.agreement * np.sqrt(s[i] ** 2 + s**2), rules.tolerance * cell) for i in range(len(z))
    ]
    weights = [(1 / s[g] ** 2).sum() for g in groups]
    best = max(range(len(z)), key=lambda i: (groups[i].sum() > 1, weights[i], -i))
    g = groups[best]
    mean = np.average(z[g], weights=1 / s[g] ** 2)
    widening = max(1.0, np.sqrt((((z[g] - mean) / s[g]) ** 2).sum() / (g.sum() - 1))) if g.sum() > 1 else 1.0
    agreed = g.sum() > 1 and 2 * g.sum() > len(z)
    code = Provenance.ONE_PAIR if len(z) == 1 else Provenance.AGREED if agreed else Provenance.DISPUTED
    return float(mean), widening / np.sqrt(weights[best]), int(g.sum()), int(code)


@settings(max_examples=60, deadline=None)
@given(HEIGHTS, SIGMAS)
def test_the_kernel_agrees_with_its_plain_twin(heights, sigmas):
    expected = plain_twin(heights, sigmas, Fusion(), 1.0)
    assert values(fused_at(heights, sigmas)) == pytest.approx(expected, rel=1e-5, abs=1e-4)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.integers(-50, 150), min_size=2, max_size=4), SIGMAS)
def test_the_number_of_supporters_does_not_depend_on_the_order_of_pairs(heights, sigmas):
    pairs = list(zip(heights, sigmas, strict=False))
    found = {values(fused_at(*zip(*order, strict=True)))[3] for order in permutations(pairs)}
    assert len(found) == 1


@settings(max_examples=50, deadline=None)
@given(HEIGHTS, SIGMAS, st.integers(-1000, 1000))
def test_a_shift_of_all_heights_shifts_the_result(heights, sigmas, shift):
    before, after = values(fused_at(heights, sigmas)), values(fused_at([h + shift for h in heights], sigmas))
    assert after[0] - shift == pytest.approx(before[0], abs=1e-3)
    assert after[1:] == pytest.approx(before[1:], rel=1e-4)


@settings(max_examples=50, deadline=None)
@given(HEIGHTS, SIGMAS)
def test_the_fused_height_lies_between_the_heights(heights, sigmas):
    height, precision, count, _ = values(fused_at(heights, sigmas))
    assert min(heights) - 1e-4 <= height <= max(heights) + 1e-4
    assert precision > 0 and 1 <= count <= len(heights)


@settings(max_examples=30, deadline=None)
@given(HEIGHTS, SIGMAS)
def test_a_pair_without_a_height_does_not_count(heights, sigmas):
    with_gap = fused_at([np.nan, *heights], [0.1, *sigmas])
    assert values(with_gap) == values(fused_at(heights, sigmas))


def test_a_precise_blunder_does_not_outvote_two_that_agree():
    assert fused_at([80.0, 10.0, 10.1], [0.001, 0.2, 0.2]).height[0, 0] == pytest.approx(10.05)


def test_scatter_beyond_the_standard_errors_widens_the_precision():
    calm, scattered = (values(fused_at(z, [0.1, 0.1, 0.1])) for z in ([5.0, 5.0, 5.0], [5.0, 5.29, 4.71]))
    assert calm[1] == pytest.approx(0.1 / np.sqrt(3), rel=1e-5)
    assert scattered[1] == pytest.approx(calm[1] * 2.9, rel=1e-3)


@pytest.mark.parametrize(("agreement", "code"), [(1.0, Provenance.DISPUTED), (3.0, Provenance.AGREED)])
def test_agreement_is_the_number_of_standard_errors(agreement, code):
    """Heights 0.3 m apart with 0.1 m each differ by 2.1 standard errors of their difference."""
    assert fused_at([5.0, 5.3], [0.1, 0.1], Fusion(agreement=agreement, tolerance=0.0)).provenance[0, 0] == code


@pytest.mark.parametrize(("tolerance", "code"), [(0.1, Provenance.DISPUTED), (0.6, Provenance.AGREED)])
def test_tolerance_is_a_share_of_the_cell(tolerance, code):
    cells = fused_at([5.0, 6.0], [0.01, 0.01], Fusion(tolerance=tolerance), cell=2.0)
    assert cells.provenance[0, 0] == code


def test_every_code_has_a_colour_and_a_meaning():
    assert [code for code, _, _ in PROVENANCE_CODES] == list(Provenance)
    assert len({colour for _, colour, _ in PROVENANCE_CODES}) == len(Provenance)
    assert all(meaning for _, _, meaning in PROVENANCE_CODES)
