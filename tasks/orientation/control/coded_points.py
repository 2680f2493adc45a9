"""Points that name themselves: coded targets found in the photographs, with coordinates or distances from files.

A photograph is searched in parts that overlap, so that memory does not grow with it. A code without coordinates is a tie point,
known by its marks alone, and an end of distances: a scale bar is two codes and their distance.
"""

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.errors import WorkflowError, first_of, some_of
from orthomill.schemas.findings.control_findings import TargetsNotFound, TargetsTwice
from orthomill.schemas.marks import FoundTarget
from orthomill.schemas.observations import Control, ControlPoint
from orthomill.schemas.photo import Photo, Photos
from orthomill.schemas.project import ControlFromTargets
from orthomill.schemas.raster import Window
from orthomill.tasks.orientation.control.control_files import read_distances, read_points
from orthomill.tasks.orientation.control.control_rows import StatedControl
from orthomill.tasks.targets.coded_targets import all_coded_targets
from orthomill.tasks.targets.photo_targets import grey_of

SIDE, HALO = 2048, 512
"""px: parts of a photograph that are searched at once, and by how much they overlap: targets up to this size are whole in one"""
SAME = 2.0
"""px: a code that is found twice within this is one target, seen in two parts"""


class FoundCode(BaseModel):
    """A coded target in a photograph: its name, centre (col, row) and standard error, px."""

    model_config = ConfigDict(frozen=True)

    name: str
    col: float
    row: float
    sigma: float


class PhotoCodes(BaseModel):
    """The coded targets of a photograph."""

    model_config = ConfigDict(frozen=True)

    photo: str
    codes: tuple[FoundCode, ...] = ()
    twice: tuple[str, ...] = ()
    """names that it shows at several places: none of these is known to be the point"""


class CodedPoints(NamedTuple):
    """Control, and the system that the file of its points names."""

    control: Control
    crs: str | None


def search_windows(height: int, width: int) -> tuple[Window, ...]:
    """The parts in which a photograph is searched."""
    step = SIDE - HALO
    rows, cols = (range(0, max(length - HALO, 1), step) for length in (height, width))
    return tuple(Window(row, col, SIDE, SIDE).clipped((height, width)) for row in rows for col in cols)


def codes_in_photograph(parts: Iterable[np.ndarray], photo: str, windows: tuple[Window, ...]) -> PhotoCodes:
    """The codes of a photograph from its `parts` (rows, cols, bands) at `windows`; one that shows twice is no point."""
    found: dict[str, list[FoundTarget]] = {}
    for pixels, window in zip(parts, windows, strict=True):
        for one in all_coded_targets(np.clip(grey_of(pixels), 0, 255).astype(np.uint8)):
            place = one.place[0] + window.col, one.place[1] + window.row
            found.setdefault(one.name, []).append(replace(one, place=place))
    single = [seen[0] for _, seen in sorted(found.items()) if _apart(seen) <= SAME]
    twice = tuple(name for name, seen in sorted(found.items()) if _apart(seen) > SAME)
    codes = tuple(FoundCode(name=one.name, col=one.place[0], row=one.place[1], sigma=one.sigma) for one in single)
    return PhotoCodes(photo=photo, codes=codes, twice=twice)


def _apart(seen: list[FoundTarget]) -> float:
    """px between the farthest of several places."""
    places = np.array([one.place for one in seen])
    return float(np.linalg.norm(np.ptp(places, axis=0)))


def coded_points(
    photos: Photos,
    found: tuple[PhotoCodes, ...],
    source: ControlFromTargets,
    stated: StatedControl,
    points: str | None = None,
    distances: str | None = None,
) -> CodedPoints:
    """Control and tie points of the codes in `found`, in pixels of the files, with the coordinates of the text `points` in its own
    system and the `distances` (CSV text) between them. Raises WorkflowError where no point of the text was found."""
    listed = read_points(photos, points, stated) if points is not None else Control()
    surveyed = {point.name: point for point in listed.points}
    named = _names(surveyed, {code.name for seen in found for code in seen.codes})
    measured = _measurements(photos, found, named)
    if surveyed and not surveyed.keys() & measured.keys():
        codes = some_of(sorted(measured)) if measured else "none at all"
        raise WorkflowError(
            f"No coded target in the photographs has the name of a point in {source.points} ({some_of(list(surveyed))}); found: "
            f"{codes}. Name the points like the codes."
        )
    ties = {name: _tie(name) for name, seen in measured.items() if name not in surveyed and len(seen) > 1}
    known = {name: point for name, point in surveyed.items() if name in measured} | ties
    mistakes: list[str] = []
    points_of = {name: _with(point, measured[name]) for name, point in known.items()}
    lengths = tuple(read_distances(distances, points_of, (), mistakes, "was found in no two photographs")) if distances else ()
    if mistakes:
        raise WorkflowError(first_of(mistakes))
    control = Control(points=tuple(points_of.values()), distances=lengths)
    lost = tuple(name for name in surveyed if name not in measured)
    doubled = sorted({name for seen in found for name in seen.twice})
    about_doubled = TargetsTwice(codes=tuple(doubled), photos=tuple(seen.photo for seen in found if seen.twice))
    findings = (*((TargetsNotFound(points=lost),) if lost else ()), *((about_doubled,) if doubled else ()))
    read = control.model_copy(update={"findings": findings, "read": listed.read})
    return CodedPoints(read, listed.read.crs if listed.read else None)


def _names(surveyed: Iterable[str], codes: set[str]) -> dict[str, str]:
    """code -> the name of its point: its own, in any case, or its number alone where only one family has that number."""
    by_name = {name.casefold(): name for name in surveyed}
    numbers = [code.rpartition("-")[2] for code in codes]
    named = {}
    for code in sorted(codes):
        number = code.rpartition("-")[2]
        alone = by_name.get(number) if numbers.count(number) == 1 else None
        named[code] = by_name.get(code.casefold()) or alone or code
    return named


def _measurements(
    photos: Photos, found: tuple[PhotoCodes, ...], named: dict[str, str]
) -> dict[str, dict[str, tuple[float, float, float]]]:
    """point -> photograph -> (col, row, sigma), px of the file."""
    measured: dict[str, dict[str, tuple[float, float, float]]] = {}
    for seen in found:
        photo = photos[seen.photo]
        for code in seen.codes:
            measured.setdefault(named[code.name], {})[seen.photo] = (*_in_file(photo, code), code.sigma)
    return measured


def _in_file(photo: Photo, code: FoundCode) -> tuple[float, float]:
    """The pixel of the (upright) file, as in lists of measurements; another one for scans."""
    if photo.scan is None:
        return code.col, code.row
    s = photo.scan
    col, row = np.linalg.solve([[s[1], s[2]], [s[4], s[5]]], [code.col - s[0], code.row - s[3]])
    return float(col), float(row)


def _tie(name: str) -> ControlPoint:
    return ControlPoint(name=name, role="tie", xyz=(0.0, 0.0, 0.0), sigma=(0.0, 0.0, 0.0), measurements={})


def _with(point: ControlPoint, measurements: dict[str, tuple[float, float, float]]) -> ControlPoint:
    return point.model_copy(update={"measurements": measurements})
