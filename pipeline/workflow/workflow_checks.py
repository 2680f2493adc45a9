"""What a workflow must satisfy beyond its types: a sensible list of stages, files that exist inside the project, a CRS in metres.

None of it needs photogrammetry, and all of it is checked before anything runs. Each check records what it finds in `Mistakes` and
continues, so that everything is reported at once.
"""

import math
import os
import shlex
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pyproj import CRS
from pyproj.exceptions import CRSError

from orthomill.pipeline.storage.depots.bucket import is_address
from orthomill.pipeline.storage.photographs.file_kinds import is_image_name
from orthomill.pipeline.storage.photographs.folder_listing import image_files
from orthomill.pipeline.workflow.camera_tags import longitude_latitude
from orthomill.pipeline.workflow.mistakes import Mistakes, nearest
from orthomill.pipeline.workflow.yaml_lines import Path_
from orthomill.schemas.errors import OrthomillError, WorkflowError
from orthomill.schemas.maps.map_scale import is_unfit, map_scale, unfit_sentence, utm_zone
from orthomill.schemas.project import MaskFiles, PhotoFolder, PhotoList, Project
from orthomill.schemas.project_paths import FileRole, file_roles, words_of
from orthomill.schemas.stage_contract import Stage

_MAP_SUFFIXES = (".tif", ".tiff")
_LONGEST_PATH, _LONGEST_NAME = 4000, 255
"""bytes; Linux allows 4096, the project's folder included"""
_METRE = frozenset({"metre", "meter"})
_MANY_NAMES = 12
"""Names of a folder are listed in a message up to this number; more would bury the sentence."""


@dataclass(frozen=True)
class Kinds:
    """The stages of a workflow in its own order: (entry of the file, kind), unknown kinds left out."""

    entries: tuple[tuple[int, str], ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The kinds alone, in the order of the file."""
        return tuple(kind for _, kind in self.entries)


def kind_of(stage: type[Stage]) -> str:
    """The kind of a stage class: the default of its field `kind`."""
    return str(stage.model_fields["kind"].default)


def check_stages(kinds: Kinds, catalogue: tuple[type[Stage], ...], mistakes: Mistakes) -> None:
    """Twice the same stage, and stages out of order; that one lacks what it needs is found when it is planned."""
    # The catalogue is in the order of processing, so that it also defines the order in a workflow.
    order = {kind_of(stage): place for place, stage in enumerate(catalogue)}
    for kind, times in Counter(kinds.names).items():
        if times > 1:
            second = [index for index, name in kinds.entries if name == kind][1]
            mistakes.add(("stages", second), f"this stage is listed {times} times; a stage runs once, so remove the others.")
    for (_, before), (index, kind) in zip(kinds.entries, kinds.entries[1:], strict=False):
        if order[kind] < order[before]:
            right = ", ".join(sorted(set(kinds.names), key=order.__getitem__))
            mistakes.add(("stages", index), f"{kind} runs before {before}, so it must be listed first; the order is {right}.")


def check_sources(project: Project, kinds: Kinds, catalogue: tuple[type[Stage], ...], mistakes: Mistakes) -> None:
    """Sources of the project that a stage provides need that stage."""
    for name in ("photographs", "positions", "control"):
        source = getattr(project, name).kind
        makers = [kind_of(stage) for stage in catalogue if source in stage.provides]
        if makers and not set(makers) & set(kinds.names):
            missing = f"is '{source}', but no stage '{makers[0]}' is in this workflow"
            mistakes.add((name,), f"{missing}; add '- kind: {makers[0]}', which provides that, first.")


def check_crs(crs: str, photographs: PhotoFolder | PhotoList | Any, root: Path, mistakes: Mistakes) -> None:
    """A projected CRS in metres; the height part, after '+', in metres, positive upwards."""
    try:
        system = CRS.from_user_input(crs)
    except CRSError:
        mistakes.add(("crs",), _unknown_crs(crs))
        return
    if _guessed(crs, system):
        code = ":".join(system.to_authority() or ("the system",))
        mistakes.add(("crs",), f"'{crs}' is neither a code nor the full name of a system; did you mean {code} ({system.name})?")
        return
    # A compound system has a horizontal part first and a vertical part second (ISO 19111).
    parts = [*(system.sub_crs_list or [system])]
    problem = _plan_problem(parts[0]) or _height_problem(parts[1:])
    if problem:
        mistakes.add(("crs",), f"{crs} ({system.name}) {problem}; {_suggestion(photographs, root)}")
    elif sentence := unfit_map(crs, _places(photographs, root)):
        mistakes.add(("crs",), sentence)


def unfit_map(crs: str, places: list[tuple[float, float]]) -> str:
    """What is wrong with a system in metres whose metres are none at the first of `places` (longitude, latitude); "" for none."""
    plane = CRS.from_user_input(crs)
    plane = plane.sub_crs_list[0] if plane.is_compound else plane
    # The system of another place is answered by the stages, with that place.
    if not places or not plane.is_projected or not _is_for(plane, *places[0]):
        return ""
    factor = map_scale(plane, *places[0]).factor
    return unfit_sentence(crs, plane, factor, *places[0]) if math.isfinite(factor) and is_unfit(factor) else ""


def _guessed(crs: str, system: CRS) -> bool:
    """Whether PROJ took a bare word for the system with the most similar name."""
    # PROJ resolves "2100" or "Greek" by a search in its database; coordinates must not depend on the first hit of a search.
    return not any(sign in crs for sign in ":+[{=") and system.name.lower() != crs.strip().lower()


def _unknown_crs(crs: str) -> str:
    advice = "look up the code at https://epsg.io"
    if crs.strip().isdigit():
        advice += "; codes are written as EPSG:2100"
    if "+" in crs:
        advice += "; plan and height part are written as EPSG:2100+5773"
    return f"'{crs}' is not a coordinate reference system that PROJ knows; {advice}."


def _plan_problem(plan: CRS) -> str:
    if plan.is_geographic:
        return "is in degrees, but orthomill needs a projected system in metres"
    if plan.is_geocentric:
        return "is geocentric, but orthomill needs a projected system in metres"
    if not plan.is_projected:
        return "is not a projected system, but orthomill needs one in metres"
    units = {axis.unit_name for axis in plan.axis_info}
    return "" if units <= _METRE else f"is in {' and '.join(sorted(units))}, but orthomill needs metres"


def _height_problem(vertical: list[CRS]) -> str:
    axes = [axis for part in vertical for axis in part.axis_info]
    bad = [f"{axis.unit_name}, {axis.direction}" for axis in axes if axis.unit_name not in _METRE or axis.direction != "up"]
    return f"has a height part in {bad[0]}, but heights must be in metres, positive upwards" if bad else ""


def _suggestion(photographs: Any, root: Path) -> str:
    """The UTM zone of the first photographs that have a position, or else how to find it."""
    places = _places(photographs, root)
    if places:
        return f"the GPS tags of the photographs suggest {utm_zone(*places[0])}, the UTM zone they are in."
    return (
        "use a national grid, or UTM: EPSG:326nn north and EPSG:327nn south of the equator, nn being the zone, "
        "e.g. EPSG:32634 for 18 to 24 degrees east."
    )


def _places(photographs: Any, root: Path) -> list[tuple[float, float]]:
    """Longitude and latitude of the first photographs that have them."""
    if not isinstance(photographs, PhotoFolder | PhotoList):
        return []
    from orthomill.pipeline.storage.image_files import header_or_fault  # loads GDAL, which no other check of the text needs

    # Three headers are enough to find the site, and a damaged photograph is reported elsewhere.
    try:
        files = image_files(root, photographs)[:3]
        return [place for file in files if (place := longitude_latitude(header_or_fault(root / file).tags))]
    except (OrthomillError, ValueError):  # a path with a null character has its own sentence
        return []


def _is_for(plane: CRS, longitude: float, latitude: float) -> bool:
    """Whether a system is meant for a place, as far as it says."""
    area = plane.area_of_use
    return area is None or area.west > area.east or (area.west <= longitude <= area.east and area.south <= latitude <= area.north)


def check_files(value: BaseModel, base: Path_, root: Path, mistakes: Mistakes) -> None:
    """Every path that a model names is inside the project and exists; every source of photographs contains photographs."""
    if isinstance(value, PhotoFolder):
        _check_folder(value, base, root, mistakes)
    elif isinstance(value, PhotoList):
        _check_list(value, base, root, mistakes)
    else:
        for path, text, role in _named_files(value, base):
            _check_file(text, path, root, mistakes, is_map=role.is_map)
        for path, model in _models(value, base):
            check_files(model, path, root, mistakes)


def named_inputs(value: BaseModel) -> Iterator[str]:
    """The files that a model and those below it name: control, positions, cameras; photographs are a folder."""
    yield from (text for _, text, _ in _named_files(value, ()))
    for _, model in _models(value, ()):
        yield from named_inputs(model)


def _named_files(value: BaseModel, base: Path_) -> Iterator[tuple[Path_, str, FileRole]]:
    for name, role in file_roles(type(value)).items():
        content = getattr(value, name)
        if isinstance(content, str) and content not in words_of(type(value), name):
            yield (*base, name), content, role
        elif content is not None and not isinstance(content, str):
            yield from (((*base, name, index), item, role) for index, item in enumerate(content) if isinstance(item, str))


def _models(value: BaseModel, base: Path_) -> Iterator[tuple[Path_, BaseModel]]:
    """The models directly below a model."""
    for name in type(value).model_fields:
        content = getattr(value, name)
        if isinstance(content, BaseModel):
            yield (*base, name), content
        elif isinstance(content, tuple | list):
            yield from (((*base, name, index), item) for index, item in enumerate(content) if isinstance(item, BaseModel))


def _check_folder(source: PhotoFolder, base: Path_, root: Path, mistakes: Mistakes) -> None:
    path = (*base, "path")
    if is_address(source.path):
        fetching = f"'orthomill init NAME --photos {source.path}', with a new NAME, fetches them"
        mistakes.add(path, f"'{source.path}' is in an object store; {fetching} into photographs/NAME: give that folder.")
        return
    if not _inside(source.path, path, root, mistakes):
        return
    folder = root / source.path
    if folder.is_file():
        mistakes.add(path, f"'{source.path}' is a file; give its folder, or name the photographs with 'kind: list' and 'paths'.")
    elif not folder.is_dir():
        mistakes.add(path, f"the folder '{source.path}' does not exist{_near_file(folder, root)}")
    else:
        _check_count(source, base, root, mistakes)
        _check_masks(source, base, root, mistakes)


def _check_masks(source: PhotoFolder | PhotoList, base: Path_, root: Path, mistakes: Mistakes) -> None:
    path = (*base, "masks")
    if source.masks is None or not _inside(source.masks, path, root, mistakes):
        return
    if not (root / source.masks).is_dir():
        mistakes.add(path, f"the folder of masks '{source.masks}' does not exist{_near_file(root / source.masks, root)}")
        return
    try:
        image_files(root, MaskFiles(path=source.masks))
    except WorkflowError as error:
        mistakes.add(path, str(error))


def _check_count(source: PhotoFolder, base: Path_, root: Path, mistakes: Mistakes) -> None:
    try:
        files = image_files(root, source)
    except WorkflowError as error:
        mistakes.add((*base, "path"), str(error))
        return
    if len(files) == 1 and base == ("photographs",):
        mistakes.add((*base, "path"), _single(files[0]))


def _single(file: str) -> str:
    return f"'{file}' is the only photograph; heights come from overlap, so at least two photographs of the same ground are needed."


def _check_list(source: PhotoList, base: Path_, root: Path, mistakes: Mistakes) -> None:
    for index, text in enumerate(source.paths):
        path = (*base, "paths", index)
        if text in source.paths[:index]:
            mistakes.add(path, f"the photograph '{text}' is listed twice; remove one of them.")
        elif not is_image_name(text):
            mistakes.add(path, f"'{text}' is not named like a photograph; accepted are .jpg, .jpeg, .tif, .tiff and .png.")
        else:
            _check_file(text, path, root, mistakes, "photograph")
    _check_masks(source, base, root, mistakes)
    # A single photograph is refused for the block only: chessboards in space can be calibrated from one.
    if len(source.paths) == 1 and base == ("photographs",):
        mistakes.add((*base, "paths"), _single(source.paths[0]))


def _check_file(text: str, path: Path_, root: Path, mistakes: Mistakes, what: str = "file", is_map: bool = False) -> None:
    if not _inside(text, path, root, mistakes):
        return
    file = root / text
    if file.is_dir():
        mistakes.add(path, f"'{text}' is a folder; a file is needed here.")
    elif not file.is_file():
        mistakes.add(path, f"the {what} '{text}' does not exist{_near_file(file, root)}")
    elif what == "file" and (is_map or file.suffix.lower() in _MAP_SUFFIXES):
        _check_map(file, path, mistakes)


def _check_map(file: Path, path: Path_, mistakes: Mistakes) -> None:
    from orthomill.pipeline.storage.map_files import check_map_file

    # A reference is read last of all, when everything that it is to judge has been computed.
    try:
        check_map_file(file)
    except WorkflowError as error:
        mistakes.add(path, str(error))


def _inside(text: str, path: Path_, root: Path, mistakes: Mistakes) -> bool:
    """Whether a path stays inside the project."""
    if not text.strip() or "\0" in text:
        problem = "is empty; name" if not text.strip() else "contains a null character; name"
        mistakes.add(path, f"{problem} a file or folder inside the project.")
        return False
    if len(os.fsencode(text)) > _LONGEST_PATH or any(len(os.fsencode(part)) > _LONGEST_NAME for part in Path(text).parts):
        mistakes.add(path, f"'{text[:40]}...' has {len(text)} characters, longer than any path of this system; correct it.")
        return False
    # Judged by the text alone, without following links: photographs often lie on another disk, linked into the project.
    top = os.path.abspath(root)
    full = os.path.normpath(os.path.join(top, text))
    if full == top or full.startswith(top.rstrip(os.sep) + os.sep):
        return True
    name = os.path.basename(full) or "data"
    mistakes.add(
        path,
        f"'{text}' is outside the project's folder {top}; copy the files into it, or create a link there "
        f"(ln -s {shlex.quote(full)} {shlex.quote(os.path.join(top, name))}) and write '{name}'.",
    )
    return False


def _near_file(missing: Path, root: Path) -> str:
    """ "; did you mean 'photos/a.jpg'?", from the content of the folder where the file should be."""
    folder = missing.parent
    if "\\" in missing.name:
        return "; separate folders by '/', not by a backslash."
    if not folder.is_dir():
        return f", nor does its folder '{os.path.relpath(folder, root)}'."
    # difflib compares with every name; beyond ten thousand the answer would keep the user waiting.
    names = sorted(entry.name for entry in folder.iterdir() if not entry.name.startswith("."))[:10_000]
    near = nearest(missing.name, names)
    if near:
        return f"; did you mean '{Path(os.path.relpath(folder / near, root)).as_posix()}'?"
    where = "the project's folder" if folder == root else f"'{os.path.relpath(folder, root)}'"
    return f"; {where} contains {', '.join(names)}." if 0 < len(names) <= _MANY_NAMES else "."
