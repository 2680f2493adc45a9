"""Grids that nest, pyramid levels, and windows that hold all that a tile needs."""

from dataclasses import replace

import numpy as np
import pytest
from box_scene import CENTRES, DSM, ORTHO, heights, view
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.geometry.photograph_part import PhotoSource, level_window, photo_level
from orthomill.tasks.texture.ground.extent import dsm_core, ground_pixels, heights_window, ortho_grid, tile_extent
from orthomill.tasks.texture.ground.relief import Relief, ReliefMap, tile_relief

RELIEF = ReliefMap(tile_relief(heights(), Window(0, 0, *DSM.shape)), DSM)
VIEWS = [view(name) for name in CENTRES]


@settings(max_examples=60, deadline=None)
@given(ground=st.floats(0.02, 5.0))
def test_the_automatic_cell_nests_and_is_about_the_ground_pixel(ground):
    grid = ortho_grid(DSM, None, ground)
    divisor = DSM.cell / grid.cell
    assert divisor == pytest.approx(round(divisor)) and (grid.rows, grid.cols) == (DSM.rows * round(divisor),) * 2
    assert (grid.west, grid.north) == (DSM.west, DSM.north)
    assert grid.cell <= max(1.25 * ground, 0) + 1e-12 or divisor == 1
    assert grid.cell > ground / 2.3 or divisor == 1


@pytest.mark.parametrize(("cell", "divisor"), [(1.0, 1), (0.5, 2), (0.25, 4), (0.1, 10), (1 / 3, 3)])
def test_a_cell_that_divides_the_models_is_taken(cell, divisor):
    assert ortho_grid(DSM, cell, 99.0).cols == DSM.cols * divisor


@pytest.mark.parametrize(("cell", "advice"), [(0.4, "use 0.5 m or auto"), (3.0, "use 1 m or auto"), (0.7, "use 1 m or auto")])
def test_a_cell_that_does_not_nest_is_refused_with_one_that_does(cell, advice):
    with pytest.raises(WorkflowError, match=advice):
        ortho_grid(DSM, cell, 0.5)


@settings(max_examples=60, deadline=None)
@given(cell=st.floats(0.01, 100.0), levels=st.integers(1, 8))
def test_the_pyramid_level_is_the_nearest_by_ratio(cell, levels):
    level = photo_level(cell, 0.1, levels)
    assert 0 <= level < levels
    ratios = [abs(np.log2(cell / (0.1 * 2**other))) for other in range(levels)]
    assert ratios[level] <= min(ratios) + 1e-9


def test_ground_pixels_follow_the_height_above_ground():
    half, whole = (ground_pixels(VIEWS, ground) for ground in (100.0, 0.0))
    assert whole == pytest.approx([v.centre[2] / v.camera.c for v in VIEWS])
    assert all(near < far for near, far in zip(half, whole, strict=True))


@settings(max_examples=60, deadline=None)
@given(
    row=st.integers(0, 300), col=st.integers(0, 300), height=st.integers(1, 90), width=st.integers(1, 90), level=st.integers(0, 4)
)
def test_a_window_of_a_level_covers_the_full_size_one(row, col, height, width, level):
    shape = (-(-420 // 2**level),) * 2
    found = level_window(Window(row, col, height, width), level, shape)
    assert found.row * 2**level <= row and found.col * 2**level <= col
    bottom, right = (found.row + found.height) * 2**level, (found.col + found.width) * 2**level
    assert bottom >= min(row + height, 420) and right >= min(col + width, 420)


@pytest.mark.parametrize("divisor", [1, 2, 5])
def test_the_cells_under_a_window_of_the_orthoimage(divisor):
    window = Window(7, 12, 30, 41)
    core = dsm_core(DSM, divisor, window)
    rows = {row // divisor for row in range(window.row, window.row + window.height)}
    cols = {col // divisor for col in range(window.col, window.col + window.width)}
    assert (core.row, core.height) == (min(rows), len(rows)) and (core.col, core.width) == (min(cols), len(cols))


def test_heights_are_read_towards_every_projection_centre():
    core = Window(50, 50, 10, 10)
    alone = {name: heights_window(RELIEF, [view(name)], core, 0) for name in CENTRES}
    west, east = alone["a"], alone["c"]
    assert west.col < core.col - 1 and west.col + west.width <= core.col + core.width + 2
    assert east.col + east.width > core.col + core.width + 1 and east.col >= core.col - 2
    together = heights_window(RELIEF, VIEWS, core, 0)
    for window in alone.values():
        assert together.row <= window.row and together.col <= window.col
        assert together.row + together.height >= window.row + window.height


def test_the_halo_grows_the_window_on_every_side():
    core = Window(50, 50, 10, 10)
    small, large = (heights_window(RELIEF, VIEWS[:1], core, halo) for halo in (0, 7))
    assert small.grown(7).clipped(DSM.shape) == large


def relief_of(model: np.ndarray) -> ReliefMap:
    return ReliefMap(tile_relief(model, Window(0, 0, *model.shape)), MapGrid(west=0.0, north=0.0, cell=1.0, rows=512, cols=512))


def test_a_window_reads_as_far_as_the_relief_asks_and_not_as_far_as_the_highest_mountain():
    """A ray from height 0 is 20 m high after a tenth of its way to a centre at 200 m."""
    photo = replace(view("a"), centre=np.array([1256.5, -280.5, 200.0]))
    ramp, core = np.zeros((512, 512), np.float32), Window(280, 0, 1, 1)
    ramp[:, 100] = 20.0
    near = heights_window(relief_of(ramp), [photo], core, 0)
    assert near.col == 0 and 100 < near.col + near.width <= 100 + 66 and near.height < 8
    ramp[:, 100] = 19.0 * 100 / 1256
    assert heights_window(relief_of(ramp), [photo], core, 0).width <= 66
    ramp[:100, 500] = 190.0  # off the way of the ray
    assert heights_window(relief_of(ramp), [photo], core, 0).width <= 66


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), row=st.integers(0, 480), col=st.integers(0, 480), height=st.floats(20.0, 400.0))
def test_every_cell_that_rises_above_a_ray_is_in_the_window(seed, row, col, height):
    rng = np.random.default_rng(seed)
    model = rng.normal(0, 1, (512, 512)).astype(np.float32)
    for top, left in rng.integers(0, 480, (6, 2)):
        model[top : top + 20, left : left + 20] += rng.uniform(0, 30)
    core = Window(row, col, 24, 24)
    photo = replace(view("a"), centre=np.array([*rng.uniform(-300, 800, 2) * [1, -1], height + 40]))
    window = heights_window(relief_of(model), [photo], core, 0)
    col0, row0 = photo.centre[0] - 0.5, -photo.centre[1] - 0.5
    for r, c in ((row, col), (row + 23, col), (row, col + 23), (row + 23, col + 23)):
        share = np.linspace(0, 1, 4000)
        rays = model[r, c] + share * (photo.centre[2] - model[r, c])
        at = np.rint(r + share * (row0 - r)).astype(int), np.rint(c + share * (col0 - c)).astype(int)
        on = (at[0] >= 0) & (at[0] < 512) & (at[1] >= 0) & (at[1] < 512)
        rows, cols = at[0][on], at[1][on]
        hidden = model[rows, cols] > rays[on]
        inside = (rows >= window.row) & (rows < window.row + window.height)
        inside &= (cols >= window.col) & (cols < window.col + window.width)
        assert inside[hidden].all()


def test_a_tile_without_heights_reads_no_photograph():
    empty = ReliefMap(Relief(*(np.zeros(0, kind) for kind in (np.int32, np.int32, np.float32, np.float32))), DSM)
    extent = tile_extent(empty, ORTHO, Window(0, 0, 64, 64), [PhotoSource(one, 0, (420, 420, 3)) for one in VIEWS], 3)
    assert extent.photos == () and extent.heights.height < 45


def test_photographs_that_do_not_show_a_tile_are_left_out():
    sources = [PhotoSource(one, 0, (420, 420, 3)) for one in VIEWS]
    far = replace(VIEWS[0], name="far", centre=VIEWS[0].centre + np.array([5000.0, 0.0, 0.0]))
    extent = tile_extent(RELIEF, ORTHO, Window(0, 0, 64, 64), [*sources, PhotoSource(far, 0, (420, 420, 3))], 3)
    assert "far" not in {part.name for part in extent.photos} and len(extent.photos) >= 2
    assert extent.divisor == 2


@pytest.mark.parametrize("level", [0, 1, 2])
def test_the_parts_of_photographs_hold_the_projected_tile(level):
    window = Window(100, 60, 50, 70)
    shape = (-(-420 // 2**level), -(-420 // 2**level), 3)
    extent = tile_extent(RELIEF, ORTHO, window, [PhotoSource(one, level, shape) for one in VIEWS], 3)
    x, y = ORTHO.centres(window)
    corners = np.array([(a, b, z) for a in (x[0], x[-1]) for b in (y[0], y[-1]) for z in (0.0, 14.0)])
    for part in extent.photos:
        pixels = view(part.name).project(corners) / 2**level
        inside = view(part.name).contains(view(part.name).project(corners))
        held = part.window
        assert part.level == level
        assert (pixels[inside, 0] >= held.col).all() and (pixels[inside, 0] <= held.col + held.width).all()
        assert (pixels[inside, 1] >= held.row).all() and (pixels[inside, 1] <= held.row + held.height).all()


def test_a_coarse_model_has_one_pixel_per_cell_at_least():
    coarse = MapGrid(west=0.0, north=100.0, cell=0.2, rows=500, cols=500)
    assert ortho_grid(coarse, None, 5.0).cell == 0.2
