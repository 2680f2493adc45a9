"""Files of surveyed points to rows with the columns of our own: names of columns of any program, or none at all.

Without names of columns a line is name, two coordinates (easting or latitude first), height and standard errors, as Pix4D, Leica
and spreadsheets have it.
"""

import math
import re
from dataclasses import dataclass

from orthomill.schemas.survey_files.column_words import Column, columns
from orthomill.schemas.survey_files.photograph_names import is_image_word
from orthomill.schemas.survey_files.sniffed_table import UNKNOWN, Lines, Separation, lines_of, separation

POINT_COLUMNS = ("name", "role", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z")
MEASUREMENT_COLUMNS = ("name", "photo", "col", "row", "sigma")
_CODE = re.compile(r"EPSG:{1,2}(\d{4,6})", re.IGNORECASE)
Row = tuple[int, dict[str, str]]
"""number of the line, and its cells by the names of our columns"""


@dataclass(frozen=True)
class StatedControl:
    """What the workflow states where files do not: standard errors (m, px), check points, the unit of standard errors of points,
    and whether pixels count from a corner (None: as the program does)."""

    sigma_plan: float = 0.03
    sigma_height: float = 0.05
    sigma_px: float = 1.0
    check: tuple[str, ...] = ()
    unit: str | None = None
    corner: bool | None = None


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


def point_rows(text: str, stated: StatedControl, mistakes: list[str]) -> Rows:
    """The surveyed points of a text; what is wrong is added to `mistakes`."""
    lines = lines_of(text)
    header = _header(lines, {"name"}, ({"x", "y"}, {"lon", "lat"}))
    if header is None:
        return _headless_points(lines, stated, mistakes)
    spec, names, sign, data = header
    meanings = {column.meaning for column in spec}
    if own := meanings & {"role"}:
        missing = [name for name in POINT_COLUMNS if name not in meanings and name != "name"]
        missing = [name for name in missing if not (name.startswith("sigma") and "sigma_plan" in meanings | _all(meanings))]
        if missing:
            mistakes.append(_lacks("control points", missing, POINT_COLUMNS))
            return Rows("table of orthomill", ())
    if missing := [name for name in (("lon", "lat") if meanings & {"lon", "lat"} else ("x", "y")) if name not in meanings]:
        mistakes.append(_lacks("control points", missing, POINT_COLUMNS))
        return Rows("unknown", ())
    rows, skipped = [], 0
    for number, line in data:
        cells = _cells(line, spec, names, sign, f"Control points file, line {number}", mistakes)
        if cells is None:
            continue
        row = _point_row(cells, spec, stated)
        # Metashape lists markers without coordinates; our own tie points have none, and say so by their role.
        if not own and not any(row[name] for name in "xy"):
            skipped += 1
        else:
            rows.append((number, row))
    form = "table of orthomill" if own else "Metashape markers (CSV)" if names[0].lower() == "label" else "table with named columns"
    stated_unit = any(column.unit != 1.0 for column in spec if column.meaning.startswith("sigma"))
    return Rows(form, tuple(rows), _stated_system(lines), skipped, unit_stated=stated_unit)


def _all(meanings: set[str]) -> set[str]:
    return {"sigma_plan"} if "sigma_all" in meanings else set()


def _lacks(what: str, missing: list[str], wanted: tuple[str, ...]) -> str:
    return (
        f"The {what} file lacks the column(s) {', '.join(missing)}; its first line must be: {','.join(wanted)} (or name columns as "
        "Pix4D, Metashape and others do)."
    )


Head = tuple[tuple[Column, ...], tuple[str, ...], Separation, tuple[tuple[int, str], ...]]


def _header(lines: Lines, needed: set[str], places: tuple[set[str], ...]) -> Head | None:
    """The columns, their names, how cells are separated, and the lines of data; None where no line names such columns."""
    candidates = [(0, lines.others[0][1], lines.others[1:])] if lines.others else []
    candidates += [(number, text.lstrip("# \t"), lines.others) for number, text in reversed(lines.comments)]
    for _, head, data in candidates:
        sign = separation([text for _, text in data] or [head])
        sign = sign if len(sign.cells(head)) >= 3 else separation([head])
        names = sign.cells(head)
        spec = columns(names)
        meanings = {column.meaning for column in spec}
        if needed <= meanings and any(place & meanings for place in places):
            return spec, names, sign, data
    return None


def _cells(
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
    if column.meaning in ("name", "photo", "role"):
        return cell
    value = sign.number(cell)
    if value is None or math.isnan(value) or (sign.decimal == "." and column.unit == 1.0):
        return cell
    return repr(value * column.unit)


def _point_row(cells: dict[str, str], spec: tuple[Column, ...], stated: StatedControl) -> dict[str, str]:
    """The cells of our own columns, standard errors and roles filled in where the file has none."""
    has = {column.meaning for column in spec}
    x, y = ("lon", "lat") if "lon" in has else ("x", "y")
    z = next((word for word in ("z", "z_sea", "z_ellipsoidal") if word in has), "")
    row = {"name": cells.get("name", ""), "x": cells.get(x, ""), "y": cells.get(y, ""), "z": cells.get(z, "nan")}
    row["role"] = cells.get("role", "check" if row["name"] in stated.check else "control")
    default = {"sigma_x": stated.sigma_plan, "sigma_y": stated.sigma_plan, "sigma_z": stated.sigma_height}
    for name, value in default.items():
        own = [word for word in (name, "sigma_plan" if name != "sigma_z" else "", "sigma_all") if word in has]
        given = cells.get(own[0], "") if own else ""
        # In a file of another program an empty accuracy means its default; ours states all or the line is wrong.
        row[name] = given if given or "role" in has else repr(value)
    return row


def _stated_system(lines: Lines) -> str | None:
    """The reference system that a comment names."""
    codes = [code for _, comment in lines.comments for code in _CODE.findall(comment)]
    return f"EPSG:{codes[-1]}" if codes else None


def _headless_points(lines: Lines, stated: StatedControl, mistakes: list[str]) -> Rows:
    sign = separation([text for _, text in lines.others])
    rows: list[Row] = []
    for number, line in lines.others:
        name, *cells = sign.cells(line) or ("",)
        values = [sign.number(cell) for cell in cells]
        known = next((i for i, value in enumerate(values) if value is None), len(values))
        if known < 2 or not name or is_image_word(name) or (sign.number(name) is not None and known < 3) or name.lower() in UNKNOWN:
            mistakes.append(_lacks("control points", list(POINT_COLUMNS), POINT_COLUMNS))
            return Rows("unknown", ())
        x, y, z, *sigma = [repr(value) if value == value else "nan" for value in values[:known]] + ["nan"] * (known == 2)
        plan, height = (sigma[0], sigma[-1]) if len(sigma) in (2, 3) else (repr(stated.sigma_plan), repr(stated.sigma_height))
        own = {"sigma_x": plan, "sigma_y": sigma[1] if len(sigma) == 3 else plan, "sigma_z": height}
        role = "check" if name in stated.check else "control"
        rows.append((number, {"name": name, "role": role, "x": x, "y": y, "z": z, **own}))
    if not rows:
        mistakes.append(_lacks("control points", list(POINT_COLUMNS), POINT_COLUMNS))
    return Rows("list without names of columns (Pix4D, Leica)", tuple(rows), _stated_system(lines), order_of_system=True)


def mark_rows(text: str, stated: StatedControl, mistakes: list[str]) -> Rows:
    """The measurements of a text; what is wrong is added to `mistakes`."""
    lines = lines_of(text)
    header = _header(lines, {"name", "photo"}, ({"col", "row"}, {"x", "y"}))
    if header is None:
        return _headless_marks(lines, stated, mistakes)
    spec, names, sign, data = header
    has = {column.meaning for column in spec}
    col, row = ("col", "row") if "col" in has else ("x", "y")
    own = {"col", "row", "sigma"} <= has
    if missing := [name for name in (col, row) if name not in has]:
        mistakes.append(_lacks("control measurements", missing, MEASUREMENT_COLUMNS))
        return Rows("unknown", ())
    rows = []
    for number, line in data:
        cells = _cells(line, spec, names, sign, f"Control measurements file, line {number}", mistakes)
        if cells is not None:
            sigma = cells.get("sigma", "") if own else cells.get("sigma", "") or repr(stated.sigma_px)
            wanted = {"name": cells["name"], "photo": cells["photo"], "col": cells.get(col, ""), "row": cells.get(row, "")}
            rows.append((number, wanted | {"sigma": sigma}))
    return Rows("table of orthomill" if own else "table with named columns", tuple(rows))


def _headless_marks(lines: Lines, stated: StatedControl, mistakes: list[str]) -> Rows:
    """The marks of Pix4D: photo, label, col, row and a scale of the zoom; the first two in either order."""
    sign = separation([text for _, text in lines.others])
    rows: list[Row] = []
    for number, line in lines.others:
        cells = sign.cells(line)
        values = [sign.number(cell) for cell in cells[2:4]]
        if len(values) < 2 or None in values:
            mistakes.append(_lacks("control measurements", list(MEASUREMENT_COLUMNS), MEASUREMENT_COLUMNS))
            return Rows("unknown", ())
        photo, name = cells[:2] if is_image_word(cells[0]) or not is_image_word(cells[1]) else cells[1::-1]
        own = {"name": name, "photo": photo, "col": repr(values[0]), "row": repr(values[1])}
        rows.append((number, own | {"sigma": repr(stated.sigma_px)}))
    if not rows:
        mistakes.append(_lacks("control measurements", list(MEASUREMENT_COLUMNS), MEASUREMENT_COLUMNS))
    return Rows("marks of Pix4D", tuple(rows), corner=True)
