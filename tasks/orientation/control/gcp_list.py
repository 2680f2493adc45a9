"""Ground control in OpenDroneMap's single file, gcp_list.txt.

The first line names the reference system; every further line is one measurement of a point in one photograph: X Y Z col row
photograph, and optionally a name. Lines without a name belong to the same point where their coordinates are equal.
Source: OpenDroneMap's documentation, "Ground Control Points", file format.
"""

from dataclasses import dataclass

from orthomill.schemas.errors import WorkflowError, first_of
from orthomill.schemas.observations import Control, ControlPoint
from orthomill.schemas.photo import Photo, Photos
from orthomill.schemas.project import ControlFromGcpList
from orthomill.tasks.geometry.coordinate_ranges import coordinate_mistake
from orthomill.tasks.orientation.control.absent_photographs import Skipped
from orthomill.tasks.orientation.control.control_files import measurement_mistake, photos_by_word


@dataclass(frozen=True)
class GcpList:
    """The reference system that the file names, and its points in it."""

    crs: str
    control: Control


def read_gcp_list(photos: Photos, text: str, source: ControlFromGcpList) -> GcpList:
    """Points and measurements. Raises WorkflowError that lists every mistake."""
    lines = [(n, line.strip()) for n, line in enumerate(text.lstrip("\ufeff").splitlines(), 1) if line.strip()]
    lines = [(n, line) for n, line in lines if not line.startswith("#")]
    if not lines:
        raise WorkflowError("The GCP list is empty; its first line names the reference system, e.g. EPSG:32634.")
    mistakes: list[str] = []
    known: dict[str, ControlPoint] = {}
    of_word, skipped = photos_by_word(photos), Skipped(source.absent)
    for number, line in lines[1:]:
        mistake = _add(line, known, of_word, source, skipped)
        if mistake:
            mistakes.append(f"GCP list, line {number}: {mistake}")
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
    return GcpList(source.crs or lines[0][1], Control(points=points, findings=(finding,) if finding else ()))


def _add(
    line: str, known: dict[str, ControlPoint], photos: dict[str, Photo], source: ControlFromGcpList, skipped: Skipped
) -> str | None:
    """Adds the measurement of one line to the points; what is wrong with the line, as the end of a sentence."""
    words = line.split()
    try:
        x, y, z, col, row = map(float, words[:5])
        word = words[5]
    except (ValueError, IndexError):
        return f"'{line[:60]}' must hold X Y Z col row photograph, and may hold a name."
    for label, value in zip(("X", "Y", "Z", "col", "row"), (x, y, z, col, row), strict=True):
        if mistake := coordinate_mistake(value):
            return f"{label} {mistake}."
    # Without a name the text of the coordinates is the name.
    name = words[6] if len(words) > 6 else f"{words[0]} {words[1]} {words[2]}"
    # Programs that count from the corner of a pixel have its centre at (0.5, 0.5).
    col, row = (col - 0.5, row - 0.5) if source.origin == "corner" else (col, row)
    point = known.setdefault(name, _new_point(name, (x, y, z), source))
    if point.xyz != (x, y, z):
        return (
            f"point {name} has the coordinates {x:g} {y:g} {z:g}, but others in an earlier line; names must differ or coordinates "
            "agree."
        )
    photo = photos.get(word)
    if photo is None and skipped.takes(name, word):
        return None
    mistake = measurement_mistake(name, word, photo, (col, row), {name: point.measurements})
    if mistake or not photo:
        return f"point {name} {mistake}"
    known[name] = point.model_copy(update={"measurements": {**point.measurements, photo.name: (col, row, source.sigma_px)}})
    return None


def _new_point(name: str, xyz: tuple[float, float, float], source: ControlFromGcpList) -> ControlPoint:
    """A point without measurements; the list has neither roles nor standard errors, which the workflow states for all of it."""
    sigma = (source.sigma_plan, source.sigma_plan, source.sigma_height)
    return ControlPoint(name=name, role="check" if name in source.check else "control", xyz=xyz, sigma=sigma, measurements={})
