"""Dense matching of a rendered village with known parallaxes; semi-global matching against its plain twin and on real stereo."""

from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage
from village_pair import normal_case, render, village

from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import Window
from orthomill.tasks.matching.dense.blocks import (
    BLOCK,
    HALO,
    DenseMatching,
    ParallaxRange,
    left_window,
    match_block,
    moved_rows,
    placed,
    right_window,
    scratch_bytes,
)
from orthomill.tasks.matching.dense.semi_global import SemiGlobal, _costs, census, remove_specks, semi_global
from orthomill.tasks.matching.smoothing import with_gaps
from orthomill.tasks.matching.volume.paths import sweep

CONES = Path(__file__).parents[4] / "shared" / "data" / "cones"


@pytest.fixture(scope="module")
def rendered():
    scene, pair = village(760, 14, seed=8), normal_case(760)
    return render(scene, pair)


def match(rendered, core, matching, right_rows=0.0):
    """Nodes of a block, their true column parallaxes, and the block's match."""
    pair = rendered.pair
    offset = pair.left_col0 - pair.right_col0
    parallaxes = ParallaxRange.around(pair.parallax_low + offset, pair.parallax_high + offset)
    right_image = rendered.right
    if right_rows:
        moved = ndimage.shift(right_image.astype(float), (right_rows, 0), order=3, mode="nearest")
        right_image = moved.clip(1, 255).astype(np.uint8)
    wanted = left_window(core), right_window(core, parallaxes)
    read = [w.clipped(image.shape) for w, image in zip(wanted, (rendered.left, right_image), strict=True)]
    blocks = [placed(image[r.slices], r, w) for image, r, w in zip((rendered.left, right_image), read, wanted, strict=True)]
    return match_block(*blocks, parallaxes, matching), core, offset


def errors(rendered, result, step):
    found, core, offset = result
    truth = rendered.parallax[core.slices][::step, ::step] + offset
    return found.nodes.parallax[: truth.shape[0], : truth.shape[1]] - truth


@pytest.fixture(scope="module")
def matched(rendered):
    return match(rendered, Window(BLOCK, 0, BLOCK, BLOCK), DenseMatching())


def test_ground_and_roofs_are_found(rendered, matched):
    step = DenseMatching().step
    error, core = errors(rendered, matched, step), matched[1]
    roof, wall = rendered.roof[core.slices][::step, ::step], rendered.wall[core.slices][::step, ::step]
    blank, col = rendered.blank[core.slices][::step, ::step], np.arange(0, BLOCK, step)[None, :]
    open_ground = ~ndimage.binary_dilation(roof | wall | blank, iterations=14) & (col > 60)
    good = np.isfinite(error)
    assert good[open_ground].mean() > 0.95
    assert 1.4826 * np.median(np.abs(error[open_ground & good])) < 0.2
    assert abs(np.median(error[open_ground & good])) < 0.02
    assert (np.abs(error[open_ground & good]) > 1.0).mean() < 0.01
    core_of_roof = ndimage.binary_erosion(roof, iterations=2) & good
    assert np.median(np.abs(error[core_of_roof])) < 0.4


def test_the_standard_errors_are_those_of_the_true_errors_of_nodes(rendered, matched):
    step = DenseMatching().step
    error, sigma = errors(rendered, matched, step), matched[0].nodes.sigma
    near = ndimage.binary_dilation(rendered.roof | rendered.wall | rendered.blank, iterations=20)[matched[1].slices][::step, ::step]
    ratio = (error / sigma)[np.isfinite(error) & ~near]
    assert 0.8 < 1.4826 * np.median(np.abs(ratio)) < 1.35


def test_still_water_stays_empty_beyond_the_reach_of_windows_on_the_shore(rendered):
    rows, cols = np.nonzero(ndimage.binary_erosion(rendered.blank, iterations=10))
    centre = Window(int(rows.mean()) - BLOCK // 2, int(cols.mean()) - BLOCK // 2, BLOCK, BLOCK)
    found, _, _ = match(rendered, centre, DenseMatching())
    water = ndimage.binary_erosion(rendered.blank, iterations=16)[centre.slices][::2, ::2]
    assert np.isfinite(found.nodes.parallax[water]).mean() < 0.1
    assert np.isfinite(found.nodes.parallax[~water]).mean() > 0.5


def test_outcomes_agree_with_parallaxes_and_sigmas(matched):
    nodes = matched[0].nodes
    assert ((nodes.outcome == Outcome.CONVERGED) == np.isfinite(nodes.parallax)).all()
    assert (np.isfinite(nodes.sigma) == np.isfinite(nodes.parallax)).all()


@pytest.mark.parametrize("rows", [0.6, -1.3])
def test_a_residual_y_parallax_is_measured_and_removed(rendered, rows):
    result = match(rendered, Window(BLOCK, BLOCK, BLOCK, BLOCK), DenseMatching(step=4), right_rows=rows)
    assert abs(result[0].y_parallax - rows) < 0.05
    error = errors(rendered, result, 4)
    assert np.isfinite(error).mean() > 0.7 and np.nanmedian(np.abs(error)) < 0.15


def test_a_wide_range_costs_bounded_memory_and_finds_the_same(rendered, matched):
    wide = DenseMatching(widest_range=24)
    error = errors(rendered, match(rendered, matched[1], wide), wide.step)
    both = np.isfinite(error) & np.isfinite(errors(rendered, matched, wide.step))
    assert both.mean() > 0.6
    assert scratch_bytes(ParallaxRange(0, 4096), DenseMatching()) < 400e6


def test_blocks_without_data_or_texture_are_empty():
    parallaxes = ParallaxRange(0, 32)
    shape, wide = (BLOCK + 2 * HALO,) * 2, (BLOCK + 2 * HALO, BLOCK + 2 * HALO + 32)
    for value, outcome in ((0, Outcome.OUTSIDE), (80, None)):
        found = match_block(np.full(shape, value, np.uint8), np.full(wide, value, np.uint8), parallaxes, DenseMatching())
        assert np.isnan(found.nodes.parallax).all() and np.isnan(found.y_parallax)
        assert outcome is None or (found.nodes.outcome == outcome).all()


def plain_paths(cost, small, large):
    """Eight paths, written down as the paper has them; a path that begins pays a jump, whichever candidate it takes."""
    rows, cols, candidates = cost.shape
    total = np.zeros(cost.shape)
    for dr, dc in ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1)):
        path = np.zeros(cost.shape)
        for r in range(rows) if dr >= 0 else range(rows - 1, -1, -1):
            for c in range(cols) if dc >= 0 else range(cols - 1, -1, -1):
                inside = 0 <= r - dr < rows and 0 <= c - dc < cols
                before = path[r - dr, c - dc] if inside else np.full(candidates, 1e9)
                lower, upper = np.r_[1e9, before[:-1]] + small, np.r_[before[1:], 1e9] + small
                best = np.minimum(np.min([before, lower, upper], axis=0) - before.min(), large)
                path[r, c] = cost[r, c] + (best if inside else large)
        total += path
    return total


def test_paths_agree_with_their_twin():
    cost = np.random.default_rng(0).integers(0, 48, (9, 11, 7)).astype(np.uint8)
    total, low, offset = np.zeros(cost.size, np.int16), np.zeros((9, 11), np.int32), 7 * np.arange(9 * 11 + 1)
    for backwards in (False, True):
        sweep(cost.ravel(), total, low, offset, 7, np.int16(8), np.int16(40), backwards)
    assert np.array_equal(total.reshape(cost.shape), plain_paths(cost, 8, 40))


def test_paths_do_not_cross_between_different_ranges():
    random = np.random.default_rng(2)
    cost, low = random.integers(0, 48, (9, 11, 16)).astype(np.uint8), random.integers(0, 11, (9, 11)).astype(np.int32)
    allowed = (np.arange(16) >= low[..., None]) & (np.arange(16) < low[..., None] + 6)
    total, offset = np.zeros(allowed.sum(), np.int16), 6 * np.arange(9 * 11 + 1)
    for backwards in (False, True):
        sweep(cost[allowed], total, low, offset, 16, np.int16(8), np.int16(40), backwards)
    walled = np.where(allowed, cost, 1e6)
    assert np.array_equal(total, plain_paths(walled, 8, 40)[allowed])


def test_costs_are_counts_of_differing_signs():
    random = np.random.default_rng(1)
    left, right = random.normal(100, 9, (9, 12)).astype(np.float32), random.normal(100, 9, (9, 16)).astype(np.float32)
    (a, _), (b, fine) = census(left), census(right)
    cost = _costs(a, b, fine, np.zeros((9, 12), np.int32), 5 * np.arange(9 * 12 + 1), np.uint8(24)).reshape(9, 12, 5)
    signs, other = left[1:8, 2:9] < left[4, 5], right[1:8, 4:11] < right[4, 5 + 4 - 2]
    assert cost[4, 5, 2] == (signs != other).sum()
    assert (cost[0] == 24).all()


def test_small_patches_are_removed_and_large_ones_kept():
    parallax = np.full((12, 12), np.float32(5.0))
    parallax[2:4, 2:4] = 9.0
    parallax[8, 8] = np.nan
    remove_specks(parallax, np.float32(1.0), 5)
    assert np.isnan(parallax).sum() == 5 and np.isfinite(parallax[0]).all()


def test_moving_rows_is_exact_on_a_ramp():
    ramp = np.add.outer(np.arange(12.0), np.zeros(5)).astype(np.float32)
    moved = moved_rows(ramp, np.float32(1.25))
    assert np.allclose(moved[2:7], ramp[2:7] + 1.25) and np.isnan(moved[-1]).all()


@pytest.mark.skipif(not CONES.exists(), reason="the Middlebury pair Cones is not on this machine")
def test_real_stereo_with_laboratory_truth():
    import cv2

    left, right = (cv2.imread(str(CONES / name), cv2.IMREAD_GRAYSCALE) for name in ("im2.png", "im6.png"))
    truth = cv2.imread(str(CONES / "disp2.pgm"), cv2.IMREAD_UNCHANGED) / 4.0
    padded = np.pad(right, ((0, 0), (63, 0)))
    found = semi_global(with_gaps(left), with_gaps(padded), SemiGlobal())
    both = np.isfinite(found) & (truth > 0)
    assert both.mean() > 0.75
    assert (np.abs(found - truth)[both] > 1.5).mean() < 0.06


def test_a_smaller_window_at_edges_keeps_walls_steep(rendered):
    core = Window(BLOCK, BLOCK, BLOCK, BLOCK)
    beside = ndimage.binary_dilation(rendered.wall, iterations=6)[core.slices][::2, ::2]
    wrong = []
    for edge_window in (5, 9):
        error = errors(rendered, match(rendered, core, DenseMatching(edge_window=edge_window)), 2)[beside]
        wrong.append((np.abs(error[np.isfinite(error)]) > 2.0).mean())
    assert wrong[0] < wrong[1]
