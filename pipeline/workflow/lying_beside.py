"""What lies beside the photographs and belongs to them: control, positions, a calibrated camera.

Looked for in the folder of the photographs and in the one above it, where surveyors put it. A file is recognised by what it holds,
the GCP list by its usual name as well. One that looks like the positions of other photographs is not used, and named.
"""

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from pyproj import CRS
from pyproj.exceptions import CRSError

from orthomill.schemas.errors import StoreError
from orthomill.schemas.survey_files.photograph_names import PhotographNames
from orthomill.schemas.survey_files.recognition import FoundControl, FoundPositions, control_in, positions_in
from orthomill.schemas.survey_files.sniffed_table import lines_of
from orthomill.schemas.survey_files.text_encoding import decoded

GCP_LIST = "gcp_list.txt"
CAMERA_KEYS = {"name", "width", "height", "c"}
LARGEST = 20_000_000
"""bytes: what is larger is no camera and no list of positions"""
_SUFFIXES = frozenset({".txt", ".csv", ".dat", ".gcp", ".pos", ".mrk", ".xml", ".tsv"})


@dataclass(frozen=True)
class Beside:
    """Files found beside the photographs, relative to the project's root (None: none): the GCP list or other single file of
    control, or a file of points with its measurements; the `system` that the control names, that system where it is `projected` in
    metres, and whether PROJ does not know it; the positions, what they are and where (longitude, latitude); the camera file.
    `unused`: sentences about files that look like positions and are not used."""

    gcp_list: str | None = None
    points: str | None = None
    marks: str | None = None
    control_format: str = ""
    system: str | None = None
    projected: str | None = None
    unknown_system: bool = False
    positions: str | None = None
    positions_format: str = ""
    site: tuple[float, float] | None = None
    camera: str | None = None
    unused: tuple[str, ...] = field(default=())

    @property
    def control(self) -> str | None:
        """The file of the control, or of its points."""
        return self.gcp_list or self.points


NOTHING = Beside()
"""Only photographs lie there."""


def look_beside(folder: Path, root: Path, sizes: set[tuple[int, int]], photographs: tuple[str, ...] = ()) -> Beside:
    """What lies in the `folder` of the `photographs` (names) or above it, but inside of the `root`; cameras only of one of these
    `sizes` (width, height) px. Files that cannot be read are no finds."""
    folder = Path(os.path.normpath(folder))
    # Photographs outside of the project come with what lies beside them.
    outside = not folder.is_relative_to(root)
    places = [place for place in (folder, folder.parent) if outside or place.is_relative_to(root)]
    names = PhotographNames(photographs)
    texts = [(_relative(path, root), path, text) for path in _files(places) for text in _text(path)]
    control = _control(texts, names)
    positions, unused = _positions(texts, names, {control.gcp_list, control.points, control.marks})
    crs = _crs(control.system) if control.system else None
    told = crs or (_crs(positions[1].system) if positions and positions[1].system else None)
    return Beside(
        control.gcp_list,
        control.points,
        control.marks,
        control.format,
        control.system,
        _projected(told) if told else None,
        control.gcp_list is not None and control.system is not None and crs is None,
        positions[0] if positions else None,
        positions[1].format if positions else "",
        positions[1].site if positions else None,
        _camera(places, root, sizes),
        unused,
    )


_Texts = list[tuple[str, Path, str]]


def _files(places: list[Path]) -> Iterator[Path]:
    """Files that may hold lists, by place and name."""
    for place in places:
        yield from sorted(path for path in place.glob("*") if path.suffix.lower() in _SUFFIXES)


def _relative(path: Path, root: Path) -> str:
    return Path(os.path.relpath(path, root)).as_posix()


def _text(path: Path) -> Iterator[str]:
    """The text of a file, if it is one and of a moderate size."""
    try:
        if path.is_file() and path.stat().st_size <= LARGEST:
            yield decoded(path.read_bytes(), str(path))
    except (OSError, StoreError):
        return


@dataclass(frozen=True)
class _Control:
    """Paths of the control (None: none), its format and the system that it names."""

    gcp_list: str | None = None
    points: str | None = None
    marks: str | None = None
    format: str = ""
    system: str | None = None


def _control(texts: _Texts, names: PhotographNames) -> _Control:
    """The single file of control, or the first list of points and the first measurements of any of them."""
    for path, file, text in texts:
        if file.name.lower() == GCP_LIST and len(text.splitlines()) > 1:
            return _Control(path, format="GCP list of OpenDroneMap", system=_system_line(text))
    found = [(path, one) for path, _, text in texts if (one := control_in(text, names)) is not None]
    for path, one in found:
        if one.holds == "all" and one.format.startswith("GCP list"):
            return _Control(path, format=one.format, system=one.system)
        if one.holds == "all":
            return _Control(points=path, format=one.format)
    return next(_pairs(found), _Control())


def _pairs(found: list[tuple[str, FoundControl]]) -> Iterator[_Control]:
    """Points and measurements that name the same points."""
    for points, surveyed in found:
        for marks, seen in found:
            if surveyed.holds == "points" and seen.holds == "marks" and surveyed.names & seen.names:
                yield _Control(None, points, marks, f"{surveyed.format}, {seen.format}", surveyed.system)


def _positions(
    texts: _Texts, names: PhotographNames, taken: set[str | None]
) -> tuple[tuple[str, FoundPositions] | None, tuple[str, ...]]:
    """The first file of positions of these photographs, and sentences about those of others."""
    found = [(path, one) for path, _, text in texts if path not in taken and (one := positions_in(text, names)) is not None]
    count = len(names.names)
    fits = next(((path, one) for path, one in found if one.fits(count)), None)
    unused = [
        f"{path} holds positions ({one.format}), but {one.misfit(count)}: it is not used."
        for path, one in found
        if not one.fits(count)
    ]
    return fits, tuple(unused)


def _camera(places: list[Path], root: Path, sizes: set[tuple[int, int]]) -> str | None:
    """The first camera file of one of the sizes."""
    for path in (path for place in places for path in sorted(place.glob("*.json"))):
        if any(_is_camera(text, sizes) for text in _text(path)):
            return _relative(path, root)
    return None


def _is_camera(text: str, sizes: set[tuple[int, int]]) -> bool:
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        return False
    # The calibration of another camera, or of photographs that were reduced since, would be refused later.
    return isinstance(found, dict) and found.keys() >= CAMERA_KEYS and (found["width"], found["height"]) in sizes


def _system_line(text: str) -> str:
    """The first line that is no comment: the reference system of a GCP list."""
    lines = lines_of(text, ("#",)).others
    return lines[0][1].strip() if lines else ""


def _crs(system: str) -> CRS | None:
    """The system of a GCP list; None where it is unknown."""
    words = system.upper().split()
    # OpenDroneMap's own way to name a UTM zone, as "WGS84 UTM 16N".
    if len(words) == 3 and words[:2] == ["WGS84", "UTM"]:
        system = f"+proj=utm +zone={words[2][:-1]} +datum=WGS84{' +south' * (words[2][-1] == 'S')}"
    try:
        return CRS.from_user_input(system)
    except CRSError:
        return None


def _projected(crs: CRS) -> str | None:
    """The system as a project names it; None where it is geographic or not in metres."""
    plane = crs.sub_crs_list[0] if crs.is_compound else crs
    if not plane.is_projected or plane.axis_info[0].unit_conversion_factor != 1.0:
        return None
    # PROJ strings lack what an authority's code tells; 70 % is PROJ's own limit for a plausible match.
    code = plane.to_epsg(min_confidence=70)
    return f"EPSG:{code}" if code else plane.srs
