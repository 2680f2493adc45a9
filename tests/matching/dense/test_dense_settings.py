"""Every setting of dense matching changes the result in the way it says; the nodes of a plane are where the plane is."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import binary_dilation, gaussian_filter, map_coordinates

from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.dense.blocks import (
    HALO,
    DenseMatching,
    ParallaxRange,
    consistent,
    match_block,
    reduced,
    refined_block,
    start_surface,
)
from orthomill.tasks.matching.dense.epipolar_least_squares import EpipolarLimits, NodeParallaxes, match_nodes
from orthomill.tasks.matching.dense.node_surfaces import StartSurface
from orthomill.tasks.matching.dense.semi_global import SemiGlobal, semi_global

RANGE = ParallaxRange(0, 48)


def pattern(shape: tuple[int, int], seed: int = 3) -> np.ndarray:
    random = np.random.default_rng(seed)
    layers = [gaussian_filter(random.standard_normal(shape), s) * s for s in (1.0, 2.0, 5.0)]
    return (128.0 + 30.0 * sum(layers) / np.std(sum(layers))).astype(np.float32)


def pair_of(parallax: np.ndarray, high: int, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Left image (H, W) and right image (H, W + high) of known parallaxes (H, W): right column = left column + high - parallax."""
    rows, cols = parallax.shape
    right = pattern((rows, cols + high), seed)
    row, col = np.mgrid[0:rows, 0:cols].astype(float)
    return map_coordinates(right, [row, col + high - parallax], order=3, mode="nearest").astype(np.float32), right


def in_range(parallax: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As `pair_of`, for RANGE."""
    return pair_of(parallax, RANGE.high)


def occluded_pair(parallax: np.ndarray, high: int, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """As `pair_of` for integer parallaxes, of which larger ones hide smaller ones in the right image."""
    rows, cols = parallax.shape
    left, right = pattern((rows, cols), seed), pattern((rows, cols + high), seed + 1)
    for level in np.unique(parallax):
        row, col = np.nonzero(parallax == level)
        right[row, col + high - int(level)] = left[row, col]
    return left, right


def with_island(background: float, island: float, side: int, shape: tuple[int, int] = (160, 160)) -> np.ndarray:
    parallax = np.full(shape, background)
    parallax[72 : 72 + side, 72 : 72 + side] = island
    return parallax


@pytest.mark.parametrize("level", [0, 1, 2])
def test_start_level_is_the_level_of_the_start_surface(level):
    found = start_surface(*in_range(np.full((160, 160), 16.0)), RANGE, DenseMatching(start_level=level))
    assert found.factor == 2**level and found.parallax.shape == (160 // 2**level,) * 2
    assert np.nanmedian(found.parallax) == pytest.approx(16.0, abs=2**level / 2)


def test_range_margin_keeps_what_the_coarse_level_missed():
    images = occluded_pair(with_island(8.0, 26.0, 14), RANGE.high)
    centres = []
    for margin in (1, 8):
        found = start_surface(*images, RANGE, DenseMatching(widest_range=16, range_margin=margin))
        centres.append(found.parallax[76:82, 76:82])
    assert not (np.abs(centres[0] - 26.0) < 1.0).any()
    assert (np.abs(centres[1] - 26.0) < 1.0).mean() > 0.5


def stepped_nodes(**changes) -> np.ndarray:
    """Errors of nodes within 3 px of a step of 2 px in parallax, with the true surface as start."""
    parallax = np.where(np.arange(120) < 60, 10.0, 12.0) * np.ones((60, 1))
    left, right = pair_of(parallax, 24)
    rows, cols = np.arange(12, 48, 2), np.array([57, 58, 61, 62])
    limits = DenseMatching(edge_window=9, smoothing=0.0, min_correlation=0.0, **changes).limits
    found = match_nodes(left, right, StartSurface(parallax.astype(np.float32), 1), rows, cols, 24, limits)
    return np.abs(found.parallax - parallax[np.ix_(rows, cols)])


def test_surface_tolerance_keeps_the_other_surface_out_of_the_window():
    narrow, wide = (np.nanmedian(stepped_nodes(surface_tolerance=tolerance)) for tolerance in (0.5, 8.0))
    assert narrow < 0.1 and wide > 2 * narrow


def flat_nodes(parallax: np.ndarray) -> NodeParallaxes:
    shape = parallax.shape
    return NodeParallaxes(
        parallax.astype(np.float32),
        np.full(shape, 0.1, np.float32),
        np.full(shape, 0.9, np.float32),
        np.full(shape, Outcome.CONVERGED, np.uint8),
    )


def test_a_node_that_differs_from_its_neighbours_is_rejected_by_the_tolerance():
    parallax = np.full((7, 7), 20.0)
    parallax[3, 3] = 21.0
    for tolerance, kept in ((1.5, True), (0.5, False)):
        found = consistent(flat_nodes(parallax), DenseMatching(neighbour_tolerance=tolerance))
        assert (found.outcome[2, 2] == Outcome.CONVERGED) == kept
        assert np.isfinite(found.sigma[2, 2]) == kept
        assert (found.outcome == Outcome.INCONSISTENT).sum() == (0 if kept else 1)


@pytest.mark.parametrize("needed", range(5))
def test_a_node_needs_as_many_agreeing_neighbours_as_set(needed):
    parallax = np.full((7, 7), np.nan)
    parallax[3, 2:5] = 20.0
    found = consistent(flat_nodes(parallax), DenseMatching(min_neighbours=needed))
    assert np.isfinite(found.parallax[2, 2]) == (needed <= 2)
    assert np.isfinite(found.parallax[2, 1]) == (needed <= 1)


def test_max_sigma_is_the_largest_standard_error_of_a_node():
    nodes = flat_nodes(np.full((7, 7), 20.0))
    nodes.sigma[3, 3] = 0.4
    assert np.isfinite(consistent(nodes, DenseMatching(max_sigma=0.5)).parallax[2, 2])
    refused = consistent(nodes, DenseMatching(max_sigma=0.3))
    assert refused.outcome[2, 2] == Outcome.IMPRECISE and np.isnan(refused.parallax[2, 2])


def census_match(images: tuple[np.ndarray, np.ndarray], **changes) -> np.ndarray:
    """Parallaxes that semi-global matching finds among 0 to 31 px."""
    return semi_global(*images, SemiGlobal(**changes))


def test_a_small_penalty_that_is_too_high_turns_slopes_into_steps():
    slope = np.minimum(4.0 + np.arange(100) / 3.0, 28.0) * np.ones((60, 1))
    images, part = pair_of(slope, 31), (slice(10, -10), slice(10, 70))
    usual, high = (census_match(images, small_penalty=penalty, large_penalty=400, speckle=0)[part] for penalty in (8, 200))
    assert (np.abs(usual - slope[part]) < 1.0).mean() > 0.95
    assert (np.abs(high - slope[part]) < 1.0).mean() < 0.87


def test_a_large_penalty_that_is_too_high_loses_narrow_surfaces():
    images = occluded_pair(np.where((np.arange(100) >= 48) & (np.arange(100) < 54), 14.0, 6.0) * np.ones((60, 1)), 31)
    low, high = (census_match(images, large_penalty=penalty, speckle=0)[10:-10, 49:53] for penalty in (20, 400))
    assert (np.abs(low - 14.0) < 1.0).mean() > 0.9
    assert (np.abs(high - 14.0) < 1.0).mean() < 0.2


def test_patches_below_the_speckle_size_are_removed():
    images, inside = occluded_pair(with_island(6.0, 16.0, 12, (110, 110)), 31), (slice(76, 80), slice(76, 80))
    kept, removed = (census_match(images, speckle=size)[inside] for size in (30, 400))
    assert (kept == 16.0).all() and np.isnan(removed).all()


def test_tolerance_is_the_difference_of_the_views_that_is_allowed():
    slope = 4.0 + np.arange(100) / 5.0 * np.ones((60, 1))
    images = pair_of(slope, 31)
    strict, loose = (np.isfinite(census_match(images, tolerance=limit, speckle=0)).mean() for limit in (0, 3))
    assert loose > strict


@settings(max_examples=15, deadline=None)
@given(level=st.floats(6.0, 14.0), along=st.floats(-0.15, 0.15), across=st.floats(-0.15, 0.15))
def test_nodes_of_a_plane_lie_on_the_plane(level, along, across):
    row, col = np.mgrid[0:48, 0:64].astype(float)
    plane = level + along * (col - 32) + across * (row - 24)
    left, right = pair_of(plane, 32)
    rows, cols = np.arange(16, 34, 3), np.arange(24, 42, 3)
    limits = DenseMatching(smoothing=0.0).limits
    found = match_nodes(left, right, StartSurface(np.rint(plane).astype(np.float32), 1), rows, cols, 32, limits)
    error = np.abs(found.parallax - plane[np.ix_(rows, cols)])
    assert np.isfinite(error).mean() > 0.95 and np.nanmax(error) < 0.1


def test_gain_and_offset_do_not_move_the_nodes():
    left, right = pair_of(np.full((48, 64), 9.0), 32)
    start, rows, cols = StartSurface(np.full((48, 64), 9.0, np.float32), 1), np.arange(16, 34), np.arange(24, 42)
    limits = DenseMatching(smoothing=0.0).limits
    plain, darker = (match_nodes(left, grey, start, rows, cols, 32, limits) for grey in (right, 0.5 * right + np.float32(30.0)))
    assert np.nanmax(np.abs(plain.parallax - darker.parallax)) < 1e-3
    assert np.nanmax(np.abs(plain.correlation - darker.correlation)) < 1e-3


@pytest.mark.parametrize(
    ("changes", "outcome"),
    [
        ({"min_gradient": 1e3}, Outcome.LOW_TEXTURE),
        ({"max_shift": 1e-9}, Outcome.MOVED_TOO_FAR),
        ({"min_correlation": 1.1}, Outcome.LOW_CORRELATION),
        ({"min_support": 1.1}, Outcome.NOT_TRIED),
    ],
)
def test_every_limit_has_its_outcome(changes, outcome):
    left, right = pair_of(np.full((48, 64), 9.3), 32)
    limits: EpipolarLimits = DenseMatching(smoothing=0.0).limits._replace(**changes)
    start = StartSurface(np.full((48, 64), 9.0, np.float32), 1)
    found = match_nodes(left, right, start, np.array([20, 24]), np.array([30, 34]), 32, limits)
    assert (found.outcome == outcome).all() and np.isnan(found.parallax).all() and np.isnan(found.sigma).all()


def test_a_reduced_level_holds_means_and_gaps():
    grey = np.arange(30, dtype=np.float32).reshape(5, 6)
    grey[0, 5] = np.nan
    level = reduced(grey, 1)
    assert level.shape == (2, 3) and level[1, 0] == grey[2:4, :2].mean() and np.isnan(level[0, 2])


def test_a_match_does_not_depend_on_where_nodes_without_data_lie():
    """A gap changes the nodes whose windows touch it, and no others beyond the reach of semi-global matching."""
    grey = [np.clip(image, 1, 255).astype(np.uint8) for image in in_range(np.full((192, 192), 20.0))]
    holed = grey[0].copy()
    holed[HALO + 20 : HALO + 30, HALO + 20 : HALO + 30] = 0
    whole, gapped = (match_block(left, grey[1], RANGE, DenseMatching(step=1)).nodes for left in (grey[0], holed))
    hole = np.zeros(whole.parallax.shape, bool)
    hole[20:30, 20:30] = True
    assert (gapped.outcome[hole] == Outcome.OUTSIDE).all() and np.isfinite(whole.parallax[hole]).mean() > 0.9
    far = ~binary_dilation(hole, iterations=12)
    assert np.nanmedian(np.abs(gapped.parallax - whole.parallax)[far]) < 0.01


def block_of(parallax: np.ndarray) -> list[np.ndarray]:
    """Both grey images of a block whose true parallaxes are given, as they are read."""
    return [np.clip(np.rint(image), 1, 255).astype(np.uint8) for image in in_range(parallax)]


def test_a_given_start_is_refined_to_the_surface_and_unknown_places_are_not_tried():
    rows, cols = np.mgrid[0:192, 0:192].astype(float)
    truth = 20.0 + 0.02 * cols + 3.0 * (cols > 110)
    given = truth + 0.6 * np.sin(rows / 9.0)
    given[:, : HALO + 20] = np.nan
    start = StartSurface(given[::2, ::2].astype(np.float32), 2)
    found = refined_block(*block_of(truth), start, RANGE, DenseMatching())
    error = found.nodes.parallax - truth[HALO:-HALO:2, HALO:-HALO:2]
    assert (found.nodes.outcome[:, :4] == Outcome.NOT_TRIED).all()
    assert np.isfinite(error[:, 14:]).mean() > 0.9 and np.nanmedian(np.abs(error)) < 0.05
    assert abs(found.y_parallax) < 0.05


def test_a_start_without_any_parallax_gives_a_block_without_nodes():
    start = StartSurface(np.full((96, 96), np.nan, np.float32), 2)
    found = refined_block(*block_of(np.full((192, 192), 20.0)), start, RANGE, DenseMatching())
    assert (found.nodes.outcome == Outcome.NOT_TRIED).all() and np.isnan(found.y_parallax)
