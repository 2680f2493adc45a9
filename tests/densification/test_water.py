"""Outlined water: its level from the shore, and one height inside."""

import numpy as np
import pytest
from pydantic import ValidationError

from orthomill.schemas.maps.wanted_area import WantedArea
from orthomill.schemas.raster import MapGrid, Window, tiles_of
from orthomill.schemas.surface import Provenance
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.stage import DensificationStage
from orthomill.tasks.densification.volume.confidence import Confidence
from orthomill.tasks.densification.water.water_levels import SHORE, WaterLevels, levelled, shore_windows, water_levels

GRID = MapGrid(west=0.0, north=100.0, cell=1.0, rows=100, cols=120)
LAKE = ((20.0, 30.0), (60.0, 30.0), (60.0, 70.0), (20.0, 70.0))
POND = ((100.0, 80.0), (110.0, 80.0), (110.0, 90.0))
OUTLINES = WantedArea(polygons=((LAKE,), (POND,)))
WHOLE = Window(0, 0, 100, 120)
ROW, COL = np.indices(GRID.shape)
EAST = COL > 60
"""a steep bank in the east of the lake"""


def heights() -> np.ndarray:
    """A flat shore at 5 m, the bank, and speckle on the water."""
    draw, wet = np.random.default_rng(3), OUTLINES.cells(GRID, WHOLE)
    land = np.where(EAST, 5.0 + 2.0 * (COL - 60), 5.0) + draw.normal(0, 0.02, GRID.shape)
    return np.where(wet, draw.normal(0, 30, GRID.shape), land).astype(np.float32)


def found(side: int, confidence: np.ndarray | None = None) -> WaterLevels:
    codes = np.full(GRID.shape, Confidence.HIGH, np.uint8) if confidence is None else confidence
    windows = shore_windows(OUTLINES, GRID, (tile.window for tile in tiles_of(GRID.shape, side)))
    height = heights()
    parts = [[raster[window.slices] for window in windows] for raster in (height, codes)]
    return water_levels(OUTLINES, GRID, windows, *map(iter, parts))


def test_the_level_is_that_of_the_flat_shore_whatever_the_bank_and_the_speckle_say():
    water = found(32)
    assert water.levels[0] == pytest.approx(5.0, abs=0.05) and 0 < water.sigmas[0] < 0.1
    assert water.unknown == 0


@pytest.mark.parametrize("side", [17, 64, 200])
def test_any_tiles_give_the_same_levels(side):
    assert found(side) == found(32)


def test_an_outline_without_a_measured_shore_has_no_level_and_changes_nothing():
    codes = np.full(GRID.shape, Confidence.HIGH, np.uint8)
    codes[:, 90:] = Confidence.LOW
    water = found(32, codes)
    assert water.unknown == 1 and water.levels[1] is None
    cells = levelled(coded(heights()), water, GRID, WHOLE)
    pond = WantedArea(polygons=((POND,),)).cells(GRID, WHOLE)
    assert np.array_equal(cells.height[pond], heights()[pond])


def test_inside_there_is_one_height_which_nobody_measured_and_outside_nothing_changes():
    water, before = found(32), coded(heights())
    for window in (WHOLE, Window(10, 15, 40, 33)):
        part = FusedCells(*(band[window.slices] for band in (before.height, before.precision, before.count, before.provenance)))
        after = levelled(part, water, GRID, window)
        lake = WantedArea(polygons=((LAKE,),)).cells(GRID, window)
        assert np.unique(after.height[lake]).tolist() == [np.float32(water.levels[0])]
        assert (after.provenance[lake] == Provenance.WATER).all() and (after.count[lake] == 0).all()
        assert after.precision[lake] == pytest.approx(water.sigmas[0])
        dry = ~OUTLINES.cells(GRID, window)
        assert np.array_equal(after.height[dry], part.height[dry]) and np.array_equal(after.provenance[dry], part.provenance[dry])


def test_only_windows_at_an_outline_are_read():
    windows = shore_windows(OUTLINES, GRID, (tile.window for tile in tiles_of(GRID.shape, 10)))
    rows = sorted({window.row for window in windows if window.col < 70})
    assert rows == [20, 30, 40, 50, 60, 70] and SHORE < 10


def test_water_is_refused_where_nothing_reads_it():
    with pytest.raises(ValidationError, match="water"):
        DensificationStage(matching={"kind": "vertical_line_locus"}, water="lakes.gpkg")
    assert DensificationStage(water="lakes.gpkg").water == "lakes.gpkg"


def coded(height: np.ndarray) -> FusedCells:
    sigma, count = np.full(GRID.shape, 0.1, np.float32), np.ones(GRID.shape, np.uint8)
    return FusedCells(height, sigma, count, np.full(GRID.shape, Provenance.ONE_PAIR, np.uint8))
