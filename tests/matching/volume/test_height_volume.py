"""The optimisation over a volume: a rectified photograph against its projection, a stereo pair, and every setting."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter
from textured_plane import photograph, texture, views

from orthomill.tasks.matching.volume.candidates import all_planes, bounded
from orthomill.tasks.matching.volume.costs import MOST_STRETCHED, Choice
from orthomill.tasks.matching.volume.height_volume import optimised, scratch_bytes
from orthomill.tasks.matching.volume.rectified_photograph import (
    CellFrame,
    PhotographPixels,
    RectifiedPhotograph,
    plane_scales,
    rectified,
    rectified_pixels,
    reference_plane,
)
from orthomill.tasks.matching.volume.signatures import signatures
from orthomill.tasks.matching.volume.volume_settings import HeightVolume

CELLS = CellFrame(x=-6.0, y=6.0, cell=0.2, rows=60, cols=60)
SMALL = HeightVolume(window=5)
HEIGHTS = np.arange(-8, 8) * 0.25


@pytest.mark.parametrize("view", views(), ids=lambda view: view.name)
def test_cells_lie_in_the_rectified_image_where_their_rays_meet_its_plane(view):
    pixels = PhotographPixels(np.zeros((384, 448), np.float32), 0, 0, 0)
    image, planes = rectified(pixels, view, CELLS, HEIGHTS, 2)
    z0, pitch = reference_plane(view, HEIGHTS), CELLS.cell / 2
    # The first pixel's place follows from the plane z0 itself, whose scale is that of the cells.
    own = np.interp(z0, HEIGHTS, planes[:, 1]), np.interp(z0, HEIGHTS, planes[:, 2])
    for k, z in enumerate(HEIGHTS):
        for r, c in ((0, 0), (30, 10), (59, 59)):
            ground = np.array([[CELLS.x + c * CELLS.cell, CELLS.y - r * CELLS.cell, z]])
            foot = view.at_height(view.project(ground), z0)[0]
            col, row = planes[k, 0] * c + planes[k, 1], planes[k, 0] * r + planes[k, 2]
            assert (foot[0] - CELLS.x) / pitch + own[0] == pytest.approx(col, abs=0.05)
            assert (CELLS.y - foot[1]) / pitch + own[1] == pytest.approx(row, abs=0.05)
            assert -0.51 <= col <= image.shape[1] and -0.51 <= row <= image.shape[0]


def test_a_rectified_photograph_shows_the_ground():
    view, image = views()[1], texture()
    grey = photograph(view, image)[:, :, 0].astype(np.float32)
    flat = np.array([-0.25, 0.0, 0.25])
    found, planes = rectified(PhotographPixels(grey[20:, 30:], 0, 30, 20), view, CELLS, flat, 2)
    rows, cols = np.mgrid[5:55, 5:55]
    col, row = (planes[1, 0] * cols + planes[1, 1]).round().astype(int), (planes[1, 0] * rows + planes[1, 2]).round().astype(int)
    x = CELLS.x + (col - planes[1, 1]) / planes[1, 0] * CELLS.cell
    y = CELLS.y - (row - planes[1, 2]) / planes[1, 0] * CELLS.cell
    expected = image[(-y / 0.1 + 550).round().astype(int), (x / 0.1 + 550).round().astype(int)]
    assert np.corrcoef(found[row, col].ravel(), expected.ravel())[0, 1] > 0.97


def test_pixels_that_the_photograph_does_not_show_have_no_value():
    view = views()[0]
    far = CellFrame(x=200.0, y=6.0, cell=0.2, rows=10, cols=10)
    image, _ = rectified(PhotographPixels(np.ones((384, 448), np.float32), 0, 0, 0), view, far, HEIGHTS, 1)
    assert np.isnan(image).all()


def test_planes_above_the_camera_are_shown_by_nothing():
    view = views()[0]
    scales = plane_scales(view, np.array([0.0, 41.0, 42.0, 60.0]), 0.0)
    assert np.isfinite(scales[0]) and np.isnan(scales[1:]).all()
    assert reference_plane(view, np.array([60.0, 70.0])) < view.centre[2]


@settings(max_examples=20, deadline=None)
@given(top=st.floats(1.0, 60.0))
def test_a_rectified_image_never_outgrows_its_cells(top):
    heights = np.linspace(-5.0, top, 9)
    assert rectified_pixels(views()[0], CELLS, heights, 2) <= (3 * 2 * 60 + 4) ** 2


def test_a_rectified_image_ends_with_the_photograph():
    wide = CellFrame(x=-60.0, y=60.0, cell=0.2, rows=600, cols=600)
    # The photograph shows about 45 m x 38 m of the 120 m x 120 m, which its rotated frame surrounds.
    assert rectified_pixels(views()[1], wide, HEIGHTS, 1) < 0.4 * wide.rows * wide.cols


def stereo(parallax: np.ndarray, seed: int = 3, noise: float = 0.0) -> list[RectifiedPhotograph]:
    """A rectified pair: candidate k is the parallax k, the right column is the left one minus it."""
    random = np.random.default_rng(seed)
    rows, cols = parallax.shape
    right = gaussian_filter(random.normal(size=(rows, cols + 40)), 1.0) * 100
    row, col = np.mgrid[:rows, :cols]
    left = right[row, col + 40 - parallax]
    right = right + random.normal(0, noise, right.shape) if noise else right
    planes = np.column_stack([np.ones(32), np.zeros(32), np.zeros(32)])
    moved = planes + np.column_stack([np.zeros(32), 40.0 - np.arange(32), np.zeros(32)])
    codes = [signatures(grey.astype(np.float32), 2, 1) for grey in (left, right)]
    return [RectifiedPhotograph(codes[0], planes), RectifiedPhotograph(codes[1], moved)]


def stepped() -> np.ndarray:
    parallax = np.full((60, 70), 6)
    parallax[20:40, 25:50] = 15
    return parallax


def found(photographs, chosen: HeightVolume = SMALL):
    shape = photographs[0].signatures.shape
    choice = Choice(256, np.arange(len(photographs)).reshape(1, 1, -1), np.zeros((len(photographs), *shape), bool))
    pixels = sum(photo.signatures.size for photo in photographs)
    return optimised(photographs, pixels, choice, all_planes(np.ones(shape, bool), 32), chosen)


def wrong(photographs, truth: np.ndarray, chosen: HeightVolume = SMALL) -> float:
    return float((abs(found(photographs, chosen).plane - truth) > 1).mean())


def test_a_rectified_pair_is_matched_with_the_same_kernels():
    cells = found(stereo(stepped()))
    assert (abs(cells.plane - stepped()) <= 1)[4:-4, 4:-4].mean() > 0.98
    assert (cells.shown == 2).all() and (cells.seen == 2).all()
    assert np.median(cells.cost) < 0.05 and np.median(cells.margin) > 0.1


def test_a_narrow_base_makes_rivals_of_no_neighbouring_heights():
    """With an eighth of a pixel of parallax between heights, four of them look alike: that is no doubt, but a coarser height."""
    left, right = stereo(np.full((60, 70), 2), noise=20.0)
    nearby = np.column_stack([np.ones(32), 40.0 - np.arange(32) / 8, np.zeros(32)])
    narrow, wide = found([left, RectifiedPhotograph(right.signatures, nearby)]), found([left, right])
    inner = slice(6, -6), slice(6, -6)
    assert np.median(narrow.stretch[inner]) == MOST_STRETCHED
    assert (wide.stretch[inner] < 1.6).all()
    assert np.median(abs(narrow.plane - 16)[inner]) <= 4
    assert np.median(narrow.spread[inner]) < 1.0, "in heights that differ; in planes it is many times as much"
    assert np.median(narrow.margin[inner]) > 0.5 * np.median(wide.margin[inner])


def test_penalties_hold_the_surface_together():
    photographs = stereo(stepped(), noise=25.0)
    held = wrong(photographs, stepped())
    assert wrong(photographs, stepped(), HeightVolume(window=5, small_penalty=0.0, large_penalty=0.0)) > 2 * held
    # A jump that costs too much is not made: the block disappears.
    assert abs(found(photographs, HeightVolume(window=5, large_penalty=4.0, small_penalty=2.0)).plane[25:35, 30:45] - 15).mean() > 1


def test_a_larger_window_has_more_bits():
    random = np.random.default_rng(0)
    codes = [signatures(random.normal(size=(60, 110)).astype(np.float32), 3, 1) for _ in range(2)]
    unrelated = [RectifiedPhotograph(code, photo.planes) for code, photo in zip(codes, stereo(stepped()), strict=True)]
    # Unrelated images differ in a third to half of the bits whatever the window.
    assert 0.2 < np.median(found(unrelated, HeightVolume(window=7)).cost) < 0.5


def test_blank_is_the_cost_of_what_only_one_photograph_shows():
    left, right = stereo(np.full((60, 70), 6))
    right.planes[5:8] = np.nan
    # The true plane is not shown: blank costs nothing, so it wins; or more than any bad match, so that it never does.
    dear, cheap = (found([left, right], HeightVolume(window=5, blank=blank)).plane for blank in (1.0, 0.0))
    assert (abs(dear - 6) <= 1).mean() < 0.1 and (abs(cheap - 6) <= 1).mean() > 0.9


def test_memory_is_counted_for_everything():
    least = scratch_bytes(1000, 100, 500, HeightVolume())
    assert scratch_bytes(2000, 100, 500, HeightVolume()) == least + 3000
    assert scratch_bytes(1000, 200, 500, HeightVolume()) > least and scratch_bytes(1000, 100, 900, HeightVolume()) > least
    assert scratch_bytes(1000, 100, 500, HeightVolume(window=5)) < least


@given(st.integers(0, 10**6))
def test_bounded_candidates_keep_all_between_the_bounds_and_drop_what_they_can(seed):
    rng = np.random.default_rng(seed)
    whole = all_planes(rng.random((4, 5)) < 0.8, 96)
    first, last = np.sort(rng.integers(-10, 110, (2, 4, 5)), axis=0)
    part = bounded(whole, first, last)
    before, after = whole.count, part.count
    assert (after % 16 == 0).all() and (after <= before).all() and (part.low + after <= 96).all()
    lower, upper = np.maximum(first, 0), np.minimum(last, 95)
    meets = (upper >= lower) & (before > 0)
    assert (part.low <= lower)[meets].all() and (part.low + after > upper)[meets].all()
    assert (after < upper - lower + 1 + 16)[meets].all()
    assert (after == before)[~meets].all()
