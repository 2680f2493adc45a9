"""A surface from elsewhere: its grid, its place, its shift, and the sentences for those that cannot be right."""

import numpy as np
import pytest
from checked_ground import GRID, ground, project
from memory_runner import MemoryProject
from scipy.ndimage import binary_dilation
from tiny_block import EAST, FLYING, HEIGHT, NORTH, block, surface

from orthomill.schemas.epipolar import EpipolarPairs
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.maps.wanted_area import WantedArea
from orthomill.schemas.observations import GroundPoints
from orthomill.schemas.photo import photo_raster
from orthomill.schemas.project import MapSurface
from orthomill.schemas.raster import MapGrid, RasterSpec, Window
from orthomill.schemas.stage_report import report_table
from orthomill.schemas.surface import CORRECTED, GIVEN_HEIGHT, ORTHO, SURFACE, CheckCode, Provenance
from orthomill.schemas.surface import HEIGHT as MEASURED_HEIGHT
from orthomill.tasks.dsm_check.area_map import AreaRule, area_map, outlines
from orthomill.tasks.dsm_check.areas import SuspiciousArea
from orthomill.tasks.dsm_check.stage import DsmCheckStage, SurfaceFile
from orthomill.tasks.dsm_check.surfaces.foreign_grid import foreign_surface
from orthomill.tasks.dsm_check.surfaces.placing import place, places
from orthomill.tasks.dsm_check.surfaces.surface_shift import SurfaceShift, surface_shift
from orthomill.tasks.dsm_check.surfaces.taken_surface import InsideArea, painted_surface, take_file
from orthomill.tasks.epipolar.pair_choice import PairChoice
from orthomill.tasks.epipolar.selection import choose_pairs
from orthomill.tasks.texture.stage import TextureStage

PAIRS = choose_pairs(block(), PairChoice(), 0.08)


def extent(cell: float, west: float = EAST - 5000, side: float = 10_000.0) -> MapGrid:
    rows = round(side / cell)
    return MapGrid(west=west, north=NORTH + 5000, cell=cell, rows=rows, cols=rows)


@pytest.mark.parametrize(("cell", "expected"), [(0.6, 0.6), (0.02, 1.0), (30.0, 1.0)])
def test_cells_that_suit_the_photographs_are_kept_and_a_country_is_cut(cell, expected):
    grid = foreign_surface(extent(cell), block(), PAIRS).grid
    assert grid.cell == pytest.approx(expected)
    assert 100 < grid.rows * grid.cell < 800 and 100 < grid.cols * grid.cell < 800
    assert grid.west < EAST - 100 and grid.north > NORTH + 80


def test_a_surface_elsewhere_is_told_with_its_distance():
    with pytest.raises(GeometryError, match=r"elsewhere.* is 4\d\.\d km from that of the photographs"):
        foreign_surface(extent(1.0, EAST + 40_000), block(), PAIRS)
    with pytest.raises(GeometryError, match="No two photographs see common ground"):
        foreign_surface(extent(1.0), block(), EpipolarPairs(pairs=()))


@pytest.mark.parametrize("drawn", [False, True])
def test_an_area_that_is_asked_for_bounds_a_surface_from_elsewhere_to_the_letter(drawn):
    bounds = EAST - 30.3, NORTH - 20.7, EAST + 40.2, NORTH + 25.2
    ring = tuple((bounds[i], bounds[j]) for i, j in ((0, 1), (2, 1), (2, 3), (0, 3)))
    asked = MapSurface(origin=(0.3, 0.3), cell=1.5) if drawn else MapSurface(area=bounds, origin=(0.3, 0.3), cell=1.5)
    wanted = WantedArea(polygons=((ring,),)) if drawn else None
    found = foreign_surface(extent(0.6), block(), PAIRS, asked, wanted=wanted)
    west, south, east, north = bounds
    grid = found.grid
    assert grid.cell == 1.5 and (grid.west - 0.3) % 1.5 == pytest.approx(0) and (grid.north - 0.3) % 1.5 == pytest.approx(0)
    assert west - 1.5 < grid.west <= west and north <= grid.north < north + 1.5
    assert east <= grid.west + grid.cols * 1.5 < east + 1.5 and south - 1.5 < grid.north - grid.rows * 1.5 <= south
    assert found.wanted == (wanted or WantedArea())


def test_an_area_without_ground_in_common_is_refused_with_its_corners():
    with pytest.raises(GeometryError, match=r"no ground in common in the area.*x = 410000.*--area"):
        foreign_surface(extent(1.0), block(), PAIRS, MapSurface(area=(EAST + 10_000, NORTH, EAST + 10_100, NORTH + 100)))


def tie_points(shift: float = 0.0) -> GroundPoints:
    random = np.random.default_rng(1)
    x, y = EAST + random.uniform(-80, 80, 60), NORTH + random.uniform(-60, 60, 60)
    none = np.zeros(60, np.float32)
    return GroundPoints(np.arange(60), x, y, surface(x, y) + shift, none, none, none, none.astype(np.int16), none)


def heights_on(grid: MapGrid) -> np.ndarray:
    x, y = np.meshgrid(grid.west + (np.arange(grid.cols) + 0.5) * grid.cell, grid.north - (np.arange(grid.rows) + 0.5) * grid.cell)
    return surface(x, y).astype(np.float32)


def test_a_surface_is_placed_by_the_tie_points():
    coarse = places(GRID)
    assert max(coarse.shape) <= 256
    found = place(heights_on(coarse) + 37.5, block(), coarse, "a.tif", tie_points())
    assert found.up == pytest.approx(-37.5, abs=0.1) and found.points == 60


def test_without_tie_points_only_what_cannot_be_right_is_moved():
    coarse = places(GRID)
    assert place(heights_on(coarse) + 3, block(), coarse, "a.tif").up == 0.0
    assert place(heights_on(coarse) + 60, block(), coarse, "a.tif").up == pytest.approx(-60, abs=3)


def test_feet_and_empty_surfaces_are_refused_in_one_sentence():
    coarse = places(GRID)
    for points in (tie_points(), None):
        with pytest.raises(GeometryError, match=r"a\.tif are in feet"):
            place(heights_on(coarse) / np.float32(0.3048), block(), coarse, "a.tif", points)
    with pytest.raises(GeometryError, match="has no height where the photographs are"):
        place(np.full(coarse.shape, np.nan, np.float32), block(), coarse, "a.tif")


def blocks_of(east: float, north: float, up: float, noise: float = 0.02) -> np.ndarray:
    """Blocks of a surface shifted by so much: dh = s . grad - z."""
    random = np.random.default_rng(5)
    out = np.zeros((40, 50, 5), np.float32)
    slope = random.normal(0, 0.15, (40, 50, 2))
    out[..., 0], out[..., 2], out[..., 3:] = 1.0, 0.05, slope
    out[..., 1] = slope @ (east, north) - up + random.normal(0, noise, (40, 50))
    out[5:10, 5:12, 1] += 8.0  # a house that is missing
    return out


def test_a_shift_in_height_and_plan_comes_out_within_its_standard_error():
    found = surface_shift(blocks_of(0.8, -0.5, 1.25), 8)
    assert abs(found.up - 1.25) < 4 * found.up_sigma < 0.02
    for value, true, sigma in zip((found.east, found.north), (0.8, -0.5), found.plan_sigma, strict=True):
        assert abs(value - true) < 4 * sigma < 0.1
    assert found.in_plan and not surface_shift(blocks_of(0.0, 0.0, 0.5), 8).in_plan
    assert surface_shift(blocks_of(1, 1, 1) * 0, 8).blocks == 0


def test_roofs_do_not_hide_a_shift_in_plan():
    """Blocks with the edge of a roof: steep, and nothing of it shows in their corrections."""
    coarse = blocks_of(1.2, -0.7, 0.4)
    steep = np.random.default_rng(8).random(coarse.shape[:2]) < 0.08
    coarse[steep, 3], coarse[steep, 1] = 0.9, -0.4
    found = surface_shift(coarse, 8)
    assert found.east is not None and found.north is not None and found.plan_sigma is not None
    assert abs(found.east - 1.2) < 3 * found.plan_sigma[0] + 0.02 and abs(found.north + 0.7) < 3 * found.plan_sigma[1] + 0.02


def test_the_smoothed_feet_of_walls_do_not_pull_a_shift():
    """Walls to the east of every place: beside them the surface slopes and is too high, which is no shift."""
    coarse = blocks_of(0.0, 0.0, 0.0)
    coarse[:, 20:40:6, 3], coarse[:, 20:40:6, 1] = 0.9, 0.0
    for col in range(20, 40, 6):
        coarse[:, col - 1, 3], coarse[:, col - 1, 1] = 0.3, -0.25
    found = surface_shift(coarse, 8)
    assert found.east is not None and found.plan_sigma is not None and abs(found.east) < 3 * found.plan_sigma[0] < 0.1
    assert abs(found.up) < 0.01


def test_a_shift_in_plan_that_is_not_beyond_doubt_moves_nothing():
    slope, doubtful = (0.1, 0.0), {"east": 2.0, "north": 0.0, "plan_sigma": (1.0, 1.0)}
    found = SurfaceShift(up=0.7, up_sigma=0.01, blocks=100, slope=slope, **doubtful)
    assert found.level == pytest.approx(0.5)
    assert found.certain.east is None and found.certain.up == pytest.approx(0.5)
    sure = found.model_copy(update={"plan_sigma": (0.1, 0.1)})
    assert sure.certain == sure


def test_few_blocks_tell_the_height_alone():
    found = surface_shift(blocks_of(0.8, -0.5, 1.25)[20:25, 20:25], 8)
    assert found.east is None and not found.in_plan and abs(found.up - 1.25) < 1.0


def test_blocks_that_all_slope_alike_tell_the_height_alone():
    """A surface in wide cells has one height a block, and no slope: its shift in plan was stated as nothing, known to nothing."""
    level = blocks_of(0.0, 0.0, 1.25)
    level[..., 3:] = 0.0
    found = surface_shift(level, 8)
    assert found.east is None and found.plan_sigma is None and found.up == pytest.approx(1.25, abs=4 * found.up_sigma)


def test_many_blocks_of_one_group_tell_the_height_alone():
    """One group has no scatter, and a shift in plan without a standard error would be beyond every doubt."""
    found = surface_shift(blocks_of(0.8, -0.5, 1.25)[24:32, 24:32], 8)
    assert found.blocks == 64 and found.east is None and not found.in_plan


def test_holes_take_what_the_photographs_measured_and_nothing_else():
    heights = np.array([[1.0, np.nan, np.nan, np.inf]], np.float32)
    matched = np.array([[9.0, 9.0, 9.0, 9.0]], np.float32)
    codes = np.array([[Provenance.AGREED, Provenance.AGREED, Provenance.INTERPOLATED, Provenance.ONE_PAIR]], np.uint8)
    everywhere = InsideArea(WantedArea(), GRID, Window(0, 0, 1, 4))
    taken = take_file(heights, 0.5, everywhere, matched, codes)
    np.testing.assert_array_equal(taken.input, np.array([[1.5, 9.0, np.nan, 9.0]], np.float32))
    np.testing.assert_array_equal(taken.filled, [[0, 1, 0, 1]])
    assert not take_file(heights, 0.0, everywhere).filled.any()


def test_outside_of_the_polygons_nothing_is_taken_of_a_file():
    x, y = GRID.centres(Window(0, 0, 1, 4))
    ring = ((x[1] - 0.1, y[0] - 1), (x[2] + 0.1, y[0] - 1), (x[2] + 0.1, y[0] + 1), (x[1] - 0.1, y[0] + 1))
    inside = InsideArea(WantedArea(polygons=((ring,),)), GRID, Window(0, 0, 1, 4))
    np.testing.assert_array_equal(
        np.isfinite(take_file(np.ones((1, 4), np.float32), 0.0, inside).input), [[False, True, True, False]]
    )


def checked_file(planted, **choices) -> MemoryProject:
    made = project(256, planted, hole=False)
    heights = made.rasters.pop(MEASURED_HEIGHT)
    del made.tables[SURFACE.path]
    made.files = {"other.tif": (GRID, heights)}
    made.run(DsmCheckStage(surface=SurfaceFile(kind="file", path="other.tif", **choices), rounds=1, levels=0, pairs=3))
    return made


@pytest.mark.slow
def test_a_surface_in_another_height_system_keeps_it_and_its_shift_is_told():
    made = checked_file(lambda x, y: 0 * x + 33.0)
    report = made.tables[report_table("dsm_check").path]
    figures = {figure.name: figure.value for figure in report.figures}
    assert figures["shift_up"] == pytest.approx(33.0, abs=0.03) and abs(figures["dh_median"]) < 0.03
    assert any("m above the photographs" in warning and "another height system" in warning for warning in report.warnings)
    x, y = ground()
    kept = made.rasters[CORRECTED] - surface(x, y)
    assert np.median(kept) == pytest.approx(33.0, abs=0.03)
    assert figures["suspicious_areas"] == 0


def test_a_shift_is_taken_out_when_that_is_asked_for():
    made = checked_file(lambda x, y: 0 * x + 2.0, shift="remove")
    x, y = ground()
    assert abs(np.median(made.rasters[CORRECTED] - surface(x, y))) < 0.06


@pytest.mark.parametrize("shift", ["keep", "remove"])
def test_a_shift_in_plan_of_several_cells_is_told_as_it_was_planted(shift):
    made = checked_file(lambda x, y: surface(x - 2.4, y + 1.8) + 0.7 - surface(x, y), shift=shift)
    report = made.tables[report_table("dsm_check").path]
    figures = {figure.name: figure.value for figure in report.figures}
    assert figures["shift_up"] == pytest.approx(0.7, abs=0.02)
    assert figures["shift_plan_sigma"] < 0.1
    for name, planted in (("shift_east", 2.4), ("shift_north", -1.8)):
        assert figures[name] == pytest.approx(planted, abs=max(0.04, 3 * figures["shift_plan_sigma"]))
    (told,) = [warning for warning in report.warnings if "too far east" in warning]
    assert ("it was taken out" in told) == (shift == "remove")
    x, y = ground()
    off = made.rasters[CORRECTED] - surface(x, y)
    assert np.nanmedian(np.abs(off)) < 0.05 or shift == "keep"


def test_what_an_earlier_surface_shows_otherwise_is_change_and_no_error():
    made = checked_file(lambda x, y: np.where(np.hypot(x - EAST, y - NORTH) < 25, -1.0, 0.0), epoch="earlier")
    warnings = made.tables[report_table("dsm_check").path].warnings
    assert any("The ground has changed" in warning and "risen by about" in warning for warning in warnings), warnings
    assert not any("Photographs and surface disagree" in warning for warning in warnings)


@pytest.mark.slow
def test_the_orthoimage_of_a_checked_file_lies_at_the_heights_of_the_photographs():
    made = project(256, lambda x, y: 0 * x + 33.0, hole=False)
    made.files = {"other.tif": (GRID, made.rasters.pop(MEASURED_HEIGHT))}
    del made.tables[SURFACE.path]
    made.has_stage = lambda kind: kind in ("dsm_check", "texture")
    made.run(DsmCheckStage(surface=SurfaceFile(kind="file", path="other.tif", sigma=0.1), rounds=1, levels=0, pairs=3))
    for name in (photo_raster(name) for name in block().names):
        pixels = made.rasters[name]
        made.specs[name] = RasterSpec(name=name, shape=pixels.shape, dtype="uint8", chunk=256)
    made.run(TextureStage(cell=0.6))
    x, y = ground()
    assert np.median(made.rasters[CORRECTED] - surface(x, y)) == pytest.approx(33.0, abs=0.03)
    assert abs(np.median(made.rasters[GIVEN_HEIGHT] - surface(x, y))) < 0.03
    assert (made.rasters[ORTHO].max(axis=2) > 0).mean() > 0.5
    assert made.tables[report_table("texture").path].verdict is not None


@pytest.mark.slow
def test_holes_of_a_file_are_filled_by_matching_in_the_height_system_of_the_file():
    made = project(256, lambda x, y: 0 * x, hole=False)
    x, y = ground()
    heights = (surface(x, y) + 7.0).astype(np.float32)
    heights[100:130, 240:280] = np.nan
    made.files = {"other.tif": (GRID, heights)}
    made.has_stage = lambda kind: kind == "densification"
    source = SurfaceFile(kind="file", path="other.tif", holes="fill")
    made.run(DsmCheckStage(surface=source, rounds=1, levels=0, pairs=3))
    codes, hole = made.rasters["dsm_check/code"], np.isnan(heights)
    assert (codes[hole] == CheckCode.FILLED).all()
    # Between cells a height beside a hole is none.
    assert not (codes[~binary_dilation(hole, np.ones((3, 3)))] == CheckCode.FILLED).any()
    assert np.abs(made.rasters[CORRECTED] - surface(x, y) - 7.0)[hole].max() < 0.1


def test_areas_are_polygons_on_the_earth():
    blocks = np.argwhere(np.array([[1, 1, 1, 0], [1, 0, 1, 0], [1, 1, 1, 1]]))
    (rings,) = outlines(blocks)
    assert len(rings) == 2 and (rings[0][0] == rings[0][-1]).all()
    area = SuspiciousArea(x=EAST, y=NORTH, area=1.0, dh=-2.0, extreme=-3.0, blocks=blocks)
    (feature,) = area_map([area], AreaRule(GRID, 8, "EPSG:2100")).features
    longitude, latitude = np.array(feature.geometry.coordinates[0][0]).T
    assert ((longitude > 20) & (longitude < 28)).all() and ((latitude > 34) & (latitude < 42)).all()
    assert feature.properties["surface"] == "too high" and FLYING > HEIGHT


def test_blocks_that_touch_at_a_corner_are_two_outlines():
    assert len(outlines(np.array([[0, 0], [1, 1]]))) == 2


def test_a_corrected_surface_is_painted_at_the_heights_of_the_photographs():
    corrected = np.array([[12.0, np.nan]], np.float32)
    painted = painted_surface(corrected, 2.0, 0.3)
    np.testing.assert_allclose(painted.height, [[10.0, np.nan]])
    np.testing.assert_allclose(painted.precision, [[0.3, np.nan]])
    np.testing.assert_array_equal(painted.code, [[Provenance.AGREED, Provenance.EMPTY]])
