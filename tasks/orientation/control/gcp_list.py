"""Ground control in OpenDroneMap's single file, gcp_list.txt.

The first line names the reference system; every further line is one measurement of a point in one photograph: X Y Z col row
photograph, and optionally a name. Lines without a name belong to the same point where their coordinates are equal. Blanks, tabs,
semicolons or commas separate; the name of a photograph may hold blanks, that of a point as well where it is not unique
without them; a height may be NaN or missing (used in plan only). Source: OpenDroneMap's documentation, "Ground Control Points",
file format."""

import math
import re
from collections import defaultdict
from dataclasses import dataclass

from orthomill.schemas.errors import WorkflowError, first_of
from orthomill.schemas.findings.control_findings import ControlRead
from orthomill.schemas.maps.system_names import code_in, known_crs
from orthomill.schemas.observations import Control, ControlPoint
from orthomill.schemas.photo import Photos
from orthomill.schemas.project import ControlFromGcpList
from orthomill.schemas.survey_files.foreign_kinds import text_kind
from orthomill.schemas.survey_files.photograph_names import is_image_word
from orthomill.schemas.survey_files.sniffed_table import Lines, Separation, lines_of, separation
from orthomill.schemas.survey_files.text_encoding import encoding_of
from orthomill.schemas.survey_files.written_steps import CUT, ENOUGH_HEIGHTS, ENOUGH_IN_PLAN, lost_digits, written_step
from orthomill.tasks.geometry.coordinate_ranges import coordinate_mistake
from orthomill.tasks.orientation.control.absent_photographs import Skipped
from orthomill.tasks.orientation.control.control_files import PhotosByWord, measurement_mistake

_TITLES = 3
"""lines above the measurements, one of them the reference system"""
_BLANKS = 60
"""letters of a line that are shown"""


@dataclass(frozen=True)
class GcpList:
    """The reference system that the file names, and its points in it."""

    crs: str
    control: Control


@dataclass(frozen=True)
class _Measured:
    """A line: coordinates (height NaN: unknown), pixel, the word of the photograph, and what follows it; the text of the
    coordinates names points that have no name."""

    line: int
    xyz: tuple[float, float, float]
    col: float
    row: float
    photo: str
    rest: tuple[str, ...]
    written: tuple[str, str, str]

    @property
    def place(self) -> str:
        """The coordinates as they are written."""
        return " ".join(self.written)

    @property
    def name(self) -> str:
        return self.rest[0] if self.rest else self.place


def read_gcp_list(photos: Photos, text: str, source: ControlFromGcpList) -> GcpList:
    """Points and measurements. Raises WorkflowError that lists every mistake."""
    # A semicolon before everything is a comment of CAD programs.
    own = lines_of(text, ("#", "//", ";"))
    if not own.others:
        raise WorkflowError("The GCP list is empty; its first line names the reference system, e.g. EPSG:32634.")
    of_word, skipped = PhotosByWord(photos), Skipped(source.absent)
    sign = separation([line for _, line in own.others[1:]])
    crs, body = _system(text, own, source, of_word)
    read = [_read(number, line, sign, of_word) for number, line in body]
    mistakes = [one for one in read if isinstance(one, str)]
    known: dict[str, ControlPoint] = {}
    for name, one in _with_names([one for one in read if isinstance(one, _Measured)]):
        if mistake := _add(name, one, known, of_word, source, skipped):
            mistakes.append(f"GCP list, line {one.line}: {mistake}")
    mistakes += [
        f"The check point {name} is not in the GCP list; its points are {', '.join(list(known)[:8])}."
        for name in source.check
        if name not in known
    ]
    if not mistakes and (nothing_left := skipped.mistake(known)):
        mistakes.append(nothing_left)
    if mistakes or not known:
        raise WorkflowError(first_of(mistakes) or "The GCP list names a reference system, but no point.")
    finding, lost = skipped.finding(known), skipped.lost(known)
    points = tuple(point for name, point in known.items() if name not in lost)
    told = ControlRead(
        format="GCP list of OpenDroneMap",
        points=len(points),
        checks=sum(point.role == "check" for point in points),
        measurements=sum(len(point.measurements) for point in points),
        crs=crs,
        corner=source.origin == "corner",
        steps=(
            written_step((word for one in read if isinstance(one, _Measured) for word in one.written[:2]), ENOUGH_IN_PLAN),
            written_step((one.written[2] for one in read if isinstance(one, _Measured)), ENOUGH_HEIGHTS),
        ),
        encoding=encoding_of(text),
    )
    return GcpList(crs, Control(points=points, findings=(finding,) if finding else (), read=told))


def _system(text: str, lines: Lines, source: ControlFromGcpList, photos: PhotosByWord) -> tuple[str, tuple[tuple[int, str], ...]]:
    """The reference system, and the lines of measurements. Raises WorkflowError where a measurement stands in its place."""
    sign = separation([line for _, line in lines.others])
    measured = [isinstance(_read(number, line, sign, photos), _Measured) for number, line in lines.others[: _TITLES + 1]]
    above = measured.index(True) if any(measured) else 1
    titles, body = lines.others[:above], lines.others[above:]
    named = next((line.strip() for _, line in titles if known_crs(line) is not None), None)
    # Titles hold no data: a line of numbers among them is a measurement that cannot be read.
    if named is not None:
        kept = tuple((number, line) for number, line in titles if line.strip() != named and _has_numbers(line))
        return source.crs or named, (*kept, *body)
    comment = code_in(" ".join(line for _, line in lines.comments))
    if not titles and (source.crs or comment):
        return source.crs or comment or "", body
    if not titles:
        number, first = lines.others[0]
        raise WorkflowError(
            f"The GCP list names no reference system: line {number} is a measurement ('{first.strip()[:_BLANKS]}'). Put it in "
            "a line before, e.g. EPSG:32634, or state it in the workflow (control > crs)."
        )
    if not any(measured) and (kind := text_kind(text)):
        raise WorkflowError(f"The GCP list {kind}.")
    return source.crs or titles[0][1].strip(), (*titles[1:], *body)


def _has_numbers(line: str) -> bool:
    sign = separation([line])
    return sum(sign.coordinate(cell) is not None for cell in sign.cells(line) if cell) > 2


def _read(number: int, line: str, sign: Separation, photos: PhotosByWord) -> _Measured | str:
    """One line, or the sentence that says what is wrong with it."""
    cells = [cell for cell in sign.cells(line) if cell or sign.sign]
    # Some lists have the name of the point before its coordinates; a number that cannot be read is no name.
    named = len(cells) > 6 and re.search(r"[^\d\s.,+-]", cells[0]) and len(_values(cells[1:], sign)) == 5
    name = cells.pop(0) if named else ""
    values = _values(cells, sign)
    # Four numbers before the photograph: the height is left out.
    if len(values) == 4 and len(cells) > 4 and is_image_word(cells[4]):
        values.insert(2, math.nan)
        cells.insert(2, "nan")
    known = len(values) == 5 and not any(math.isnan(value) for value in (*values[:2], *values[3:]))
    if not known or len(cells) < 6 or not cells[5]:
        return (
            f"GCP list, line {number}: '{line.strip()[:_BLANKS]}' must hold X Y Z col row photograph, and may hold a name; "
            "blanks, tabs, semicolons or commas between them, and only one sign for decimals."
        )
    for label, value in zip(("X", "Y", "Z", "col", "row"), values, strict=True):
        if not math.isnan(value) and (mistake := coordinate_mistake(value)):
            return f"GCP list, line {number}: {label} {mistake}."
    if cut := next((cell for cell in cells[:2] if lost_digits(cell)), None):
        return f"GCP list, line {number}: '{cut}', {CUT}."
    photo, rest = _photo_and_name(cells[5:], photos, bool(sign.sign))
    x, y, z, col, row = values
    return _Measured(
        line=number,
        xyz=(x, y, z),
        col=col,
        row=row,
        photo=photo,
        rest=(name, *rest) if name else rest,
        written=(cells[0], cells[1], cells[2]),
    )


def _values(cells: list[str], sign: Separation) -> list[float]:
    """The numbers before the photograph; where that comes before its pixel, the two change places in `cells`."""
    if len(cells) > 5 and is_image_word(cells[3]):
        cells[3:6] = [cells[4], cells[5], cells[3]]
    values: list[float] = []
    for i, cell in enumerate(cells[:5]):
        value = sign.coordinate(cell) if i < 2 else sign.number(cell)
        if value is None or (sign.sign and not cell and i != 2):
            break
        values.append(value)
    return values


def _photo_and_name(words: list[str], photos: PhotosByWord, separated: bool) -> tuple[str, tuple[str, ...]]:
    """The word of the photograph, which may hold blanks, and the words after it."""
    if separated:
        return words[0], tuple(word for word in words[1:] if word)
    for count in range(1, len(words) + 1):
        word = " ".join(words[:count])
        if photos.get(word) is not None or is_image_word(word):
            return word, tuple(words[count:])
    return words[0], tuple(words[1:])


def _with_names(lines: list[_Measured]) -> list[tuple[str, _Measured]]:
    """Lines with the names of their points: the first word after the photograph; all of them where the first is not unique, as in
    "GCP 1" and "GCP 2"."""
    places: dict[str, set[str]] = defaultdict(set)
    for one in lines:
        places[one.name].add(one.place)
    ambiguous = {name for name, found in places.items() if len(found) > 1}
    named = [(" ".join(one.rest) if one.name in ambiguous and one.rest else one.name, one) for one in lines]
    # "gcp1" and "GCP1" at one place are one point.
    first: dict[tuple[str, str], str] = {}
    return [(first.setdefault((name.casefold(), one.place), name), one) for name, one in named]


def _add(
    name: str, one: _Measured, known: dict[str, ControlPoint], photos: PhotosByWord, source: ControlFromGcpList, skipped: Skipped
) -> str | None:
    """Adds a measurement to the points; what is wrong with it, as the end of a sentence."""
    # Programs that count from the corner of a pixel have its centre at (0.5, 0.5).
    col, row = (one.col - 0.5, one.row - 0.5) if source.origin == "corner" else (one.col, one.row)
    point = known.setdefault(name, _new_point(name, one, source))
    if not _same(point.xyz, one.xyz):
        x, y, z = one.xyz
        return (
            f"point {name} has the coordinates {x!r} {y!r} {z!r}, but others in an earlier line; names must differ or coordinates "
            "agree."
        )
    photo = photos.get(one.photo)
    if photo is None and skipped.takes(name, one.photo):
        return None
    mistake = measurement_mistake(name, one.photo, photo, (col, row), {name: point.measurements})
    if mistake or not photo:
        return f"point {name} {mistake}"
    known[name] = point.model_copy(update={"measurements": {**point.measurements, photo.name: (col, row, source.sigma_px)}})
    return None


def _same(first: tuple[float, float, float], second: tuple[float, float, float]) -> bool:
    """Whether coordinates are equal; unknown heights are."""
    return all(a == b or (math.isnan(a) and math.isnan(b)) for a, b in zip(first, second, strict=True))


def _new_point(name: str, one: _Measured, source: ControlFromGcpList) -> ControlPoint:
    """A point without measurements; the list has neither roles nor standard errors, which the workflow states for all of it."""
    sigma = (source.sigma_plan, source.sigma_plan, source.sigma_height)
    role = "check" if name in source.check else "control"
    return ControlPoint(name=name, role=role, xyz=one.xyz, sigma=sigma, measurements={}, line=one.line)
