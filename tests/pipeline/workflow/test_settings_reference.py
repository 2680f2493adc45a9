"""docs/settings.md is what the schemas say, all of it, and current."""

from pathlib import Path

from front_door import CATALOGUE

from orthomill.pipeline.workflow.field_words import allowed, type_words
from orthomill.pipeline.workflow.settings_reference import settings_reference, write_settings_reference
from orthomill.schemas.project import CameraFromChessboards, Project

PAGE = Path(__file__).parents[3] / "docs" / "settings.md"


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
    assert "### `cameras > photographs` of kind `folder`\n\nAs `photographs` of kind `folder`." in page


def test_fields_in_words():
    assert allowed(Project.model_fields["tile"]) == "a whole number (px), from 128 to 8192, a multiple of 64"
    assert allowed(CameraFromChessboards.model_fields["corners"]) == "2 whole numbers in brackets"
    assert type_words(float | None) == "a number or null"
    assert type_words(dict[str, float]) == "a mapping"


def test_the_page_in_the_repository_is_current():
    from orthomill.tasks.catalogue import STAGES  # here, so that a broken stage fails this test alone

    assert PAGE.read_text(encoding="utf-8") == settings_reference(STAGES), "docs/settings.md is out of date: make docs"


def test_the_page_is_written(tmp_path):
    write_settings_reference(CATALOGUE, tmp_path / "settings.md")
    assert (tmp_path / "settings.md").read_text(encoding="utf-8") == settings_reference(CATALOGUE)
