"""Depth maps of pairs: what both directions say is kept, at the parallaxes of the pair."""

import numpy as np
import pytest
from scipy import ndimage
from village_pair import normal_case

from orthomill.schemas.raster import Window
from orthomill.tasks.densification.canopy.depth_map import STEP, DepthBlock, confirmed, depth_block


def leaves(rows: int, cols: int, seed: int, grain: float = 1.0) -> np.ndarray:
    noise = ndimage.gaussian_filter(np.random.default_rng(seed).normal(0, 1, (rows, cols)), grain)
    return (128 + 40 * noise / noise.std()).clip(1, 255).astype(np.float32)


def test_what_only_one_image_sees_is_not_confirmed():
    ground, crown = leaves(90, 140, 1), leaves(90, 30, 2)
    left, right = ground[:, :120].copy(), np.full((90, 130), np.nan, np.float32)
    left[:, 50:80] = crown
    # Column left - column right is -3 on the ground and -9 on the crown, which hides ground beside it from the right.
    right[:, 3:] = ground[:, :127]
    right[:, 59:89] = crown
    found = confirmed(left, right, -15.0, 0.0)
    for cols, parallax in ((slice(5, 42), -3), (slice(58, 74), -9), (slice(92, 115), -3)):
        part = found[5:-5, cols]
        assert np.isfinite(part).mean() > 0.95 and np.nanmedian(part) == pytest.approx(parallax, abs=0.1)
    assert np.isfinite(found[5:-5, 81:85]).mean() < 0.3


@pytest.mark.parametrize("parallax", [885.0, 900.0, 940.0])
def test_a_block_knows_its_place_in_both_images(parallax):
    pair = normal_case(1400)
    # x_left - x_right = parallax: columns differ by as much more as the principal columns do.
    moved = round(parallax + pair.left_col0 - pair.right_col0)
    whole = np.round(leaves(pair.rows, pair.left_cols, 3, 4.0)).astype(np.uint8)
    right = np.zeros((pair.rows, pair.right_cols), np.uint8)
    right[:, max(-moved, 0) : pair.right_cols - max(moved, 0)] = whole[:, max(moved, 0) : pair.left_cols - max(-moved, 0)]
    block = DepthBlock(pair, Window(20, 120, 100, 90))
    found = depth_block(block, whole[block.left.slices], right[block.right.slices])
    assert found.shape == (100, 90) and np.isfinite(found).mean() > 0.9
    assert np.nanmedian(found) == pytest.approx(moved - pair.left_col0 + pair.right_col0, abs=1.3), "a third of a pixel of the map"


def test_a_block_whose_other_image_lies_elsewhere_is_empty():
    block = DepthBlock(normal_case(1400), Window(0, 0, 8, 6))
    assert np.isnan(depth_block(block, np.full(block.left.shape, 100, np.uint8))).all()
    assert block.left.width % STEP == 0 or block.left.width == block.pair.left_cols
