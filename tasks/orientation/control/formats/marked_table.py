"""A table with named columns whose lines are measurements, the coordinates of the point beside each of them: a GCP list as it comes
out of a spreadsheet."""

from orthomill.schemas.survey_files.sniffed_table import lines_of
from orthomill.schemas.survey_files.table_heads import possible_heads
from orthomill.tasks.orientation.control.control_rows import Row, Rows, StatedControl
from orthomill.tasks.orientation.control.mark_rows import mark_rows
from orthomill.tasks.orientation.control.point_rows import point_rows

_PLACE = ("x", "y", "z")


def is_marked_table(text: str) -> bool:
    """Whether a text is such a table."""
    return any("name" in head.meanings and head.has_marks and head.has_places for head in possible_heads(lines_of(text)))


def marked_rows(text: str, stated: StatedControl, mistakes: list[str]) -> tuple[Rows, Rows]:
    """Points, each once, and measurements; what is wrong is added to `mistakes`, coordinates of a point that differ among it."""
    points, known = point_rows(text, stated, mistakes), dict[str, Row]()
    for line, row in points.rows:
        first, own = known.setdefault(row["name"].casefold(), (line, row))
        if [own[axis] for axis in _PLACE] != [row[axis] for axis in _PLACE]:
            mistakes.append(
                f"Control points file, line {line}: point {row['name']} has other coordinates than in line {first}; a point has "
                "one place."
            )
    form = "table of points and measurements"
    marks = mark_rows(text, stated, mistakes if points.rows else [])
    return (Rows(form, tuple(known.values()), points.crs, points.skipped, unit_stated=points.unit_stated), Rows(form, marks.rows))
