"""Ground control in the one file of OpenDroneMap: gcp_list.txt.

The first line names the reference system; every further line is one measurement of a point in one photograph: X Y Z col row
photograph, and a name. Lines without a name belong together by their coordinates.
Source: OpenDroneMap's documentation, "Ground Control Points", file format.
"""

from dataclasses import dataclass

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.observations import Control, ControlPoint
from orthomill.schemas.photo import Photo, Photos
from orthomill.schemas.project import ControlFromGcpList
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
    of_word = photos_by_word(photos)
    for number, line in lines[1:]:
        _take(line, f"GCP list, line {number}: ", known, of_word, source, mistakes)
    mistakes += [
        f"The check point {name} is not in the GCP list; its points are {', '.join(list(known)[:8])}."
        for name in source.check
        if name not in known
    ]
    if mistakes or not known:
        raise WorkflowError("\n".join(mistakes) or "The GCP list names a reference system, but no point.")
    return GcpList(lines[0][1], Control(points=tuple(known.values())))


def _take(
    line: str, where: str, known: dict[str, ControlPoint], photos: dict[str, Photo], source: ControlFromGcpList, mistakes: list[str]
) -> None:
    words = line.split()
    try:
        x, y, z, col, row = map(float, words[:5])
        word = words[5]
    except (ValueError, IndexError):
        mistakes.append(f"{where}'{line[:60]}' must hold X Y Z col row photograph, and may hold a name.")
        return
    name = words[6] if len(words) > 6 else f"{words[0]} {words[1]} {words[2]}"
    if source.origin == "corner":
        col, row = col - 0.5, row - 0.5
    role = "check" if name in source.check else "control"
    sigma = (source.sigma_plan, source.sigma_plan, source.sigma_height)
    point = known.setdefault(name, ControlPoint(name=name, role=role, xyz=(x, y, z), sigma=sigma, measurements={}))
    photo = photos.get(word)
    measured = {name: point.measurements}
    mistake = measurement_mistake(name, word, photo, (col, row), measured)
    if point.xyz != (x, y, z):
        mistake = f"has the coordinates {x:g} {y:g} {z:g}, but others in an earlier line; names must differ or coordinates agree."
    if mistake:
        mistakes.append(f"{where}point {name} {mistake}")
    elif photo:
        known[name] = point.model_copy(update={"measurements": {**point.measurements, photo.name: (col, row, source.sigma_px)}})
