"""What lies beside the photographs and belongs to them: control, positions, a calibrated camera.

Looked for in the folder of the photographs and in the one above it, where surveyors put it. A file is recognised by what it holds,
the GCP list by its usual name as well. What is not used, and may have been meant, is named: files of other photographs, second
ones, points without measurements, spreadsheets.
"""

import json
import os
import re
from dataclasses import dataclass, field
from pathlib import Path

from pyproj import CRS

from orthomill.pipeline.storage.photographs.file_kinds import FOREIGN_SUFFIXES, LIST_SUFFIXES
from orthomill.pipeline.workflow.lists_beside import ListText, choose_control, choose_positions
from orthomill.schemas.errors import StoreError
from orthomill.schemas.maps.system_names import known_crs
from orthomill.schemas.survey_files.control_recognition import control_in
from orthomill.schemas.survey_files.foreign_cameras import foreign_camera
from orthomill.schemas.survey_files.foreign_kinds import text_kind
from orthomill.schemas.survey_files.photograph_names import PhotographNames
from orthomill.schemas.survey_files.recognition import positions_in, words_that_name
from orthomill.schemas.survey_files.text_encoding import decoded

CAMERA_KEYS = {"name", "width", "height", "c"}
LARGEST = 20_000_000
"""bytes: what is larger is no camera and no list of positions"""
_NAMED, _LONGEST_LIST = 2, 100_000
"""photographs that a text has to name to be told, and lines of the longest such list"""
_BY_NAME = re.compile(r"gcp|control[ _-]?point|ground[ _-]?control|passpunkt|geotag|geoloc|ppk", re.IGNORECASE)


@dataclass(frozen=True)
class Beside:
    """Files found beside the photographs, relative to the project's root (None: none): the GCP list or other single file of
    control, or a file of points with its measurements; the `system` that the control names, that system where it is `projected` in
    metres, and whether PROJ does not know it; the positions, what they are and where (longitude, latitude); the camera file.
    `unused`: sentences about files that look like positions or control and are not used."""

    gcp_list: str | None = None
    points: str | None = None
    marks: str | None = None
    control_format: str = ""
    system: str | None = None
    projected: str | None = None
    unknown_system: bool = False
    positions: str | None = None
    positions_format: str = ""
    positions_text: str = field(default="", repr=False)
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
    files = _files(places)
    texts, unused = _read(files, root)
    control, of_control = choose_control(texts, names)
    positions, of_positions = choose_positions(texts, names, {control.gcp_list, control.points, control.marks})
    unused += [*of_control, *of_positions, *_meant(texts, names)]
    crs = _crs(control.system) if control.system else None
    told = crs or (_crs(positions[1].system) if positions and positions[1].system else None)
    return Beside(
        gcp_list=control.gcp_list,
        points=control.points,
        marks=control.marks,
        control_format=control.format,
        system=control.system,
        projected=_projected(told) if told else None,
        unknown_system=control.gcp_list is not None and control.system is not None and crs is None,
        positions=positions[0] if positions else None,
        positions_format=positions[1].format if positions else "",
        positions_text=next((one.text for one in texts if positions and one.path == positions[0]), ""),
        site=positions[1].site if positions else None,
        camera=_camera(places, root, sizes),
        unused=tuple(unused),
    )


def _files(places: list[Path]) -> list[Path]:
    """Files that may hold lists, by place and name; those that nobody can read as one, too."""
    wanted = LIST_SUFFIXES | FOREIGN_SUFFIXES
    return [path for place in places for path in sorted(place.glob("*")) if path.suffix.lower() in wanted and path.is_file()]


def _relative(path: Path, root: Path) -> str:
    return Path(os.path.relpath(path, root)).as_posix()


def _read(files: list[Path], root: Path) -> tuple[list[ListText], list[str]]:
    """The texts of files of a moderate size, and sentences about those that are no lists."""
    texts, unused = [], []
    for file in files:
        path = _relative(file, root)
        try:
            if file.stat().st_size > LARGEST:
                continue
            text = decoded(file.read_bytes(), path)
        except StoreError as error:
            # Logs of receivers (.dat) are binary, and nobody takes them for a list.
            if file.suffix.lower() in FOREIGN_SUFFIXES | {".txt", ".csv", ".tsv"}:
                unused.append(f"Not used: {error}")
            continue
        except OSError:
            continue
        kind = text_kind(text)
        if kind:
            unused.append(f"Not used: {path} {kind}.")
        elif file.suffix.lower() in LIST_SUFFIXES:
            texts.append(ListText(path, file.name, text))
    return texts, unused


def _meant(texts: list[ListText], names: PhotographNames) -> list[str]:
    """Sentences about files that are control or positions by their names only, or that name photographs, and about cameras of
    other programs."""
    told = []
    for one in texts:
        if program := foreign_camera(one.text):
            told.append(
                f"{one.path} is a camera of {program}, which is not read: the camera follows from the tags, and the block adjusts "
                "it. To begin with a calibration, give its values (docs/guide.md: cameras: {kind: given, c: ...})."
            )
            continue
        if control_in(one.text, names) or positions_in(one.text, names):
            continue
        if _BY_NAME.search(one.name):
            told.append(f"{one.path} is control or positions by its name, but follows no format that is known: it is not used.")
        elif (named := words_that_name(one.text, names)) >= _NAMED and one.text.count("\n") < _LONGEST_LIST:
            told.append(
                f"{one.path} names {named} of the photographs, but follows no format that is known: it is not used. If it holds "
                "positions, name its columns photo, x, y, z (docs/guide.md)."
            )
    return told


def _camera(places: list[Path], root: Path, sizes: set[tuple[int, int]]) -> str | None:
    """The first camera file of one of the sizes."""
    for path in (path for place in places for path in sorted(place.glob("*.json"))):
        try:
            if path.stat().st_size <= LARGEST and _is_camera(decoded(path.read_bytes(), str(path)), sizes):
                return _relative(path, root)
        except (OSError, StoreError):
            continue
    return None


def _is_camera(text: str, sizes: set[tuple[int, int]]) -> bool:
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        return False
    # The calibration of another camera, or of photographs that were reduced since, would be refused later.
    return isinstance(found, dict) and found.keys() >= CAMERA_KEYS and (found["width"], found["height"]) in sizes


def _crs(system: str) -> CRS | None:
    """The system of a list; None where it is unknown."""
    return known_crs(system)


def _projected(crs: CRS) -> str | None:
    """The system as a project names it; None where it is geographic or not in metres."""
    plane = crs.sub_crs_list[0] if crs.is_compound else crs
    if not plane.is_projected or plane.axis_info[0].unit_conversion_factor != 1.0:
        return None
    # PROJ strings lack what an authority's code tells; 70 % is PROJ's own limit for a plausible match.
    code = plane.to_epsg(min_confidence=70)
    return f"EPSG:{code}" if code else plane.srs
