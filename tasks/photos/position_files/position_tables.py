"""Positions in tables with one line for a photograph: our own, Pix4D, Metashape, REDtoolbox, senseFly, Wingtra, and anyone's.

The columns are known by their names (with # before them or not); without names the order is that of Pix4D: photograph, two
coordinates in the order of the axes of their system (latitude before longitude, east before north), height, and what follows.
"""

import math
import re
from dataclasses import replace
from math import isfinite
from statistics import pstdev

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.maps.system_names import code_in
from orthomill.schemas.photo import Fix, HeightKind
from orthomill.schemas.survey_files.column_words import Column, columns
from orthomill.schemas.survey_files.foreign_kinds import text_kind
from orthomill.schemas.survey_files.photograph_names import is_image_word
from orthomill.schemas.survey_files.sniffed_table import Line, Lines, Separation, lines_of, separation
from orthomill.schemas.survey_files.table_heads import possible_heads
from orthomill.schemas.survey_files.written_steps import CUT, ENOUGH_HEIGHTS, ENOUGH_IN_PLAN, lost_digits, written_step
from orthomill.tasks.geometry.coordinate_ranges import coordinate_mistake, sigma_mistake
from orthomill.tasks.photos.position_files.listed_positions import ListedPosition, PositionList, Triple, fix_of

OWN = ("photo", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z")
"""Columns of our own format; standard errors may be left out."""
_LIKE_ERRORS = 5.0
"""angles of a flight are not all between 0 and 5 degrees, and standard errors in metres are"""
_WHOLE_TURNS = 3600.0  # degrees; larger angles are other numbers
_SIGMAS = (("sigma_x", "sigma_plan", "sigma_all"), ("sigma_y", "sigma_plan", "sigma_all"), ("sigma_z", "sigma_all", "sigma_plan"))
"""Columns from which the standard error of each coordinate is taken, the best first."""
_FIX_WORDS: dict[str, Fix] = {"fix": "fixed", "fixed": "fixed", "float": "float", "single": "single", "none": "none"}
# Pix4D's files without a header, by the number of their columns; angles are told apart by which of them turns most.
_PIX4D = ("photo", "x", "y", "z")
_HEADLESS: dict[int, tuple[str, ...]] = {
    4: _PIX4D,
    5: (*_PIX4D, "sigma_all"),
    6: (*_PIX4D, "sigma_plan", "sigma_z"),
    7: (*_PIX4D, "angle1", "angle2", "angle3"),
    9: (*_PIX4D, "angle1", "angle2", "angle3", "sigma_plan", "sigma_z"),
    10: (*_PIX4D, "angle1", "angle2", "angle3", "sigma_x", "sigma_y", "sigma_z"),
}


def read_table(text: str) -> PositionList:
    """The positions of a table. Raises WorkflowError for a text that is none."""
    lines = lines_of(text)
    for head in possible_heads(lines):
        has = head.meanings
        if has & {"photo", "name"} and (has & {"x", "lon"} or has & {"y", "lat"}):
            data = [Line(number, head.separation.cells(line)) for number, line in head.data]
            return _listed_rows(_format(head.names, text), _checked(head.names), head.separation, data, lines)
    return _headless(lines, text)


def _listed_rows(form: str, names: tuple[str, ...], sign: Separation, data: list[Line], lines: Lines) -> PositionList:
    """The lines of data below the names of their columns."""
    spec = columns(names)
    rows = [_listed(line, spec, names, sign) for line in data]
    told = [
        f"Line {line.number} of the positions file {row}." for line, row in zip(data, rows, strict=True) if isinstance(row, str)
    ]
    meanings = {column.meaning for column in spec}
    heights: HeightKind | None = "ellipsoidal" if "z_ellipsoidal" in meanings else "sea_level" if "z_sea" in meanings else None
    listed = PositionList(
        form,
        tuple(row for row in rows if isinstance(row, ListedPosition)),
        code_in(" ".join(comment for _, comment in lines.comments)),
        heights,
        degrees={"lon", "lat"} <= meanings,
        unit_stated=any(c.unit != 1.0 for c in spec if c.meaning.startswith("sigma")) or _names_metres(names),
        steps=_steps(data, spec),
        without=sum(row is None for row in rows),
        mistakes=tuple(told),
    )
    return _with_angles(listed)


def _steps(data: list[Line], spec: tuple[Column, ...]) -> tuple[float, float]:
    """To which steps plan and heights are written, metres or degrees."""
    at = {column.meaning: (i, column.unit) for i, column in enumerate(spec) if column.meaning}
    found = []
    plan = ("lon", "lat") if "lon" in at else ("x", "y")
    for words, enough in ((plan, ENOUGH_IN_PLAN), (("z_ellipsoidal", "z", "z_sea"), ENOUGH_HEIGHTS)):
        own = [at[word] for word in words if word in at]
        cells = [line.cells[i] for line in data for i, _ in own if len(line.cells) > i]
        found.append(written_step(cells, enough) * own[0][1])
    return found[0], found[1]


def _names_metres(names: tuple[str, ...]) -> bool:
    """Whether a column of standard errors says that it is in metres."""
    return any(re.search(r"[\(\[_]\s*m(et(er|re)s?)?\s*[\)\]]?$", name.strip().lower()) for name in names if "acc" in name.lower())


def _checked(names: tuple[str, ...]) -> tuple[str, ...]:
    """The names of the columns. Raises WorkflowError where one that is needed is missing."""
    meanings = {column.meaning for column in columns(names)}
    pair = ("lon", "lat") if meanings & {"lon", "lat"} else ("x", "y")
    missing = [name for name in pair if name not in meanings]
    missing += [] if meanings & {"z", "z_ellipsoidal", "z_sea"} else ["z"]
    if missing:
        raise WorkflowError(f"The positions file has no column {', '.join(missing)}; its first line must name {', '.join(OWN)}.")
    return names


def _format(names: tuple[str, ...], text: str) -> str:
    """The program that writes such columns."""
    own = [name.strip().lstrip("#").strip().lower() for name in names]
    if set(own) >= set(OWN[:4]):
        return "table of orthomill"
    if "redtoolbox" in text[:4000].lower() or "redcatch" in text[:4000].lower():
        return "REDtoolbox table"
    if "altitude_wgs84" in own or "altitude_amsl" in own:
        return "senseFly geoinfo"
    if own[0] == "label":
        return "Metashape reference"
    return "Pix4D geolocation" if own[0] in {"imagename", "image_name"} else "table with named columns"


def _listed(line: Line, spec: tuple[Column, ...], names: tuple[str, ...], sign: Separation) -> ListedPosition | str | None:
    """The position of a line, what is wrong with it as the end of a sentence, or None where it has no position."""
    if len([cell for cell in line.cells[len(spec) :] if cell]) > 0:
        return (
            f"has {len(line.cells)} cells, but the first line names {len(names)} columns; decimals with a comma need another sign "
            "between the columns"
        )
    cells = {c.meaning: cell for c, cell in zip(spec, line.cells, strict=False) if c.meaning}
    units = {c.meaning: c.unit for c in spec}
    name = cells.get("photo") or cells.get("name") or ""
    x, y = ("lon", "lat") if "lon" in units else ("x", "y")
    z = next(word for word in ("z_ellipsoidal", "z", "z_sea") if word in units)
    if not any(cells.get(word, "").strip() for word in (x, y)):
        return None if name else "is empty"
    values = [sign.coordinate(cells.get(word, "")) for word in (x, y, z)]
    # A height may be missing, where the line says so; a place may not.
    known = [value for value in values if value is not None]
    if len(known) < 3 or math.isnan(known[0]) or math.isnan(known[1]) or z not in cells:
        return f"does not hold six numbers after the photograph's name, but {', '.join(cells.get(w, '')[:20] for w in (x, y, z))!r}"
    if cut := next((cells[word] for word in (x, y) if lost_digits(cells[word])), None):
        return f"holds {cut!r}, {CUT}"
    place: Triple = (known[0] * units[x], known[1] * units[y], known[2] * units[z])
    for word, value in zip("xyz", place, strict=True):
        if not math.isnan(value) and (mistake := coordinate_mistake(value)):
            return f"is wrong: {word} {mistake}"
    sigma = _sigma(cells, units, sign)
    if isinstance(sigma, str):
        return sigma
    opk, ypr = _angles(cells, ("omega", "phi", "kappa"), sign), _angles(cells, ("yaw", "pitch", "roll"), sign)
    if isinstance(opk, str) or isinstance(ypr, str):
        return opk if isinstance(opk, str) else str(ypr)
    return ListedPosition(
        line=line.number,
        name=name,
        xyz=place,
        sigma=sigma,
        omega_phi_kappa=opk,
        yaw_pitch_roll=ypr,
        fix=_fix(cells.get("fix", ""), sign),
    )


def _sigma(cells: dict[str, str], units: dict[str, float], sign: Separation) -> Triple | str | None:
    """The standard errors of a line, m; what is wrong with them as the end of a sentence; None where it states none."""
    found: list[float] = []
    for own in _SIGMAS:
        word = next((name for name in own if name in units), None)
        if word is None:
            return None
        value = sign.number(cells.get(word, ""))
        if value is None:
            return f"gives {cells.get(word, '')[:20]!r} as standard error {own[0]}, which is no number"
        if math.isnan(value):
            return None
        value *= units[word]
        if mistake := sigma_mistake(value):
            return f"is wrong: {own[0]} {mistake}"
        found.append(value)
    return found[0], found[1], found[2]


def _angles(cells: dict[str, str], names: tuple[str, str, str], sign: Separation) -> Triple | str | None:
    words = [cells.get(name, "").strip() for name in names]
    if not all(name in cells for name in names) or not any(words):
        return None
    values = [sign.number(word) for word in words]
    if any(value is None or not abs(value) <= _WHOLE_TURNS for value in values):
        return f"gives {', '.join(word[:20] for word in words)} for {', '.join(names)}; give three angles in degrees or none"
    return values[0], values[1], values[2]  # type: ignore[return-value]


def _fix(cell: str, sign: Separation) -> Fix | None:
    return _FIX_WORDS.get(cell.strip().lower()) or fix_of(sign.number(cell))


def _with_angles(listed: PositionList) -> PositionList:
    """The list with the name of the angles that its photographs have."""
    for name in ("omega_phi_kappa", "yaw_pitch_roll"):
        if any(getattr(one, name) for one in listed.positions):
            return replace(listed, angles=name.replace("_", ", "))
    return listed


def _headless(lines: Lines, text: str) -> PositionList:
    """A table without names of columns, as Pix4D reads it. Raises WorkflowError where it is none."""
    if not lines.others:
        raise WorkflowError("The positions file is empty; fill it in, or set positions: {kind: none}.")
    if kind := text_kind(text):
        raise WorkflowError(f"The positions file {kind}.")
    sign = separation([text for _, text in lines.others])
    rows = [Line(number, sign.cells(text)) for number, text in lines.others]
    width = max((len(row.cells) for row in rows), default=0)
    first = rows[0].cells
    numbers = [sign.coordinate(cell) for cell in first[1:3]]
    if (
        width not in _HEADLESS
        or len(numbers) < 2
        or None in numbers
        or not (is_image_word(first[0]) or sign.number(first[0]) is None)
    ):
        raise WorkflowError(
            f"The positions file has no column photo, x, y, z and follows no format that is known: it begins with "
            f"'{lines.others[0][1].strip()[:60]}'. Its first line must name {', '.join(OWN)}."
        )
    names = _named_angles(_HEADLESS[width], rows, sign)
    return replace(_listed_rows("Pix4D geolocation without header", names, sign, rows, lines), order_of_system=True)


def _finite(number: float | None) -> float:
    """An angle for the choice of names; the row of one that is none is refused when it is read."""
    return number if number is not None and isfinite(number) else 0.0


def _named_angles(names: tuple[str, ...], rows: list[Line], sign: Separation) -> tuple[str, ...]:
    """Three angles without a name: the one that turns through all directions is kappa (third) or yaw (first)."""
    if "angle1" not in names:
        return names
    at = names.index("angle1")
    triples = [[_finite(sign.number(cell)) for cell in row.cells[at : at + 3]] for row in rows if len(row.cells) >= at + 3]
    first, _, third = (pstdev(values) for values in zip(*triples, strict=True)) if triples else (0.0, 0.0, 0.0)
    if triples and len(names) == 7 and all(0.0 < value <= _LIKE_ERRORS for values in triples for value in values):
        raise WorkflowError(
            "The last three columns of the positions file may be standard errors or angles; name its columns in the first line: "
            f"{', '.join(OWN)}."
        )
    if max(first, third) < 5.0 * min(first, third) or max(first, third) < 10.0:
        return tuple("" if name.startswith("angle") else name for name in names)
    words = ("omega", "phi", "kappa") if third > first else ("yaw", "pitch", "roll")
    return tuple(words[int(name[-1]) - 1] if name.startswith("angle") else name for name in names)
