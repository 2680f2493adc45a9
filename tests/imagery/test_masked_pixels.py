"""Masks behind the colours: what is no picture has no grey value, no point and no colour, on any level."""

import numpy as np
import pytest

from orthomill.schemas.raster import Window
from orthomill.tasks.colouring.sampling.photograph_colours import PhotoPixelsAt, colours_at
from orthomill.tasks.imagery.masked_pixels import colours_of, is_masked, picture_of, picture_or_nan
from orthomill.tasks.imagery.pyramid import halved
from orthomill.tasks.imagery.radiometry import grey, grey_bytes, grey_range, real_grey
from orthomill.tasks.photos.pixels import exposure
from orthomill.tasks.projection.photographs.border_masks import border_mask
from orthomill.tasks.tie_points.features import LARGEST, Detection, tile_features

GAP = np.s_[20:60, 30:90]


def masked(bands: int = 3, dtype: str = "uint8", rows: int = 120, cols: int = 160) -> np.ndarray:
    full = np.iinfo(dtype).max
    pixels = np.random.default_rng(3).integers(1, full, (rows, cols, bands + 1)).astype(dtype)
    pixels[..., -1] = full
    pixels[(*GAP, -1)] = 0
    return pixels


@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
@pytest.mark.parametrize("bands", [1, 3])
def test_grey_values_are_those_of_the_colours_and_missing_in_the_mask(bands, dtype):
    pixels = masked(bands, dtype)
    values = grey(pixels)
    assert np.isnan(values[GAP]).all() and np.isnan(values).sum() == 40 * 60
    kept = picture_of(pixels)
    assert np.array_equal(values[kept], grey(colours_of(pixels))[kept])


def test_grey_bytes_are_zero_in_the_mask_and_real_ones_nowhere_else():
    pixels = masked()
    pixels[70:75, 100:110, :3] = 0
    limits = grey_range(pixels)
    assert (grey_bytes(pixels, limits)[GAP] == 0).all()
    assert np.array_equal(real_grey(pixels, limits) > 0, picture_of(pixels))


def test_the_range_of_sixteen_bits_is_that_of_the_picture():
    pixels = masked(1, "uint16")
    pixels[..., 0] = 1000 + pixels[..., 0] % 500
    pixels[(*GAP, 0)] = 65000
    assert grey_range(pixels)[1] < 1501


def test_a_coarser_pixel_is_picture_where_nothing_else_was_averaged_into_it():
    pixels = masked()
    coarse = halved(pixels)
    for row, col in np.ndindex(coarse.shape[:2]):
        needed = picture_of(pixels)[max(2 * row - 1, 0) : 2 * row + 3, max(2 * col - 1, 0) : 2 * col + 3]
        assert picture_of(coarse)[row, col] == needed.all()


def test_a_photograph_without_mask_stays_as_it_is():
    pixels = masked()[..., :3]
    assert not is_masked(pixels) and picture_or_nan(pixels) is pixels and picture_of(pixels).all()


def test_a_colour_needs_all_its_sixteen_neighbours():
    pixels = masked()
    part = PhotoPixelsAt.of(pixels, Window(0, 0, 120, 160), 0)
    rng = np.random.default_rng(4)
    places = np.column_stack([rng.uniform(2, 156, 3000), rng.uniform(2, 116, 3000)])
    colour, known = colours_at(part, (120, 160), places)
    col, row = np.floor(places).astype(int).T
    whole = np.array([picture_of(pixels)[r - 1 : r + 3, c - 1 : c + 3].all() for c, r in zip(col, row, strict=True)])
    assert np.array_equal(known, whole) and 100 < whole.sum() < 2900
    plain, _ = colours_at(PhotoPixelsAt.of(pixels[..., :3], Window(0, 0, 120, 160), 0), (120, 160), places)
    assert np.allclose(colour[whole], plain[whole], atol=1e-3) and (colour[~whole] == 0).all()


def test_no_descriptor_reaches_into_the_mask():
    pixels = masked(rows=400, cols=500)
    pixels[150:250, 200:300, 3] = 0
    detection = Detection(0, (400, 500), Window(0, 0, 400, 500), 4000, 0.02)
    found = tile_features(pixels, pixels[::4, ::4], detection).features
    rows, cols = np.nonzero(~picture_of(pixels))
    nearest = [np.hypot(rows - r, cols - c).min() for r, c in zip(found.row, found.col, strict=True)]
    assert len(found.row) > 200 and (np.array(nearest) > 5.3 * found.size - 1).all()
    open_ = tile_features(pixels[..., :3], pixels[::4, ::4, :3], detection).features
    beside = (open_.row > 150) & (open_.row < 250) & (open_.col > 200) & (open_.col < 300)
    assert beside.any() and open_.size.max() <= LARGEST


def test_exposure_counts_the_picture_only():
    pixels = masked()
    pixels[(*GAP, slice(0, 3))] = 255
    found = exposure(pixels, "a")
    assert found.masked == pytest.approx(40 * 60 / (120 * 160)) and found.white < 0.001
    pixels[..., 3] = 0
    assert exposure(pixels, "a").masked == 1.0


def test_what_the_file_masks_is_border_wherever_it_lies():
    assert (border_mask(masked()).mask[..., 0][GAP] == 0).all()
    assert border_mask(masked()).facts.share == pytest.approx(40 * 60 / (120 * 160))
