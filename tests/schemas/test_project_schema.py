"""The project part of a workflow: what may be said, what is meant when nothing is said, and what is refused."""

from typing import get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import BaseModel, TypeAdapter, ValidationError

from orthomill.schemas import project as schema
from orthomill.schemas.project import CameraSource, ControlSource, Photographs, Positions, Project
from orthomill.schemas.settings import Settings, setting

FOLDER = {"kind": "folder", "path": "photos"}
LEAST = {"project": "site", "crs": "EPSG:2100", "photographs": FOLDER}
MODELS = [
    value for value in vars(schema).values() if isinstance(value, type) and issubclass(value, Settings) and value is not Settings
]
UNIONS = {"photographs": Photographs, "cameras": CameraSource, "positions": Positions, "control": ControlSource}


def project(**more) -> Project:
    return Project.model_validate(LEAST | more)


def test_the_least_that_a_workflow_must_say():
    least = project()
    assert (least.cameras.kind, least.positions.kind, least.control.kind, least.tile) == ("exif", "exif", "none", 512)
    for name in LEAST:
        with pytest.raises(ValidationError, match=name):
            Project.model_validate({key: value for key, value in LEAST.items() if key != name})


@pytest.mark.parametrize("name", ["volos", "0a", "a-b_c", "v2"])
def test_names_that_are_folders_everywhere(name):
    assert project(project=name).project == name


@pytest.mark.parametrize("name", ["", "Volos", "-a", "_a", "a b", "a/b", "..", "ä", "a\n"])
def test_names_that_are_not(name):
    with pytest.raises(ValidationError):
        project(project=name)


@pytest.mark.parametrize("tile", [128, 192, 512, 8192])
def test_tiles_are_multiples_of_64(tile):
    assert project(tile=tile).tile == tile


@pytest.mark.parametrize("tile", [0, 64, 130, 8256, -512, 512.5, float("nan")])
def test_other_tiles_are_refused(tile):
    with pytest.raises(ValidationError):
        project(tile=tile)


SOURCES = [
    ("photographs", FOLDER, {"pattern": "*"}),
    ("photographs", {"kind": "list", "paths": ["a.jpg"]}, {}),
    ("photographs", {"kind": "simulated"}, {}),
    ("cameras", {"kind": "exif"}, {}),
    ("cameras", {"kind": "file", "path": "camera.json"}, {"serves": "*"}),
    ("cameras", {"kind": "given", "c": 3000.0}, {"x0": 0.0, "k1": 0.0, "pixel_um": None, "sigma_c": 0.0}),
    (
        "cameras",
        {"kind": "chessboards", "photographs": FOLDER, "corners": [5, 6], "square": 0.05},
        {"boards": 0, "arrangement": "plane", "sigma_in_plane": 0.0, "sigma_height": 0.0},
    ),
    ("positions", {"kind": "exif"}, {"sigma_plan": None, "sigma_height": None}),
    ("positions", {"kind": "file", "path": "gnss.csv"}, {}),
    ("positions", {"kind": "none"}, {}),
    ("positions", {"kind": "simulated"}, {}),
    ("control", {"kind": "files", "points": "p.csv", "measurements": "m.csv"}, {"distances": None, "crs": None}),
    ("control", {"kind": "gcp_list", "path": "gcp_list.txt"}, {"sigma_plan": 0.03, "sigma_height": 0.05, "sigma_px": 1.0}),
    ("control", {"kind": "scans", "measurements": "m.csv"}, {"check": (), "absent": "skip"}),
    ("control", {"kind": "targets", "distances": "bars.csv"}, {"points": None, "sigma_plan": 0.03, "check": ()}),
    ("control", {"kind": "none"}, {}),
    ("control", {"kind": "simulated"}, {}),
]


@pytest.mark.parametrize(("name", "given", "defaults"), SOURCES, ids=lambda value: value if isinstance(value, str) else "")
def test_every_kind_has_its_defaults_and_comes_back_from_what_is_written(name, given, defaults):
    source = getattr(project(**{name: given}), name)
    for field, value in defaults.items():
        assert getattr(source, field) == value
    assert TypeAdapter(UNIONS[name]).validate_python(source.model_dump(mode="json")) == source


def test_every_kind_is_tried_above():
    for name, union in UNIONS.items():
        kinds = {get_args(model.model_fields["kind"].annotation)[0] for model in get_args(get_args(union)[0])}
        assert kinds == {given["kind"] for part, given, _ in SOURCES if part == name}


@pytest.mark.parametrize(
    ("name", "given", "place"),
    [
        ("cameras", {"kind": "given"}, "c"),
        ("cameras", {"kind": "given", "c": 0}, "greater than 0"),
        ("cameras", {"kind": "given", "c": float("inf")}, "finite"),
        ("cameras", {"kind": "given", "c": 1, "sigma_c": -1}, "greater than or equal to 0"),
        ("cameras", {"kind": "given", "c": 1, "pixel_um": 0}, "greater than 0"),
        ("cameras", {"kind": "exif", "c": 1}, "Extra inputs"),
        ("cameras", {"kind": "guess"}, "does not match any of the expected tags"),
        ("cameras", {"kind": "chessboards", "photographs": FOLDER, "corners": [5], "square": 0.05}, "corners"),
        ("cameras", {"kind": "chessboards", "photographs": FOLDER, "corners": [5, 6], "square": 0}, "greater than 0"),
        (
            "cameras",
            {"kind": "chessboards", "photographs": FOLDER, "corners": [5, 6], "square": 1, "boards": 41},
            "less than or equal",
        ),
        (
            "cameras",
            {"kind": "chessboards", "photographs": FOLDER, "corners": [5, 6], "square": 1, "arrangement": "line"},
            "arrangement",
        ),
        ("positions", {"kind": "exif", "sigma_plan": 0}, "greater than 0"),
        ("positions", {"kind": "exif", "sigma_height": -1}, "greater than 0"),
        ("control", {"kind": "gcp_list", "path": "a", "sigma_px": 0}, "greater than 0"),
        ("control", {"kind": "gcp_list", "path": "a", "origin": "middle"}, "origin"),
        ("control", {"kind": "files", "measurements": "a"}, "points"),
        ("photographs", {"kind": "list", "paths": []}, "at least 1 item"),
    ],
)
def test_what_cannot_be_is_refused(name, given, place):
    with pytest.raises(ValidationError, match=place):
        project(**{name: given})


def fields():
    return [(model, name, field) for model in MODELS for name, field in model.model_fields.items() if name != "kind"]


@pytest.mark.parametrize(("model", "name", "field"), fields(), ids=lambda value: getattr(value, "__name__", str(value))[:30])
def test_every_setting_has_a_sentence_and_a_unit(model, name, field):
    """Messages, the reference and the starting workflow are generated from them."""
    assert field.description and field.description.rstrip()[-1] in ".;)" and "\n" not in field.description
    assert "unit" in field.json_schema_extra
    if name.startswith("sigma"):
        assert field.json_schema_extra["unit"], "a standard error without a unit"


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_every_model_says_what_it_is(model):
    assert model.__doc__ and model.__doc__.strip().endswith(".")


# --- how settings are declared -----------------------------------------------------------------------------------------------


class Matching(Settings):
    """An example."""

    size: int = setting(21, "Side of the window.", "px", ge=3)
    name: str = setting(..., "Its name.")


def test_a_setting_carries_default_sentence_unit_and_bounds():
    field = Matching.model_fields["size"]
    assert (field.default, field.description, field.json_schema_extra) == (21, "Side of the window.", {"unit": "px"})
    assert Matching.model_fields["name"].is_required() and Matching.model_fields["name"].json_schema_extra == {"unit": ""}
    with pytest.raises(ValidationError, match="greater than or equal to 3"):
        Matching(name="a", size=2)


def test_settings_are_frozen_closed_and_finite():
    with pytest.raises(ValidationError, match="frozen"):
        Matching(name="a").size = 5
    with pytest.raises(ValidationError, match="Extra inputs"):
        Matching(name="a", sise=5)

    class Length(Settings):
        """A length."""

        metres: float = setting(..., "A length.", "m")

    for value in (float("nan"), float("inf")):
        with pytest.raises(ValidationError, match="finite"):
            Length(metres=value)


@settings(max_examples=60, deadline=None)
@given(size=st.integers(3, 10**6), name=st.text(max_size=10))
def test_settings_are_values(size, name):
    """Equal settings are equal keys: fingerprints and caches rely on it."""
    one, other = Matching(size=size, name=name), Matching(size=size, name=name)
    assert one == other and hash(one) == hash(other)
    assert isinstance(one, BaseModel) and Matching.model_validate(one.model_dump()) == one
