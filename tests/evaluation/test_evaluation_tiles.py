"""The jobs of a tile: planted differences against truth and files come back cell by cell."""

import numpy as np
import pytest
from box_scene import block as box_block
from scipy.ndimage import gaussian_filter

from orthomill.schemas.raster import MapGrid, RasterSpec, Window, tiles_of
from orthomill.schemas.surface import MEASURED, CheckCode, HeightSource, Provenance
from orthomill.schemas.truth import Material
from orthomill.tasks.evaluation.accuracy import HeightSums, merged_histogram, merged_sums
from orthomill.tasks.evaluation.classes import HALO as CLASS_HALO
from orthomill.tasks.evaluation.classes import PlaceClass, strata_of
from orthomill.tasks.evaluation.edges import edge_shares
from orthomill.tasks.evaluation.grids import grid_of, placement, readable
from orthomill.tasks.evaluation.orthoimage_accuracy import HALO, GreyFit, merged_counts, photos_that_reach
from orthomill.tasks.evaluation.porous_crowns import crown_shares
from orthomill.tasks.evaluation.report.codes_section import check_section
from orthomill.tasks.evaluation.tile_sums import summarise_check
from orthomill.tasks.evaluation.tiles import (
    HeightComparison,
    OrthoPlace,
    OrthoTruthPlace,
    check_against_truth,
    heights_against_file,
    heights_against_truth,
    ortho_against_file,
    ortho_against_truth,
    sums_against_file,
    sums_against_truth,
)

GRID = MapGrid(west=0.0, north=60.0, cell=1.0, rows=60, cols=80)
WHOLE = Window(0, 0, 60, 80)


def truth():
    """Level ground at 10 m with a building of 8 m (number 3), a pond and a tree of 6 m with a pit below it; photograph counts
    of 3, 1 in the last rows."""
    surface, material = np.full(GRID.shape, 10.0, np.float32), np.full(GRID.shape, Material.OPEN_GROUND, np.uint8)
    building, visibility = np.zeros(GRID.shape, np.uint16), np.full(GRID.shape, 0b111, np.uint32)
    roof = (slice(10, 26), slice(20, 44))
    surface[roof], material[roof], building[roof] = 18.0, Material.ROOF, 3
    material[40:50, 60:72], material[45:48, 10:13] = Material.WATER, Material.TREE
    visibility[55:] = 0b010
    ground = np.where(material == Material.TREE, np.float32(4.0), np.float32(10.0))
    return surface, ground, material, building, visibility


def dsm():
    """The truth, 0.2 m too high, roofs 0.5 m too low, empty water; height, precision and code (AGREED, or VOLUME in the east)."""
    surface, _, material, _, _ = truth()
    height = surface + np.where(material == Material.ROOF, -0.5, 0.2).astype(np.float32)
    height[material == Material.WATER] = np.nan
    code = np.full(GRID.shape, Provenance.AGREED, np.uint8)
    code[:, 50:], code[np.isnan(height)] = Provenance.VOLUME, Provenance.EMPTY
    return height, np.where(np.isfinite(height), np.float32(0.15), np.float32(np.nan)), code


def test_what_the_check_says_is_counted_by_class_whatever_the_tiles():
    """The roof has 16 x 24 cells, the ground within three cells of it 22 x 30 less these; a quarter of the roof is not judged."""
    _, _, material, _, _ = truth()
    code = np.full(GRID.shape, CheckCode.AGREES, np.uint8)
    code[10:18, 20:32], code[material == Material.WATER], code[8, 30] = CheckCode.NOT_JUDGED, CheckCode.ESTIMATE, CheckCode.WRONG
    parts = []
    for tile in tiles_of(GRID.shape, 32):
        place = placement(GRID, tile.window.grown(CLASS_HALO), GRID)
        parts.append(check_against_truth(code[tile.window.slices], material[readable(place).slices], place, tile.window))
    groups = {group.name: group for group in summarise_check(tuple(parts)).groups}
    roof, margin = groups["roof"], groups["building_margin"]
    assert (roof.cells, roof.judged, roof.wrong) == (16 * 24, 75.0, 0.0)
    assert margin.cells == 22 * 30 - 16 * 24 and margin.wrong == pytest.approx(100 / margin.cells, abs=1e-4)
    assert "water" not in groups and groups["all"].cells == 60 * 80 - 10 * 12, "estimates are not to be judged"
    section = check_section(summarise_check(tuple(parts)))
    assert {f.name: f.value for f in section.figures}["check_judged_roof"] == 75.0 and section.grids[0].rows[0][1] == 60 * 80 - 120


def against_truth(surface, truths, place, core) -> HeightComparison:
    """`surface`: height, precision and code; `truths`: surface, ground, material, building, visibility; a block without errors."""
    names = ("surface", "ground", "material", "building", "visibility")
    height, precision, code = surface
    own = {"height": height, "precision": precision, "relative": precision, "provenance": code}
    blocks = {"block": box_block(), "true_block": box_block()}
    return heights_against_truth(**own, **dict(zip(names, truths, strict=True)), **blocks, place=place, core=core)


def compared(core=WHOLE, given=None) -> HeightComparison:
    place = placement(GRID, core.grown(CLASS_HALO), GRID)
    parts = (raster[readable(place).slices] for raster in truth())
    return against_truth([raster[core.slices] for raster in given or dsm()], parts, place, core)


def row_of(sums: HeightSums, *places: PlaceClass, **which) -> dict[str, float]:
    return merged_sums((sums,), strata_of(places, **which))


def test_differences_are_those_that_were_planted():
    _, _, material, _, _ = truth()
    dh = compared().dh
    assert dh.dtype == np.float32 and dh[material == Material.ROOF] == pytest.approx(-0.5)
    assert dh[material == Material.OPEN_GROUND] == pytest.approx(0.2) and np.isnan(dh[material == Material.WATER]).all()


def test_sums_are_kept_by_class_of_place():
    sums = compared().sums
    roof, water = row_of(sums, PlaceClass.ROOF_INTERIOR, PlaceClass.ROOF_EDGE), row_of(sums, PlaceClass.WATER)
    assert roof["cells"] == 16 * 24 and roof["total"] == pytest.approx(-0.5 * 16 * 24, rel=1e-6)
    assert roof["within_3"] == 0 and roof["within_4"] == roof["with_precision"] == 16 * 24
    assert water["cells"] == 120 and water["heights"] == 0 and water["lowest"] == np.inf
    clear = row_of(sums, PlaceClass.CLEAR_GROUND)
    assert clear["lowest"] == pytest.approx(0.2) == clear["highest"] and clear["within_1"] == 0


def test_cells_that_one_photograph_shows_are_not_expected():
    sums = compared().sums
    every, twice = row_of(sums, *PlaceClass), row_of(sums, *PlaceClass, only_seen_twice=True)
    assert every["cells"] == 60 * 80 and twice["cells"] == 55 * 80


def test_sums_are_kept_by_code():
    sums = compared().sums
    volume, empty = (row_of(sums, *PlaceClass, codes=(code,)) for code in (Provenance.VOLUME, Provenance.EMPTY))
    assert volume["cells"] == volume["heights"] == 60 * 30 - 120 and empty["cells"] == 120 and empty["heights"] == 0


def test_an_estimated_roof_does_not_judge_its_building():
    height, precision, code = dsm()
    code[10:18, 20:44] = Provenance.INCOHERENT
    assert compared(given=(height, precision, code)).buildings.count.sum() == 7 * 22


def test_grown_and_lost_edges_are_counted_by_code():
    """Three cells north of the roof have its height (24 of 3 rows around it); one row of its southern edge has the ground's."""
    surface = truth()[0].copy()
    surface[7:10, 20:44], surface[25, 20:44] = 18.0, 10.0
    _, precision, code = dsm()
    code[25] = Provenance.INCOHERENT
    edges = compared(given=(surface, precision, code)).edges
    beside, rim = 22 * 30 - 16 * 24, 2 * (16 + 24) - 4
    assert (edges.beside.sum(), edges.rim.sum()) == (beside, rim)
    assert edge_shares((edges,), tuple(Provenance)) == pytest.approx((100 * 72 / beside, 100 * 24 / rim))
    assert edge_shares((edges, edges), MEASURED) == pytest.approx((100 * 72 / (beside - 6), 0))


def test_a_step_that_is_no_wall_has_no_edge():
    surface, *others = truth()
    low = np.minimum(surface, 11.5)
    place = placement(GRID, WHOLE.grown(CLASS_HALO), GRID)
    parts = (raster[readable(place).slices] for raster in (low, *others))
    edges = against_truth(dsm(), parts, place, WHOLE).edges
    assert edges.beside.sum() == edges.rim.sum() == 0 and np.isnan(edge_shares((edges,), MEASURED)).all()


def test_a_building_is_judged_by_its_interior():
    histogram = compared().buildings
    assert set(histogram.part) == {3} and histogram.count.sum() == 14 * 22, "one cell along each side is edge"
    assert set(histogram.bin) == {-50}


def test_ground_seen_through_a_crown_is_told_from_the_crown():
    """Nine cells of crown: three at it, two at the ground below, one at the ground with an error of 3 sigma, one in the air, one of
    another code, one without a height."""
    height, precision, code = dsm()
    height[45:48, 10:13] = [[10.2, 10.2, 9.9], [4.1, 3.9, 4.45], [7.0, 10.2, np.nan]]
    code[47, 11], code[47, 12] = Provenance.INCOHERENT, Provenance.EMPTY
    found = compared(given=(height, precision, code)).crowns
    assert crown_shares((found,), MEASURED) == pytest.approx(
        {
            "at_crown": 100 * 3 / 7,
            "at_ground": 100 * 3 / 7,
            "at_neither": 100 / 7,
            "nearer_within_2": 100 * 5 / 7,
            "nearer_beyond_4": 100 / 7,
        }
    )
    assert crown_shares((found, found), (Provenance.INCOHERENT,))["at_crown"] == 100
    assert np.isnan(crown_shares((found,), (Provenance.INTERPOLATED,))["at_crown"])


def test_crowns_that_one_photograph_sees_are_not_counted():
    rasters = truth()
    rasters[-1][45:48] = 0b1
    place = placement(GRID, WHOLE.grown(CLASS_HALO), GRID)
    parts = (raster[readable(place).slices] for raster in rasters)
    found = against_truth(dsm(), parts, place, WHOLE)
    assert found.crowns.cells.sum() == 0


@pytest.mark.parametrize("size", [16, 32])
def test_tiles_of_heights_add_up_to_the_whole(size):
    whole = compared()
    parts = [compared(tile.window) for tile in tiles_of(GRID.shape, size)]
    for tile, part in zip(tiles_of(GRID.shape, size), parts, strict=True):
        assert np.array_equal(part.dh, whole.dh[tile.window.slices], equal_nan=True)
    for place in PlaceClass:
        one, other = (merged_sums(tuple(p.sums for p in some), strata_of((place,))) for some in ([whole], parts))
        assert one == pytest.approx(other)
    for name in ("beside", "grown", "rim", "lost"):
        assert np.array_equal(getattr(whole.edges, name), sum(getattr(p.edges, name) for p in parts))
    for name in ("cells", "crown", "ground", "rated", "within_2", "beyond_4"):
        assert np.array_equal(getattr(whole.crowns, name), sum(getattr(p.crowns, name) for p in parts))
    assert np.array_equal(merged_histogram((whole.histogram,)), merged_histogram(tuple(p.histogram for p in parts)))


def test_a_file_has_one_class_and_no_buildings():
    reference = np.full(GRID.shape, 10.0)
    reference[:5] = np.nan
    found = heights_against_file(*dsm(), reference, GRID.cell)
    assert row_of(found.sums, PlaceClass.UNKNOWN, only_seen_twice=True)["cells"] == 55 * 80 == found.sums.cells.sum()
    assert np.isnan(found.dh[:5]).all() and len(found.buildings) == len(found.edges) == len(found.crowns) == 0


def test_the_standard_error_of_a_reference_is_one_of_the_difference():
    surface, precision, code = dsm()
    # 0.4 m are 2.7 standard errors of the surface, and 1.2 of a difference from a reference of 0.3 m.
    reference = surface - np.float32(0.4)
    alone, both = (heights_against_file(surface, precision, code, reference, GRID.cell, sigma) for sigma in (0.0, 0.3))
    rows = [row_of(found.sums, PlaceClass.UNKNOWN, only_seen_twice=True) for found in (alone, both)]
    assert (rows[0]["within_2"], rows[0]["within_3"]) == (0, rows[0]["heights"])
    assert rows[1]["within_2"] == rows[1]["heights"] and rows[1]["within_1"] == 0


def texture(seed=1) -> np.ndarray:
    noise = gaussian_filter(np.random.default_rng(seed).normal(0, 1, (*GRID.shape, 1)), (1.5, 1.5, 0))
    return np.clip(np.rint(120 + 30 * noise / noise.std() * np.array([1.0, 0.9, 0.8])), 1, 255).astype(np.uint8)


def rgba(colours: np.ndarray) -> np.ndarray:
    return np.dstack([colours, np.full(GRID.shape, 255, np.uint8)])


def judged_ortho(core=WHOLE, ortho=None, adjusted=None):
    ortho = rgba(texture()) if ortho is None else ortho
    window = core.grown(HALO).clipped(GRID.shape)
    place = placement(GRID, window, GRID)
    surface, _, material, _, visibility = (raster[readable(place).slices] for raster in truth())
    where = OrthoTruthPlace(GRID, core, window, place)
    colours = texture()[readable(place).slices]
    return ortho_against_truth(
        ortho[window.slices],
        colours,
        material,
        visibility,
        surface,
        np.full(window.shape, HeightSource.MEASURED, np.uint8),
        box_block(),
        adjusted or box_block(),
        GreyFit(),
        where,
    )


def test_a_perfect_orthoimage_has_no_difference():
    found = judged_ortho()
    assert np.abs(found.difference).max() == 0 and found.counts.difference_absolute == 0
    assert found.counts.ssim_sum == pytest.approx(found.counts.ssim_count)
    assert np.nanmax(np.hypot(found.shifts.dx, found.shifts.dy)) < 1e-3


def test_the_shift_of_the_datum_is_that_of_the_adjusted_centres():
    """Centres 2 m too far east and 1 m too far south move every point by as much; the orthoimage itself is perfect."""
    assert np.nanmax(np.abs(judged_ortho().shifts.datum_dx)) < 1e-5
    true = box_block()
    photos = tuple(p.model_copy(update={"centre": tuple(np.add(p.centre, (2.0, -1.0, 0.0)))}) for p in true.photos)
    found = judged_ortho(adjusted=true.model_copy(update={"photos": photos})).shifts
    known = np.isfinite(found.datum_dx)
    assert known.sum() > 2 and found.datum_dx[known] == pytest.approx(2.0, abs=1e-4)
    assert found.datum_dy[known] == pytest.approx(1.0, abs=1e-4)


def test_a_planted_difference_of_grey_values_is_found_where_it_is():
    bright = texture().astype(int)
    bright[20:30, 50:70] += 9
    found = judged_ortho(ortho=rgba(np.clip(bright, 1, 255).astype(np.uint8)))
    assert found.difference[20:30, 50:70] == pytest.approx(9.0, abs=1e-4)
    assert found.counts.difference_absolute == pytest.approx(9.0 * 200, rel=1e-5)


def test_pixels_without_a_colour_are_neither_judged_nor_covered():
    ortho = rgba(texture())
    ortho[:10, :, 3] = 0
    found = judged_ortho(ortho=ortho)
    assert np.isnan(found.difference[:10]).all() and found.counts.visible_covered == found.counts.visible - 800


@pytest.mark.parametrize("size", [16, 64])
def test_tiles_of_the_orthoimage_add_up_to_the_whole(size):
    whole = judged_ortho()
    parts = [judged_ortho(tile.window) for tile in tiles_of(GRID.shape, size)]
    assert merged_counts(tuple(p.counts for p in parts)).model_dump() == pytest.approx(whole.counts.model_dump())
    assert sum(len(p.shifts) for p in parts) == len(whole.shifts)


def test_an_orthoimage_against_a_file_knows_nothing_of_visibility():
    reference = texture().astype(np.float32)
    reference[:, :10] = np.nan
    sources = np.full(GRID.shape, HeightSource.MEASURED, np.uint8)
    found = ortho_against_file(rgba(texture()), reference, sources, GreyFit(), OrthoPlace(GRID, WHOLE, WHOLE))
    assert found.counts.difference_count == 60 * 70 and found.counts.visible == found.counts.hidden == 0
    assert np.isnan(found.shifts.datum_dx).all()
    assert (found.shifts.seen == 255).all() and (found.shifts.place == PlaceClass.UNKNOWN).all()


def test_grey_sums_of_truth_and_file_agree_on_one_grid():
    place = placement(GRID, WHOLE, GRID)
    with_truth = sums_against_truth(rgba(texture()), texture()[readable(place).slices], place)
    assert with_truth == sums_against_file(rgba(texture()), texture().astype(np.float32))
    assert with_truth.pixels == 60 * 80 and with_truth.oo == with_truth.ot


def test_photographs_that_reach_a_point_ignore_what_stands_in_the_way():
    points = np.array([[60.0, 60.0, 0.0], [5000.0, 60.0, 0.0]])
    assert photos_that_reach(box_block(), points).tolist() == [4, 0]


def test_a_raster_without_a_place_on_the_map_is_refused():
    placed = RasterSpec(name="x", shape=(4, 5), dtype="uint8", chunk=4, transform=GRID.transform)
    assert grid_of(placed) == GRID.model_copy(update={"rows": 4, "cols": 5})
    with pytest.raises(ValueError, match="x has no"):
        grid_of(placed.model_copy(update={"transform": None}))
