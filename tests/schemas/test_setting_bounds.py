"""Bounds of the project's settings: the last value inside is accepted, the first one outside is refused with its sentence."""

import math
from collections.abc import Iterator

import pytest
from pydantic import TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

from orthomill.schemas import project as schema
from orthomill.schemas.project import CameraFromChessboards, CameraGiven, PhotoList, Project
from orthomill.schemas.settings import Settings

MODELS = [
    value for value in vars(schema).values() if isinstance(value, type) and issubclass(value, Settings) and value is not Settings
]
FOLDER = {"kind": "folder", "path": "photos"}
VALUES = {
    "Project": {"project": "site", "crs": "EPSG:2100", "photographs": FOLDER},
    "CameraGiven": {"kind": "given", "c": 3000.0},
    "CameraFromChessboards": {"kind": "chessboards", "photographs": FOLDER, "corners": (5, 6), "square": 0.05},
    "PositionsFromExif": {"kind": "exif"},
    "PositionsFromFile": {"kind": "file", "path": "gnss.csv"},
    "ControlFromFiles": {"kind": "files", "points": "points.csv"},
    "ControlFromTargets": {"kind": "targets"},
    "SurveyedPoints": {},
    "ControlFromGcpList": {"kind": "gcp_list", "path": "gcp_list.txt"},
    "Tolerances": {},
}
SENTENCES = {"ge": "greater than or equal to", "gt": "greater than", "le": "less than or equal to", "lt": "less than"}
OUTWARDS = {"ge": -1, "gt": -1, "le": 1, "lt": 1}


def bounds_of(field: FieldInfo) -> Iterator[tuple[str, float]]:
    for bound in field.metadata:
        for word in SENTENCES:
            if hasattr(bound, word):
                yield word, getattr(bound, word)


BOUNDS = [
    (model, name, word, limit) for model in MODELS for name, field in model.model_fields.items() for word, limit in bounds_of(field)
]


def step(model: type[Settings], name: str, limit: float, direction: int) -> float:
    """The neighbour of a limit: the next allowed integer, or the next float."""
    if model.model_fields[name].annotation is int:
        return limit + direction * (64 if name == "tile" else 1)
    return math.nextafter(limit, direction * math.inf)


@pytest.mark.parametrize(("model", "name", "word", "limit"), BOUNDS, ids=lambda value: getattr(value, "__name__", str(value)))
def test_a_setting_is_accepted_up_to_its_bound_and_no_further(model, name, word, limit):
    first, last = limit, limit
    if word in ("gt", "lt"):
        last = step(model, name, limit, -OUTWARDS[word])
    else:
        first = step(model, name, limit, OUTWARDS[word])
    values = VALUES[model.__name__]
    assert getattr(model(**values | {name: last}), name) == last
    with pytest.raises(ValidationError, match=rf"{name}\s+Input should be {SENTENCES[word]} {limit:g}"):
        model(**values | {name: first})


def test_lengths_and_standard_errors_have_bounds():
    """Whatever is a length, a size or a standard error cannot be negative."""
    bounded = {(model.__name__, name) for model, name, word, _ in BOUNDS if word in ("ge", "gt")}
    sizes = {
        (model.__name__, name)
        for model in MODELS
        for name in model.model_fields
        if name.startswith("sigma_") or name in ("c", "square", "pixel_um", "tile", "boards")
    }
    assert len(sizes) == 22 and sizes <= bounded


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_an_unknown_setting_is_named(model):
    with pytest.raises(ValidationError, match=r"sigma_hieght\s+Extra inputs are not permitted"):
        model(**VALUES.get(model.__name__, {}), sigma_hieght=1.0)


@pytest.mark.parametrize("name", ["c", "x0", "y0", "k1", "k2", "k3", "p1", "p2", "sigma_c", "pixel_um"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_number_of_a_camera_is_finite(name, value):
    """NaN passes every comparison with a bound, so that bounds alone do not refuse it."""
    with pytest.raises(ValidationError, match=rf"{name}\s+Input should be a finite number"):
        CameraGiven(**VALUES["CameraGiven"] | {name: value})


@pytest.mark.parametrize("corners", [(5,), (5, 6, 7), (5.5, 6), ("five", 6), 30])
def test_corners_are_two_integers(corners):
    with pytest.raises(ValidationError, match="corners"):
        CameraFromChessboards(**VALUES["CameraFromChessboards"] | {"corners": corners})


def test_a_list_of_photographs_keeps_its_order():
    assert PhotoList(kind="list", paths=["b.jpg", "a.jpg"]).paths == ("b.jpg", "a.jpg")


@pytest.mark.parametrize("field", ["photographs", "cameras", "positions", "control"])
def test_a_source_without_a_kind_names_what_is_missing(field):
    with pytest.raises(ValidationError, match=rf"{field}\s+Unable to extract tag using discriminator 'kind'"):
        Project(**VALUES["Project"] | {field: {"path": "a"}})


def test_a_workflow_read_twice_is_the_same_project():
    one, other = (TypeAdapter(Project).validate_python(VALUES["Project"]) for _ in range(2))
    assert one == other and hash(one) == hash(other)
    assert one != Project(**VALUES["Project"] | {"tile": 256})
