"""The page of the whole is that of the pages of results, its links lead somewhere, and what it says can be typed."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from benchmarks.mission.mission_page import PAGE, WORKS, body
from benchmarks.mission.page_cells import cell_of
from benchmarks.mission.published_row import NO_FIGURE, Cannot, Found, Row
from orthomill.pipeline.workflow.workflow_checks import kind_of
from orthomill.tasks.catalogue import STAGES

ROOT = Path(__file__).parents[1]
ROWS = [row for rows in WORKS.values() for row in rows]
TEXT = PAGE.read_text()
LINKS = sorted(set(re.findall(r"\]\(([^)]+)\)", TEXT)))
KINDS = {kind_of(stage): stage for stage in STAGES}
REACHED = sorted({row.reach for row in ROWS})


def test_the_page_is_made_from_the_results_as_they_are():
    made = "\n".join(body())
    assert made in TEXT, "make it again: python -m benchmarks mission"


def test_no_cell_is_empty():
    lines = [line for line in TEXT.splitlines() if line.startswith("| ") and not line.startswith("| ---")]
    assert len(lines) > 90
    for line in lines:
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        assert len(cells) == 6 and all(cells), line


@pytest.mark.parametrize("link", LINKS)
def test_a_link_leads_somewhere(link):
    path, _, anchor = link.partition("#")
    target = PAGE.parent / path
    assert target.exists(), link
    if anchor:
        assert re.search(rf'<a id="{anchor}">|\{{#{anchor}\}}', target.read_text()), link


@pytest.mark.parametrize("reach", [one for one in REACHED if one.startswith("{")])
def test_a_fragment_of_a_workflow_is_valid(reach):
    settings = yaml.safe_load(reach)
    KINDS[settings["kind"]].model_validate(settings)


def test_all_else_is_a_command():
    # That it exists, with its options, is tested with those of all documents.
    assert all(one.startswith(("{", "orthomill ")) for one in REACHED)


def test_a_cell_that_is_not_there_is_named():
    with pytest.raises(LookupError, match="has no cell 'RMSE' in a row 'no such row'"):
        cell_of("benchmarks/results/line_locus.md", "Accuracy", "no such row", "RMSE")


def test_nothing_is_called_as_published_without_a_published_value_and_ours():
    row = Row("s", "matching.md#pyramids", "orthomill plan PROJECT", "1.0", Found("matching", "Full extraction", ()))
    assert row.why == "as published" and replace(row, cause="Another scene.").why == "Another scene."
    assert replace(row, ours=Cannot("no photographs", "docs/mission.md")).why == "not compared"
    assert replace(row, published=NO_FIGURE).why == "nothing printed to compare with"
