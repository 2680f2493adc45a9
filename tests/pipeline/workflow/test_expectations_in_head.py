"""What is expected of a block stands in the head of its starting workflow, unless files beside the photographs change it."""

import pytest
from front_door import CATALOGUE, photograph

from orthomill.pipeline.workflow.starting_workflow import write_starting_workflow
from orthomill.pipeline.workflow.workflow_file import load_workflow
from orthomill.schemas.findings.flight_findings import ExpectedFlight, FirstLook

VOLOS = (22.94, 39.36)
EXPECTED = ExpectedFlight(
    pattern="Flight: a grid. " + "It is long. " * 12, bend="It bends: 1 m.", accuracy="Errors: 2 m.", effort="1 h."
)


@pytest.fixture
def root(tmp_path):
    for number in range(3):
        photograph(tmp_path / "photos" / f"DJI_{number}.JPG", "DJI FC300S", gps=VOLOS, focal=3.61)
    return tmp_path


def look(headers, crs, beside=None):
    assert crs == "EPSG:32634"
    return FirstLook(findings=("Camera: one.",), used=tuple(header.path for header in headers), expected=EXPECTED)


def test_all_lines_are_comments_in_the_head(root):
    start = write_starting_workflow("site", root / "photos", root, CATALOGUE, look=look)
    head = start.path.read_text().partition("project:")[0]
    assert "\n# Camera: one.\n# Flight: a grid." in head and "\n# It bends: 1 m.\n# Errors: 2 m.\n# 1 h.\n" in head
    assert max(map(len, head.splitlines())) <= 120
    assert load_workflow(start.path, CATALOGUE).project.project == "site"


def test_errors_of_tags_are_not_stated_where_control_is_used(root):
    (root / "photos" / "gcp_list.txt").write_text("EPSG:32634\n407000 4357000 10 30 20 DJI_0.JPG\n")
    expected = write_starting_workflow("site", root / "photos", root, CATALOGUE, look=look).look.expected
    assert expected.bend is None and expected.pattern == EXPECTED.pattern
    assert (
        expected.accuracy
        == "Expected accuracy: not foreseen, for control or a camera beside the photographs is used; the run states it."
    )


def test_positions_beside_the_photographs_are_what_is_looked_at(root):
    text = "photo,x,y,z\n" + "".join(f"DJI_{n}.JPG,{407000 + 20 * n},4357000,120\n" for n in range(3))
    (root / "photos" / "positions.csv").write_text(text)
    seen = []

    def looked(headers, crs, beside=None):
        seen.append((beside.path, beside.text))
        return look(headers, crs)

    start = write_starting_workflow("site", root / "photos", root, CATALOGUE, look=looked)
    assert seen == [("photos/positions.csv", text)] and start.look.expected == EXPECTED
