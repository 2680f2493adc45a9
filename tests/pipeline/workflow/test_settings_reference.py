"""The page of settings is what the schemas say, all of it."""

from collections.abc import Iterator
from typing import get_args

from front_door import CATALOGUE
from pydantic import BaseModel

from orthomill.pipeline.workflow.field_words import allowed, sentence, type_words
from orthomill.pipeline.workflow.settings_reference import settings_reference
from orthomill.schemas.project import CameraFromChessboards, Project


def test_a_row_has_type_default_bounds_unit_and_sentence():
    page = settings_reference(CATALOGUE)
    assert "| `size` | a whole number | `21` | from 3 to 255 | px | Side of the window. |" in page
    assert "| `limit` | a number or null | `null` |  | m | Largest difference. |" in page
    assert "| `centre` | one of mean, median | `mean` |  |  | Which middle counts. |" in page
    assert "Thresholds \\| one for each level." in page


def test_every_kind_of_a_tagged_union_has_its_own_table():
    page = settings_reference(CATALOGUE)
    assert "### `window` of kind `ellipse`\n\nA window stretched along the direction of low texture.\n" in page
    assert "| `max_axis_ratio` | a number | `4.0` | greater than 1, at most 8 |  | Longest over shortest axis. |" in page
    for kind in ("exif", "file", "given", "chessboards"):
        assert f"### `cameras` of kind `{kind}`" in page


def test_a_model_used_in_two_places_is_described_once():
    page = settings_reference(CATALOGUE)
    assert page.count("| `pattern` |") == 1
    assert "### `cameras (chessboards) > photographs` of kind `folder`\n\nAs `photographs` of kind `folder`." in page


def test_a_table_that_stands_elsewhere_is_named_by_the_kind_it_stands_under():
    from orthomill.tasks.catalogue import STAGES

    lines = settings_reference(STAGES).splitlines()
    itself = [line for title, line in zip(lines, lines[2:], strict=False) if line == f"As {title.removeprefix('### ')}."]
    assert itself == [] and "### `outputs (plane) > section` of kind `box`" in lines


def test_fields_in_words():
    assert allowed(Project.model_fields["tile"]) == "a whole number (px), from 128 to 8192, a multiple of 64"
    assert allowed(CameraFromChessboards.model_fields["corners"]) == "2 whole numbers in brackets"
    assert type_words(float | None) == "a number or null"
    assert type_words(dict[str, float]) == "a mapping"


def below(annotation) -> Iterator[type[BaseModel]]:
    """All models in a type, at any depth."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
        for field in annotation.model_fields.values():
            yield from below(field.annotation)
    for part in get_args(annotation):
        yield from below(part)


def test_every_setting_of_every_stage_is_on_the_page():
    from orthomill.tasks.catalogue import STAGES  # here, so that a broken stage fails this test alone

    page = settings_reference(STAGES)
    models = {model for root in (Project, *STAGES) for model in below(root)}
    missing = {
        f"{model.__name__}.{name}"
        for model in models
        for name, field in model.model_fields.items()
        if name != "kind" and f"| `{name}` |" not in page
    }
    unsaid = {
        f"{model.__name__}.{name}"
        for model in models
        for name, f in model.model_fields.items()
        if name != "kind" and not sentence(f)
    }
    assert len(models) > 50 and not missing and not unsaid
