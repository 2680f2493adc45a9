"""The codes of heights in the report: figures and tables by code and class, and the edges of roofs."""

import pytest

from orthomill.tasks.evaluation.report.codes_section import code_figures, code_grids
from orthomill.tasks.evaluation.report.heights_section import before_check_section, heights_section
from orthomill.tasks.evaluation.tile_sums import CodeMeasures, EdgeShares, HeightsSummary

RELATIVE = (60.0, 90.0, 95.0, 96.0, 97.0, 98.0, 99.0)
WITHIN = (70.0, 95.0, 98.0, 99.0, 99.5, 99.8, 100.0)


def code(name: str, place: str, **numbers) -> CodeMeasures:
    known = {"share": 90.0, "heights": 1000.0, "bias": 0.01, "nmad": 0.06, "beyond_metre": 1.0, "beyond_cell": 4.0}
    return CodeMeasures(
        code=name,
        place=place,
        words=f"{name} heights, {place}",
        numbers={**known, **numbers},
        within=WITHIN,
        within_relative=RELATIVE,
    )


def summary(*codes: CodeMeasures, edges=()) -> HeightsSummary:
    return HeightsSummary(groups=(), codes=codes, edges=edges, expected_sigma=None, cell=0.5)


def values(*codes: CodeMeasures, full=True, edges=()) -> dict:
    return {figure.name: figure.value for figure in code_figures("dsm", summary(*codes, edges=edges), full)}


def test_figures_are_named_by_code_class_and_measure():
    found = values(code("measured", "all"), code("volume", "roof", beyond_metre=2.5))
    assert found["dsm_measured_share"] == 90.0 and found["dsm_measured_beyond_1_cell"] == 4.0
    assert found["dsm_volume_roof_beyond_1_m"] == 2.5 and found["dsm_volume_roof_within_2_sigma"] == 95.0


def test_shares_beyond_are_what_is_not_within():
    found = values(code("measured", "all"))
    assert found["dsm_measured_within_3_sigma"] == 98.0
    assert found["dsm_measured_within_2_relative_sigma"] == 90.0 and found["dsm_measured_beyond_4_relative_sigma"] == 4.0
    assert found["dsm_measured_beyond_4_sigma"] == pytest.approx(1.0) and found["dsm_measured_beyond_5_sigma"] == pytest.approx(0.5)


def test_single_codes_have_the_main_measures_only():
    found = values(code("agreed", "all"))
    honesty = ("within_2_sigma", "beyond_4_sigma", "within_2_relative_sigma", "beyond_4_relative_sigma")
    assert set(found) == {f"dsm_agreed_{name}" for name in ("share", "nmad", "beyond_1_m", *honesty)}


def test_before_the_check_single_codes_have_no_figures():
    found = values(code("agreed", "all"), code("all_codes", "tree"), full=False)
    assert "dsm_all_codes_tree_share" in found and not any("agreed" in name or "bias" in name for name in found)


def test_classes_that_are_part_of_another_are_not_told_apart_by_code():
    assert not values(code("measured", "roof_interior")) and not code_grids("Surface", summary(code("measured", "roof_interior")))


def test_edges_have_figures_of_measured_and_of_all_heights():
    edges = tuple(EdgeShares(code=name, words=f"{name} heights", grown=16.0, lost=None) for name in ("measured", "volume"))
    assert values(edges=edges) == {"dsm_measured_roofs_grown": 16.0, "dsm_measured_roofs_lost": None}


def test_the_tables_have_a_row_for_every_code_and_class():
    edges = (EdgeShares(code="volume", words="volume heights", grown=16.0, lost=4.0),)
    codes, roofs = code_grids("Surface", summary(code("agreed", "tree"), code("volume", "water"), edges=edges))
    assert [row[0] for row in codes.rows] == ["agreed heights, tree", "volume heights, water"]
    assert {len(row) for row in codes.rows} == {len(codes.columns)} and codes.rows[0][1:5] == (90.0, 1000.0, 0.01, 0.06)
    assert roofs.rows == (("volume heights", 16.0, 4.0),)
    assert len(code_grids("Surface", summary(code("agreed", "tree")))) == 1, "without roofs there is no table of their edges"


def test_both_surfaces_show_their_codes():
    known = summary(code("measured", "all"))
    for section, head in (
        (heights_section(known), "dsm_measured_share"),
        (before_check_section(known), "dsm_before_check_measured_share"),
    ):
        assert head in {figure.name for figure in section.figures} and "by code" in " ".join(g.title for g in section.grids)
