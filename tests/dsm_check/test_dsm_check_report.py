"""The report of the check from counts that can be verified by hand, and the choice of the pairs that check."""

import numpy as np
import pytest
from tiny_block import EAST, FLYING, NORTH, block

from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import Provenance, Surface
from orthomill.tasks.dsm_check.areas import CHECKED, MEAN, SIGMA, SuspiciousArea, Trend, blocks, suspicious_areas
from orthomill.tasks.dsm_check.correction_map import CorrectionMap, CorrectionNodes
from orthomill.tasks.dsm_check.coverage import (
    CheckedPair,
    CheckedPairs,
    best_cover,
    choose_checked_pairs,
    covered,
    ground_pixel,
    rasterised,
    seen_ground,
)
from orthomill.tasks.dsm_check.difference_words import CHANGES
from orthomill.tasks.dsm_check.judged_blocks import tolerance_values
from orthomill.tasks.dsm_check.nodes import BANDS, DH, OUTCOME
from orthomill.tasks.dsm_check.report.area_words import area_warnings
from orthomill.tasks.dsm_check.report.check_report import Blocks, report
from orthomill.tasks.dsm_check.report.round_words import relief_values, shift_warnings
from orthomill.tasks.dsm_check.stage import DsmCheckStage
from orthomill.tasks.dsm_check.statistics import PairCounts, TileCounts, count, count_pair, count_tile
from orthomill.tasks.dsm_check.surfaces.foreign_grid import measured_surface, surface_on
from orthomill.tasks.dsm_check.surfaces.surface_shift import SurfaceShift
from orthomill.tasks.dsm_check.surfaces.whole_shift import with_pairs_apart
from orthomill.tasks.dsm_check.tile import CorrectionRule, NodeWindow, correct_tile, take_surface
from orthomill.tasks.epipolar.pair_choice import PairChoice
from orthomill.tasks.epipolar.selection import choose_pairs

GRID = MapGrid(west=1000.0, north=2000.0, cell=1.0, rows=128, cols=160)
PAIRS = CheckedPairs(
    pairs=(CheckedPair(name="a-b", left="a", right="b", box=(0, 0, 128, 160), base_height=0.5, share=1.0),),
    pixels_per_cell=1,
    pixel_height=2.0,
)


def tile_counts(dh: np.ndarray, sigma: float = 0.2, changed: int = 5, outside: int = 10) -> TileCounts:
    outcomes = [0] * len(Outcome)
    outcomes[Outcome.CONVERGED], outcomes[Outcome.OUTSIDE] = int(np.isfinite(dh).sum()), outside
    counts = count(dh, np.full(dh.shape, sigma), PAIRS.pixel_height)
    return TileCounts(
        heights=dh.size,
        checked=counts.number,
        changed=changed,
        dh=counts,
        pairs=(PairCounts(pair="a-b", outcomes=tuple(outcomes), dh=counts),),
    )


def reported(dh: np.ndarray, pixel_height: float = PAIRS.pixel_height):
    """The report of a surface (rows, cols) of corrections, in two tiles."""
    coarse = blocks(dh, np.full(dh.shape, 0.2), 8)
    tiles = tuple(tile_counts(part) for part in np.array_split(dh, 2))
    pairs = PAIRS.model_copy(update={"pixel_height": pixel_height})
    return report(tiles, pairs, coarse, Blocks(GRID, 8, 3.0, "EPSG:2100")).report


def figures(found) -> dict:
    return {figure.name: figure.value for figure in found.figures}


def noisy(shift: float = 0.0) -> np.ndarray:
    return shift + np.random.default_rng(3).normal(0, 0.2, GRID.shape)


def test_figures_of_a_good_surface():
    found = reported(noisy())
    values = figures(found)
    assert values["dh_std"] == pytest.approx(0.2, abs=0.005) and values["dh_nmad"] == pytest.approx(0.2, abs=0.01)
    assert values["dh_within_1_sigma"] == pytest.approx(68.3, abs=1.5) and values["checked"] == 100.0
    assert values["changed"] == round(100 * 10 / (128 * 160), 2) and values["suspicious_areas"] == 0
    assert not found.warnings and [f.name for f in found.figures if f.headline] == ["dh_nmad", "checked", "suspicious_areas"]


def test_the_share_judged_is_told_by_relief():
    half = tile_counts(noisy()).model_copy(update={"relief": ((60, 30), (20, 19), (0, 0))})
    values = relief_values((half, half))
    assert values == {"checked_level": 50.0, "checked_steep": 95.0, "checked_steps": None}


def test_a_shifted_surface_is_reported_as_a_whole_and_not_as_an_area():
    found = reported(noisy(-1.0))
    (warning,) = found.warnings
    assert warning.startswith("The surface as a whole is too high by about 1 m relative to the photographs.")
    assert figures(found)["suspicious_areas"] == 0


def test_corrections_that_scatter_are_no_shift_of_the_whole():
    (warning,) = reported(5 * noisy() - 0.7, pixel_height=2.0).warnings
    assert warning.startswith("The corrections that the photographs ask for scatter by 1 m (robust spread) about -0.69 m")
    assert "control" not in warning


def test_a_tilted_surface_is_reported_with_its_gradients():
    x, _y = np.meshgrid(*GRID.centres(Window(0, 0, *GRID.shape)))
    found = reported(noisy() + 0.01 * (x - x.mean()))
    (warning,) = found.warnings
    assert "tilted" in warning and "by 1.5 m from corner to corner, too low in the east as compared with the west" in warning
    assert figures(found)["tilt_east"] == pytest.approx(10.0, abs=0.1) and found.doubts == (warning,)


def test_a_tilt_below_the_errors_that_are_found_one_by_one_is_no_warning():
    x, _y = np.meshgrid(*GRID.centres(Window(0, 0, *GRID.shape)))
    found = reported(noisy() + 0.004 * (x - x.mean()), pixel_height=0.1)
    values = figures(found)
    assert 0.05 < values["trend_range"] < values["detectable"] and not found.warnings


def test_an_area_is_reported_with_place_sign_and_size():
    dh = noisy()
    dh[40:56, 80:104] += 3.0
    found = reported(dh)
    grid = found.grids[2]
    (row,) = grid.rows
    assert row[0] == pytest.approx(1092, abs=1) and row[1] == pytest.approx(1952, abs=1)
    assert row[2] == pytest.approx(16 * 24, rel=0.01) and row[3] == pytest.approx(3.0, abs=0.15) and row[5] == "too low"
    assert figures(found)["suspicious_area"] == row[2]
    assert "too low by about 3 m" in found.warnings[0]


def test_more_areas_than_are_named_are_counted():
    dh = noisy()
    for k in range(7):
        dh[16 * k : 16 * k + 8, 40:72] += 2.0 + 0.2 * k
    found = reported(dh)
    assert figures(found)["suspicious_areas"] == 7 and "4 more areas are in the table" in found.warnings[-1]
    volumes = [row[2] * row[3] for row in found.grids[2].rows]
    assert volumes == sorted(volumes, reverse=True)


def test_a_surface_that_could_not_be_checked_says_so():
    dh = noisy()
    dh[:, 60:] = np.nan
    found = reported(dh)
    assert "Only 38 % of the measured surface could be checked" in found.warnings[0]
    assert found.doubts == (found.warnings[0],)
    nothing = reported(np.full(GRID.shape, np.nan))
    assert figures(nothing)["dh_mean"] is None and not nothing.charts


def test_the_table_of_pairs_counts_nodes_that_were_tried():
    row = reported(noisy()).grids[0].rows[0]
    assert row[:4] == ("a-b", 0.5, 128 * 160, 100.0)
    outcomes = dict(reported(noisy()).grids[1].rows)
    assert outcomes == {Outcome.CONVERGED.sentence: 128 * 160, Outcome.OUTSIDE.sentence: 20}


@pytest.mark.parametrize(("significance", "areas"), [(3.0, 1), (20.0, 0)])
def test_significance_decides_what_is_an_area(significance, areas):
    coarse = np.zeros((16, 20, 3), np.float32)
    coarse[..., CHECKED], coarse[..., SIGMA] = 1.0, 0.2
    coarse[4:7, 5:9, MEAN] = 1.5
    assert len(suspicious_areas(coarse, np.zeros((16, 20)), GRID, 8, significance)) == areas


def test_blocks_hold_share_mean_and_sigma():
    dh, sigma = np.full((10, 16), 2.0), np.full((10, 16), 0.5)
    dh[:8, :4] = np.nan
    sigma[:8, :4] = np.nan
    out = blocks(dh, sigma, 8)
    assert out.shape == (2, 2, 3)
    assert np.allclose(out[0], [[0.5, 2.0, 0.5], [1.0, 2.0, 0.5]]) and out[1, 0, CHECKED] == pytest.approx(16 / 64)


def test_a_tile_without_nodes_leaves_the_surface_as_it_is():
    heights = take_surface(np.array([[1.0, np.inf], [np.nan, 4.0]]))
    assert np.array_equal(heights, np.array([[1.0, np.nan], [np.nan, 4.0]], np.float32), equal_nan=True)
    rule = CorrectionRule("all", 3.0, CorrectionNodes(4, 1, 6.0, 20.0, 11.0), 8, 2.0)
    cells = correct_tile(Window(0, 0, 2, 2), (), rule, heights)
    assert np.array_equal(cells.height, heights, equal_nan=True) and np.isnan(cells.dh).all()
    assert (cells.counts.heights, cells.counts.checked, cells.counts.changed) == (2, 0, 0)


def test_a_tile_counts_its_own_nodes_only():
    nodes = np.zeros((8, 8, len(BANDS)), np.float32)
    nodes[..., OUTCOME], nodes[..., DH], nodes[..., 3] = Outcome.CONVERGED, 0.5, 0.1
    window = NodeWindow("a-b", Window(10, 20, 8, 8), Window(12, 22, 4, 4))
    assert window.inner(nodes).shape == (4, 4, len(BANDS))
    rule = CorrectionRule("all", 3.0, CorrectionNodes(4, 1, 6.0, 20.0, 11.0), 8, 2.0)
    cells = correct_tile(Window(48, 88, 16, 16), (window,), rule, np.zeros((16, 16), np.float32), (nodes,))
    assert cells.counts.pairs[0].outcomes[Outcome.CONVERGED] == 16
    assert cells.height == pytest.approx(0.5, abs=1e-5) and cells.counts.changed == 256


def test_estimated_heights_are_judged_apart_and_stay_as_they_are():
    nodes = np.zeros((8, 8, len(BANDS)), np.float32)
    nodes[..., OUTCOME], nodes[..., DH], nodes[..., 3] = Outcome.CONVERGED, 0.5, 0.1
    window = NodeWindow("a-b", Window(10, 20, 8, 8), Window(12, 22, 4, 4))
    rule = CorrectionRule("all", 3.0, CorrectionNodes(4, 1, 6.0, 20.0, 11.0), 8, 2.0)
    codes = np.full((16, 16), Provenance.AGREED, np.uint8)
    codes[:, 8:] = Provenance.INTERPOLATED
    cells = correct_tile(Window(48, 88, 16, 16), (window,), rule, np.zeros((16, 16), np.float32), (nodes,), codes)
    assert cells.height[:, :8] == pytest.approx(0.5, abs=1e-5) and (cells.height[:, 8:] == 0.0).all()
    assert np.isnan(cells.dh[:, 8:]).all() and np.isnan(cells.precision[:, 8:]).all()
    counts = cells.counts
    assert (counts.heights, counts.checked, counts.changed, counts.dh.number) == (128, 128, 128, 128)
    assert (counts.estimates, counts.dh_estimates.number) == (128, 128)
    assert counts.pairs[0].outcomes[Outcome.CONVERGED] == counts.pairs[0].dh.number == 8
    assert cells.coarse[0, 0, CHECKED] == 1.0 and cells.coarse[0, 1, CHECKED] == 0.0
    found = figures(report((counts,), PAIRS, cells.coarse, Blocks(GRID, 8, 3.0, "EPSG:2100")).report)
    assert found["checked"] == found["changed"] == 100.0 and found["estimates"] == 50.0
    assert found["estimates_compared"] == 100.0 and found["estimates_dh_nmad"] == pytest.approx(0.0, abs=0.02)


def test_counts_of_nodes_and_cells():
    nodes = np.full((2, 2, len(BANDS)), np.nan, np.float32)
    nodes[0, 0] = (0.5, 0, 0, 0.1, 0.9, Outcome.CONVERGED)
    nodes[0, 1, OUTCOME] = Outcome.OCCLUDED
    counts = count_pair("a-b", nodes, 2.0)
    assert counts.outcomes[Outcome.CONVERGED] == counts.outcomes[Outcome.OCCLUDED] == 1
    assert counts.outcomes[Outcome.NOT_TRIED] == 2 and counts.dh.number == 1
    correction = CorrectionMap(np.array([[1.0, 1.0, np.nan]]), np.full((1, 3), 0.5))
    cells = count_tile(np.array([[5.0, np.nan, 5.0]]), correction, np.array([[1.0, 1.0, 0.0]]), np.zeros((1, 3), bool), (), 2.0)
    assert (cells.heights, cells.checked, cells.changed, cells.dh.within_3) == (2, 1, 1, 1)


TINY = Surface(grid=MapGrid(west=EAST - 120, north=NORTH + 96, cell=0.6, rows=320, cols=400), height_low=20, height_high=85)


def test_pairs_are_limited_and_their_windows_are_whole_tiles():
    pairs = choose_pairs(block(), PairChoice(), 0.08)
    few, all_ = (choose_checked_pairs(pairs, block(), TINY, 64, count_, None) for count_ in (1, None))
    assert len(few.pairs) == 1 < len(all_.pairs) and few.pairs[0] == all_.pairs[0]
    for pair in all_.pairs:
        window = pair.window
        assert window.row % 64 == window.col % 64 == 0 and window == window.clipped(TINY.grid.shape)
    assert sum(pair.share for pair in all_.pairs) <= 1.0


@pytest.mark.parametrize(("asked", "cell", "factor"), [(None, 0.6, 1), (None, 2.0, 2), (1, 2.0, 1), (2, 0.6, 2)])
def test_pixels_per_cell_follow_the_photographs_unless_asked(asked, cell, factor):
    grid = TINY.grid.model_copy(update={"cell": cell, "rows": int(192 / cell), "cols": int(240 / cell)})
    surface = TINY.model_copy(update={"grid": grid})
    found = choose_checked_pairs(choose_pairs(block(), PairChoice(), 0.08), block(), surface, 64, 1, asked)
    assert found.pixels_per_cell == factor
    assert found.pixel_height == pytest.approx(cell / factor / found.pairs[0].base_height)


def test_ground_pixel_is_flying_height_over_camera_constant():
    assert ground_pixel(block(), TINY) == pytest.approx(FLYING / 700, rel=0.02)


def test_a_foreign_surface_may_leave_the_tie_points_by_a_seventh_of_the_flying_height():
    own = surface_on(GRID, block())
    assert own.grid == GRID and own.height_high - block().ground_high == pytest.approx(FLYING / 7, rel=0.01)
    assert block().ground_low - own.height_low == pytest.approx(FLYING / 7, rel=0.01)
    assert measured_surface(TINY) is TINY


def test_the_common_ground_lies_in_both_photographs():
    pair = choose_pairs(block(), PairChoice(), 0.08).pairs[0]
    polygon = seen_ground(pair, block(), TINY)
    middle = polygon.mean(axis=0)
    inside = rasterised(polygon, TINY.grid)
    assert len(polygon) >= 4 and np.hypot(*(middle - (EAST, NORTH))) < 200 and 0.2 < inside.mean() < 1.0
    assert np.array_equal(inside, rasterised(polygon[::-1], TINY.grid)), "either orientation of the polygon"
    assert not rasterised(np.empty((0, 2)), TINY.grid).any()


def test_ground_counts_as_covered_only_where_its_height_shows_it():
    """A surface from a file may leave the tie points by hundreds of metres; what both photographs see then is far wider."""
    pair, far = choose_pairs(block(), PairChoice(), 0.08).pairs[0], surface_on(TINY.grid, block())
    shown, possible = covered(pair, block(), far), rasterised(seen_ground(pair, block(), far), TINY.grid)
    assert shown.any() and not (shown & ~possible).any() and shown.sum() < 0.9 * possible.sum()


def test_a_square_covers_its_share_of_the_raster():
    grid = MapGrid(west=0.0, north=96.0, cell=1.0, rows=96, cols=96)
    square = np.array([[24.0, 24.0], [72.0, 24.0], [72.0, 72.0], [24.0, 72.0]])
    assert rasterised(square, grid).mean() == pytest.approx(0.25, abs=0.01)


def test_steep_pairs_are_preferred_up_to_a_limit():
    same = [np.ones((4, 4), bool)] * 3
    assert best_cover(same, [0.2, 0.5, 0.3], 1)[0][0] == 1
    assert best_cover(same, [0.7, 0.9, 0.3], 1)[0][0] == 0, "beyond 0.6 they count alike, and the first is taken"


def test_a_tolerance_is_proved_broken_or_cannot_be_told():
    coarse = np.zeros((1, 4, 5), np.float32)
    coarse[..., CHECKED] = 1.0
    coarse[0, :, MEAN] = (0.05, 0.9, 0.2, 0.0)
    coarse[0, :, SIGMA] = (0.02, 0.05, 0.05, 0.5)
    values = tolerance_values(coarse, 5.0, 0.3)
    assert (values["proved"], values["broken"], values["untold"]) == (50.0, 25.0, 25.0)
    assert tolerance_values(coarse, 5.0, None)["proved"] is None and tolerance_values(coarse * 0, 5.0, 0.3)["proved"] is None


def test_the_tolerance_of_the_stage_reaches_the_report():
    assert DsmCheckStage(tolerance=0.25).tolerance == 0.25
    made = report((tile_counts(noisy()),), PAIRS, blocks_of_noise(), Blocks(GRID, 8, 3.0, "EPSG:2100", 5.0)).report
    assert figures(made)["proved"] == 100.0


def blocks_of_noise() -> np.ndarray:
    return np.concatenate([blocks(noisy(), np.full(GRID.shape, 0.2), 8), np.zeros((16, 20, 2), np.float32)], axis=-1)


def test_uncertain_cells_of_a_block_do_not_hide_what_the_others_say():
    """The walls of a wrong house: known to metres only."""
    dh, sigma = np.full((8, 8), -5.0, np.float32), np.full((8, 8), 0.1, np.float32)
    dh[:, :3], sigma[:, :3] = -2.0, 2.0
    ((share, mean, error),) = blocks(dh, sigma, 8)[0]
    assert share == 1.0 and mean == pytest.approx(-5.0, abs=0.02) and error == pytest.approx(0.1, abs=0.01)


def test_what_no_two_photographs_show_is_told_apart_from_what_could_not_be_judged():
    """Half of the heights are shown by a pair, and 80 % of these judged."""
    dh = noisy()
    dh[:, 64:] = np.nan
    half = tile_counts(dh).model_copy(update={"shown": 128 * 80})
    found = report((half,), PAIRS, blocks(dh, np.full(dh.shape, 0.2), 8), Blocks(GRID, 8, 3.0, "EPSG:2100")).report
    values = figures(found)
    assert (values["checked"], values["shown"], values["checked_of_shown"]) == (40.0, 50.0, 80.0)
    assert "40 % of the measured heights (80 % of those that two photographs show)" in found.verdict.sentence


def bent(height: float) -> np.ndarray:
    """Corrections of a surface with a dome of so many metres, below a pixel of height."""
    row, col = np.indices(GRID.shape) / np.array(GRID.shape)[:, None, None]
    return noisy() - height * (1 - 4 * (row - 0.5) ** 2) * (1 - 4 * (col - 0.5) ** 2)


def test_agreement_below_a_pixel_is_good_only_as_far_as_the_check_can_see():
    """A pixel stands for 2 m; blocks are told to 0.2 m, so that 0.93 m would have been found."""
    assert reported(noisy()).verdict.level == "good"
    assert reported(bent(1.9)).verdict.level == "fair"
    sentence = reported(noisy()).verdict.sentence
    assert "an error of 0.93 m would have been found: of smaller and narrower ones" in sentence and "tells nothing" in sentence
    assert "errors below 0.93 m are not seen" in reported(noisy()).answers[0].text


@pytest.mark.parametrize(("tolerance", "level", "share"), [(1.5, "good", "100 %"), (0.3, "fair", "0 %")])
def test_a_tolerance_that_the_check_cannot_prove_is_not_good(tolerance, level, share):
    dh = noisy()
    coarse = blocks(dh, np.full(dh.shape, 0.2), 8)
    found = report((tile_counts(dh),), PAIRS, coarse, Blocks(GRID, 8, 3.0, "EPSG:2100", tolerance=tolerance)).report
    assert found.verdict.level == level
    assert f"{tolerance} m are allowed: {share} of the judged ground is proved to keep that" in found.verdict.sentence


@pytest.mark.parametrize(
    ("up", "words"),
    [
        (0.5, "photographs (standard error 0.010 m); the corrected"),
        (40.0, "another height system"),
        (1874.0, "no two height systems"),
    ],
)
def test_a_shift_is_told_with_what_it_can_come_from(up, words):
    (told,) = shift_warnings(SurfaceShift(up=up, up_sigma=0.01, blocks=100), removed=False, cell=1.0)
    assert words in told and ("camera constant" in told) == (up > 3)


def test_a_height_that_pairs_see_differently_is_known_no_better_than_they_agree():
    found = SurfaceShift(up=0.4, up_sigma=0.003, blocks=100)
    apart = with_pairs_apart(found, [0.0, 0.03, -0.03, float("nan")])
    assert apart.up == found.up and apart.up_sigma == pytest.approx(np.hypot(0.003, 0.03 / np.sqrt(3)))
    assert with_pairs_apart(found, [0.5]) == found


def test_a_shift_in_plan_of_a_small_part_of_a_cell_puts_nothing_in_doubt():
    shift = SurfaceShift(up=0.0, up_sigma=0.01, east=0.2, north=0.0, plan_sigma=(0.01, 0.01), blocks=100)
    assert not list(shift_warnings(shift, removed=False, cell=1.0))
    (told,) = shift_warnings(shift, removed=False, cell=0.5)
    assert "0.20 m too far east" in told


def test_differences_from_an_earlier_surface_are_told_as_change():
    dh = np.zeros(GRID.shape, np.float32)
    dh[32:64, 32:64], dh[88:112, 96:128] = 2.0, -1.5
    coarse = blocks(dh, np.full(dh.shape, 0.1), 8)
    made = report((tile_counts(dh),), PAIRS, coarse, Blocks(GRID, 8, 3.0, "EPSG:2100", words=CHANGES))
    (told,) = [warning for warning in made.report.warnings if "changed" in warning]
    assert told.startswith("The ground has changed") and "risen by about 2 m" in told and "fallen by about 1.5 m" in told
    assert {feature.properties["ground"] for feature in made.areas.features} == {"risen", "fallen"}
    assert any(picture.title == "Change since the earlier surface" for picture in made.report.pictures)


@pytest.mark.parametrize(("area", "place"), [(1600.0, "X 3, Y -1"), (9.0, "X 3.1, Y -1.2"), (0.09, "X 3.14, Y -1.21")])
def test_an_area_is_placed_to_a_tenth_of_its_width(area, place):
    one = SuspiciousArea(x=3.1416, y=-1.214, area=area, dh=1.0, extreme=2.0, blocks=np.zeros((1, 2), int))
    (told,) = area_warnings([one], Trend(0.0, 0.0, 0.0, 0.0), CHANGES)
    assert f"at {place}. " in told
