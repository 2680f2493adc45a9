"""The report of densification from counts that can be checked by hand, and the statistics of blocks."""

import numpy as np
import pytest
from village_pair import LEVEL_GRID, level_pair

from orthomill.schemas.epipolar import EpipolarPairs
from orthomill.schemas.observations import GroundPoints
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import Provenance, Surface
from orthomill.tasks.densification.line_locus.locus_block import CORRELATION_CLASSES, LineStatistics
from orthomill.tasks.densification.matching_block import (
    PRECISION_EDGES,
    MatchingStatistics,
    PairBlock,
    match_pair_block,
    sum_matching,
)
from orthomill.tasks.densification.plan.densification_jobs import surface_rules
from orthomill.tasks.densification.precision.class_medians import median_of
from orthomill.tasks.densification.precision.tie_points import DISTANCES, TieCounts, around, tie_counts
from orthomill.tasks.densification.report.densification_report import completeness, report, y_parallax
from orthomill.tasks.densification.report.line_report import line_report
from orthomill.tasks.densification.report.surface_report import surface_report
from orthomill.tasks.densification.stage import DensificationStage
from orthomill.tasks.densification.surface_tile import CLASSES, SurfaceStatistics
from orthomill.tasks.matching.dense.blocks import BLOCK
from orthomill.tasks.matching.dense.dense_settings import DenseMatching

SURFACE = Surface(grid=LEVEL_GRID, height_low=-30.0, height_high=60.0)


def matching(converged=800, failed=200, outside=500, y=(0.1, -0.1)) -> MatchingStatistics:
    outcomes = [0] * len(Outcome)
    outcomes[Outcome.CONVERGED], outcomes[Outcome.LOW_TEXTURE], outcomes[Outcome.OUTSIDE] = converged, failed, outside
    precision = [0] * (len(PRECISION_EDGES) - 1)
    precision[2] = converged
    return MatchingStatistics(outcomes=tuple(outcomes), precision=tuple(precision), y_parallaxes=y)


def cells(empty=10, one=50, agreed=30, disputed=2, filled=3, volume=4, incoherent=1) -> SurfaceStatistics:
    classes = [0] * CLASSES
    classes[3] = one + agreed + disputed + volume
    codes = (empty, one, agreed, disputed, filled, volume, incoherent, 0, 0)
    return SurfaceStatistics(provenance=codes, precision=tuple(classes), datum=tuple(classes), spikes=4, lowest=1.234)


EMPTY = cells(100, 0, 0, 0, 0, 0, 0)


def ties(contradicting=2, off=1, points=100) -> TieCounts:
    """Tie points of which `off` lie more than a pixel of parallax, worth 40 m here, off the surface."""
    distances = [0] * DISTANCES
    distances[0], distances[4] = points - off, off
    return TieCounts(points=points, contradicting=contradicting, distances=tuple(distances), width=10.0)


def reported(parts=None, surface=None, names=("a-b", "b-c"), tied=None):
    parts = (matching(), matching(900, 100)) if parts is None else parts
    pairs = EpipolarPairs(pairs=tuple(level_pair(name) for name in names[: len(parts)]))
    return report(pairs, SURFACE, parts, surface or cells(), tied or ties())


def figures(found) -> dict:
    return {figure.name: figure.value for figure in found.figures}


def test_figures_of_matching_leave_out_nodes_outside_the_photographs():
    found = figures(reported())
    assert (found["pairs"], found["nodes"], found["nodes_matched"]) == (2, 2000, 1700)
    assert found["completeness_nodes"] == 0.85
    assert found["parallax_precision_median"] == 0.05, "all nodes are in the class of 0.04 to 0.06 px"


def test_figures_of_the_surface_are_shares_of_the_cells_with_a_height():
    found = figures(reported())
    assert found["cells_with_height"] == 90 and found["completeness_grid"] == 0.9
    assert found["share_one_pair"] == round(50 / 90, 4) and found["share_agreed"] == round(30 / 90, 4)
    assert found["share_disputed"] == round(2 / 90, 4) and found["share_volume"] == round(4 / 90, 4)
    assert found["share_filled"] == round(3 / 90, 4) and found["share_incoherent"] == round(1 / 90, 4)
    assert found["cells_measured"] == 86 and found["share_measured"] == round(86 / 90, 4)
    assert found["spikes_removed"] == 4 and found["height_lowest"] == 1.23 and found["height_highest"] is None
    assert found["precision_median"] == found["datum_precision_median"] == pytest.approx(0.35 * LEVEL_GRID.cell)
    assert (found["cell"], found["rows"], found["columns"]) == (LEVEL_GRID.cell, LEVEL_GRID.rows, LEVEL_GRID.cols)


def test_headlines_are_the_two_figures_that_are_signed():
    assert [f.name for f in reported().figures if f.headline] == ["completeness_nodes", "precision_median"]
    assert all(f.sentence.endswith(".") for f in reported().figures)


def test_the_table_of_pairs_turns_parallaxes_into_heights():
    row = reported().grids[0].rows[0]
    pair = level_pair()
    mean = (pair.parallax_low + pair.parallax_high) / 2
    assert row[:4] == ("a-b", 800, 0.8, 0.05)
    assert row[4] == round(0.05 * pair.base * pair.c / mean**2, 3) and row[5] == 0.0


def test_the_outcomes_of_every_pair_are_listed():
    grid = reported().grids[1]
    assert grid.columns == ("outcome", "a-b", "b-c") and len(grid.rows) == len(Outcome)
    assert (Outcome.LOW_TEXTURE.sentence, 200, 100) in grid.rows


def test_the_origin_of_the_heights_is_listed_by_code():
    rows = reported().grids[2].rows
    assert [row[0] for row in rows] == list(Provenance) and [row[2] for row in rows] == [10, 50, 30, 2, 3, 4, 1, 0, 0]
    assert sum(row[3] for row in rows) == pytest.approx(1.0, abs=1e-3)


def test_a_sound_surface_causes_no_warning():
    assert not reported().warnings


def test_pairs_with_many_failures_are_named_worst_first():
    warning = reported((matching(600, 400), matching(300, 700))).warnings[0]
    assert "In 2 of 2 pairs fewer than 70 %" in warning and warning.index("b-c 30 %") < warning.index("a-b 60 %")


def test_a_y_parallax_that_the_orientation_left_is_reported_for_its_pair():
    warnings = reported((matching(), matching(y=(-0.8, -0.6, -0.7)))).warnings
    assert len(warnings) == 1 and "Pair b-c" in warnings[0] and "-0.70 px" in warnings[0]


def test_disputed_and_empty_surfaces_are_reported():
    for surface, words in ((cells(0, 50, 10, 20, 0, 0, 0), "disagree on 25 %"), (EMPTY, "is empty")):
        found = reported(surface=surface)
        assert words in found.warnings[0] and found.warnings[0] in found.doubts


def test_many_estimates_are_reported():
    assert reported(surface=cells(0, 85, 0, 0, 10, 0, 5)).doubts == ()
    assert "60 % of the heights are estimates" in reported(surface=cells(0, 40, 0, 0, 50, 0, 10)).doubts[0]
    assert "15 % of the heights are estimates" in reported(surface=cells(0, 85, 0, 0, 10, 0, 5)).warnings[0]


def test_nothing_matched_gives_no_numbers():
    none = matching(0, 0, 100, y=())
    found = figures(reported((none,), EMPTY))
    assert found["completeness_nodes"] is None and found["share_one_pair"] is None
    assert completeness(none) is None and y_parallax(none) is None


def test_a_median_of_classes_is_linear_within_its_class():
    edges = np.array([0.0, 1.0, 2.0, 4.0])
    assert median_of((3, 0, 1), edges) == pytest.approx(2.0 / 3.0)
    assert median_of((0, 4, 0), edges) == 1.5 and median_of((1, 0, 3), edges) == pytest.approx(2.0 + 2.0 / 3.0)
    assert median_of((0, 0, 0), edges) is None


def test_statistics_of_blocks_add_up():
    total = sum_matching((matching(), matching(10, 20, 30, y=(0.5,))))
    assert total.outcomes[Outcome.CONVERGED] == 810 and total.outcomes[Outcome.LOW_TEXTURE] == 220
    assert total.precision[2] == 810 and total.y_parallaxes == (0.1, -0.1, 0.5)


def test_a_block_reads_its_square_and_what_the_parallaxes_can_reach():
    pair = level_pair()
    block = PairBlock.over(pair, Window(0, 0, 10, 10), 4, SURFACE)
    assert block.core == Window(0, 0, BLOCK, BLOCK)
    assert block.offset == pair.left_col0 - pair.right_col0
    assert block.parallaxes.low <= pair.parallax_low + block.offset < pair.parallax_high + block.offset <= block.parallaxes.high
    assert block.left.row == block.left.col == 0 and block.left.height <= pair.rows
    assert block.right.width <= pair.right_cols


def test_a_block_without_a_right_image_has_no_match():
    beyond = level_pair(right_col0=level_pair().right_col0 - 5000.0)
    block = PairBlock.over(beyond, Window(0, 0, 9, 7), 4, SURFACE)
    assert block.right.empty
    found = match_pair_block(block, DenseMatching(step=4), np.full(block.left.shape, 100, np.uint8))
    assert found.nodes.shape == (9, 7, 3) and np.isnan(found.nodes).all() and found.outcome.shape == (9, 7)
    assert (found.outcome == Outcome.NOT_TRIED).all()
    assert sum(found.statistics.outcomes) == 63 and sum(found.statistics.precision) == 0


def test_the_settings_of_a_stage_reach_its_tiles():
    stage = DensificationStage.model_validate(
        {
            "kind": "densification",
            "gridding": {"max_jump": 0.7},
            "fusion": {"agreement": 2.0},
            "spikes": {"rounds": 5},
            "completion": {"nearness": 2.5},
            "points": {"most_per_cell": 5},
            "fill": {"kind": "estimate", "max_gap": 3},
        }
    )
    rules = surface_rules(stage)
    assert rules.gridding.max_jump == 0.7 and rules.fusion.agreement == 2.0
    assert rules.spikes.rounds == 5 and rules.fill.reach == 3
    assert rules.completion.nearness == 2.5 and rules.points.most_per_cell == 5


@pytest.mark.parametrize(
    ("surface", "level", "words"),
    [
        (cells(), "good", "96 % of the heights are measured"),
        (cells(incoherent=30), "fair", "28 % are estimates"),
        (cells(incoherent=300), "poor", "78 % are estimates"),
        (EMPTY, "poor", "The surface is empty"),
    ],
)
def test_the_verdict_is_the_share_of_measured_heights(surface, level, words):
    verdict = reported(surface=surface).verdict
    assert verdict.level == level and verdict.weighs and words in verdict.sentence


@pytest.mark.parametrize(
    ("tied", "level"),
    [
        (ties(2, 1), "good"),
        (ties(15, 1), "fair"),
        (ties(0, 15), "fair"),
        (ties(40, 1), "poor"),
        (ties(1, 25), "poor"),
        (ties(9, 1, points=10), "good"),
    ],
)
def test_tie_points_off_the_surface_decide_its_verdict(tied, level):
    found = reported(tied=tied)
    told = [sentence for sentence in found.losses if "tie points lie off the surface" in sentence]
    assert found.verdict.level == level and len(told) == (level != "good")
    assert (told == list(found.doubts)) is (level != "fair"), "what is in doubt is a doubt"


def test_heights_that_are_stated_to_be_coarse_are_no_good_surface():
    coarse = TieCounts(points=100, distances=(100, *[0] * (DISTANCES - 1)), width=0.01)
    found = reported(tied=coarse)
    assert found.verdict.level == "fair" and "one pixel of parallax is 0.04 m" in found.losses[0] and not found.doubts


def test_a_surface_from_lines_is_judged_like_any_other():
    outcomes = [0] * len(Outcome)
    outcomes[Outcome.CONVERGED], outcomes[Outcome.LOW_CORRELATION] = 60, 40
    classes = (0, 0, 60, *[0] * (CORRELATION_CLASSES - 3))
    found = line_report(SURFACE, LineStatistics(outcomes=tuple(outcomes), accepted=classes, limits=classes), cells(), ties(40))
    assert found.verdict.level == "poor" and found.answers == reported().answers
    assert {product.path for product in found.products} > {product.path for product in reported().products}
    assert all(words in " ".join(found.losses) for words in ("Only 60 %", "a correlation of 0.12", "40 % of the 100 tie points"))


def test_windows_that_know_no_walls_make_no_good_surface_and_say_why():
    found = surface_report(SURFACE, cells(), ties(), wall_blind=True)
    assert surface_report(SURFACE, cells(), ties()).verdict.level == "good" and found.verdict.level == "fair"
    assert "do not hold on roofs" in found.verdict.sentence and any("know no walls" in words for words in found.losses)
    assert surface_report(SURFACE, cells(), ties(40), wall_blind=True).verdict.level == "poor"


def test_tie_points_are_compared_with_the_heights_of_their_own_cells():
    grid = MapGrid(west=0.0, north=8.0, cell=1.0, rows=8, cols=8)
    height = np.zeros((8, 8), np.float32)
    height[:, 5:] = 4.0
    code = np.full((8, 8), Provenance.AGREED, np.uint8)
    code[0] = Provenance.INTERPOLATED
    # On the ground, 2 m above it, on the wall between both heights, and on a height that is an estimate.
    x, z = np.array([1.5, 2.5, 4.5, 1.5]), np.array([0.1, 2.0, 3.0, 9.0])
    y, none = np.array([4.5, 4.5, 4.5, 7.5]), np.zeros(4, np.float32)
    points = GroundPoints(np.arange(4), x, y, z, none, none, none + 0.3, np.full(4, 2, np.int16), none)
    windows = tuple(Window(row, col, 4, 4) for row in (0, 4) for col in (0, 4))

    def read(raster):
        return (raster[around(window, grid.shape).slices] for window in windows)

    found = tie_counts(points, read(height), read(np.full((8, 8), 0.4, np.float32)), read(code), grid, windows, 0.5)
    assert (found.points, found.contradicting) == (3, 1)
    assert found.distances[0] == 2 and found.distances[4] == 1


@pytest.mark.parametrize(("cell", "area"), [(0.5, "22.5 m²"), (5.0, "0.225 ha"), (200.0, "3.6 km²")])
def test_areas_have_the_unit_of_their_size(cell, area):
    surface = SURFACE.model_copy(update={"grid": SURFACE.grid.model_copy(update={"cell": cell})})
    answers = {answer.topic: answer.text for answer in surface_report(surface, cells(), ties()).answers}
    assert answers["Area of the surface"] == area


def test_a_client_is_told_the_area_and_how_much_of_it_is_measured():
    answers = {answer.topic: answer.text for answer in reported().answers}
    assert answers["Area of the surface"] == "360 m²"
    assert answers["Heights"].startswith("96 % measured, 4 % estimated") and answers["Heights"].endswith(
        "10 % of the rectangle is empty"
    )
