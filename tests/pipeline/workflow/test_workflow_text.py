"""Plain data as YAML on one line: whatever goes in comes out again, for this reader and for an ordinary YAML 1.1 reader."""

import pytest
import yaml
from front_door import CATALOGUE, MatchingStage, PaintingStage
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.pipeline.workflow.workflow_text import comment, default_text, flow, workflow_text
from orthomill.pipeline.workflow.yaml_lines import read_yaml
from orthomill.schemas.project import CameraFromChessboards, CameraGiven, Project

TEXT = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)
SCALAR = st.none() | st.integers(-(10**17), 10**17) | st.floats(allow_nan=False, allow_infinity=False) | TEXT
DATA = st.recursive(SCALAR, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXT, inner, max_size=4), max_leaves=10)
TRICKY = (
    "",
    "no",
    "Yes",
    "null",
    "~",
    "1e-3",
    "007",
    "1_000",
    "12:30",
    "2026-01-01",
    "a: b",
    "- a",
    "# c",
    "*a",
    "&a",
    "!t",
    "EPSG:2100",
    "é\n\t",
    "'",
    '"',
)


@settings(max_examples=200, deadline=None)
@given(value=DATA)
def test_data_comes_back_as_it_was(value):
    assert read_yaml(f"value: {flow(value)}").value == {"value": value}


@pytest.mark.parametrize("text", TRICKY)
def test_texts_that_look_like_something_else_stay_texts_for_every_reader(text):
    line = f"value: {flow(text)}"
    assert read_yaml(line).value == yaml.safe_load(line) == {"value": text}


@settings(max_examples=200, deadline=None)
@given(value=st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_are_numbers_for_every_reader(value):
    found = yaml.safe_load(f"value: {flow(value)}")["value"]
    assert isinstance(found, float) and found == value


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "null"),
        (True, "true"),
        (512, "512"),
        (0.5, "0.5"),
        (1e-5, "1.0e-05"),
        ("photos/a.jpg", "photos/a.jpg"),
        ("EPSG:2100+5773", "EPSG:2100+5773"),
        ([1, 2.5, "a b"], '[1, 2.5, "a b"]'),
        ({"kind": "square"}, "{kind: square}"),
        ([], "[]"),
    ],
)
def test_plain_data_are_written_plainly(value, text):
    assert flow(value) == text


def test_defaults_on_one_line():
    fields = MatchingStage.model_fields
    assert default_text(fields["window"]) == "{kind: square}" and default_text(fields["levels"]) == "[1.0e-05, 2.0]"
    assert default_text(fields["limit"]) == "null" and default_text(fields["centre"]) == "mean"


@pytest.mark.parametrize(
    ("words", "measure", "text"),
    [("Side of a tile.", "px", "  # Side of a tile. [px]"), ("Words.", "", "  # Words."), ("", "m", "  # [m]"), ("", "", "")],
)
def test_comments(words, measure, text):
    assert comment(words, measure) == text


def test_a_workflow_has_its_nested_settings_in_columns():
    photographs = {"kind": "folder", "path": "boards"}
    cameras = CameraFromChessboards(kind="chessboards", photographs=photographs, corners=(5, 6), square=0.05)
    project = Project(project="site", crs="EPSG:2100", photographs=photographs, cameras=cameras)
    text = workflow_text(project, (MatchingStage(), PaintingStage(note="a: b")))
    value = read_yaml(text).value
    every = photographs | {"folders": "none", "pattern": "*", "band": None, "masks": None}
    assert value["cameras"]["photographs"] == every and value["cameras"]["corners"] == [5, 6]
    assert [stage["kind"] for stage in value["stages"]] == ["matching", "painting"] and value["stages"][1]["note"] == "a: b"
    assert Project.model_validate({name: part for name, part in value.items() if name != "stages"}) == project


@pytest.mark.parametrize("stage", CATALOGUE)
def test_every_line_of_a_stage_has_its_sentence(stage):
    project = Project(project="a", crs="b", photographs={"kind": "folder", "path": "c"}, cameras=CameraGiven(kind="given", c=1.0))
    lines = workflow_text(project, (stage(),)).split("stages:")[1].strip().splitlines()
    described = {name for name, field in stage.model_fields.items() if field.description}
    for line in lines:
        name = line.strip("- ").split(":")[0]
        assert name not in described or "  # " in line, line
