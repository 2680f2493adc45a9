"""Dense matching of the blocks of a rendered village with known parallaxes, from a start that the block itself gives."""

import numpy as np
import pytest
from scipy import ndimage
from village_pair import normal_case, render, village

from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import Window
from orthomill.tasks.matching.dense.blocks import (
    BLOCK,
    HALO,
    ParallaxRange,
    left_window,
    moved_rows,
    placed,
    refined_block,
    right_window,
    scratch_bytes,
)
from orthomill.tasks.matching.dense.dense_settings import DenseMatching
from orthomill.tasks.matching.dense.node_surfaces import StartSurface
from orthomill.tasks.matching.dense.pair_start import pair_start
from orthomill.tasks.matching.smoothing import with_gaps


@pytest.fixture(scope="module")
def rendered():
    scene, pair = village(760, 14, seed=8), normal_case(760)
    return render(scene, pair)


def block_start(left, right, parallaxes: ParallaxRange) -> StartSurface:
    """What the volume of the block's own two images gives."""
    found = pair_start(with_gaps(left), with_gaps(right), parallaxes.low - parallaxes.high, 0)
    return StartSurface(found.parallax + np.float32(parallaxes.high), 1)


def match(rendered, core, matching, right_rows=0.0):
    """Nodes of a block, their true column parallaxes, and the block's match."""
    pair = rendered.pair
    offset = pair.left_col0 - pair.right_col0
    parallaxes = ParallaxRange.around(pair.parallax_low + offset, pair.parallax_high + offset)
    wanted, images = (left_window(core), right_window(core, parallaxes)), (rendered.left, rendered.right)
    read = [w.clipped(image.shape) for w, image in zip(wanted, images, strict=True)]
    blocks = [placed(image[r.slices], r, w) for image, r, w in zip(images, read, wanted, strict=True)]
    # The start is that of images without y-parallax, for the volume comes from all photographs.
    start = block_start(*blocks, parallaxes)
    if right_rows:
        moved = ndimage.shift(rendered.right.astype(float), (right_rows, 0), order=3, mode="nearest").clip(1, 255).astype(np.uint8)
        blocks[1] = placed(moved[read[1].slices], read[1], wanted[1])
    return refined_block(*blocks, start, parallaxes, matching), core, offset


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
    assert 0.6 < 1.4826 * np.median(np.abs(ratio)) < 1.3


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


def test_the_memory_of_a_block_is_bounded():
    assert scratch_bytes(ParallaxRange(0, 4096), DenseMatching()) < 100e6


def test_blocks_without_data_or_texture_are_empty():
    parallaxes = ParallaxRange(0, 32)
    shape, wide = (BLOCK + 2 * HALO,) * 2, (BLOCK + 2 * HALO, BLOCK + 2 * HALO + 32)
    for value, outcome in ((0, Outcome.OUTSIDE), (80, None)):
        images = np.full(shape, value, np.uint8), np.full(wide, value, np.uint8)
        found = refined_block(*images, block_start(*images, parallaxes), parallaxes, DenseMatching())
        assert np.isnan(found.nodes.parallax).all() and np.isnan(found.y_parallax)
        assert outcome is None or (found.nodes.outcome == outcome).all()


def test_moving_rows_is_exact_on_a_ramp():
    ramp = np.add.outer(np.arange(12.0), np.zeros(5)).astype(np.float32)
    moved = moved_rows(ramp, np.float32(1.25))
    assert np.allclose(moved[2:7], ramp[2:7] + 1.25) and np.isnan(moved[-1]).all()


def test_a_smaller_window_at_edges_keeps_walls_steep(rendered):
    core = Window(BLOCK, BLOCK, BLOCK, BLOCK)
    beside = ndimage.binary_dilation(rendered.wall, iterations=6)[core.slices][::2, ::2]
    wrong = []
    for edge_window in (5, 9):
        error = errors(rendered, match(rendered, core, DenseMatching(edge_window=edge_window)), 2)[beside]
        wrong.append((np.abs(error[np.isfinite(error)]) > 0.5).mean())
    assert wrong[0] < wrong[1]
