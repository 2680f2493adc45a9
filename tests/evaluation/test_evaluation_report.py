"""The sections of the evaluation report, from summaries that can be verified by hand."""

import numpy as np
import pytest

from orthomill.tasks.evaluation.accuracy import SIGMAS
from orthomill.tasks.evaluation.classes import GROUPS
from orthomill.tasks.evaluation.orthoimage_accuracy import GreyFit, OrthoCounts
from orthomill.tasks.evaluation.report.evaluation_report import EvaluationFacts, evaluation_report
from orthomill.tasks.evaluation.report.heights_section import before_check_section, heights_section
from orthomill.tasks.evaluation.report.orientation_section import orientation_section
from orthomill.tasks.evaluation.report.orthoimage_section import orthoimage_section
from orthomill.tasks.evaluation.report.report_section import ReportSection, share_of
from orthomill.tasks.evaluation.tile_sums import GroupMeasures, HeightsSummary, OrientationSummary, OrthoSummary

NUMBERS = {
    "cells": 1000.0,
    "measured": 900.0,
    "completeness": 90.0,
    "completeness_seen_twice": 95.0,
    "measured_unseen": 2.5,
    "bias": 0.05,
    "sd": 0.2,
    "rmse": 0.21,
    "median": 0.04,
    "nmad": 0.18,
    "median_absolute": 0.12,
    "q68": 0.2,
    "q95": 0.4,
    "fgdc95": 0.41,
    "lowest": -3.0,
    "highest": 2.0,
}
GOOD = (68.0, 95.0, 99.0, 99.5, 99.8, 99.9, 100.0)


def group(name: str, within=GOOD, expected=GOOD, **numbers) -> GroupMeasures:
    words = next(words for key, words, _ in GROUPS if key == name)
    return GroupMeasures(name=name, words=words, numbers={**NUMBERS, **numbers}, within=within, within_expected=expected)


def heights(*groups: GroupMeasures, **changes) -> HeightsSummary:
    return HeightsSummary(groups=groups, expected_sigma=changes.pop("expected_sigma", 0.25), cell=0.5, **changes)


DATUM = {"datum_mean_dx": -0.17, "datum_mean_dy": 0.02, "own_median": 0.05, "own_share_above_half": 0.03}


def shift(**changes) -> dict[str, float | None]:
    names = ("median", "q95", "share_above_half", "nodes_matched")
    values = {f"{head}{name}": 0.1 for head in ("", "open_ground_", "roof_", "measured_") for name in names}
    return {**values, "nodes": 100.0, "matched": 80.0, "mean_dx": 0.01, "mean_dy": -0.02, **DATUM, **changes}


def ortho(fit=None, counts=None, **changes) -> OrthoSummary:
    fit = fit or GreyFit(pixels=500, psnr=38.1234, psnr_raw=30.0)
    return OrthoSummary(fit=fit, counts=counts or OrthoCounts(), shift=shift(**changes), chart_x=(0.1,), chart_y=(4.0,))


ORIENTATION = OrientationSummary(
    numbers={"photos_compared": 2, "centre_rmse_plan": 0.03, "centres_within_3_sigma": 100.0},
    photos=(("a", 0.01, 0.02, 0.03, 0.0, 0.0, 0.0, 1.2, 0.4), ("b", -0.01, 0.0, 0.1, 0.0, 0.0, 0.0, None, None)),
    places=((10.0, 20.0), (30.0, 40.0)),
    interior=(("cam", "c", 401.0, 400.0, 0.5, 2.0),),
)


def values(section: ReportSection) -> dict:
    return {figure.name: figure.value for figure in section.figures}


def test_figures_of_heights_are_named_by_group_and_measure():
    found = values(heights_section(heights(group("all"), group("open_ground", bias=0.5))))
    assert found["dsm_bias"] == 0.05 and found["dsm_open_ground_bias"] == 0.5
    assert found["dsm_completeness"] == 95.0 and found["dsm_completeness_all"] == 90.0 and found["dsm_cells"] == 1000
    assert found["dsm_within_1_sigma"] == 68.0 and found["dsm_open_ground_within_10_expected_sigma"] == 100.0
    assert found["dsm_expected_sigma"] == 0.25 and found["dsm_measured_unseen"] == 2.5


def test_every_figure_has_one_name_and_a_sentence():
    section = heights_section(heights(*(group(name) for name, _, _ in GROUPS), buildings=((1, 20, 0.3),)))
    names = [figure.name for figure in section.figures]
    assert len(names) == len(set(names)) and all(figure.sentence.endswith((".", "be.")) for figure in section.figures)
    assert sum("_within_" in name and "expected" not in name for name in names) == len(GROUPS) * len(SIGMAS) + 1


def test_without_an_expectation_nothing_is_compared_with_it():
    section = heights_section(heights(group("all", expected=()), expected_sigma=None))
    assert not any("expected" in name for name in values(section))
    row = section.grids[1].rows[0]
    assert row[1:] == (*GOOD, *(None,) * len(SIGMAS)) and len(section.grids[1].columns) == len(row)


def test_roofs_water_and_buildings_have_figures_of_their_own():
    buildings = ((1, 40, 0.2), (2, 30, -0.8), (3, 25, 0.4))
    section = heights_section(
        heights(group("all"), group("roof", median_absolute=0.33), group("water", completeness=12.0), buildings=buildings)
    )
    found = values(section)
    assert found["dsm_roof_median_error"] == 0.33 and found["dsm_water_left_empty"] == 88.0
    assert found["dsm_buildings_judged"] == 3 and found["dsm_buildings_median_error"] == 0.4
    assert found["dsm_buildings_within_half_metre"] == 66.67
    assert [row[0] for row in section.grids[2].rows] == [2, 3, 1], "largest difference first"


def test_the_worst_dozen_buildings_are_listed():
    many = tuple((k, 20, 0.1 * k) for k in range(1, 31))
    rows = heights_section(heights(group("all"), buildings=many)).grids[2].rows
    assert [row[0] for row in rows] == list(range(30, 18, -1))


def test_the_table_of_heights_has_a_column_for_every_number():
    grid = heights_section(heights(group("all"))).grids[0]
    assert grid.rows[0] == ("all cells but water", 1000, 95, 0.05, 0.2, 0.21, 0.04, 0.18, 0.12, 0.2, 0.4, -3.0, 2.0)
    assert len(grid.columns) == len(grid.rows[0]) and "0.5 cm" in grid.note


def test_before_the_check_only_the_main_measures_are_reported():
    found = values(before_check_section(heights(group("all"), group("tree"), group("roof"))))
    assert found["dsm_before_check_nmad"] == 0.18 and found["dsm_before_check_roof_q95"] == 0.4
    assert found["dsm_before_check_tree_completeness"] == 95.0
    assert "dsm_before_check_tree_nmad" not in found and not any("_within_1_" in name for name in found)


@pytest.mark.parametrize(("share", "warned"), [(99.0, False), (95.0, False), (80.0, True), (None, False)])
def test_an_optimistic_precision_is_warned_of(share, warned):
    within = (60.0, 90.0, share, *GOOD[3:])
    warnings = heights_section(heights(group("all"), group("open_ground", within=within))).warnings
    assert bool(warnings) == warned
    assert not warned or ("Only 80 % of the heights (open ground" in warnings[0] and "too optimistic" in warnings[0])


def test_open_ground_decides_where_it_is_known():
    poor = (10.0, 15.0, 20.0, *GOOD[3:])
    assert not heights_section(heights(group("all", within=poor), group("open_ground"))).warnings
    assert heights_section(heights(group("all", within=poor))).warnings


def test_a_surface_beside_its_reference_is_reported():
    assert "nothing was compared" in heights_section(heights()).warnings[0]


def test_figures_of_the_orthoimage_against_a_file():
    found = values(orthoimage_section(ortho(counts=OrthoCounts(ssim_sum=45.0, ssim_count=50)), truth=False))
    assert found["ortho_psnr"] == 38.123 and found["ortho_psnr_raw"] == 30.0 and found["ortho_ssim"] == 0.9
    assert found["ortho_shift_nodes"] == 80 and found["ortho_shift_mean_row_px"] == -0.02
    assert found["ortho_mean_absolute_difference"] is None and "ortho_completeness" not in found


def test_figures_of_the_orthoimage_against_the_truth():
    counts = OrthoCounts(
        visible=200,
        visible_covered=190,
        visible_modelled=100,
        visible_modelled_covered=99,
        hidden=50,
        hidden_covered=10,
        shadow=40,
        shadow_doubled=2,
        shadow_doubled_apart=1,
        free=1000,
        free_doubled=1,
        road_3=100,
        road_3_far=4,
        road_fewer=10,
        road_fewer_far=5,
        difference_absolute=300.0,
        difference_count=200,
    )
    found = values(orthoimage_section(ortho(counts=counts), truth=True))
    assert found["ortho_completeness_on_surface"] == 99.0
    assert found["ortho_completeness"] == 95.0 and found["ortho_hidden_coloured"] == 20.0
    assert found["ortho_doubled_share"] == 5.0 and found["ortho_doubled_by_chance"] == 0.1
    assert found["ortho_doubled_apart_share"] == 2.5
    assert found["ortho_roads_disturbed_3"] == 4.0 and found["ortho_roads_disturbed_fewer"] == 50.0
    assert found["ortho_mean_absolute_difference"] == 1.5
    assert found["ortho_datum_shift_mean_col_px"] == -0.17 and found["ortho_own_shift_above_half_px_share"] == 0.03


def test_shifted_orthoimages_are_warned_of():
    assert not orthoimage_section(ortho(), truth=True).warnings
    assert orthoimage_section(ortho(share_above_half=12.4), truth=True).warnings == (
        "12 % of the orthoimage's nodes are shifted by more than half a pixel.",
    )
    nothing = orthoimage_section(ortho(fit=GreyFit(), share_above_half=None, matched=None), truth=True)
    assert "no pixel in common" in nothing.warnings[0] and values(nothing)["ortho_shift_nodes"] is None


def test_the_orientation_lists_photographs_and_parameters():
    section = orientation_section(ORIENTATION)
    found = values(section)
    assert found["photos_compared"] == 2 and found["rotation_rmse"] is None
    assert section.grids[0].rows == ORIENTATION.photos and section.grids[1].rows == ORIENTATION.interior
    (arrows,) = section.charts
    assert arrows.x == (10.0, 30.0) and arrows.series == {"y": (20.0, 40.0), "dx": (0.01, -0.01), "dy": (0.02, 0.0)}
    assert not section.warnings


def test_an_optimistic_orientation_is_warned_of():
    poor = ORIENTATION.model_copy(update={"numbers": {"centres_within_3_sigma": 71.0}})
    assert "Only 71 %" in orientation_section(poor).warnings[0]
    assert not orientation_section(OrientationSummary()).charts


FACTS = EvaluationFacts("truth", ("heights", "ortho", "orientation"))


def test_the_report_puts_the_main_figures_first():
    found = evaluation_report(FACTS, ORIENTATION, heights(group("all")), ortho=ortho())
    details = [figure.detail for figure in found.figures]
    assert details == sorted(details), "main figures before details"
    main = [figure.name for figure in found.figures if not figure.detail]
    assert main[:3] == ["dsm_bias", "dsm_rmse", "dsm_nmad"] and "centre_rmse_plan" in main
    assert {picture.raster for picture in found.pictures} == {"evaluation/dh", "evaluation/ortho_difference", "texture/ortho"}
    assert len(found.grids) == 2 + 2 and len(found.charts) == 3


def test_the_report_of_a_file_has_no_figures_that_need_the_truth():
    found = evaluation_report(EvaluationFacts("file", ("ortho",)), ortho=ortho())
    assert not any("doubled" in figure.name for figure in found.figures)


def test_a_report_of_nothing_says_so():
    found = evaluation_report(EvaluationFacts("none", ()))
    assert not found.figures and found.warnings == (
        "Nothing was compared: the workflow names no reference, or has none of the stages that could be evaluated.",
    )


def test_shares_of_nothing_do_not_exist():
    assert share_of(1, 0) is None and share_of(1, 3) == 33.3333 and share_of(1, 3, 1.0) == 0.3333
    assert np.isclose(share_of(2, 8), 25.0)
