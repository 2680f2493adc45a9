"""Ground control, check points and measured distances from CSV texts. All mistakes are reported together, one sentence each.

Measurements are in pixels of the image file; `in_photographs` transforms them where a photograph has another frame (a scan in that
of its fiducial marks).
"""

import csv
import math
from collections.abc import Iterator
from itertools import zip_longest
from pathlib import PurePosixPath

from orthomill.schemas.errors import WorkflowError, first_of
from orthomill.schemas.observations import Control, ControlPoint, Distance
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.geometry.coordinate_ranges import coordinate_mistake, sigma_mistake
from orthomill.tasks.orientation.control.absent_photographs import Rule, Skipped

POINT_COLUMNS = ("name", "role", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z")
MEASUREMENT_COLUMNS = ("name", "photo", "col", "row", "sigma")
DISTANCE_COLUMNS = ("from", "to", "metres", "sigma")
ROLES = ("control", "check", "tie")


def read_control(photos: Photos, points: str, measurements: str, distances: str | None = None, absent: Rule = "skip") -> Control:
    """Control, check and tie points with their image measurements, and distances between them.

    `points`: CSV text with POINT_COLUMNS (m); `measurements`: CSV text with MEASUREMENT_COLUMNS (px); `distances`: CSV text with
    DISTANCE_COLUMNS (m). Photographs are named with or without extension; `absent`: whether lines of others are skipped. Raises
    WorkflowError that lists every mistake in the texts.
    """
    # Everything is read before anything is refused: a surveyor corrects a whole file at once.
    mistakes: list[str] = []
    known = _points(points, mistakes)
    if not known and not mistakes:
        mistakes.append(
            "The control points file holds no points; fill it in, or say that there is no ground control (control: {kind: none})."
        )
    return _measured(known, photos, (measurements, distances), absent, mistakes)


def control_at(known: dict[str, ControlPoint], photos: Photos, measurements: str, absent: Rule) -> Control:
    """Control of `known` points, those that the CSV text `measurements` names. Raises WorkflowError as `read_control` does."""
    named = {row["name"] for _, row in _rows(measurements, MEASUREMENT_COLUMNS, "control measurements", [])}
    return _measured({name: point for name, point in known.items() if name in named}, photos, (measurements, None), absent, [])


def _measured(
    known: dict[str, ControlPoint], photos: Photos, texts: tuple[str, str | None], absent: Rule, mistakes: list[str]
) -> Control:
    """The points with the measurements and distances of the CSV `texts`; raises WorkflowError with all `mistakes`."""
    measurements, distances = texts
    skipped = Skipped(absent)
    measured = _measurements(measurements, known, photos, skipped, mistakes)
    points_of = {name: point.model_copy(update={"measurements": measured[name]}) for name, point in known.items()}
    lost = skipped.lost(points_of)
    if not mistakes and (mistake := skipped.mistake(points_of)):
        mistakes.append(mistake)
    # A point whose only measurement is wrong has its sentence already.
    answered = " ".join(mistakes)
    mistakes += [
        f"Control point {name} is measured in no photograph; measure it in two or more, or leave it out."
        for name in known
        if not measured[name] and name not in lost and f"point {name} " not in answered
    ]
    lengths = () if distances is None else tuple(_distances(distances, points_of, lost, mistakes))
    if mistakes:
        raise WorkflowError(first_of(mistakes))
    finding = skipped.finding(points_of)
    return Control(
        points=tuple(point for name, point in points_of.items() if name not in lost),
        distances=lengths,
        findings=(finding,) if finding else (),
    )


def no_control() -> Control:
    """A project without ground control."""
    return Control()


def photos_by_word(photos: Photos) -> dict[str, Photo]:
    """Photographs by the names that files may use: the file name with and without extension."""
    return {word: photo for photo in photos.photos for word in (PurePosixPath(photo.path).name, photo.name)}


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


def _numbers(row: dict[str, str], names: tuple[str, ...], where: str, mistakes: list[str]) -> tuple[float, ...] | None:
    """The numbers of a row; None, and a mistake, where one is missing, not finite, or a standard error that is not positive."""
    values = []
    for name in names:
        try:
            value = float(row.get(name, ""))
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or (name.startswith("sigma") and value <= 0):
            needed = "a positive number" if name.startswith("sigma") else "a number"
            mistakes.append(f"{where}: {name} is '{row.get(name, '')[:40]}', which must be {needed}.")
            return None
        if mistake := sigma_mistake(value) if name.startswith("sigma") else coordinate_mistake(value):
            mistakes.append(f"{where}: {name} {mistake}.")
            return None
        values.append(value)
    return tuple(values)


def _points(text: str, mistakes: list[str]) -> dict[str, ControlPoint]:
    """Points by name, without measurements."""
    known: dict[str, ControlPoint] = {}
    for line, row in _rows(text, POINT_COLUMNS, "control points", mistakes):
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
            known[row["name"]] = ControlPoint(
                name=row["name"], role=row["role"], xyz=(x, y, z), sigma=tuple(sigma), measurements={}
            )
    return known


def _measurements(
    text: str, known: dict[str, ControlPoint], photos: Photos, skipped: Skipped, mistakes: list[str]
) -> dict[str, dict[str, tuple[float, float, float]]]:
    """Measurements (col, row, sigma) by point and photograph."""
    of_name = photos_by_word(photos)
    measured: dict[str, dict[str, tuple[float, float, float]]] = {name: {} for name in known}
    for line, row in _rows(text, MEASUREMENT_COLUMNS, "control measurements", mistakes):
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


def _distances(text: str, known: dict[str, ControlPoint], lost: tuple[str, ...], mistakes: list[str]) -> Iterator[Distance]:
    """The distances, but for those to points that were lost with their photographs."""
    for line, row in _rows(text, DISTANCE_COLUMNS, "distances", mistakes):
        ends = row["from"], row.get("to", "")
        where = f"Distances file, line {line}, {ends[0]} to {ends[1]}: "
        values = _numbers(row, DISTANCE_COLUMNS[2:], where.removesuffix(": "), mistakes)
        if set(ends).intersection(lost):
            continue
        mistake = _distance_mistake(ends, values, known)
        if mistake:
            mistakes.append(f"{where}{mistake}")
        elif values:
            yield Distance(first=ends[0], second=ends[1], length=values[0], sigma=values[1])


def _distance_mistake(ends: tuple[str, str], values: tuple[float, ...] | None, known: dict[str, ControlPoint]) -> str | None:
    """What is wrong with one distance, as the end of a sentence."""
    for name in ends:
        if name not in known:
            return f"the point '{name}' is not in the control points file."
        if known[name].role == "check":
            return f"{name} is a check point, which takes no part in the adjustment; give it the role control or tie."
        # Control has coordinates of its own; a tie point needs two rays, or the distance determines nothing.
        if len(known[name].measurements) < (2 if known[name].role == "tie" else 1):
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
            f"{photo.height} rows; correct the line or take it out."
        )
    return None
