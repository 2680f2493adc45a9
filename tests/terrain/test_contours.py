"""Contours: where they run, what they say of the ground, and that tiles do not show."""

import numpy as np
import pytest

from orthomill.schemas.bare_ground import ContourLines, TerrainCode
from orthomill.schemas.raster import MapGrid, Window, tiles_of
from orthomill.tasks.terrain.contours.contour_interval import ContourInterval, contour_interval
from orthomill.tasks.terrain.contours.contour_pieces import HALO, contour_pieces, smoothed
from orthomill.tasks.terrain.contours.joined_contours import join_contours
from orthomill.tasks.terrain.terrain_sums import TerrainSums

SIDE, SIGMA = 120, 0.05
GRID = MapGrid(west=500.0, north=900.0, cell=0.5, rows=SIDE, cols=SIDE)


def cone(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """m: a cone of slope 0.3 about the middle of the grid."""
    return 50.0 - 0.3 * np.hypot(x - 530.0, y - 870.0)


def hill() -> np.ndarray:
    x, y = GRID.centres(Window(0, 0, SIDE, SIDE))
    return cone(x[None, :], y[:, None]) + np.random.default_rng(3).normal(0, SIGMA, (SIDE, SIDE))


def codes() -> np.ndarray:
    found = np.full((SIDE, SIDE), TerrainCode.MEASURED, np.uint8)
    found[:, 70:100] = TerrainCode.UNDER_WOOD
    return found


def contours(tile: int, interval: float = 0.5, every: int = 5) -> ContourLines:
    step = ContourInterval(interval=interval, sigma=SIGMA)
    parts = []
    for t in tiles_of(GRID.shape, tile):
        core = Window(t.window.row, t.window.col, t.window.height + 1, t.window.width + 1).clipped(GRID.shape)
        outer = core.grown(HALO).clipped(GRID.shape)
        at = outer.slices
        sigma = np.full(outer.shape, SIGMA, np.float32)
        parts.append(contour_pieces(hill()[at].astype(np.float32), sigma + 2, sigma, codes()[at], step, GRID, (outer, core)))
    return join_contours(tuple(parts), step, GRID.cell, every)


def test_every_vertex_is_at_its_height_within_two_standard_errors():
    lines = contours(SIDE)
    off = cone(lines.x, lines.y) - lines.height
    assert (np.abs(off) <= 2 * SIGMA).mean() > 0.95 and len(np.unique(lines.height)) > 20


def test_contours_are_dashed_over_wood_and_nowhere_else():
    lines = contours(SIDE)
    col = GRID.pixel(lines.x, lines.y)[0]
    inside = (col > 72) & (col < 97)
    assert lines.dashed[inside].all() and not lines.dashed[col < 65].any()
    assert np.array_equal(lines.dashed, ~lines.measured)
    assert set(np.unique(lines.layer)) == {"CONTOUR", "CONTOUR_DASHED", "CONTOUR_INDEX", "CONTOUR_INDEX_DASHED"}


def test_every_fifth_contour_is_an_index_contour_with_its_height():
    lines = contours(SIDE)
    assert np.array_equal(lines.index, np.isclose(lines.height % 2.5, 0) | np.isclose(lines.height % 2.5, 2.5))
    assert set(lines.text[~lines.index]) == {""} and "45" in set(lines.text[lines.index])


@pytest.mark.parametrize("tile", [30, 64])
def test_tiles_do_not_show(tile):
    one, several = contours(SIDE), contours(tile)
    for name in ("line", "x", "y", "height", "dashed", "sigma"):
        assert np.array_equal(getattr(one, name), getattr(several, name)), name


def test_smoothing_moves_no_cell_by_more_than_its_standard_error():
    z = hill()
    z[40:44, 40:50] = np.nan
    rough = smoothed(z, np.full(z.shape, 0.02))
    assert np.nanmax(np.abs(rough - z)) <= 0.02 + 1e-12 and np.array_equal(np.isnan(rough), np.isnan(z))
    x, y = GRID.centres(Window(0, 0, SIDE, SIDE))
    free = smoothed(hill(), np.full(z.shape, 1.0)) - cone(x[None, :], y[:, None])
    assert free[10:50, 10:50].std() < 0.5 * SIGMA


def sums(sigma: float, low: float | None, high: float | None, cells: int = 100) -> TerrainSums:
    return TerrainSums(
        cells=(0, cells, 0, 0, 0),
        squares=(0, cells * (sigma + 2.0) ** 2, 0, 0, 0),
        relative=cells * sigma**2,
        classes=(0,),
        tallest=0.0,
        lowest=low,
        highest=high,
    )


@pytest.mark.parametrize(
    ("sigma", "high", "interval"), [(0.05, 12.0, 0.2), (0.14, 12.0, 0.5), (0.001, 4.0, 0.05), (0.05, 300.0, 5.0), (0.5, 12.0, 2.0)]
)
def test_the_interval_follows_from_the_accuracy_of_the_shape_of_the_ground(sigma, high, interval):
    """The whole of it is off by two metres more, as a block without control may be: that moves contours and blurs none."""
    assert contour_interval((sums(sigma, 10.0, high), sums(0.0, None, None, 0)), None).interval == pytest.approx(interval)


def test_an_interval_that_is_asked_for_is_kept_and_an_empty_terrain_has_no_lines():
    assert contour_interval((sums(0.05, 10.0, 12.0),), 0.3).interval == 0.3
    empty = np.full((10, 10), np.nan, np.float32)
    window = Window(0, 0, 10, 10)
    step = ContourInterval(interval=1.0, sigma=None)
    pieces = contour_pieces(empty, empty, empty, np.zeros((10, 10), np.uint8), step, GRID, (window, window))
    assert len(pieces) == 0 and len(join_contours((pieces,), step, 1.0, 5)) == 0
