"""Overviews and pictures in files, against plain NumPy and an independent reader."""

import base64
import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from memory_store import MemoryStore
from PIL import Image

from orthomill.pipeline.painting.map_colours import exaggeration, palette, shade
from orthomill.pipeline.painting.overview import overview
from orthomill.pipeline.report.grey_png import write_grey_png
from orthomill.pipeline.report.image_uri import jpeg_uri, png_uri
from orthomill.pipeline.report.pictures import draw
from orthomill.schemas.errors import StoreError
from orthomill.schemas.stage_report import Picture

NAN = float("nan")
SHAPES = st.tuples(st.integers(1, 150), st.integers(1, 150))


def block_means(values: np.ndarray, present: np.ndarray, factor: int) -> tuple[np.ndarray, np.ndarray]:
    """Means and shares of blocks, one block after another."""
    rows, cols = (-(-length // factor) for length in values.shape)
    means, share = np.full((rows, cols), np.nan), np.zeros((rows, cols))
    for row, col in np.ndindex(rows, cols):
        block = np.s_[row * factor : (row + 1) * factor, col * factor : (col + 1) * factor]
        share[row, col] = present[block].mean()
        if present[block].any():
            means[row, col] = values[block][present[block]].mean(dtype=np.float64)
    return means, share


@settings(max_examples=40, deadline=None)
@given(shape=SHAPES, limit=st.integers(5, 60), chunk=st.sampled_from([64, 96]), seed=st.integers(0, 99))
def test_any_size_and_chunk_gives_the_means_of_the_blocks(shape, limit, chunk, seed):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=shape).astype(np.float32)
    values[rng.random(shape) < 0.3] = np.nan
    seen = overview(MemoryStore().put("r", values, chunk), "r", limit, nearest=False)
    means, share = block_means(values, np.isfinite(values), seen.factor)
    assert max(seen.values.shape) <= limit
    np.testing.assert_allclose(seen.values, means, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(seen.share, share)


@settings(max_examples=40, deadline=None)
@given(shape=SHAPES, limit=st.integers(5, 60), chunk=st.sampled_from([64, 96]))
def test_codes_are_picked_and_never_averaged(shape, limit, chunk):
    codes = (np.arange(np.prod(shape)) % 251).astype(np.uint8).reshape(shape)
    seen = overview(MemoryStore().put("r", codes, chunk), "r", limit, nearest=True)
    rows, cols = (np.minimum(np.arange(-(-n // seen.factor)) * seen.factor + seen.factor // 2, n - 1) for n in shape)
    np.testing.assert_array_equal(seen.values, codes[np.ix_(rows, cols)])


def test_a_nodata_value_and_transparent_pixels_are_no_values():
    counts = np.array([[7, 0, 0, 0], [0, 0, 3, 0]], np.uint8)
    seen = overview(MemoryStore().put("r", counts, nodata=0), "r", 2, nearest=False)
    np.testing.assert_array_equal(seen.values, [[7, 3]])
    np.testing.assert_array_equal(seen.share, [[0.25, 0.25]])
    picture = np.full((4, 4, 4), 90, np.uint8)
    picture[:2, :, 3] = 0
    seen = overview(MemoryStore().put("r", picture), "r", 2, nearest=False)
    np.testing.assert_array_equal(seen.share, [[0, 0], [1, 1]])
    assert np.isnan(seen.values[0]).all() and (seen.values[1, :, :3] == 90).all()


def test_a_small_raster_is_shown_as_stored():
    values = np.arange(12, dtype=np.float32).reshape(3, 4)
    seen = overview(MemoryStore().put("r", values), "r", 100, nearest=False)
    assert seen.factor == 1
    np.testing.assert_array_equal(seen.values, values)


# --- files -------------------------------------------------------------------------------------------------------------------


def opened(uri: str) -> Image.Image:
    kind, _, data = uri.partition(",")
    assert kind in ("data:image/png;base64", "data:image/jpeg;base64")
    return Image.open(io.BytesIO(base64.b64decode(data)))


@settings(max_examples=30, deadline=None)
@given(shape=st.tuples(st.integers(1, 40), st.integers(1, 40)), colours=st.integers(1, 256), seed=st.integers(0, 99))
def test_a_palette_png_shows_exactly_the_colours_of_its_table(shape, colours, seed):
    rng = np.random.default_rng(seed)
    index, table = rng.integers(0, colours, shape, np.uint8), rng.integers(0, 256, (colours, 3), np.uint8)
    np.testing.assert_array_equal(np.asarray(opened(png_uri(index, table)).convert("RGB")), table[index])


def test_a_jpeg_has_its_bands_in_order():
    colours = np.zeros((16, 48, 3), np.uint8)
    for band in range(3):
        colours[:, 16 * band : 16 * band + 16, band] = 230
    shown = np.asarray(opened(jpeg_uri(colours))).astype(int)
    for band in range(3):
        middle = shown[8, 16 * band + 8]
        assert middle[band] > 200 and middle.sum() - middle[band] < 90


@settings(max_examples=20, deadline=None)
@given(rows=st.integers(1, 30), cols=st.integers(1, 30), strip=st.integers(1, 30), seed=st.integers(0, 99))
def test_a_grey_png_is_the_same_whatever_the_height_of_its_strips(tmp_path_factory, rows, cols, strip, seed):
    grey = np.random.default_rng(seed).integers(0, 256, (rows, cols), np.uint8)
    path = tmp_path_factory.getbasetemp() / "grey.png"
    write_grey_png(path, grey.shape, (grey[row : row + strip] for row in range(0, rows, strip)))
    np.testing.assert_array_equal(np.asarray(Image.open(path)), grey)


def test_a_grey_png_that_is_interrupted_leaves_the_old_one(tmp_path):
    def broken():
        yield np.zeros((2, 4), np.uint8)
        raise StoreError("a strip is damaged")

    path = tmp_path / "a.png"
    path.write_bytes(b"old")
    with pytest.raises(StoreError):
        write_grey_png(path, (4, 4), broken())
    assert path.read_bytes() == b"old" and [file.name for file in tmp_path.iterdir()] == ["a.png"]


# --- colours -----------------------------------------------------------------------------------------------------------------


def test_a_palette_runs_evenly_from_the_first_to_the_last_colour():
    colours = palette(("#000000", "#ffffff"), 6)
    np.testing.assert_array_equal(colours, np.repeat([[0], [51], [102], [153], [204], [255]], 3, axis=1))
    np.testing.assert_array_equal(palette(("#123456",), 2), [[0x12, 0x34, 0x56]] * 2)


def test_given_limits_of_a_ramp_are_its_colour_bar():
    store = MemoryStore().put("r", np.linspace(0, 10, 400, dtype=np.float32).reshape(20, 20), unit="m")
    bar = draw(store, Picture(title="", raster="r", style="ramp", low=2.0, high=4.0)).bar
    assert (bar.low, bar.high, bar.unit, sum(bar.counts)) == (2.0, 4.0, "m", 400)
    free = draw(store, Picture(title="", raster="r", style="ramp", unit="px")).bar
    assert free.low == pytest.approx(0.2, abs=0.01) and free.high == pytest.approx(9.8, abs=0.01) and free.unit == "px"


def test_16_bit_colours_are_stretched():
    pixels = np.random.default_rng(0).integers(1000, 2000, (64, 64, 3), np.uint16)
    shown = np.asarray(opened(draw(MemoryStore().put("r", pixels), Picture(title="", raster="r", style="rgb")).uri))
    assert shown.min() < 30 and shown.max() > 225


@settings(max_examples=30, deadline=None)
@given(height=st.floats(-500, 3000), cell=st.floats(0.05, 50))
def test_level_ground_has_one_brightness_at_any_height(height, cell):
    bright = shade(np.full((6, 7), height), cell, exaggeration(np.full((6, 7), height), cell))
    assert np.ptp(bright) == 0 and 0.5 < bright[0, 0] < 1.5


def test_shading_shows_slopes_of_flat_and_of_steep_terrain_alike():
    """Exaggeration adapts to the terrain: a gentle ridge and one ten times as steep are shaded with the same contrast."""
    ridge = np.abs(np.arange(60.0) - 30)[None].repeat(40, axis=0)
    gentle, steep = (np.ptp(shade(slope * ridge, 1.0, exaggeration(slope * ridge, 1.0))[20]) for slope in (0.2, 2.0))
    assert gentle > 0.3 and steep == pytest.approx(gentle, rel=0.35)


def test_a_hole_is_neither_bright_nor_dark_and_hides_no_neighbour():
    heights = np.arange(49.0).reshape(7, 7)
    heights[3, 3] = NAN
    bright = shade(heights, 1.0, exaggeration(heights, 1.0))
    assert bright[3, 3] == 1.0 and np.isfinite(bright).all()
