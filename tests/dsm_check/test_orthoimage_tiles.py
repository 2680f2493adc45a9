"""Orthoimages of a photograph over level ground, where every pixel can be computed by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from orthomill.schemas.camera import Camera
from orthomill.schemas.epipolar import GreyRange
from orthomill.schemas.orientation import ExteriorOrientation
from orthomill.schemas.raster import MapGrid, Window, tiles_of
from orthomill.tasks.dsm_check.working_orthoimage import WorkingTile, height_at, ortho_tile
from orthomill.tasks.geometry.view import view_of
from orthomill.tasks.imagery.resampling import sample_cubic

CAMERA = Camera(name="c", width=240, height=200, c=200.0, k1=-0.03)
PHOTO = ExteriorOrientation(photo="p", centre=(30.0, 25.0, 100.0), omega_phi_kappa=(2.0, -3.0, 15.0))
GRID = MapGrid(west=0.0, north=50.0, cell=1.0, rows=50, cols=60)
WHOLE = Window(0, 0, 50, 60)
ALL = Window(0, 0, 200, 240)


def image() -> np.ndarray:
    values = gaussian_filter(np.random.default_rng(2).standard_normal((200, 240)), 2.0)
    return np.clip(np.rint(120 + 35 * values / values.std()), 1, 255).astype(np.uint8)[..., None]


def relief() -> np.ndarray:
    x, y = np.meshgrid(*GRID.centres(WHOLE))
    return (5.0 * np.sin(x / 9.0) * np.cos(y / 7.0)).astype(np.float32)


def made(window=WHOLE, heights=None, factor=1, photo=ALL, stretch=None, pixels=None) -> np.ndarray:
    heights = relief() if heights is None else heights
    given_ = window.grown(1).clipped(GRID.shape)
    tile = WorkingTile(PHOTO, CAMERA, GRID, window, given_, factor, photo)
    grey = image()[photo.slices] if pixels is None else pixels
    return ortho_tile(tile, heights[given_.slices], grey, stretch or GreyRange())


def test_a_pixel_shows_where_its_ground_point_is_imaged():
    x, y = np.meshgrid(*GRID.centres(WHOLE))
    pixels = view_of(PHOTO, CAMERA).project(np.column_stack([x.ravel(), y.ravel(), relief().ravel()]))
    expected = np.clip(sample_cubic(image()[..., 0], pixels) + 0.5, 1, 255).reshape(GRID.shape)
    found = made().astype(float)
    inside = np.isfinite(expected) & (found > 0)
    assert inside.mean() > 0.9 and np.abs(found - np.floor(expected))[inside].max() <= 1


@pytest.mark.parametrize("size", [16, 25])
@pytest.mark.parametrize("factor", [1, 2])
def test_tiles_make_up_the_whole_orthoimage(size, factor):
    whole = made(factor=factor)
    for tile in tiles_of(GRID.shape, size):
        assert np.array_equal(made(tile.window, factor=factor), whole[tile.window.scaled(factor).slices])


def test_two_pixels_per_cell_surround_its_centre():
    """On level ground without distortion the mean of the four pixels of a cell is close to the cell's own pixel."""
    level = np.zeros(GRID.shape, np.float32)
    coarse, fine = made(heights=level).astype(float), made(heights=level, factor=2).astype(float)
    mean = fine.reshape(50, 2, 60, 2).mean(axis=(1, 3))
    inner = (slice(5, -5), slice(5, -5))
    assert np.corrcoef(mean[inner].ravel(), coarse[inner].ravel())[0, 1] > 0.99
    shifted = fine.reshape(50, 2, 60, 2)[:, 0, :, 0]
    assert np.abs(mean - coarse)[inner].mean() < np.abs(shifted - coarse)[inner].mean()


def test_what_the_photograph_masks_is_no_data():
    mask = np.full((200, 240, 1), 255, np.uint8)
    mask[80:120, 90:150] = 0
    plain, found = made(), made(pixels=np.concatenate([image(), mask], axis=2))
    lost = (plain > 0) & (found == 0)
    assert lost.sum() > 20 and np.array_equal(found[~lost], plain[~lost])


def test_without_height_there_is_no_data():
    heights = relief()
    heights[20:25, 30:40] = np.nan
    found = made(heights=heights)
    assert not found[20:25, 30:40].any() and (found > 0).sum() == (made() > 0).sum() - (made()[20:25, 30:40] > 0).sum()


def test_a_window_of_the_photograph_is_enough_where_it_covers_the_tile():
    window = Window(20, 20, 10, 10)
    x, y = np.meshgrid(*GRID.centres(window))
    pixels = view_of(PHOTO, CAMERA).project(np.column_stack([x.ravel(), y.ravel(), relief()[window.slices].ravel()]))
    (left, top), (right, bottom) = np.floor(pixels.min(axis=0)).astype(int) - 4, np.ceil(pixels.max(axis=0)).astype(int) + 5
    part = Window(int(top), int(left), int(bottom - top), int(right - left))
    assert np.array_equal(made(window, photo=part), made(window))


def test_a_photograph_that_does_not_show_the_tile_gives_no_data():
    tile = WorkingTile(PHOTO, CAMERA, GRID, WHOLE, WHOLE, 2, Window(0, 0, 0, 0))
    found = ortho_tile(tile, relief())
    assert found.shape == (100, 120) and found.dtype == np.uint8 and not found.any()


def test_the_stretch_maps_sixteen_bits_to_eight():
    deep = image().astype(np.uint16) * 100 + 500
    found = made(pixels=deep, stretch=GreyRange(low=500.0, high=500.0 + 25500.0))
    assert np.abs(found.astype(int) - made()).max() <= 1


def test_black_ground_is_one_and_not_without_data():
    found = made(pixels=np.zeros((200, 240, 1), np.uint8))
    assert set(np.unique(found)) <= {0, 1} and found.max() == 1


@settings(max_examples=60, deadline=None)
@given(row=st.floats(0, 8.999), col=st.floats(0, 9.999), a=st.floats(-2, 2), b=st.floats(-2, 2))
def test_heights_between_cell_centres_are_bilinear(row, col, a, b):
    r, c = np.mgrid[:10, :11]
    plane = a * r + b * c + 3.0
    assert height_at(plane, row, col) == pytest.approx(a * row + b * col + 3.0, abs=1e-9)


def test_heights_on_a_cell_centre_need_no_neighbour():
    heights = np.full((3, 3), np.nan)
    heights[1, 1] = 7.0
    assert height_at(heights, 1.0, 1.0) == 7.0
    assert np.isnan(height_at(heights, 1.0, 1.2)) and np.isnan(height_at(heights, 0.9, 1.0))
    assert np.isnan(height_at(heights, -0.1, 1.0)) and np.isnan(height_at(heights, 1.0, 2.5))
