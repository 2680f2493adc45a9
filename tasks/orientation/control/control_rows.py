"""What the readers of control share: rows with the columns of our own, what the workflow states, and the sentences about tables."""

import math
from dataclasses import dataclass

from orthomill.schemas.maps.system_names import code_in
from orthomill.schemas.survey_files.column_words import Column
from orthomill.schemas.survey_files.foreign_kinds import text_kind
from orthomill.schemas.survey_files.sniffed_table import Lines, Separation
from orthomill.schemas.survey_files.table_heads import TableHead, possible_heads
from orthomill.schemas.survey_files.written_numbers import is_plain

POINT_COLUMNS = ("name", "role", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z")
MEASUREMENT_COLUMNS = ("name", "photo", "col", "row", "sigma")
SHOWN = 60
"""letters of a line that are shown"""
Row = tuple[int, dict[str, str]]
"""number of the line, and its cells by the names of our columns"""


@dataclass(frozen=True)
class StatedControl:
    """What the workflow states where files do not: standard errors (m, px), check points, the unit of standard errors of points,
    whether pixels count from a corner (None: as the program does), and the reference system."""

    sigma_plan: float = 0.03
    sigma_height: float = 0.05
    sigma_px: float = 1.0
    check: tuple[str, ...] = ()
    unit: str | None = None
    corner: bool | None = None
    crs: str | None = None


@dataclass(frozen=True)
class Rows:
    """The rows of a file, the program that it follows, the system that it names, how many lines hold no data, whether its
    coordinates may come latitude first, and whether its pixels count from a corner."""

    format: str
    rows: tuple[Row, ...]
    crs: str | None = None
    skipped: int = 0
    order_of_system: bool = False
    corner: bool = False
    unit_stated: bool = False


def stated_row(name: str, found: dict[str, str], stated: StatedControl) -> dict[str, str]:
    """The row of a point: what a file tells of it, and for the rest what the workflow states."""
    plan, height = repr(stated.sigma_plan), repr(stated.sigma_height)
    role = "check" if name in stated.check else "control"
    return {"name": name, "role": role, "sigma_x": plan, "sigma_y": plan, "sigma_z": height} | found


def table_head(lines: Lines, needed: set[str], places: tuple[set[str], ...]) -> TableHead | None:
    """The head of the table; None where no line names such columns."""
    for head in possible_heads(lines):
        if needed <= head.meanings and any(place & head.meanings for place in places):
            return head
    return None


def row_cells(
    line: str, spec: tuple[Column, ...], names: tuple[str, ...], sign: Separation, where: str, mistakes: list[str]
) -> dict[str, str] | None:
    """The cells of a line by their meaning, decimals with a point; None, and a mistake, where it has too many."""
    cells = sign.cells(line)
    if any(cells[len(spec) :]):
        mistakes.append(
            f"{where}: {len(cells)} cells, but the first line names {len(names)} columns; decimals with a comma need another sign "
            "between the columns."
        )
        return None
    filled = (*cells, *("",) * (len(spec) - len(cells)))
    return {column.meaning: _number(cell, column, sign) for column, cell in zip(spec, filled, strict=False) if column.meaning}


def _number(cell: str, column: Column, sign: Separation) -> str:
    """A cell with a decimal point, in metres; names and what is no number as they are."""
    if column.meaning in ("name", "photo", "role", "kind", "enabled", "system"):
        return cell
    value = sign.coordinate(cell)
    # What is written plainly stays: the number of its digits tells how good it is.
    if value is None or math.isnan(value) or (sign.decimal == "." and column.unit == 1.0 and is_plain(cell)):
        return cell
    return repr(value * column.unit)


def written(cell: str, value: float | None, sign: Separation) -> str:
    """A number with a decimal point, as it is written where it has one."""
    if value is None or math.isnan(value):
        return "nan"
    return cell if sign.decimal == "." and is_plain(cell) else repr(value)


def stated_system(lines: Lines) -> str | None:
    """The reference system that a comment names."""
    return code_in(" ".join(comment for _, comment in lines.comments))


def lacks(what: str, missing: list[str], wanted: tuple[str, ...]) -> str:
    """The sentence about a list without columns that are needed."""
    return (
        f"The {what} file lacks the column(s) {', '.join(missing)}; its first line must be: {','.join(wanted)} (or name columns as "
        "Pix4D, Metashape and others do)."
    )


def unknown(what: str, text: str, lines: Lines, wanted: tuple[str, ...]) -> str:
    """The sentence about a text that is no list of points or measurements."""
    if not lines.others:
        return f"The {what} file is empty."
    if kind := text_kind(text):
        return f"The {what} file {kind}."
    return (
        f"The {what} file follows no format that is known: line {lines.others[0][0]} is '{lines.others[0][1].strip()[:SHOWN]}'. "
        f"Its first line must be: {','.join(wanted)} (or name columns as Pix4D, Metashape and others do)."
    )
