"""The stage on a model with known ground: accuracy and honesty of the terrain, equal for any tile size, and classes."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from box_scene import block
from hilly_ground import HOUSE, SIDE, SIGMA, TREES, bare_land, hilly_grid, model
from memory_runner import MemoryProject
from pydantic import ValidationError

from orthomill.schemas import bare_ground
from orthomill.schemas.bare_ground import (
    ABOVE_GROUND,
    CELL_CLASS,
    TERRAIN,
    TERRAIN_CODE,
    TERRAIN_PRECISION,
    CellClass,
    TerrainCode,
    point_classes_table,
)
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.raster import tiles_of
from orthomill.schemas.stage_report import report_table
from orthomill.schemas.surface import (
    DATUM_PRECISION,
    HEIGHT,
    PROVENANCE,
    RELATIVE_PRECISION,
    SURFACE,
    Provenance,
    Surface,
    SurfacePoints,
    points_table,
)
from orthomill.tasks.terrain.objects.object_classes import point_classes
from orthomill.tasks.terrain.stage import DrawContours, NoContours, TerrainStage

RASTERS = (TERRAIN, TERRAIN_PRECISION, TERRAIN_CODE, ABOVE_GROUND, CELL_CLASS)


@dataclass
class HillyProject(MemoryProject):
    """The model as a finished surface."""

    def fill(self, cell: float) -> "HillyProject":
        z, codes = model(cell)
        grid = hilly_grid(cell)
        for name, values in ((HEIGHT, z), (RELATIVE_PRECISION, np.full(z.shape, SIGMA, np.float32)), (PROVENANCE, codes)):
            self.put(name, values)
        self.put(DATUM_PRECISION, np.full(z.shape, 0.01, np.float32))
        self.tables |= {BLOCK.path: block(), SURFACE.path: Surface(grid=grid, height_low=90, height_high=120)}
        for tile in tiles_of(grid.shape, self.tile):
            x, y = (a.ravel() for a in np.meshgrid(*grid.centres(tile.window)))
            heights, some = z[tile.window.slices].ravel().astype(np.float64), np.full(x.size, 0.1, np.float32)
            ones = np.ones(x.size, np.uint8)
            self.tables[points_table(tile.row, tile.col).path] = SurfacePoints(
                x, y, heights, some, ones, ones, ones.astype(np.uint16)
            )
        return self


@cache
def terrain(tile: int, cell: float = 1.0, **settings) -> MemoryProject:
    project = HillyProject(tile).fill(cell)
    project.run(TerrainStage(**{"widest_object": 30 * cell, "max_gap": 60 * cell, **settings}))
    return project


def test_the_ground_under_a_house_and_trees_is_found_with_its_error():
    found = terrain(384).rasters
    off, sigma = found[TERRAIN] - bare_land(), found[TERRAIN_PRECISION]
    for place, limit in ((HOUSE, 0.3), (TREES, 0.2)):
        assert np.sqrt((off[place] ** 2).mean()) < limit
        assert (np.abs(off[place]) <= 3 * sigma[place]).mean() > 0.9
    open_ground = found[TERRAIN_CODE] == TerrainCode.MEASURED
    assert np.sqrt((off[open_ground] ** 2).mean()) < 1.3 * SIGMA


def test_codes_and_classes_say_what_stands_there():
    found = terrain(384).rasters
    codes, classes = found[TERRAIN_CODE], found[CELL_CLASS]
    assert (codes[HOUSE] == TerrainCode.UNDER_BUILDING).all() and (classes[HOUSE] == CellClass.BUILDING).mean() > 0.95
    assert (codes[TREES] == TerrainCode.UNDER_WOOD).mean() > 0.95
    assert (classes[TREES] == CellClass.HIGH_VEGETATION).mean() > 0.8
    assert (classes[:80, :80] == CellClass.GROUND).mean() > 0.98
    assert found[ABOVE_GROUND][HOUSE].mean() == pytest.approx((108 - bare_land()[HOUSE]).mean(), abs=0.3)


@pytest.mark.parametrize(
    "settings", [{}, {"cell": 0.25, "widest_object": 30.0, "max_gap": 20.0}], ids=["blocks of a cell", "of two"]
)
def test_any_tile_size_gives_the_same_bits(settings):
    one, several = (terrain(tile, **settings) for tile in (384, 128))
    for name in RASTERS:
        assert np.array_equal(one.rasters[name], several.rasters[name], equal_nan=True), name


def test_cells_finer_than_blocks_keep_what_is_smaller_than_a_block():
    found = terrain(384, cell=0.25, widest_object=30.0, max_gap=20.0).rasters
    z, _ = model(0.25)
    ground = found[TERRAIN_CODE] == TerrainCode.MEASURED
    assert ground.mean() > 0.8 and np.median(np.abs(found[TERRAIN] - z)[ground]) < 1e-4


def test_points_get_the_class_of_their_cell():
    project = terrain(384)
    classes = project.tables[point_classes_table(0, 0).path].classification.reshape(SIDE, SIDE)
    assert (classes[HOUSE] == CellClass.BUILDING).mean() > 0.95 and (classes[:80, :80] == CellClass.GROUND).mean() > 0.98


def test_a_point_is_judged_by_its_own_height():
    z = np.array([10.0, 10.1, 12.0, 7.0, 5.0])
    ground, sigma = np.full(5, 10.0), np.full(5, 0.1)
    cells = np.array([CellClass.GROUND, CellClass.HIGH_VEGETATION, CellClass.GROUND, CellClass.GROUND, CellClass.NONE], np.uint8)
    found = point_classes(z, ground, sigma, cells)
    assert found.tolist() == [CellClass.GROUND, CellClass.GROUND, CellClass.UNCLASSIFIED, CellClass.LOW_NOISE, CellClass.LOW_NOISE]


def test_waves_are_water_and_what_stands_out_of_it_is_not_classified():
    z, ground, sigma = np.array([10.05, 11.0, 9.0]), np.full(3, 10.0), np.full(3, 0.1)
    found = point_classes(z, ground, sigma, np.full(3, CellClass.WATER, np.uint8))
    assert found.tolist() == [CellClass.WATER, CellClass.UNCLASSIFIED, CellClass.UNCLASSIFIED]


LAKE = slice(20, 60), slice(200, 250)


def test_outlined_water_is_level_in_the_terrain_and_has_codes_of_its_own():
    dry, project = terrain(384), HillyProject(384).fill(1.0)
    for name, value in ((HEIGHT, 95.0), (RELATIVE_PRECISION, 0.2), (PROVENANCE, Provenance.WATER)):
        project.rasters[name][LAKE] = value
    project.run(TerrainStage(widest_object=30.0, max_gap=60.0))
    found = project.rasters
    assert (found[TERRAIN][LAKE] == 95.0).all() and (found[ABOVE_GROUND][LAKE] == 0.0).all()
    assert found[TERRAIN_PRECISION][LAKE] == pytest.approx(np.hypot(0.2, 0.01), abs=1e-3)
    assert (found[TERRAIN_CODE][LAKE] == TerrainCode.WATER).all() and (found[CELL_CLASS][LAKE] == CellClass.WATER).all()
    # What is learned of the whole block from its open ground changes a little.
    assert np.abs(found[TERRAIN] - dry.rasters[TERRAIN])[150:].max() < 0.1
    assert "% is guessed, 2 % is water." in project.tables[report_table("terrain").path].verdict.sentence


def test_the_report_tells_shares_errors_and_what_was_hidden():
    report = terrain(384).tables[report_table("terrain").path]
    figures = {figure.name: figure.value for figure in report.figures}
    codes = terrain(384).rasters[TERRAIN_CODE]
    assert figures["under_buildings_share"] == pytest.approx(100 * (codes == TerrainCode.UNDER_BUILDING).mean(), abs=0.01)
    assert figures["measured_sigma"] == pytest.approx(SIGMA, abs=0.02) and figures["hidden_blocks"] > 100
    assert "measured ground" in report.verdict.sentence and report.verdict.level == "good"


def test_a_surface_without_any_measured_height_has_no_terrain_and_says_so():
    project = HillyProject(384).fill(1.0)
    project.put(PROVENANCE, np.full((SIDE, SIDE), Provenance.INCOHERENT, np.uint8))
    project.run(TerrainStage(widest_object=30, max_gap=20, slope=0.2, steepest=0.6, roughness=0.2))
    assert np.isnan(project.rasters[TERRAIN]).all() and not project.rasters[TERRAIN_CODE].any()
    assert project.tables[report_table("terrain").path].verdict.level == "poor"


def test_contours_are_drawn_at_the_interval_that_is_asked_for_or_left_out():
    drawn = HillyProject(384).fill(1.0)
    drawn.run(TerrainStage(widest_object=30, max_gap=60, contours=DrawContours(interval=2.0, index_every=2)))
    lines = drawn.tables["terrain/contours/sheet_0-0.parquet"]
    assert set(np.unique(lines.height)) <= {98.0, 100.0, 102.0, 104.0, 106.0, 108.0} and len(lines) > 500
    assert set(lines.text[lines.height == 100.0]) == {"100"} and lines.dashed.any() and not lines.dashed.all()
    assert {export.format for export in drawn.exports.values()} >= {"gpkg", "dxf", "geojson"}
    without = HillyProject(384).fill(1.0)
    without.run(TerrainStage(widest_object=30, max_gap=60, contours=NoContours(kind="none")))
    assert not any(path.startswith("terrain/contours/sheet") for path in without.tables)


def test_contours_of_a_large_terrain_are_joined_sheet_by_sheet(monkeypatch):
    """All pieces of a map in one job asked for more memory than a worker has, from two hundred million cells on."""
    stage = TerrainStage(widest_object=30, max_gap=60, contours=DrawContours(interval=2.0, index_every=2))
    lengths = []
    for cells in (4096, 128):
        monkeypatch.setattr(bare_ground, "CONTOUR_SHEET", cells)
        drawn = HillyProject(96).fill(1.0)
        drawn.run(stage)
        sheets = [table for path, table in drawn.tables.items() if path.startswith("terrain/contours/sheet")]
        same = [np.diff(lines.line) == 0 for lines in sheets]
        lengths.append(sum(np.hypot(np.diff(s.x), np.diff(s.y))[one].sum() for s, one in zip(sheets, same, strict=True)))
    assert len(sheets) > 1 and lengths[1] == pytest.approx(lengths[0], rel=0.01)


@pytest.mark.parametrize("wrong", [{"widest_object": 0}, {"slope": -0.1}, {"max_gap": 0}])
def test_settings_have_bounds(wrong):
    with pytest.raises(ValidationError):
        TerrainStage(**wrong)
