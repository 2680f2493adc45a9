"""Windows, tiles and map grids: the geometry that every tile of every stage relies on."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from orthomill.schemas.raster import MapGrid, RasterSpec, Window, map_raster, tiles_of

SIDE = st.integers(-60, 60)
LENGTH = st.integers(0, 60)
WINDOWS = st.builds(Window, SIDE, SIDE, LENGTH, LENGTH)
SHAPES = st.tuples(st.integers(1, 80), st.integers(1, 80))
GRIDS = st.builds(
    MapGrid,
    west=st.floats(-1e6, 1e6),
    north=st.floats(-1e7, 1e7),
    cell=st.floats(0.01, 100),
    rows=st.integers(1, 300),
    cols=st.integers(1, 300),
)


def cells(window: Window, shape: tuple[int, int]) -> np.ndarray:
    """The window as a mask of a raster: what it covers, found pixel by pixel."""
    rows, cols = np.mgrid[: shape[0], : shape[1]]
    inside = (rows >= window.row) & (rows < window.row + window.height)
    return inside & (cols >= window.col) & (cols < window.col + window.width)


@settings(max_examples=150, deadline=None)
@given(window=WINDOWS, shape=SHAPES)
def test_clipping_keeps_exactly_what_is_inside(window, shape):
    clipped, covered = window.clipped(shape), cells(window, shape)
    assert clipped.empty == (not covered.any())
    assert clipped.height >= 0 and clipped.width >= 0
    if not clipped.empty:
        mask = np.zeros(shape, bool)
        mask[clipped.slices] = True
        assert np.array_equal(mask, covered) and clipped.clipped(shape) == clipped
        assert mask[clipped.slices].shape == clipped.shape


@settings(max_examples=100, deadline=None)
@given(window=WINDOWS, halo=st.integers(0, 20))
def test_a_grown_window_reaches_a_halo_further_on_every_side(window, halo):
    grown = window.grown(halo)
    assert (grown.row, grown.col) == (window.row - halo, window.col - halo)
    assert (grown.height, grown.width) == (window.height + 2 * halo, window.width + 2 * halo)
    assert grown.grown(-halo) == window


@settings(max_examples=100, deadline=None)
@given(window=WINDOWS, factor=st.integers(1, 8))
def test_a_scaled_window_covers_the_same_ground(window, factor):
    scaled = window.scaled(factor)
    coarse, fine = (cells(one, (80 * size, 80 * size)) for one, size in ((window, 1), (scaled, factor)))
    assert np.array_equal(np.kron(coarse, np.ones((factor, factor), bool)), fine)


@settings(max_examples=100, deadline=None)
@given(window=WINDOWS, factor=st.integers(1, 8))
def test_a_reduced_window_holds_all_larger_pixels_that_the_window_touches(window, factor):
    touched = {
        (row // factor, col // factor)
        for row in range(window.row, window.row + window.height)
        for col in range(window.col, window.col + window.width)
    }
    reduced = window.reduced(factor)
    assert window.empty or touched == {
        (row, col)
        for row in range(reduced.row, reduced.row + reduced.height)
        for col in range(reduced.col, reduced.col + reduced.width)
    }
    assert window.scaled(factor).reduced(factor) == window


@settings(max_examples=100, deadline=None)
@given(window=WINDOWS, halo=st.integers(0, 20))
def test_a_window_within_another_is_its_place_in_that_array(window, halo):
    outer = window.grown(halo)
    assert window.within(outer) == Window(halo, halo, *window.shape)


@settings(max_examples=150, deadline=None)
@given(shape=SHAPES, size=st.tuples(st.integers(1, 40), st.integers(1, 40)))
def test_tiles_cover_a_raster_exactly_once_row_by_row(shape, size):
    seen, places = np.zeros(shape, int), []
    for tile in tiles_of(shape, size):
        seen[tile.window.slices] += 1
        places.append((tile.row, tile.col))
        assert (tile.window.row, tile.window.col) == (tile.row * size[0], tile.col * size[1])
    assert (seen == 1).all() and places == sorted(places)


def test_one_number_stands_for_square_tiles():
    assert list(tiles_of((10, 10), 4)) == list(tiles_of((10, 10), (4, 4))) and len(list(tiles_of((10, 10), 4))) == 9


@settings(max_examples=100, deadline=None)
@given(grid=GRIDS)
def test_centres_of_cells_are_whole_pixels(grid):
    x, y = grid.centres(Window(0, 0, *grid.shape))
    col = grid.pixel(x, np.resize(y, x.shape))[0]
    scale = max(abs(grid.west), abs(grid.north)) / grid.cell
    np.testing.assert_allclose(col, np.arange(grid.cols), atol=1e-14 * scale + 1e-9)
    np.testing.assert_allclose(grid.pixel(np.resize(x, y.shape), y)[1], np.arange(grid.rows), atol=1e-14 * scale + 1e-9)


@settings(max_examples=100, deadline=None)
@given(grid=GRIDS, row=st.integers(0, 100), col=st.integers(0, 100))
def test_centres_of_a_window_are_those_of_its_part_of_the_grid(grid, row, col):
    window = Window(row, col, 3, 4)
    whole_x, whole_y = grid.centres(Window(0, 0, 200, 200))
    x, y = grid.centres(window)
    np.testing.assert_array_equal(x, whole_x[col : col + 4])
    np.testing.assert_array_equal(y, whole_y[row : row + 3])


@settings(max_examples=100, deadline=None)
@given(grid=GRIDS)
def test_the_transform_takes_pixel_corners_to_the_ground(grid):
    """GDAL counts from the outer corner of the upper-left cell: pixel (0, 0) there is half a cell before the first centre."""
    a, b, c, d, e, f = grid.transform
    assert (c, f) == (grid.west, grid.north) and b == d == 0 and a == -e == grid.cell
    x, y = grid.centres(Window(0, 0, 1, 1))
    assert x[0] == pytest.approx(a * 0.5 + c, abs=1e-9) and y[0] == pytest.approx(e * 0.5 + f, abs=1e-9)


def spec(**more) -> RasterSpec:
    return RasterSpec(**({"name": "a/z", "shape": (100, 90, 3), "dtype": "uint16", "chunk": 64} | more))


def test_a_specification_knows_its_chunks_and_bytes():
    assert spec().chunks == (64, 64, 3) and spec(chunk=512).chunks == (100, 90, 3)
    assert spec().full == Window(0, 0, 100, 90)
    assert spec().bytes_of(Window(0, 0, 10, 20)) == 10 * 20 * 3 * 2
    assert spec(shape=(100, 90), dtype="float32").bytes_of(Window(5, 5, 10, 20)) == 10 * 20 * 4


@pytest.mark.parametrize("change", [{"chunk": 32}, {"dtype": "uint8"}, {"nodata": 0.0}, {"unit": "m"}, {"readers": ("a",)}])
def test_specifications_that_differ_in_anything_are_not_the_same(change):
    assert not spec().same(spec(**change)) and spec(**change).same(spec(**change))


def test_a_nodata_of_nan_equals_itself():
    one, other = spec(nodata=float("nan")), spec(nodata=float("nan"))
    assert one != other and one.same(other)


def test_a_map_raster_lies_on_its_grid():
    grid = MapGrid(west=1000.0, north=2000.0, cell=0.5, rows=30, cols=40)
    plain = map_raster("a/z", grid, "float32", "EPSG:2100", 16, nodata=float("nan"), unit="m", readers=("b",))
    assert (plain.shape, plain.transform, plain.crs, plain.unit, plain.readers) == (
        (30, 40),
        grid.transform,
        "EPSG:2100",
        "m",
        ("b",),
    )
    assert map_raster("a/ortho", grid, "uint8", "EPSG:2100", 16, bands=4).shape == (30, 40, 4)


@pytest.mark.parametrize("value", [Window(0, 0, 1, 1), MapGrid(west=0, north=0, cell=1, rows=1, cols=1), spec()])
def test_values_are_frozen(value):
    with pytest.raises((AttributeError, ValidationError)):
        value.row = 3


@settings(max_examples=100, deadline=None)
@given(window=WINDOWS, shape=SHAPES, halo=st.integers(0, 20))
def test_a_halo_never_loses_pixels_of_the_tile(window, shape, halo):
    tile, with_halo = window.clipped(shape), window.grown(halo).clipped(shape)
    assert not (cells(tile, shape) & ~cells(with_halo, shape)).any()
    assert with_halo.height <= window.height + 2 * halo and with_halo.width <= window.width + 2 * halo


@settings(max_examples=100, deadline=None)
@given(shape=SHAPES, size=st.integers(1, 40))
def test_only_the_last_tiles_are_smaller(shape, size):
    tiles = list(tiles_of(shape, size))
    rows, cols = -(-shape[0] // size), -(-shape[1] // size)
    assert len(tiles) == rows * cols and not any(tile.window.empty for tile in tiles)
    assert all(tile.window.height == size for tile in tiles if tile.row < rows - 1)
    assert all(tile.window.width == size for tile in tiles if tile.col < cols - 1)


@settings(max_examples=60, deadline=None)
@given(shape=SHAPES, bands=st.integers(1, 4), size=st.integers(1, 40), dtype=st.sampled_from(["uint8", "uint16", "float32"]))
def test_bytes_of_tiles_add_up_to_those_of_the_array(shape, bands, size, dtype):
    one = spec(shape=(*shape, bands), dtype=dtype)
    assert sum(one.bytes_of(tile.window) for tile in tiles_of(shape, size)) == np.zeros(one.shape, dtype).nbytes


@settings(max_examples=60, deadline=None)
@given(shape=SHAPES, chunk=st.integers(1, 100))
def test_a_chunk_holds_whole_pixels_and_fits_into_the_raster(shape, chunk):
    chunks = spec(shape=(*shape, 4), chunk=chunk).chunks
    assert chunks == (min(chunk, shape[0]), min(chunk, shape[1]), 4)


@settings(max_examples=100, deadline=None)
@given(grid=GRIDS, col=st.floats(-50, 350), row=st.floats(-50, 350))
def test_ground_points_and_pixels_belong_to_each_other(grid, col, row):
    """The inverse of `pixel` is the affine transform, moved by half a cell."""
    a, _, c, _, e, f = grid.transform
    x, y = a * (col + 0.5) + c, e * (row + 0.5) + f
    tolerance = 1e-14 * max(abs(grid.west), abs(grid.north)) / grid.cell + 1e-9
    assert grid.pixel(x, y) == (pytest.approx(col, abs=tolerance), pytest.approx(row, abs=tolerance))


@pytest.mark.parametrize("nodata", [None, 0.0, -9999.0, float("nan")])
def test_a_specification_is_the_same_after_it_was_stored(nodata):
    """The store keeps it as an attribute of the array, and compares it with the one of the next run."""
    grid = MapGrid(west=1000.0, north=2000.0, cell=0.1, rows=30, cols=40)
    one = map_raster("a/z", grid, "float32", "EPSG:2100", 16, nodata=nodata, readers=("b",), axes=("y_fine", "x_fine"))
    assert RasterSpec.model_validate(one.model_dump(mode="json")).same(one)


@pytest.mark.parametrize(
    ("change", "text"), [({"shape": "wide"}, "shape"), ({"axes": ("y",)}, "axes"), ({"transform": (1.0, 0.0)}, "transform")]
)
def test_a_malformed_specification_is_refused(change, text):
    with pytest.raises(ValidationError, match=text):
        spec(**change)


def test_windows_are_sorted_by_row_then_column():
    windows = [Window(64, 0, 1, 1), Window(0, 64, 1, 1), Window(0, 0, 1, 1)]
    assert sorted(windows) == windows[::-1]
