"""Ground control, check points and measured distances from CSV texts. All mistakes are reported together, one sentence each.

Measurements are in pixels of the image file; `in_photographs` transforms them where a photograph has another frame (a scan in that
of its fiducial marks).
"""

import csv
import math
from collections import Counter
from collections.abc import Iterator
from itertools import zip_longest

from orthomill.schemas.errors import WorkflowError, first_of
from orthomill.schemas.findings.control_findings import ChecksUnmarked, ControlRead
from orthomill.schemas.observations import Control, ControlPoint, Distance
from orthomill.schemas.photo import Photo, Photos
from orthomill.schemas.survey_files.photograph_names import PhotographNames
from orthomill.schemas.survey_files.sniffed_table import Separation
from orthomill.schemas.survey_files.text_encoding import encoding_of
from orthomill.schemas.survey_files.written_steps import CUT, ENOUGH_HEIGHTS, ENOUGH_IN_PLAN, lost_digits, written_step
from orthomill.tasks.geometry.coordinate_ranges import coordinate_mistake, sigma_mistake
from orthomill.tasks.orientation.control.absent_photographs import Rule, Skipped
from orthomill.tasks.orientation.control.control_rows import MEASUREMENT_COLUMNS, POINT_COLUMNS, Row, Rows, StatedControl
from orthomill.tasks.orientation.control.formats.landxml_points import is_landxml, landxml_rows
from orthomill.tasks.orientation.control.formats.leica_gsi import gsi_rows, is_gsi
from orthomill.tasks.orientation.control.formats.marked_table import is_marked_table, marked_rows
from orthomill.tasks.orientation.control.formats.metashape_xml import is_markers_xml, marker_rows
from orthomill.tasks.orientation.control.formats.micmac_xml import is_micmac, micmac_marks, micmac_points
from orthomill.tasks.orientation.control.formats.opensfm_points import is_opensfm, opensfm_rows
from orthomill.tasks.orientation.control.mark_rows import mark_rows
from orthomill.tasks.orientation.control.point_rows import point_rows

SURVEYED = 5.0
"""m: standard errors in plan that no survey of points on the ground has; those from maps stay below"""
DISTANCE_COLUMNS = ("from", "to", "metres", "sigma")
NOTHING_STATED = StatedControl()
ROLES = ("control", "check", "tie")


def read_control(
    photos: Photos,
    points: str,
    measurements: str | None,
    distances: str | None = None,
    absent: Rule = "skip",
    stated: StatedControl = NOTHING_STATED,
) -> Control:
    """Control, check and tie points with their image measurements, and distances between them.

    `points`: CSV text with POINT_COLUMNS (m), or that of another program; `measurements`: CSV text with MEASUREMENT_COLUMNS (px) or
    of another program, None where the points come with theirs; `distances`: CSV text with DISTANCE_COLUMNS (m). Photographs are
    named in any case, with or without folder and extension; `absent`: whether lines of others are skipped; `stated`: what the
    workflow says where files do not. Raises WorkflowError that lists every mistake in the texts.
    """
    # Everything is read before anything is refused: a surveyor corrects a whole file at once.
    mistakes: list[str] = []
    surveyed, marked = _both(photos, points, measurements, stated, mistakes)
    # One sentence for a file that is no list: measurements would all be of points that are unknown, or points all without any.
    if mistakes and not (surveyed.rows and marked.rows):
        raise WorkflowError(first_of(mistakes))
    known = _points(surveyed, stated, mistakes)
    if not known and not mistakes:
        mistakes.append(
            "The control points file holds no points; fill it in, or say that there is no ground control (control: {kind: none})."
        )
    corner = marked.corner if stated.corner is None else stated.corner
    marks = _of_known(_from_centre(marked.rows, corner), surveyed.rows, known)
    control = _measured(known, photos, (marks, distances), absent, mistakes)
    return control.model_copy(update={"read": _as_read(surveyed, marked, control, corner, (points, measurements or ""))})


def read_points(photos: Photos, points: str, stated: StatedControl = NOTHING_STATED) -> Control:
    """Points of a text as in `read_control`, which need not be measured in any photograph yet. Raises WorkflowError that lists
    every mistake."""
    mistakes: list[str] = []
    surveyed, _ = _points_in(photos, points, stated, mistakes)
    known = _points(surveyed, stated, mistakes) if surveyed.rows else {}
    if mistakes or not known:
        raise WorkflowError(first_of(mistakes) or "The file holds no points; it needs a name and coordinates on each line.")
    control = Control(points=tuple(known.values()))
    return control.model_copy(update={"read": _as_read(surveyed, Rows("", ()), control, False, (points, ""))})


def _both(photos: Photos, points: str, measurements: str | None, stated: StatedControl, mistakes: list[str]) -> tuple[Rows, Rows]:
    """The rows of points and measurements; a file may hold both."""
    surveyed, marked = _points_in(photos, points, stated, mistakes)
    if measurements is not None:
        return surveyed, _marks_in(photos, measurements, stated, mistakes)
    if marked is None:
        mistakes.append("The control points come without measurements in photographs; name their file (control > measurements).")
    return surveyed, marked or Rows("", ())


def _points_in(photos: Photos, text: str, stated: StatedControl, mistakes: list[str]) -> tuple[Rows, Rows | None]:
    """The points of a file of any program, and its measurements, where it has them."""
    if is_markers_xml(text):
        return marker_rows(text, stated, mistakes)
    if is_opensfm(text):
        return opensfm_rows(text, photos, stated, mistakes)
    for recognises, read in ((is_gsi, gsi_rows), (is_landxml, landxml_rows), (is_micmac, micmac_points)):
        if recognises(text):
            return read(text, stated, mistakes), None
    if is_marked_table(text):
        return marked_rows(text, stated, mistakes)
    return point_rows(text, stated, mistakes), None


def _marks_in(photos: Photos, text: str, stated: StatedControl, mistakes: list[str]) -> Rows:
    """The measurements of a file of any program."""
    if is_markers_xml(text):
        return marker_rows(text, stated, mistakes)[1]
    if is_opensfm(text):
        return opensfm_rows(text, photos, stated, mistakes)[1]
    return (micmac_marks if is_micmac(text) else mark_rows)(text, stated, mistakes)


def _of_known(marks: tuple[Row, ...], surveyed: tuple[Row, ...], known: dict[str, ControlPoint]) -> tuple[Row, ...]:
    """Measurements by the names that their points have, which may differ in capitals; without those of points that have their
    sentence already."""
    broken = {row["name"].casefold() for _, row in surveyed} - {name.casefold() for name in known}
    times = Counter(name.casefold() for name in known)
    folded = {name.casefold(): name for name in known if times[name.casefold()] == 1}
    named = [(line, row, row["name"].casefold()) for line, row in marks]
    return tuple(
        (line, row if row["name"] in known else row | {"name": folded.get(own, row["name"])})
        for line, row, own in named
        if own not in broken
    )


def _from_centre(rows: tuple[Row, ...], corner: bool) -> tuple[Row, ...]:
    """Measurements whose pixels count from the centre of the upper-left one."""
    if not corner:
        return rows
    return tuple((line, row | {name: _less_half(row.get(name, "")) for name in ("col", "row")}) for line, row in rows)


def _less_half(cell: str) -> str:
    value = number_of(cell)
    return cell if value is None or math.isnan(value) else repr(value - 0.5)


def _as_read(surveyed: Rows, marked: Rows, control: Control, corner: bool, texts: tuple[str, str]) -> ControlRead:
    form = surveyed.format if surveyed.format == marked.format else f"{surveyed.format}, {marked.format}"
    return ControlRead(
        format=form,
        points=len(control.points),
        checks=sum(point.role == "check" for point in control.points),
        measurements=sum(len(point.measurements) for point in control.points),
        crs=surveyed.crs or "",
        skipped=surveyed.skipped + marked.skipped,
        corner=corner,
        steps=_steps(surveyed.rows),
        encoding="Windows-1252" if "Windows-1252" in map(encoding_of, texts) else "UTF-8",
    )


def _steps(rows: tuple[Row, ...]) -> tuple[float, float]:
    """To which steps coordinates and heights of surveyed points are written."""
    cells = [row for _, row in rows if row.get("role") != "tie"]
    plan = written_step((row.get(name, "") for row in cells for name in "xy"), ENOUGH_IN_PLAN)
    return plan, written_step((row.get("z", "") for row in cells), ENOUGH_HEIGHTS)


def control_at(known: dict[str, ControlPoint], photos: Photos, measurements: str, absent: Rule) -> Control:
    """Control of `known` points, those that the CSV text `measurements` names. Raises WorkflowError as `read_control` does."""
    mistakes: list[str] = []
    rows = mark_rows(measurements, NOTHING_STATED, mistakes).rows
    named = {row["name"] for _, row in rows}
    return _measured({name: point for name, point in known.items() if name in named}, photos, (rows, None), absent, mistakes)


def _measured(
    known: dict[str, ControlPoint], photos: Photos, found: tuple[tuple[Row, ...], str | None], absent: Rule, mistakes: list[str]
) -> Control:
    """The points with the measurements (rows) and distances (CSV text) `found`; raises WorkflowError with all `mistakes`."""
    measurements, distances = found
    skipped = Skipped(absent)
    measured = _measurements(measurements, known, photos, skipped, mistakes)
    points_of = {name: point.model_copy(update={"measurements": measured[name]}) for name, point in known.items()}
    lost = skipped.lost(points_of)
    if not mistakes and (mistake := skipped.mistake(points_of)):
        mistakes.append(mistake)
    # A point whose only measurement is wrong has its sentence already.
    answered, unmarked = " ".join(mistakes), [name for name in known if not measured[name] and name not in lost]
    checks = tuple(name for name in unmarked if known[name].role == "check")
    mistakes += [
        f"Control point {name} is measured in no photograph; measure it in two or more, or leave it out."
        for name in unmarked
        if name not in checks and f"point {name} " not in answered
    ]
    lengths = () if distances is None else tuple(read_distances(distances, points_of, lost, mistakes))
    if mistakes:
        raise WorkflowError(first_of(mistakes))
    findings = (skipped.finding(points_of), ChecksUnmarked(points=checks) if checks else None)
    return Control(
        points=tuple(point for name, point in points_of.items() if name not in lost),
        distances=lengths,
        findings=tuple(finding for finding in findings if finding),
    )


def no_control() -> Control:
    """A project without ground control."""
    return Control()


class PhotosByWord:
    """Photographs by the names that files may use: in any case, with or without folder and extension."""

    def __init__(self, photos: Photos) -> None:
        self._names = PhotographNames(photos.names)
        self._of_name = {photo.name: photo for photo in photos.photos}

    def get(self, word: str) -> Photo | None:
        """The photograph that a word means."""
        return self._of_name.get(self._names.find(word) or "")


def in_photographs(measurements: dict[str, tuple[float, float, float]], photos: Photos) -> dict[str, tuple[float, float, float]]:
    """Measurements given in pixels of the files, in pixels of the photographs."""
    return {name: (*photos[name].from_file(col, row), sigma) for name, (col, row, sigma) in measurements.items()}


def _rows(text: str, columns: tuple[str, ...], what: str, mistakes: list[str]) -> list[tuple[int, dict[str, str]]]:
    """Line numbers and cells; lines that begin with # are comments."""
    # Spreadsheet programs begin UTF-8 files with a byte order mark, which would become part of the first column's name.
    lines = [
        (number, line)
        for number, line in enumerate(text.lstrip("\ufeff").splitlines(), 1)
        if line.strip() and not line.startswith("#")
    ]
    header = _cells(lines[0][1]) if lines else []
    if not set(columns) <= set(header):
        missing = ", ".join(name for name in columns if name not in header)
        mistakes.append(f"The {what} file lacks the column(s) {missing}; its first line must be: {','.join(columns)}.")
        return []
    # A line that ends early has empty cells, which are answered like all others.
    return [(number, dict(zip_longest(header, _cells(line)[: len(header)], fillvalue=""))) for number, line in lines[1:]]


def _cells(line: str) -> list[str]:
    """The cells of one line: a quote that is not closed ends with its line, so that it spoils no other."""
    try:
        return [cell.strip() for cell in next(csv.reader([line], skipinitialspace=True))]
    except csv.Error:  # a cell of more than 128 KiB
        return []


def number_of(cell: str) -> float | None:
    """The number of a cell with a decimal point; NaN where it says that it is unknown, None where it is none."""
    return Separation("", ".").number(cell)


def _numbers(row: dict[str, str], names: tuple[str, ...], where: str, mistakes: list[str]) -> tuple[float, ...] | None:
    """The numbers of a row; None, and a mistake, where one is missing, not finite, or a standard error that is not positive. A
    height that says that it is unknown is NaN."""
    values = []
    for name in names:
        value = number_of(row.get(name, ""))
        unknown = name == "z" and value is not None and math.isnan(value) and row.get(name, "").strip() != ""
        if unknown:
            values.append(math.nan)
            continue
        if value is None or not math.isfinite(value) or (name.startswith("sigma") and value <= 0):
            needed = "a positive number" if name.startswith("sigma") else "a number (or NaN)" if name == "z" else "a number"
            mistakes.append(f"{where}: {name} is '{row.get(name, '')[:40]}', which must be {needed}.")
            return None
        if mistake := sigma_mistake(value) if name.startswith("sigma") else coordinate_mistake(value):
            mistakes.append(f"{where}: {name} {mistake}.")
            return None
        if name in ("x", "y") and lost_digits(row[name]):
            mistakes.append(f"{where}: {name} is '{row[name]}', {CUT}.")
            return None
        values.append(value)
    return tuple(values)


def _points(surveyed: Rows, stated: StatedControl, mistakes: list[str]) -> dict[str, ControlPoint]:
    """Points by name, without measurements."""
    known: dict[str, ControlPoint] = {}
    for line, row in surveyed.rows:
        where = f"Control points file, line {line}, point {row['name']} "
        if row["name"] in known:
            mistakes.append(f"{where}occurs twice; names must differ.")
            continue
        if row.get("role") not in ROLES:
            mistakes.append(f"{where}has the role '{row.get('role', '')}'; allowed are control, check and tie.")
            continue
        # Tie points have no coordinates: they are known by their measurements and distances only.
        if row["role"] == "tie":
            known[row["name"]] = ControlPoint(name=row["name"], role="tie", xyz=(0.0,) * 3, sigma=(0.0,) * 3, measurements={})
            continue
        values = _numbers(row, POINT_COLUMNS[2:], where.strip(), mistakes)
        if values:
            x, y, z, *sigma = values
            scale = 0.001 if stated.unit == "mm" else 1.0
            found = (sigma[0] * scale, sigma[1] * scale, sigma[2] * scale)
            point = ControlPoint(name=row["name"], role=row["role"], xyz=(x, y, z), sigma=found, measurements={}, line=line)
            known[row["name"]] = point
    mistakes += [
        f"The check point {name} is not in the control points file; its points are {', '.join(list(known)[:8])}."
        for name in stated.check
        if name not in known
    ]
    if stated.unit is None and not surveyed.unit_stated and (mistake := _millimetres(known)):
        mistakes.append(mistake)
    return known


def _millimetres(known: dict[str, ControlPoint]) -> str | None:
    """The sentence where the standard errors in plan of most points would be no survey's in metres."""
    sigma = [point.sigma for point in known.values() if point.role != "tie"]
    if not sigma or sorted(min(one[:2]) for one in sigma)[len(sigma) // 2] < SURVEYED:
        return None
    shown = ", ".join(f"{value:g}" for value in sigma[0])
    return (
        f"The control points file gives standard errors of {shown}, which read as metres are those of no survey: are they "
        "millimetres? State their unit: control: {..., errors_in: mm}, or errors_in: m if they are meant."
    )


def _measurements(
    rows: tuple[Row, ...], known: dict[str, ControlPoint], photos: Photos, skipped: Skipped, mistakes: list[str]
) -> dict[str, dict[str, tuple[float, float, float]]]:
    """Measurements (col, row, sigma) by point and photograph."""
    of_name = PhotosByWord(photos)
    measured: dict[str, dict[str, tuple[float, float, float]]] = {name: {} for name in known}
    for line, row in rows:
        name, photo = row["name"], of_name.get(row.get("photo", ""))
        where = f"Control measurements file, line {line}, point {name} "
        values = _numbers(row, MEASUREMENT_COLUMNS[2:], where.strip(), mistakes)
        if photo is None and name in known and row.get("photo") and skipped.takes(name, row["photo"]):
            continue
        mistake = measurement_mistake(name, row.get("photo", ""), photo, values, measured)
        if mistake:
            mistakes.append(f"{where}{mistake}")
        elif values and photo:
            col, row_, sigma = values
            measured[name][photo.name] = col, row_, sigma
    return measured


def read_distances(
    text: str,
    known: dict[str, ControlPoint],
    lost: tuple[str, ...],
    mistakes: list[str],
    unknown: str = "is not in the control points file",
) -> Iterator[Distance]:
    """The distances of a CSV text with DISTANCE_COLUMNS (m) between `known` points, but for those to points that were `lost` with
    their photographs; `unknown`: what is wrong with a point that is not known."""
    for line, row in _rows(text, DISTANCE_COLUMNS, "distances", mistakes):
        ends = row["from"], row.get("to", "")
        where = f"Distances file, line {line}, {ends[0]} to {ends[1]}: "
        values = _numbers(row, DISTANCE_COLUMNS[2:], where.removesuffix(": "), mistakes)
        if set(ends).intersection(lost):
            continue
        mistake = _distance_mistake(ends, values, known, unknown)
        if mistake:
            mistakes.append(f"{where}{mistake}")
        elif values:
            yield Distance(first=ends[0], second=ends[1], length=values[0], sigma=values[1])


def _distance_mistake(
    ends: tuple[str, str], values: tuple[float, ...] | None, known: dict[str, ControlPoint], unknown: str
) -> str | None:
    """What is wrong with one distance, as the end of a sentence."""
    for name in ends:
        if name not in known:
            return f"the point '{name}' {unknown}."
        # Control has coordinates of its own; any other point needs two rays, or the distance determines nothing.
        if len(known[name].measurements) < (1 if known[name].role == "control" else 2):
            return f"{name} is measured in {len(known[name].measurements)} photographs, but needs two."
    if ends[0] == ends[1]:
        return "a distance needs two different points."
    if values and values[0] <= 0:
        return f"metres is {values[0]:g}, which must be a positive number."
    return None


def measurement_mistake(
    name: str, word: str, photo: Photo | None, values: tuple[float, ...] | None, measured: dict[str, dict]
) -> str | None:
    """What is wrong with one measurement, as the end of a sentence."""
    if name not in measured:
        return "is not in the control points file."
    if photo is None:
        return f"is measured in the photograph '{word}', which the project does not have."
    if photo.name in measured[name]:
        return f"is measured twice in {photo.name}; one measurement is needed."
    if values and not photo.holds(*photo.from_file(values[0], values[1])):
        return (
            f"is measured at col {values[0]:g}, row {values[1]:g}, outside of {photo.name}, which has {photo.width} columns and "
            f"{photo.height} rows; correct the line or take it out, or, if the marks were made in larger pictures, run with those."
        )
    return None
