"""Every setting of dense matching changes the result in the way it says; the nodes of a plane are where the plane is."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import binary_dilation, gaussian_filter, map_coordinates

from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.dense.blocks import HALO, ParallaxRange, consistent, limits_of, reduced, refined_block
from orthomill.tasks.matching.dense.dense_settings import DenseMatching
from orthomill.tasks.matching.dense.epipolar_least_squares import EpipolarLimits, NodeParallaxes, match_nodes, stated_variance
from orthomill.tasks.matching.dense.node_surfaces import StartSurface

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


def stepped_nodes(**changes) -> np.ndarray:
    """Errors of nodes within 3 px of a step of 2 px in parallax, with the true surface as start."""
    parallax = np.where(np.arange(120) < 60, 10.0, 12.0) * np.ones((60, 1))
    left, right = pair_of(parallax, 24)
    rows, cols = np.arange(12, 48, 2), np.array([57, 58, 61, 62])
    limits = limits_of(DenseMatching(edge_window=9, smoothing=0.0, min_correlation=0.0, **changes))
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


@settings(max_examples=15, deadline=None)
@given(level=st.floats(6.0, 14.0), along=st.floats(-0.15, 0.15), across=st.floats(-0.15, 0.15))
def test_nodes_of_a_plane_lie_on_the_plane(level, along, across):
    row, col = np.mgrid[0:48, 0:64].astype(float)
    plane = level + along * (col - 32) + across * (row - 24)
    left, right = pair_of(plane, 32)
    rows, cols = np.arange(16, 34, 3), np.arange(24, 42, 3)
    limits = limits_of(DenseMatching(smoothing=0.0))
    found = match_nodes(left, right, StartSurface(np.rint(plane).astype(np.float32), 1), rows, cols, 32, limits)
    error = np.abs(found.parallax - plane[np.ix_(rows, cols)])
    assert np.isfinite(error).mean() > 0.95 and np.nanmax(error) < 0.1


def test_gain_and_offset_do_not_move_the_nodes():
    left, right = pair_of(np.full((48, 64), 9.0), 32)
    start, rows, cols = StartSurface(np.full((48, 64), 9.0, np.float32), 1), np.arange(16, 34), np.arange(24, 42)
    limits = limits_of(DenseMatching(smoothing=0.0))
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
    limits: EpipolarLimits = limits_of(DenseMatching(smoothing=0.0))._replace(**changes)
    start = StartSurface(np.full((48, 64), 9.0, np.float32), 1)
    found = match_nodes(left, right, start, np.array([20, 24]), np.array([30, 34]), 32, limits)
    assert (found.outcome == outcome).all() and np.isnan(found.parallax).all() and np.isnan(found.sigma).all()


def test_a_reduced_level_holds_means_and_gaps():
    grey = np.arange(30, dtype=np.float32).reshape(5, 6)
    grey[0, 5] = np.nan
    level = reduced(grey, 1)
    assert level.shape == (2, 3) and level[1, 0] == grey[2:4, :2].mean() and np.isnan(level[0, 2])


def test_a_match_does_not_depend_on_where_nodes_without_data_lie():
    """A gap changes the nodes whose windows or planes touch it, and no others."""
    grey = [np.clip(image, 1, 255).astype(np.uint8) for image in in_range(np.full((192, 192), 20.0))]
    holed = grey[0].copy()
    holed[HALO + 20 : HALO + 30, HALO + 20 : HALO + 30] = 0
    start = StartSurface(np.full((192, 192), 20.0, np.float32), 1)
    whole, gapped = (refined_block(left, grey[1], start, RANGE, DenseMatching(step=1)).nodes for left in (grey[0], holed))
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


def bent_nodes(**changes) -> NodeParallaxes:
    """Nodes of a surface that bends, from a start that has its rough shape."""
    truth = (12.0 + 2.0 * np.sin(np.arange(140) / 6.0)) * np.ones((96, 1))
    left, right = pair_of(truth, 32)
    limits = limits_of(DenseMatching(smoothing=0.0, **changes))
    rows, cols = np.arange(24, 72, 2), np.arange(30, 110, 2)
    found = match_nodes(left, right, StartSurface(truth.astype(np.float32), 1), rows, cols, 32, limits)
    return found._replace(parallax=found.parallax - truth[np.ix_(rows, cols)].astype(np.float32))


def test_the_small_window_serves_where_the_surface_bends():
    small, none = (bent_nodes(small_window=side, edge_window=5).parallax for side in (7, 15))
    assert np.nanpercentile(np.abs(small), 90) < np.nanpercentile(np.abs(none), 90)


def weak_nodes(**changes) -> NodeParallaxes:
    """Nodes of a level surface of weak texture under noise."""
    left, right = pair_of(np.full((120, 140), 12.0), 32)
    random = np.random.default_rng(8)
    left, right = (
        (128.0 + 0.12 * (image - 128.0) + random.normal(0, 2.0, image.shape)).astype(np.float32) for image in (left, right)
    )
    limits = limits_of(DenseMatching(smoothing=0.0, min_gradient=0.0, min_correlation=0.0, **changes))
    start = StartSurface(np.full((120, 140), 12.0, np.float32), 1)
    return match_nodes(left, right, start, np.arange(40, 80, 2), np.arange(40, 100, 2), 32, limits)


def test_weak_texture_is_matched_with_the_wide_window():
    wide, none = weak_nodes(), weak_nodes(wide_window=15)
    assert np.nanmedian(wide.sigma) < np.nanmedian(none.sigma)
    assert np.nanstd(wide.parallax) < np.nanstd(none.parallax)


def test_weak_sigma_says_what_weak_is():
    strict, lax = weak_nodes(weak_sigma=0.01), weak_nodes(weak_sigma=5.0)
    assert np.nanstd(strict.parallax) < np.nanstd(lax.parallax)
    assert np.array_equal(lax.parallax, weak_nodes(wide_window=15, weak_sigma=5.0).parallax, equal_nan=True)


def test_the_window_is_as_large_as_it_is_set():
    small, large = (weak_nodes(window=side, small_window=5, wide_window=31, weak_sigma=5.0) for side in (9, 21))
    assert np.nanstd(large.parallax) < np.nanstd(small.parallax)


NOISE, PHOTOGRAPH = np.full(100, 0.8), np.full(100, 1.7)


@pytest.mark.parametrize(("moved", "more"), [(0.05, 0.0), (0.3, 0.29), (3.0, 0.45)])
def test_a_node_that_leaves_its_start_is_less_sure_up_to_a_limit(moved, more):
    near, far = (stated_variance(np.array([0.01]), np.array([distance]), NOISE)[0] for distance in (0.0, moved))
    assert np.sqrt(far - near) == pytest.approx(more, abs=0.01)


@pytest.mark.parametrize(("misfit", "sigma"), [(NOISE, 0.1), (PHOTOGRAPH, 0.1616), (PHOTOGRAPH[:10], 0.1616), (NOISE[:10], 0.1616)])
def test_images_with_more_than_noise_have_larger_standard_errors(misfit, sigma):
    assert np.sqrt(stated_variance(np.array([0.01]), np.zeros(1), misfit)) == pytest.approx([sigma], abs=1e-3)


def test_the_noise_of_a_rough_start_does_not_count():
    moved = np.random.default_rng(1).normal(0.0, 0.3, 2000)
    assert np.median(stated_variance(np.full(2000, 0.01), moved, NOISE)) == pytest.approx(0.01, rel=0.05)
