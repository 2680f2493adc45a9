"""The kernels of dense least squares against plain NumPy: planes of nodes, the warped right image, the solution of a window."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter, map_coordinates

from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.dense.blocks import limits_of
from orthomill.tasks.matching.dense.dense_settings import DenseMatching
from orthomill.tasks.matching.dense.epipolar_least_squares import match_nodes
from orthomill.tasks.matching.dense.node_surfaces import (
    NodeLattice,
    StartSurface,
    finer_planes,
    smoothed_planes,
    start_planes,
    start_values,
)
from orthomill.tasks.matching.dense.surface_warp import LANES, WarpedPair, warp
from orthomill.tasks.matching.dense.window_solution import (
    ASIDE,
    CORRECTION,
    CORRELATION,
    KERNEL,
    SLOPE_X,
    SLOPE_Y,
    SPREAD,
    STRENGTH,
    SUPPORT,
    VARIANCE,
    correlated_pairs,
    correlation_factor,
    cut_block,
    lay_out,
    scratch_for,
    solved,
)

LATTICE = NodeLattice(0, 0, 24, 30, 2)
HALF = 6


def sloping(level: float, along: float, across: float, lattice: NodeLattice = LATTICE) -> np.ndarray:
    """Parallaxes (rows, cols) of a plane at the nodes."""
    rows, cols = lattice.pixels
    return (level + along * cols + across * rows[:, None]).astype(np.float32)


@settings(max_examples=25, deadline=None)
@given(level=st.floats(-20, 20), along=st.floats(-0.15, 0.15), across=st.floats(-0.15, 0.15), factor=st.sampled_from([1, 2]))
def test_start_planes_of_a_plane_lie_on_it(level, along, across, factor):
    row, col = np.mgrid[0 : 48 // factor, 0 : 60 // factor] * factor + 0.5 * (factor - 1)
    start = StartSurface((level + along * col + across * row).astype(np.float32), factor)
    planes = start_planes(start, LATTICE, HALF, 1.0)[4:-4, 4:-4]
    assert np.abs(planes[..., 0] - sloping(level, along, across)[4:-4, 4:-4]).max() < 1e-2
    # The ridge draws slopes towards zero: by 0.06 against the variance of the coordinates, 4 squared spacings.
    assert np.allclose(planes[..., 1:], np.array([along, across]) * 4.0 / 4.06, atol=1e-3)


def test_a_plane_keeps_the_roof_and_drops_the_ground():
    start = np.where(np.arange(60) < 30, 10.0, 18.0) * np.ones((48, 1))
    planes = start_planes(StartSurface(start.astype(np.float32), 1), LATTICE, HALF, 1.0)
    assert np.allclose(planes[..., 0], start_values(StartSurface(start.astype(np.float32), 1), LATTICE), atol=1e-4)
    assert np.allclose(planes[..., 1:], 0.0, atol=1e-4)


def test_a_speck_and_a_gap_take_the_level_of_their_surroundings():
    start = np.full((48, 60), np.float32(10.0))
    start[24:26, 30:32] = 17.0
    start[8:12, 8:12] = np.nan
    planes = start_planes(StartSurface(start, 1), LATTICE, HALF, 1.0)
    assert np.allclose(planes[..., 0], 10.0, atol=1e-4)


def test_nodes_far_from_any_known_parallax_have_no_plane():
    start = np.full((48, 60), np.float32(10.0))
    start[:, 20:] = np.nan
    planes = start_planes(StartSurface(start, 1), LATTICE, HALF, 1.0)
    assert np.isfinite(planes[:, :13, 0]).all() and np.isnan(planes[:, 14:, 0]).all()


def test_only_the_wanted_nodes_get_a_plane():
    wanted = np.zeros(LATTICE.shape, bool)
    wanted[5, 7] = True
    planes = start_planes(StartSurface(np.full((48, 60), np.float32(3.0)), 1), LATTICE, HALF, 1.0, wanted)
    assert np.array_equal(np.isfinite(planes[..., 0]), wanted)


def test_values_outside_the_start_are_unknown():
    start = StartSurface(np.arange(12, dtype=np.float32).reshape(3, 4), 4)
    values = start_values(start, NodeLattice(-2, -2, 8, 10, 2))
    for i, j in np.ndindex(values.shape):
        row, col = (-2 + 2 * i) // 4, (-2 + 2 * j) // 4
        inside = 0 <= row < 3 and 0 <= col < 4
        assert values[i, j] == start.parallax[row, col] if inside else np.isnan(values[i, j])


def plain_plane(values: np.ndarray, weights: np.ndarray, at: tuple[int, int], plane: np.ndarray) -> np.ndarray:
    """The weighted plane through what lies within two nodes and 1 px of a plane, with the ridge that slopes are damped by."""
    reach, step = 2, 4
    spans = (np.arange(max(c - reach, 0), min(c + reach + 1, n)) for c, n in zip(at, values.shape, strict=True))
    i, j = np.meshgrid(*spans, indexing="ij")
    x, y = (j - at[1]) * float(step), (i - at[0]) * float(step)
    near = np.abs(values[i, j] - plane[0] - plane[1] * x - plane[2] * y) <= 1.0
    x, y, value, weight = x[near], y[near], values[i, j][near].astype(float), weights[i, j][near].astype(float)
    mean = np.array([np.average(array, weights=weight) for array in (x, y, value)])
    dx, dy, dv = x - mean[0], y - mean[1], value - mean[2]
    normal = np.array([[np.average(a * b, weights=weight) for b in (dx, dy)] for a in (dx, dy)]) + 0.06 * step**2 * np.eye(2)
    slopes = np.linalg.solve(normal, [np.average(a * dv, weights=weight) for a in (dx, dy)])
    return np.array([mean[2] - slopes @ mean[:2], *slopes])


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 999))
def test_smoothed_planes_agree_with_their_twin(seed):
    random = np.random.default_rng(seed)
    planes = np.zeros((12, 14, 3), np.float32)
    planes[..., 0] = 5.0 + random.normal(0, 0.2, (12, 14))
    planes[..., 1:] = random.normal(0, 0.02, (12, 14, 2))
    weights = random.uniform(0.1, 10.0, (12, 14)).astype(np.float32)
    out = smoothed_planes(planes, weights, NodeLattice(0, 0, 12, 14, 4), 7, 1.0)
    for at in ((1, 1), (5, 6), (10, 9)):
        assert np.allclose(out[at], plain_plane(planes[..., 0], weights, at, planes[at]), atol=2e-4)


def test_finer_planes_are_those_of_the_nearest_node_carried_to_their_place():
    coarse = LATTICE.thinned(2)
    planes = np.stack([sloping(3.0, 0.1, -0.05, coarse), *(np.full(coarse.shape, s, np.float32) for s in (0.1, -0.05))], axis=-1)
    assert np.allclose(finer_planes(planes, coarse, LATTICE)[..., 0], sloping(3.0, 0.1, -0.05), atol=1e-4)


def textured(shape: tuple[int, int], seed: int = 5) -> np.ndarray:
    return (120.0 + 40.0 * gaussian_filter(np.random.default_rng(seed).standard_normal(shape), 1.2) / 0.23).astype(np.float32)


def seen(change: Callable[[np.ndarray, np.ndarray], np.ndarray], margin: int = 10) -> tuple[WarpedPair, np.ndarray, np.ndarray]:
    """A warped pair whose planes are level at 12 px, while the true parallax is 12 px + change(row, col); left and right image."""
    right = textured((60, 90))
    row, col = np.mgrid[0:60, 0:70].astype(float)
    left = map_coordinates(right, [row, col + 18 - 12 - change(row, col)], order=3, mode="nearest").astype(np.float32)
    lattice = NodeLattice(0, 0, 30, 35, 2)
    pair = WarpedPair.of(left, margin)
    warp(pair, right, 18, lattice, np.full((30, 35, 3), [12.0, 0.0, 0.0], np.float32))
    return pair, left, right


def image_of(pair: WarpedPair, flat: np.ndarray) -> np.ndarray:
    m = pair.margin
    return flat.reshape(-1, pair.cols)[m:-m, m : -m - LANES]


def test_the_warped_image_is_the_right_one_at_the_parallax_of_the_nearest_node():
    left, right, lattice = textured((40, 50)), textured((40, 80), 6), NodeLattice(-2, -2, 22, 27, 2)
    planes = np.stack([sloping(9.3, 0.03, 0.02, lattice), *(np.full(lattice.shape, s, np.float32) for s in (0.03, 0.02))], axis=-1)
    pair = WarpedPair.of(left, 6)
    warp(pair, right, 20, lattice, planes)
    row, col = np.mgrid[0:40, 0:50].astype(float)
    parallax = 9.3 + 0.03 * col + 0.02 * row
    inside = slice(2, -2), slice(2, -2)
    assert np.allclose(image_of(pair, pair.field)[inside], parallax[inside], atol=1e-3)
    at = col + 20 - parallax
    k, f = np.floor(at).astype(int), at - np.floor(at)
    w = (-0.5 * f + f**2 - 0.5 * f**3, 1 - 2.5 * f**2 + 1.5 * f**3, 0.5 * f + 2 * f**2 - 1.5 * f**3, -0.5 * f**2 + 0.5 * f**3)
    plain = sum(w[n] * right[row.astype(int), np.clip(k - 1 + n, 0, 79)] for n in range(4))
    assert np.allclose(image_of(pair, pair.warped)[inside], plain[inside], atol=0.05)
    assert np.allclose(image_of(pair, pair.gradient)[inside], 0.5 * (left[2:-2, 3:-1] - left[2:-2, 1:-3]), atol=1e-4)


def test_what_lacks_data_in_either_image_is_unknown():
    left, right = textured((40, 50)), textured((40, 80), 6)
    left[10, 20], right[30, 40] = np.nan, np.nan
    lattice = NodeLattice(0, 0, 20, 25, 2)
    pair = WarpedPair.of(left, 6)
    warp(pair, right, 20, lattice, np.full((20, 25, 3), [10.0, 0.0, 0.0], np.float32))
    unknown = np.isnan(image_of(pair, pair.field))
    assert unknown[10, 19:22].all() and not unknown[10, 22:25].any()
    # Four columns of the right image decide a place: column 30 of the left one lies at column 40.
    assert unknown[30, 28:32].all() and not unknown[30, 33:36].any()


def solution_of(pair: WarpedPair, row: int, col: int, half: int, flat: bool = False) -> tuple[np.ndarray, Outcome]:
    scratch, out = scratch_for(half), np.full(10, np.nan)
    centre = (row + pair.margin) * pair.cols + col + pair.margin
    plane = np.array([12.0, 0.0, 0.0])
    lay_out(half, scratch.block)
    size = cut_block(pair, centre, half, plane, 1.0, flat, scratch.block)
    return out, Outcome(solved(scratch, half, size, (0.0, 0.0), 0.0, out))


def plain_solution(pair: WarpedPair, row: int, col: int, half: int) -> tuple[float, float, float]:
    """Correction of the parallax, its variance, and the variance from the scores, as five unknowns in one system."""
    part = slice(row - half, row + half + 1), slice(col - half, col + half + 1)
    left, warped, g = (image_of(pair, flat)[part].astype(float) for flat in (pair.left, pair.warped, pair.gradient))
    y, x = np.mgrid[-half : half + 1, -half : half + 1].astype(float)
    design = np.stack([np.ones_like(g), left, g, g * x, g * y], axis=-1).reshape(-1, 5)
    own, other = left - left.mean(), warped - warped.mean()
    gain = (own * other).sum() / (own * own).sum()
    prior = (((other * other).sum() - gain * (own * other).sum()) / g.size + 0.3) / (gain * 0.05) ** 2
    normal = design.T @ design + np.diag([0, 0, 0, prior, prior])
    unknowns = np.linalg.solve(normal, design.T @ warped.ravel())
    cofactor = np.linalg.inv(normal)[2, 2]
    power = warped.ravel() @ warped.ravel() - unknowns @ design.T @ warped.ravel()
    scores = (g - g.mean()) * (warped.ravel() - design @ unknowns).reshape(g.shape)
    side = 2 * half + 1
    cuts = [k * side // 3 for k in range(4)]
    parts = [scores[a:b, c:d].sum() for a, b in pairwise(cuts) for c, d in pairwise(cuts)]
    scale = 1.0 / unknowns[1] ** 2
    return unknowns[2] / unknowns[1], power / (g.size - 5) * cofactor * scale, 1.5 * np.square(parts).sum() * cofactor**2 * scale


@pytest.mark.parametrize("half", [2, 4, 7, 9])
def test_a_window_is_solved_as_its_twin_solves_it(half):
    pair, _, _ = seen(lambda row, col: 0.2 + 0.02 * np.sin(row / 3.0) * np.cos(col / 4.0))
    noisy = image_of(pair, pair.warped)
    noisy += np.random.default_rng(2).normal(0, 2.0, noisy.shape).astype(np.float32)
    found, outcome = solution_of(pair, 30, 36, half)
    correction, variance, spread = plain_solution(pair, 30, 36, half)
    assert outcome == Outcome.CONVERGED and found[SUPPORT] == (2 * half + 1) ** 2
    assert found[CORRECTION] == pytest.approx(correction, abs=1e-4)
    assert found[VARIANCE] == pytest.approx(variance, rel=1e-2) and found[SPREAD] == pytest.approx(spread, rel=1e-2)


@settings(max_examples=20, deadline=None)
@given(shift=st.floats(-0.3, 0.3), along=st.floats(-0.02, 0.02), across=st.floats(-0.02, 0.02))
def test_a_correction_is_the_parallax_that_the_plane_lacks(shift, along, across):
    pair, _, _ = seen(lambda row, col: shift + along * (col - 36) + across * (row - 30))
    found, _ = solution_of(pair, 30, 36, 7)
    assert found[CORRECTION] == pytest.approx(shift, abs=0.02 + 0.2 * abs(shift))
    assert found[SLOPE_X] == pytest.approx(along, abs=0.012) and found[SLOPE_Y] == pytest.approx(across, abs=0.012)
    assert found[CORRELATION] > 0.95 and found[STRENGTH] > 5.0


def test_a_bending_surface_shows_in_the_scores_and_not_in_the_noise():
    bent, _, _ = seen(lambda row, col: 0.012 * (col - 36) ** 2)
    plane, _, _ = seen(lambda row, col: np.zeros_like(row))
    ratios = []
    for pair in (bent, plane):
        grey = image_of(pair, pair.warped)
        grey += np.random.default_rng(4).normal(0, 1.0, grey.shape).astype(np.float32)
        found, _ = solution_of(pair, 30, 36, 7)
        ratios.append(found[SPREAD] / found[VARIANCE])
    assert ratios[0] > 4.0 > 2.5 > ratios[1]


def test_pixels_of_another_surface_take_no_part():
    pair, _, _ = seen(lambda row, col: np.zeros_like(row))
    image_of(pair, pair.field)[:, 40:] = 17.0
    image_of(pair, pair.warped)[:, 40:] = 0.0
    found, _ = solution_of(pair, 30, 36, 7)
    assert found[SUPPORT] == 15 * 11 and found[CORRECTION] == pytest.approx(0.0, abs=0.01)


def test_corrections_count_from_the_plane_where_the_field_is_not_smooth_enough():
    pair, _, _ = seen(lambda row, col: np.full_like(row, 0.25))
    lattice = NodeLattice(0, 0, 30, 35, 2)
    warp(pair, textured((60, 90)), 18, lattice, np.full((30, 35, 3), [12.25, 0.0, 0.0], np.float32))
    # The field already holds the quarter of a pixel that the plane lacks.
    assert solution_of(pair, 30, 36, 9)[0][CORRECTION] == pytest.approx(0.0, abs=0.03)
    assert solution_of(pair, 30, 36, 9, flat=True)[0][CORRECTION] == pytest.approx(0.25, abs=0.03)


def test_texture_on_one_side_of_a_window_lies_aside():
    pair, _, _ = seen(lambda row, col: np.zeros_like(row))
    assert solution_of(pair, 30, 36, 7)[0][ASIDE] < 2.0
    image_of(pair, pair.gradient)[:, :40] = 0.0
    assert solution_of(pair, 30, 36, 7)[0][ASIDE] > 4.0


@pytest.mark.parametrize(
    ("spoil", "outcome"),
    [
        (lambda pair: pair.field.fill(np.nan), Outcome.NOT_TRIED),
        (lambda pair: pair.warped.fill(50.0), Outcome.LOW_TEXTURE),
        (lambda pair: np.negative(pair.warped, out=pair.warped), Outcome.LOW_CORRELATION),
    ],
)
def test_a_window_that_cannot_be_solved_says_why(spoil, outcome):
    pair, _, _ = seen(lambda row, col: np.zeros_like(row))
    spoil(pair)
    assert solution_of(pair, 30, 36, 7)[1] == outcome


def test_correlated_residuals_count_as_their_twin_says():
    g = np.random.default_rng(3).normal(size=(15, 16)).astype(np.float32)
    g[:, 15] = 0.0
    near, far = 0.37, 0.02
    padded, upper = np.pad(g.astype(float), ((0, 0), (0, 3))), 13
    here = padded[:upper, :16]
    along = [(here * padded[dy : upper + dy, dx : 16 + dx]).sum() for dy, dx in ((0, 1), (1, 0))]
    diagonal = (here * padded[1 : upper + 1, 1:17]).sum() + (padded[:upper, 1:17] * padded[1 : upper + 1, :16]).sum()
    two = (here * padded[:upper, 2:18]).sum() + (here * padded[2 : upper + 2, :16]).sum()
    expected = 1 + 2 * (near * sum(along) + near**2 * diagonal + far * two) / (here**2).sum()
    factor, alike = correlation_factor(correlated_pairs(g.ravel(), g.size, 16, near, far))
    assert factor == pytest.approx(max(expected, 0.3), rel=0.03) and alike == pytest.approx(along[0] / (here**2).sum(), abs=0.01)


@pytest.mark.parametrize("frequency", [0.06, 0.1, 0.15])
def test_interpolation_alone_gives_the_standard_error_of_a_pair_without_noise(frequency):
    # Without noise what the cubic kernel moves is all that is wrong: a wave of texture at all places between pixels.
    col = np.arange(90.0)
    phase = 2 * np.pi * np.arange(60)[:, None] * 0.618
    errors, sigma = [], 0.0
    for shift in np.linspace(0.05, 0.95, 10):
        right = (120.0 + 40.0 * np.cos(2 * np.pi * frequency * col + phase)).astype(np.float32)
        left = (120.0 + 40.0 * np.cos(2 * np.pi * frequency * (col[:70] + 6.0 + shift) + phase)).astype(np.float32)
        pair = WarpedPair.of(left, 10)
        warp(pair, right, 18, NodeLattice(0, 0, 30, 35, 2), np.full((30, 35, 3), [12.0 - shift, 0.0, 0.0], np.float32))
        found, outcome = solution_of(pair, 30, 36, 7)
        assert outcome == Outcome.CONVERGED
        errors.append(found[CORRECTION])
        sigma = np.sqrt(found[KERNEL])
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(sigma, rel=0.3)


def test_nodes_that_cannot_succeed_say_so():
    right = textured((60, 90))
    left = right[:, 6:76].copy()
    # On the left another texture, on the right nothing that the right image shows.
    left[:, :30] = textured((60, 30), 9)
    start, rows, cols = StartSurface(np.full((60, 70), 12.0, np.float32), 1), np.arange(10, 50, 2), np.arange(10, 66, 2)
    nodes = match_nodes(left, right[:, :56].copy(), start, rows, cols, 18, limits_of(DenseMatching()))
    assert (nodes.outcome[:, cols < 20] == Outcome.LOW_CORRELATION).mean() > 0.9
    assert (nodes.outcome[:, (cols > 38) & (cols < 44)] == Outcome.CONVERGED).all()
    assert (nodes.outcome[:, cols > 60] == Outcome.OUTSIDE).all()
