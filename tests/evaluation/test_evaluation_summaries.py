"""Summaries over all tiles: heights, orthoimage and orientation, against numbers that are computed directly."""

import numpy as np
import pytest
from box_scene import block as box_block
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm
from village_pair import level_pair

from orthomill.schemas.epipolar import EpipolarPairs
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import Provenance
from orthomill.tasks.evaluation.accuracy import (
    BINS_PER_CELL,
    REACH,
    HeightHistogram,
    JudgedCells,
    bin_width,
    height_sums,
    histogram,
    measures,
    merged_histogram,
    merged_sums,
    quantile,
)
from orthomill.tasks.evaluation.classes import CODE_GROUPS, GROUPS, MARGIN, PlaceClass, place_classes, strata, strata_of
from orthomill.tasks.evaluation.edges import no_edges
from orthomill.tasks.evaluation.grids import codes_on, colours_on, heights_on, placement, readable
from orthomill.tasks.evaluation.orthoimage_accuracy import GreyFit, OrthoCounts, Shifts
from orthomill.tasks.evaluation.porous_crowns import no_crowns
from orthomill.tasks.evaluation.stage import EvaluationStage
from orthomill.tasks.evaluation.tile_sums import (
    LEAST_ROOF,
    expected_sigma,
    rounded,
    summarise_heights,
    summarise_orientation,
    summarise_ortho,
)

CELL = 0.5


def tile(dh, place, building=None, code=Provenance.AGREED, twice=True):
    """Sums, histogram, histogram of buildings, counts at edges and in crowns of a tile."""
    dh = np.asarray(dh, float)
    stratum = strata(np.asarray(place), np.full(len(dh), code), np.full(len(dh), twice))
    cells = JudgedCells(stratum, dh, *(np.full(len(dh), value) for value in (0.2, 0.1, 0.0)))
    known = np.isfinite(dh)
    building = np.zeros(len(dh), int) if building is None else np.asarray(building)
    roof = known & (building > 0)
    return (
        height_sums(cells, CELL),
        histogram(dh[known], stratum[known], CELL),
        histogram(dh[roof], building[roof], CELL),
        no_edges(),
        no_crowns(),
    )


def summary(*tiles, pairs=None, parallax_sigma=0.5):
    sums, histograms, buildings, edges, crowns = zip(*tiles, strict=True)
    return summarise_heights(sums, histograms, buildings, edges, crowns, box_block(), CELL, parallax_sigma, pairs)


def pairs(base_height=0.5) -> EpipolarPairs:
    return EpipolarPairs(pairs=(level_pair(base_height=base_height),))


def test_groups_combine_their_classes():
    ground, roof = PlaceClass.CLEAR_GROUND, PlaceClass.ROOF_EDGE
    found = summary(tile([0.1] * 6, [ground] * 6), tile([0.4] * 2 + [-0.5], [roof] * 2 + [PlaceClass.WATER]))
    groups = {group.name: group.numbers for group in found.groups}
    assert set(groups) == {"all", "open_ground", "clear_ground", "roof", "water"}
    assert groups["all"]["cells"] == 8 and groups["roof"]["bias"] == 0.4 and groups["water"]["cells"] == 1
    assert groups["all"]["bias"] == pytest.approx((6 * 0.1 + 2 * 0.4) / 8)


def test_completeness_counts_cells_that_can_be_measured():
    ground = [PlaceClass.CLEAR_GROUND]
    found = summary(tile([0.0, 0.1, np.nan], 3 * ground), tile([np.nan], ground, twice=False))
    assert found.groups[0].numbers["measured_unseen"] == 0
    claimed = summary(tile([0.1, np.nan], 2 * ground, twice=False), tile([9.0], ground, code=Provenance.INCOHERENT, twice=False))
    assert claimed.groups[0].numbers["measured_unseen"] == pytest.approx(100 / 3, abs=1e-3)
    assert found.groups[0].numbers["completeness"] == 50 and found.groups[0].numbers["completeness_seen_twice"] == 66.6667


def test_an_estimated_height_is_not_a_measured_one():
    ground = [PlaceClass.CLEAR_GROUND]
    found = summary(
        tile([0.1, 0.1], 2 * ground),
        tile([5.0], ground, code=Provenance.INTERPOLATED),
        tile([0.3], ground, code=Provenance.VOLUME),
        tile([np.nan], ground, code=Provenance.EMPTY),
    )
    measured = found.groups[0].numbers
    assert (measured["cells"], measured["heights"], measured["completeness"], measured["highest"]) == (5, 3, 60, 0.3)
    shares = {row.code: row.numbers["share"] for row in found.codes if row.place == "all"}
    assert shares == {"measured": 60, "all_codes": 80, "agreed": 40, "volume": 20, "interpolated": 20}
    beyond = {row.code: row.numbers["beyond_metre"] for row in found.codes if row.place == "clear_ground"}
    assert beyond["measured"] == 0 and beyond["all_codes"] == 25 and beyond["interpolated"] == 100


def test_codes_are_judged_where_two_photographs_see_only():
    tree = [PlaceClass.TREE]
    found = summary(tile([0.1, 0.3], 2 * tree), tile([9.0] * 8, 8 * tree, twice=False))
    (row,) = (row for row in found.codes if (row.code, row.place) == ("agreed", "tree"))
    assert row.numbers["share"] == 100 and row.numbers["heights"] == 2 and row.within[:2] == (50, 100)


def test_groups_of_codes_are_named_once_and_leave_only_empty_cells_out():
    names = [name for name, _, _ in CODE_GROUPS]
    together = {code for name, _, codes in CODE_GROUPS if name == "all_codes" for code in codes}
    assert len(names) == len(set(names)) and together == set(Provenance) - {Provenance.EMPTY}


def test_buildings_need_enough_cells():
    roof = [PlaceClass.ROOF_INTERIOR] * (2 * LEAST_ROOF - 1)
    building = [5] * LEAST_ROOF + [6] * (LEAST_ROOF - 1)
    found = summary(tile([0.3] * len(roof), roof, building))
    assert found.buildings == ((5, LEAST_ROOF, 0.3),)


def test_the_chart_holds_shares_that_add_up():
    dh = np.random.default_rng(1).normal(0.1, 0.1, 4000)
    found = summary(tile(dh, np.full(4000, int(PlaceClass.CLEAR_GROUND))))
    curve = np.array(found.chart["all cells but water"])
    assert curve.sum() == pytest.approx(100.0, abs=0.1) and len(curve) == len(found.chart_x) == 121
    assert found.chart_x[int(curve.argmax())] == pytest.approx(0.1, abs=0.06)
    assert found.chart_x[0] == -3 * CELL and found.chart_x[-1] == 3 * CELL


def test_the_expected_standard_error_is_the_published_formula():
    """sigma_Z = (H / B) times the ground pixel times the parallax error (Karfis 2009, 1.21)."""
    heights = [photo.centre[2] - 7.0 for photo in box_block().photos]
    pixel = np.median(heights) / 400.0
    assert expected_sigma(box_block(), pairs(0.5), 0.5) == pytest.approx(0.5 * pixel / 0.5)
    assert expected_sigma(box_block(), pairs(0.25), 0.5) == pytest.approx(0.5 * pixel / 0.25)
    assert expected_sigma(box_block(), None, 0.5) is None and expected_sigma(box_block(), EpipolarPairs(pairs=()), 0.5) is None


@pytest.mark.parametrize(
    ("flying", "base", "scale", "pixel", "sigma"),
    [
        (1029.0, 582.0, 6800, 64e-6, 0.76945),
        (1029.0, 582.0, 6800, 15e-6, 0.18034),
        (1525.0, 829.0, 10000, 49e-6, 0.90139),
        (1525.0, 829.0, 10000, 11e-6, 0.20235),
    ],
    ids=["Volos rough", "Volos full resolution", "Kea rough", "Kea full resolution"],
)
def test_the_published_expected_errors(flying, base, scale, pixel, sigma):
    """Karfis 2009, 8.3 and 8.4 (sources/epipolar.md#results-expected): k (H / B) sigma_p for one pixel of parallax."""
    camera = box_block().cameras["test"].model_copy(update={"c": flying / (scale * pixel)})
    photos = tuple(p.model_copy(update={"centre": (0.0, 0.0, flying)}) for p in box_block().photos)
    known = box_block().model_copy(update={"cameras": {"test": camera}, "photos": photos, "ground_low": 0.0, "ground_high": 0.0})
    assert expected_sigma(known, pairs(base / flying), 1.0) == pytest.approx(sigma, abs=5e-5)


def test_the_published_difference_of_two_models():
    """Two models of equal precision differ by sqrt(2) sigma_Z; tripled, 0.76 m for Volos and 0.86 m for Kea."""
    assert 3 * np.sqrt(2) * 0.18034 == pytest.approx(0.76, abs=0.006)
    dh = np.sqrt(2) * 0.18034 * norm.ppf((np.arange(20000) + 0.5) / 20000)
    found = summary(tile(dh, np.full(20000, int(PlaceClass.CLEAR_GROUND))))
    assert 3 * found.groups[0].numbers["sd"] == pytest.approx(0.76, abs=0.01)


@pytest.mark.parametrize("sigma", [0.25, 0.5, 2.0])
def test_parallax_sigma_scales_what_is_expected(sigma):
    some = tile(np.linspace(-0.5, 0.5, 101), np.full(101, int(PlaceClass.CLEAR_GROUND)))
    one, other = summary(some, pairs=pairs()), summary(some, pairs=pairs(), parallax_sigma=sigma)
    assert other.expected_sigma == pytest.approx(2 * sigma * one.expected_sigma, abs=2e-4)
    within = np.mean(np.abs(np.linspace(-0.5, 0.5, 101)) <= other.expected_sigma + 1e-9)
    assert other.groups[0].within_expected[0] == pytest.approx(100 * within, abs=1.5)


def test_the_setting_parallax_sigma_is_that_of_the_stage():
    assert EvaluationStage(parallax_sigma=0.3).parallax_sigma == 0.3


def test_without_pairs_nothing_is_expected():
    found = summary(tile([0.1], [PlaceClass.CLEAR_GROUND]))
    assert found.expected_sigma is None and found.groups[0].within_expected == ()


def test_the_published_fgdc_factor():
    """Check 4 of sources/surface_check.md: an RMSE of 2.02 m is 3.96 m at 95 %."""
    sums, counts, *_ = tile([2.02, -2.02], [PlaceClass.CLEAR_GROUND] * 2)
    clear = strata_of((PlaceClass.CLEAR_GROUND,))
    found = measures(merged_sums((sums,), clear), merged_histogram((counts,), clear), CELL, None)
    assert found.fgdc95 == pytest.approx(3.96, abs=0.005)


def shifts(dx, dy, place=PlaceClass.CLEAR_GROUND, seen=3, datum=np.nan, measured=True) -> Shifts:
    n = len(dx)
    code, photos = np.full(n, place, np.uint8), np.full(n, seen, np.uint8)
    number = np.arange(n, dtype=np.int32)
    dx, dy = np.asarray(dx, np.float32), np.asarray(dy, np.float32)
    of_datum = np.full((2, n), datum, np.float32)
    return Shifts(number, number, dx, dy, code, photos, np.full(n, measured), *of_datum)


def test_shifts_are_summed_by_place():
    found = summarise_ortho(
        (OrthoCounts(visible=5), OrthoCounts(visible=7)),
        (shifts([0.3, np.nan, -0.6], [0.4, np.nan, 0.8]), shifts([0.0, 0.0], [0.2, 0.2], PlaceClass.ROOF_EDGE)),
        GreyFit(),
    )
    assert found.counts.visible == 12 and found.shift["nodes"] == 5 and found.shift["matched"] == 4
    assert found.shift["open_ground_median"] == pytest.approx(0.75) and found.shift["roof_median"] == pytest.approx(0.2)
    assert found.shift["share_above_half"] == 25.0, "0.5 itself is not above a half"
    assert found.shift["mean_dx"] == pytest.approx(-0.075, abs=1e-4) and found.shift["mean_dy"] == pytest.approx(0.4, abs=1e-4)


def test_shifts_on_measured_ground_are_told_apart():
    parts = shifts([0.7, 0.1], [0.0, 0.0]), shifts([3.0], [0.0], measured=False)
    assert summarise_ortho((OrthoCounts(),), parts, GreyFit()).shift["measured_share_above_half"] == 50.0


def test_cars_and_water_are_no_measure_of_the_shift():
    found = summarise_ortho(
        (OrthoCounts(),),
        (shifts([0.1], [0.0]), *(shifts([3.0], [0.0], p) for p in (PlaceClass.VEHICLE, PlaceClass.WATER))),
        GreyFit(),
    )
    assert found.shift["nodes"] == 1 and found.shift["share_above_half"] == 0.0


def test_the_datum_is_told_apart_from_the_other_shifts():
    found = summarise_ortho((OrthoCounts(),), (shifts([0.7, 0.5, 1.5], [0.5, 0.5, 0.5], datum=0.5),), GreyFit()).shift
    assert found["datum_mean_dx"] == found["datum_mean_dy"] == 0.5 and found["own_median"] == pytest.approx(0.2)
    assert found["share_above_half"] == 100.0 and found["own_share_above_half"] == 33.333
    assert summarise_ortho((OrthoCounts(),), (shifts([0.1], [0.1]),), GreyFit()).shift["own_median"] is None


def test_nodes_that_no_photograph_shows_are_left_out():
    found = summarise_ortho((OrthoCounts(),), (shifts([3.0, 0.1], [0.0, 0.0], seen=0),), GreyFit())
    assert found.shift["nodes"] == 0 and found.shift["median"] is None and sum(found.chart_y) == 0


def test_the_last_bar_collects_larger_shifts():
    found = summarise_ortho((OrthoCounts(),), (shifts([0.02, 1.99, 3.9], [0.0, 0.0, 0.0]),), GreyFit())
    assert found.chart_y[0] == 1 and found.chart_y[-1] == 2 and len(found.chart_x) == 40


def displaced(sigma: float, error: float, seed: int = 0) -> Block:
    """The box block with errors of centres drawn with `error`, and standard errors `sigma`."""
    rng, true = np.random.default_rng(seed), box_block()
    covariance = tuple(map(tuple, np.diag([sigma**2] * 3 + [1e-10] * 3)))
    photos = tuple(
        p.model_copy(update={"centre": tuple(np.add(p.centre, rng.normal(0, error, 3))), "covariance": covariance})
        for p in true.photos
    )
    return true.model_copy(update={"photos": photos})


def test_the_orientation_is_summarised_in_lengths_and_ratios():
    found = summarise_orientation(displaced(0.1, 0.05), box_block())
    moved = np.array(
        [np.subtract(a.centre, b.centre) for a, b in zip(displaced(0.1, 0.05).photos, box_block().photos, strict=True)]
    )
    assert found.numbers["photos_compared"] == 4 and found.numbers["photos_unoriented"] == 0
    assert found.numbers["centre_rmse_plan"] == pytest.approx(np.sqrt((moved[:, :2] ** 2).sum(axis=1).mean()), abs=1e-6)
    assert found.numbers["centre_largest"] == pytest.approx(np.abs(moved).max(), abs=1e-4)
    assert found.numbers["centres_within_3_sigma"] == 100.0 and found.numbers["rotation_rmse"] == 0
    assert found.photos[0][0] == "a" and found.places[0] == box_block().photos[0].centre[:2]


def test_optimistic_standard_errors_show_in_the_ratios():
    found = summarise_orientation(displaced(0.01, 0.5), box_block())
    assert found.numbers["centres_within_3_sigma"] < 30 and found.photos[0][7] > 3


def test_missing_and_foreign_photographs():
    part = box_block("ab")
    found = summarise_orientation(part, box_block())
    assert found.numbers["photos_compared"] == 2 and found.numbers["photos_unoriented"] == 2
    assert found.photos[0][7] is None, "without a covariance there is no ratio"
    names = {f"{photo.photo}x": "test" for photo in part.photos}
    photos = tuple(photo.model_copy(update={"photo": f"{photo.photo}x"}) for photo in part.photos)
    other = part.model_copy(update={"photos": photos, "of_photo": names})
    assert summarise_orientation(other, box_block()).numbers == {"photos_compared": 0}


@pytest.mark.parametrize(("value", "expected"), [(None, None), (float("nan"), None), (float("inf"), None), (1.23456, 1.2346)])
def test_numbers_that_do_not_exist_are_none(value, expected):
    assert rounded(value) == expected


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(-30, 30), min_size=1, max_size=60), st.integers(1, 5))
def test_histograms_of_parts_add_up(dh, parts):
    dh, place = np.array(dh), np.ones(len(dh), int)
    whole = merged_histogram((histogram(dh, place, CELL),))
    split = tuple(histogram(d, p, CELL) for d, p in zip(np.array_split(dh, parts), np.array_split(place, parts), strict=True))
    assert np.array_equal(merged_histogram(split), whole) and whole.sum() == len(dh)
    assert len(whole) == 2 * REACH * BINS_PER_CELL + 1


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(-9, 9), min_size=3, max_size=60), st.sampled_from([0.1, 0.5, 0.9]))
def test_quantiles_are_within_a_bin_of_those_of_the_values(dh, share):
    counts, width = merged_histogram((histogram(np.array(dh), np.ones(len(dh), int), CELL),)), bin_width(CELL)
    found = quantile(counts, share, -(len(counts) / 2) * width, width)
    inside = np.sort(dh)
    low, high = inside[int(np.ceil(share * len(dh))) - 1], inside[min(int(np.ceil(share * len(dh))), len(dh) - 1)]
    assert low - width <= found <= high + width
    assert np.isnan(quantile(np.zeros(5, int), 0.5, 0.0, 1.0))


def test_histograms_keep_parts_apart():
    found = histogram(np.array([0.1, 0.1, -0.2]), np.array([3, 7, 3]), CELL)
    assert isinstance(found, HeightHistogram)
    assert list(zip(found.part, found.bin, found.count, strict=True)) == [(3, -40, 1), (3, 20, 1), (7, 20, 1)]
    assert merged_histogram((found,), (3,)).sum() == 2


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_every_cell_has_one_class_and_materials_keep_theirs(seed):
    rng = np.random.default_rng(seed)
    material = rng.choice([0, 1, 2, 3, 4, 5, 6], (20, 20), p=[0.02, 0.7, 0.1, 0.1, 0.04, 0.02, 0.02]).astype(np.uint8)
    classes = place_classes(material)
    assert ((classes == PlaceClass.UNKNOWN) == (material == 0)).all() and ((classes == PlaceClass.WATER) == (material == 6)).all()
    assert (np.isin(classes, (PlaceClass.ROOF_EDGE, PlaceClass.ROOF_INTERIOR)) == (material == 4)).all()
    clear = np.argwhere(classes == PlaceClass.CLEAR_GROUND)
    for row, col in clear[:10]:
        near = material[max(row - MARGIN, 0) : row + MARGIN + 1, max(col - MARGIN, 0) : col + MARGIN + 1]
        assert not np.isin(near, (4, 5)).any()


def test_groups_are_named_once_and_cover_every_class_but_water():
    names = [name for name, _, _ in GROUPS]
    assert len(names) == len(set(names)) and set(GROUPS[0][2]) == set(PlaceClass) - {PlaceClass.WATER}


SOURCE = MapGrid(west=0.0, north=40.0, cell=0.5, rows=80, cols=96)


@settings(max_examples=40, deadline=None)
@given(cell=st.sampled_from([0.5, 0.7, 1.0, 2.0]), west=st.floats(-3, 20), row=st.integers(0, 8), col=st.integers(0, 8))
def test_a_window_of_a_reference_is_resampled_like_the_whole(cell, west, row, col):
    """Heights, codes and colours of a tile do not depend on the tile."""
    rng = np.random.default_rng(7)
    z, codes = rng.normal(0, 0.1, SOURCE.shape).astype(np.float32), rng.integers(1, 7, SOURCE.shape).astype(np.uint8)
    colours = rng.integers(0, 255, (*SOURCE.shape, 2)).astype(np.uint8)
    grid = MapGrid(west=west, north=39.3, cell=cell, rows=12, cols=12)
    part, whole = (placement(grid, window, SOURCE, margin=8) for window in (Window(row, col, 4, 4), Window(0, 0, 12, 12)))
    for resample, raster in ((heights_on, z), (codes_on, codes), (colours_on, colours)):
        one, every = (resample(raster[readable(p).slices], p) for p in (part, whole))
        assert np.allclose(one, every[row : row + 4, col : col + 4], atol=2e-2, equal_nan=True)
