"""Files of surveyed points to rows with the columns of our own: names of columns of any program, or none at all.

Without names of columns a line is name, two coordinates (easting or latitude first), height and standard errors, as Pix4D, Leica
and spreadsheets have it.
"""

from orthomill.schemas.survey_files.column_words import Column
from orthomill.schemas.survey_files.photograph_names import is_image_word
from orthomill.schemas.survey_files.sniffed_table import Lines, lines_of, separation
from orthomill.schemas.survey_files.written_numbers import UNKNOWN
from orthomill.tasks.orientation.control.control_rows import (
    POINT_COLUMNS,
    SHOWN,
    Row,
    Rows,
    StatedControl,
    lacks,
    row_cells,
    stated_system,
    table_head,
    unknown,
    written,
)
from orthomill.tasks.orientation.control.point_columns import named_system, place_columns, roles_in


def point_rows(text: str, stated: StatedControl, mistakes: list[str]) -> Rows:
    """The surveyed points of a text; what is wrong is added to `mistakes`."""
    lines = lines_of(text)
    head = table_head(lines, {"name"}, ({"x", "y"}, {"lon", "lat"}))
    if head is None:
        return _headless_points(text, lines, stated, mistakes)
    spec, names, sign, data = head.columns, head.names, head.separation, head.data
    meanings = head.meanings
    if own := meanings & {"role"}:
        missing = [name for name in POINT_COLUMNS if name not in meanings and name != "name"]
        missing = [name for name in missing if not (name.startswith("sigma") and "sigma_plan" in meanings | _all(meanings))]
        if missing:
            mistakes.append(lacks("control points", missing, POINT_COLUMNS))
            return Rows("table of orthomill", ())
    if missing := [name for name in (("lon", "lat") if meanings & {"lon", "lat"} else ("x", "y")) if name not in meanings]:
        mistakes.append(lacks("control points", missing, POINT_COLUMNS))
        return Rows("unknown", ())
    rows, skipped = [], 0
    named = named_system(head, stated)
    place = place_columns(meanings, stated.crs or named)
    roles = roles_in(head, stated.check)
    for number, line in data:
        cells = row_cells(line, spec, names, sign, f"Control points file, line {number}", mistakes)
        if cells is None:
            continue
        row = _point_row(cells, spec, stated, place) | ({"role": roles[number]} if number in roles else {})
        # Metashape lists markers without coordinates; our own tie points have none, and say so by their role.
        if not own and not any(row[name] for name in "xy"):
            skipped += 1
        else:
            rows.append((number, row))
    form = "table of orthomill" if own else "Metashape markers (CSV)" if names[0].lower() == "label" else "table with named columns"
    stated_unit = any(column.unit != 1.0 for column in spec if column.meaning.startswith("sigma"))
    system = stated_system(lines) or (named if place[0] == "x" else None) or ("EPSG:4979" if place[2] == "z_ellipsoidal" else None)
    return Rows(form, tuple(rows), system, skipped, unit_stated=stated_unit)


def _all(meanings: frozenset[str]) -> set[str]:
    return {"sigma_plan"} if "sigma_all" in meanings else set()


def _point_row(
    cells: dict[str, str], spec: tuple[Column, ...], stated: StatedControl, place: tuple[str, str, str]
) -> dict[str, str]:
    """The cells of our own columns, standard errors and roles filled in where the file has none."""
    has = {column.meaning for column in spec}
    x, y, z = place
    row = {"name": cells.get("name", ""), "x": cells.get(x, ""), "y": cells.get(y, ""), "z": cells.get(z, "nan")}
    row["role"] = cells.get("role", "check" if row["name"] in stated.check else "control")
    default = {"sigma_x": stated.sigma_plan, "sigma_y": stated.sigma_plan, "sigma_z": stated.sigma_height}
    for name, value in default.items():
        own = [word for word in (name, "sigma_plan" if name != "sigma_z" else "", "sigma_all") if word in has]
        given = cells.get(own[0], "") if own else ""
        # In a file of another program an empty accuracy means its default; ours states all or the line is wrong.
        row[name] = given if given or "role" in has else repr(value)
    return row


def _headless_points(text: str, lines: Lines, stated: StatedControl, mistakes: list[str]) -> Rows:
    sign = separation([text for _, text in lines.others])
    rows: list[Row] = []
    for number, line in lines.others:
        name, *cells = sign.cells(line) or ("",)
        values = [sign.coordinate(cell) if i < 2 else sign.number(cell) for i, cell in enumerate(cells)]
        known = next((i for i, value in enumerate(values) if value is None), len(values))
        if known < 2 or not name or is_image_word(name) or (sign.number(name) is not None and known < 3) or name.lower() in UNKNOWN:
            if rows:
                mistakes.append(f"Control points file, line {number}: '{line.strip()[:SHOWN]}' must hold name, x, y and z.")
                continue
            mistakes.append(unknown("control points", text, lines, POINT_COLUMNS))
            return Rows("unknown", ())
        x, y, z, *sigma = [written(cell, value, sign) for cell, value in zip(cells[:known], values, strict=False)] + ["nan"] * (
            known == 2
        )
        plan, height = (sigma[0], sigma[-1]) if len(sigma) in (2, 3) else (repr(stated.sigma_plan), repr(stated.sigma_height))
        own = {"sigma_x": plan, "sigma_y": sigma[1] if len(sigma) == 3 else plan, "sigma_z": height}
        role = "check" if name in stated.check else "control"
        rows.append((number, {"name": name, "role": role, "x": x, "y": y, "z": z, **own}))
    if not rows:
        mistakes.append(unknown("control points", text, lines, POINT_COLUMNS))
    return Rows("list without names of columns (Pix4D, Leica)", tuple(rows), stated_system(lines), order_of_system=True)
