"""Water that nobody outlined: named where heights are anywhere inside of a level shore, and nowhere else."""

import numpy as np
import pytest

from orthomill.schemas.maps.wanted_area import WantedArea
from orthomill.schemas.raster import MapGrid, Window, tiles_of
from orthomill.tasks.densification.report.densification_report import _place_warnings
from orthomill.tasks.densification.speckle_blocks import BlockBand, block_grid, speckle_blocks
from orthomill.tasks.densification.volume.confidence import Confidence
from orthomill.tasks.densification.water.water_places import NO_PLACES, FoundPlaces, WaterPlaces, water_places

GRID = MapGrid(west=500.0, north=900.0, cell=0.5, rows=210, cols=250)
COARSE = block_grid(GRID)
FACTOR = 4
ROW, COL = np.indices(GRID.shape)
POND = np.hypot((ROW - 100) / 50, (COL - 120) / 70) < 1
LEVEL = 31.0
EVERYWHERE = WantedArea()
LOOKED_FOR = 60.0


def land(slope: float = 0.05) -> np.ndarray:
    """Ground that rises away from the pond, whose shore is level, with the noise of matching."""
    away = np.maximum(np.hypot((ROW - 100) / 50, (COL - 120) / 70) - 1, 0) * 60 * GRID.cell
    return LEVEL + slope * away + np.random.default_rng(1).normal(0, 0.03, GRID.shape)


def blocks(raw: np.ndarray, incoherent: np.ndarray) -> np.ndarray:
    confidence = np.where(incoherent, Confidence.CALMED, Confidence.HIGH).astype(np.uint8)
    return speckle_blocks(raw.astype(np.float32), raw.astype(np.float32), confidence, FACTOR)


def found(raw: np.ndarray, incoherent: np.ndarray = POND, **more: WantedArea) -> FoundPlaces:
    return water_places(blocks(raw, incoherent), COARSE, **{"wanted": EVERYWHERE, "looked_for": LOOKED_FOR, **more})


def speckle(low: float, high: float) -> np.ndarray:
    """The land with heights anywhere between on the pond, m above its level."""
    return np.where(POND, LEVEL + np.random.default_rng(2).uniform(low, high, GRID.shape), land())


def test_a_pond_is_named_with_its_level_and_its_outline():
    water = found(speckle(-15, 40))
    (place,) = water.places.places
    assert place.level == pytest.approx(LEVEL, abs=0.15) and 0 < place.scatter < 0.3
    assert place.below == pytest.approx((15 - 0.03 * 54) / 55, abs=0.03) and place.spread == pytest.approx(54, abs=3)
    named = np.kron(water.numbers, np.ones((FACTOR, FACTOR)))[: GRID.rows, : GRID.cols] == 1
    assert (named & POND).sum() / (named | POND).sum() > 0.93
    assert place.area == pytest.approx(POND.sum() * GRID.cell**2, rel=0.06)
    assert water.areas.attributes[1]["level_m"] == f"{place.level:.2f}"


def test_a_wood_is_not_named_as_its_crowns_are_above_the_ground():
    assert found(speckle(-1, 18)).places == NO_PLACES


def test_shadow_on_level_ground_is_not_named_as_its_heights_lie_close_together():
    assert found(speckle(-1.5, 1.5)).places == NO_PLACES
    assert found(speckle(-8, 8)).places == NO_PLACES


def test_a_slope_is_not_named_whatever_its_heights_are():
    hill = np.where(POND, speckle(-15, 40), land() + 0.1 * (COL - 120) * GRID.cell)
    assert found(hill).places == NO_PLACES


def test_a_wide_hollow_on_one_side_is_not_named_as_water_would_run_there():
    assert found(np.where((COL > 120) & ~POND, land() - 4, speckle(-15, 40))).places == NO_PLACES


def test_single_wrong_heights_beside_a_pond_hide_it_not():
    wrong = np.where((np.abs(ROW - 100) < 10) & (COL > 120) & ~POND, land() - 20, speckle(-15, 40))
    (place,) = found(wrong).places.places
    assert place.level == pytest.approx(LEVEL, abs=0.2)


def test_what_is_cut_by_the_edge_of_the_photographs_is_not_named():
    raw = speckle(-15, 40)
    raw[:, 150:] = np.nan
    assert found(raw, POND & np.isfinite(raw)).places == NO_PLACES
    raw = speckle(-15, 40)[60:, :]
    cut = blocks(raw, POND[60:, :])
    grid = MapGrid(west=0.0, north=0.0, cell=2.0, rows=cut.shape[0], cols=cut.shape[1])
    assert water_places(cut, grid, EVERYWHERE, LOOKED_FOR).places == NO_PLACES
    half = ((500.0, 700.0), (560.0, 700.0), (560.0, 900.0), (500.0, 900.0))
    assert found(speckle(-15, 40), wanted=WantedArea(polygons=((half,),))).places == NO_PLACES


def test_what_is_outlined_is_not_named_again():
    lake = ((520.0, 820.0), (600.0, 820.0), (600.0, 880.0), (520.0, 880.0))
    assert found(speckle(-15, 40), outlined=WantedArea(polygons=((lake,),))).places == NO_PLACES


def test_a_puddle_is_too_small_to_tell():
    small = np.hypot(ROW - 100, COL - 120) < 12
    raw = np.where(small, LEVEL + np.random.default_rng(2).uniform(-15, 40, GRID.shape), LEVEL)
    assert found(raw, small).places == NO_PLACES


def test_the_largest_place_comes_first():
    ponds = (np.hypot(ROW - 60, COL - 60) < 22) | (np.hypot(ROW - 130, COL - 170) < 35)
    raw = np.where(ponds, np.random.default_rng(3).uniform(-15, 40, GRID.shape), 0.0) + LEVEL
    water = found(raw, ponds)
    assert [round(place.area) for place in water.places.places] == sorted(
        (round(p.area) for p in water.places.places), reverse=True
    )
    assert len(water.places.places) == 2 and water.numbers[130 // 4, 170 // 4] == 1 and water.numbers[60 // 4, 60 // 4] == 2
    (sentence,) = _place_warnings(water.places)
    assert sentence.startswith("2 places look like water that is not outlined (the largest")
    assert list(_place_warnings(WaterPlaces())) == []
    lake = water.places.places[0].model_copy(update={"area": 12345.6, "level": 7.0})
    assert next(_place_warnings(WaterPlaces(places=(lake,)))).startswith(
        "One place looks like water that is not outlined (12300 m² with a shore at 7.00 m):"
    )


@pytest.mark.parametrize("side", [64, 100])
def test_any_tiles_give_the_same_blocks(side):
    raw, confidence = speckle(-15, 40).astype(np.float32), np.where(POND, Confidence.COARSE, Confidence.HIGH).astype(np.uint8)
    raw[:30, :41] = np.nan
    whole = speckle_blocks(raw, raw, confidence, FACTOR)
    joined = np.zeros_like(whole)
    for tile in tiles_of(GRID.shape, side):
        part = tile.window.slices
        joined[tile.window.reduced(FACTOR).slices] = speckle_blocks(raw[part], raw[part], confidence[part], FACTOR)
    assert np.array_equal(whole, joined, equal_nan=True)


def test_blocks_say_what_is_there():
    raw = np.array([[1.0, 3.0, np.nan, 4.0, 7.0]], np.float32)
    confidence = np.array([[Confidence.HIGH, Confidence.HIGH, Confidence.LOW, Confidence.CALMED, Confidence.HIGH]], np.uint8)
    bands = speckle_blocks(raw, raw, confidence, 4)
    assert np.isnan(bands[0, :, BlockBand.MEASURED]).all()
    assert speckle_blocks(raw[:, :2], raw[:, :2], confidence[:, :2], 2)[0, 0, BlockBand.MEASURED] == 2.0
    assert bands[0, :, BlockBand.SEEN].tolist() == [3 / 4, 1]
    assert np.isnan(bands[..., BlockBand.SPECKLE]).all()


def test_large_surfaces_have_larger_blocks_and_tiles_remain_whole_blocks():
    assert COARSE.cell == 2.0
    large = block_grid(MapGrid(west=0.0, north=0.0, cell=1.0, rows=30_000, cols=30_000))
    assert large.cells <= 1 << 22 and large.cell == 16.0
    assert Window(1024, 0, 1024, 1024).reduced(16) == Window(64, 0, 64, 64)
