"""Files of measurements of points in photographs to rows with the columns of our own."""

from orthomill.schemas.survey_files.photograph_names import is_image_word
from orthomill.schemas.survey_files.sniffed_table import Lines, lines_of, separation
from orthomill.tasks.orientation.control.control_rows import (
    MEASUREMENT_COLUMNS,
    SHOWN,
    Row,
    Rows,
    StatedControl,
    lacks,
    row_cells,
    table_head,
    unknown,
)


def mark_rows(text: str, stated: StatedControl, mistakes: list[str]) -> Rows:
    """The measurements of a text; what is wrong is added to `mistakes`."""
    lines = lines_of(text)
    head = table_head(lines, {"name", "photo"}, ({"col", "row"}, {"x", "y"}))
    if head is None:
        return _headless_marks(text, lines, stated, mistakes)
    spec, names, sign, data, has = head.columns, head.names, head.separation, head.data, head.meanings
    col, row = ("col", "row") if "col" in has else ("x", "y")
    own = {"col", "row", "sigma"} <= has
    if missing := [name for name in (col, row) if name not in has]:
        mistakes.append(lacks("control measurements", missing, MEASUREMENT_COLUMNS))
        return Rows("unknown", ())
    rows = []
    for number, line in data:
        cells = row_cells(line, spec, names, sign, f"Control measurements file, line {number}", mistakes)
        if cells is not None:
            sigma = cells.get("sigma", "") if own else cells.get("sigma", "") or repr(stated.sigma_px)
            wanted = {"name": cells["name"], "photo": cells["photo"], "col": cells.get(col, ""), "row": cells.get(row, "")}
            rows.append((number, wanted | {"sigma": sigma}))
    return Rows("table of orthomill" if own else "table with named columns", tuple(rows))


def _headless_marks(text: str, lines: Lines, stated: StatedControl, mistakes: list[str]) -> Rows:
    """The marks of Pix4D: photo, label, col, row and a scale of the zoom; the first two in either order."""
    sign = separation([text for _, text in lines.others])
    rows: list[Row] = []
    for number, line in lines.others:
        cells = sign.cells(line)
        values = [sign.number(cell) for cell in cells[2:4]]
        if len(values) < 2 or None in values:
            if rows:
                mistakes.append(
                    f"Control measurements file, line {number}: '{line.strip()[:SHOWN]}' must hold photo, name, col and row."
                )
                continue
            mistakes.append(unknown("control measurements", text, lines, MEASUREMENT_COLUMNS))
            return Rows("unknown", ())
        photo, name = cells[:2] if is_image_word(cells[0]) or not is_image_word(cells[1]) else cells[1::-1]
        own = {"name": name, "photo": photo, "col": repr(values[0]), "row": repr(values[1])}
        rows.append((number, own | {"sigma": repr(stated.sigma_px)}))
    if not rows:
        mistakes.append(unknown("control measurements", text, lines, MEASUREMENT_COLUMNS))
    return Rows("marks of Pix4D", tuple(rows), corner=True)
