"""`orthomill check`: the workflow of a surface from a file against photographs, made from the command line.

The photographs are those of a folder or of a finished project. A block of cameras may be given; without one the photographs are
oriented first, with what `orthomill init` would use: their EXIF tags and what lies beside them. The run writes the workflow next to
its results like any other, so that it can be run again. What lies outside of the current folder is linked into it.
"""

import hashlib
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from orthomill.pipeline.storage.depots.product_files import product_file, refuse_joined
from orthomill.pipeline.storage.file_names import shown
from orthomill.pipeline.storage.height_files import check_height_file, plan_crs_of
from orthomill.pipeline.storage.mesh_files import MESH_SUFFIXES
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.pipeline.workflow.mistakes import Mistakes
from orthomill.pipeline.workflow.photograph_survey import Survey, survey_folder
from orthomill.pipeline.workflow.starting_workflow import starting_text
from orthomill.pipeline.workflow.workflow_checks import check_crs, kind_of
from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow, load_workflow
from orthomill.pipeline.workflow.workflow_text import workflow_text
from orthomill.pipeline.workflow.yaml_lines import read_yaml
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.orientation import Block
from orthomill.schemas.project import Project
from orthomill.schemas.stage_contract import InspectionPart, Stage
from orthomill.schemas.survey_files.noted_origin import noted_origin
from orthomill.schemas.survey_files.text_encoding import decoded

_HEAD = "# Written by orthomill check"
_WHOLE_HEAD = f"{_HEAD}, which writes it anew every time it is called; so does accept --block."
_BLOCKS = "cameras.json of orthomill, OpenSfM's reconstruction.json or a CSV of X, Y, Z, omega, phi, kappa"
_LINKS = "linked"
"""folder for links to files outside of the project's folder"""


@dataclass(frozen=True)
class CheckOptions:
    """What the command line says: the photographs or a finished project, a block, reference systems, and what to do."""

    photos: Path | None = None
    project: str | None = None
    block: Path | None = None
    crs: str | None = None
    system: str | None = None
    remove_shift: bool = False
    fill: bool = False
    sigma: float = 0.0
    """m, of the heights of the surface"""
    ortho: bool = False
    """whether an orthoimage is made of the corrected surface"""
    earlier: bool = False
    """whether the surface is of an earlier epoch than the photographs"""
    area: tuple[float, float, float, float] | None = None
    """m: west, south, east, north of what is checked, in the system of the answer"""
    cutline: Path | None = None
    """polygons of what is checked"""


def check_workflow(
    name: str, surface: Path, options: CheckOptions, root: Path, catalogue: tuple[type[Stage], ...]
) -> LoadedWorkflow:
    """The workflow of a check with results in runs/<name> below `root`. Raises WorkflowError with one sentence."""
    if not surface.is_file():
        raise WorkflowError(f"There is no surface {shown(surface)}; give a GeoTIFF, LAS or LAZ file.")
    if surface.suffix.lower() in MESH_SUFFIXES:
        raise WorkflowError(
            f"{shown(surface)} is a mesh, which may have several heights at one place, and names no reference system: the check "
            "compares one height of every place. Make a GeoTIFF of its upper side (CloudCompare: Rasterize), or look at it with "
            "the stage projection, which makes each photograph again from the others and tells which disagree."
        )
    refuse_joined(shown(surface))
    check_height_file(surface)
    if (options.photos is None) == (options.project is None):
        raise WorkflowError("Give the photographs with --photos FOLDER, or a finished project with --project NAME, one of the two.")
    source = _of_project(options, root, catalogue) if options.project else _of_photos(name, surface, options, root, catalogue)
    given = {**source, "project": name} | _grid(options, root)
    try:
        project = Project.model_validate(given)
        stages = tuple(_stages(surface, options, root, catalogue))
    except ValidationError as error:
        raise WorkflowError("; ".join(f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors()) + ".") from error
    path = _written(name, root, workflow_text(project, stages))
    return LoadedWorkflow(project, stages, path, root, path.read_text(encoding="utf-8"))


def block_workflow(
    name: str, product: Path, options: CheckOptions, more: dict[str, Any], root: Path, catalogue: tuple[type[Stage], ...]
) -> LoadedWorkflow:
    """The workflow that takes the block of another program as it is, to its orientation; product: names the system where nothing
    else does; `more`: keys of the project. Raises WorkflowError, and ValidationError for what no project can have."""
    project = Project.model_validate(_of_photos(name, product, options, root, catalogue) | more | {"project": name})
    wanted: tuple[InspectionPart, ...] = ("cameras", *(("ties",) if _examines(options, root) else ()))
    exterior = _exterior(_cameras_of(options, root), root)
    if exterior["kind"] == "colmap" and project.positions.kind == "none":
        # Without positions nothing could place it: its coordinates are those of the project, or its points will not be found.
        exterior["placed"] = "project"
    stages = tuple(_inspecting(wanted, {"orientation": {"exterior": exterior}}, catalogue))
    path = _written(name, root, workflow_text(project, stages))
    return LoadedWorkflow(project, stages, path, root, path.read_text(encoding="utf-8"))


def _written(name: str, root: Path, text: str) -> Path:
    """workflows/<name>.yaml with the text. Raises WorkflowError rather than overwrite what this command has not written."""
    path = root / "workflows" / f"{name}.yaml"
    if path.exists() and not path.read_text(encoding="utf-8").startswith(_HEAD):
        raise WorkflowError(f"{shown(path)} exists already and is not overwritten; choose another name with --name.")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, f"{_WHOLE_HEAD}\n\n{text}".encode())
    return path


def check_name(surface: Path) -> str:
    """The project's name where none is given: that of the surface, as a possible name."""
    stem = re.sub(r"[^a-z0-9_-]+", "-", surface.stem.lower()).strip("-_")
    return f"check-{stem}" if stem else "check"


def change_workflow(
    before: str, after: str, name: str | None, sigma: float, root: Path, catalogue: tuple[type[Stage], ...]
) -> LoadedWorkflow:
    """The workflow that asks whether the ground has changed: the surface of an earlier epoch, a file or a finished project,
    against the photographs of a later project. Raises WorkflowError with one sentence."""
    surface = Path(before)
    if not surface.is_file():
        made = product_file(root / "runs" / before, "dsm")
        if made is None:
            raise WorkflowError(
                f"There is neither a surface {before} nor a finished project of that name; run it first, or name a file."
            )
        surface = made
    return check_workflow(
        name or f"change-{after}", surface, CheckOptions(project=after, sigma=sigma, earlier=True), root, catalogue
    )


def _of_project(options: CheckOptions, root: Path, catalogue: tuple[type[Stage], ...]) -> dict[str, Any]:
    """The project part of a finished run, whose photographs are files."""
    folder = root / "runs" / str(options.project)
    if not (folder / "workflow.yaml").is_file() or not _cameras_of(options, root).is_file():
        raise WorkflowError(f"runs/{options.project} holds no oriented photographs; run it first: orthomill run {options.project}")
    done = load_workflow(folder / "workflow.yaml", catalogue).project
    photographs: dict[str, Any] = done.photographs.model_dump()
    if done.photographs.kind == "simulated":
        photographs = {"kind": "folder", "path": f"runs/{options.project}/photographs", "pattern": "*.tif"}
    cameras: dict[str, Any] = done.cameras.model_dump()
    if done.cameras.kind == "chessboards":
        # The boards need not be measured again, and photographs without tags have no other camera.
        cameras = {"kind": "file", "path": f"runs/{options.project}/products/camera.json", "serves": done.cameras.serves}
    project = {"crs": done.crs, "photographs": photographs, "cameras": cameras, "positions": {"kind": "none"}, "tile": done.tile}
    # Its cells are those of its own surface; a surface from elsewhere is best checked in the cells that it has.
    return project | ({"grid": {"kind": "map", "area": done.grid.area}} if done.grid.kind == "map" else {})


def _grid(options: CheckOptions, root: Path) -> dict[str, Any]:
    """Where the surface is checked, if the command line says so. Raises WorkflowError where it says so twice, or names no file."""
    if options.area is not None and options.cutline is not None:
        raise WorkflowError("--area and --cutline each say where the surface is checked; give one of them.")
    if options.cutline is not None and not options.cutline.is_file():
        raise WorkflowError(f"There are no polygons {shown(options.cutline)}; give a GeoPackage or GeoJSON file.")
    area = relative_to(options.cutline, root) if options.cutline else options.area
    return {"grid": {"kind": "map", "area": area}} if area else {}


def _cameras_of(options: CheckOptions, root: Path) -> Path:
    return options.block or root / "runs" / str(options.project) / "products" / "cameras.json"


def _of_photos(
    name: str, surface: Path | None, options: CheckOptions, root: Path, catalogue: tuple[type[Stage], ...]
) -> dict[str, Any]:
    """The project part that `orthomill init` would write for a folder of photographs."""
    assert options.photos is not None
    survey = survey_folder(relative_to(options.photos, root), root)
    crs = options.crs or _crs_of_block(options.block) or _noted_system(options.block) or survey.beside.projected
    crs = crs or (plan_crs_of(surface) if surface and surface.is_file() else None) or survey.utm
    if crs is None:
        known = f"Neither {shown(surface)} nor the photographs name" if surface else "The photographs do not name"
        raise WorkflowError(f"{known} a projected system in metres; name one with --crs.")
    check_crs_option(crs)
    text = starting_text(name, survey, catalogue, crs)
    project = {key: value for key, value in yaml.safe_load(text).items() if key != "stages"}
    if options.block is not None:
        # The cameras and the control of the block are in the block.
        project |= {"control": {"kind": "none"}} | _any_camera(survey, options.block)
    elif not survey.focal_lengths and not survey.beside.camera:
        raise WorkflowError(
            "No photograph has a focal length in its EXIF tags, so they cannot be oriented without more; give a block with "
            "--block, or "
            f"begin with: orthomill init {name} --photos {shown(options.photos)}"
        )
    return project


def _any_camera(survey: Survey, block: Path) -> dict[str, Any]:
    """A camera for photographs without tags: the block brings its own, but every photograph needs one before it is read."""
    if survey.focal_lengths or survey.beside.camera or block.suffix == ".csv":
        return {}
    first = survey.headers[0]
    return {"cameras": {"kind": "given", "c": float(max(first.width, first.height))}}


def check_crs_option(crs: str) -> None:
    """Raises WorkflowError for a system that no project can have."""
    mistakes = Mistakes("--crs", read_yaml("crs: x\n"))
    check_crs(crs, None, Path(), mistakes)
    mistakes.raise_if_any()


def _crs_of_block(block: Path | None) -> str | None:
    if block is None or block.suffix != ".json" or not block.is_file():
        return None
    try:
        return Block.model_validate_json(block.read_text(encoding="utf-8")).crs
    except (ValidationError, UnicodeDecodeError):
        return None


def _noted_system(block: Path | None) -> str | None:
    """The system that COLMAP's texts note where they are an export of a project here."""
    images = block and block.is_dir() and _colmap_texts(block) / "images.txt"
    noted = noted_origin(decoded(images.read_bytes(), str(images))) if images and images.is_file() else None
    return noted.crs if noted else None


def _colmap_texts(folder: Path) -> Path:
    """Where the texts are: in the folder, or, in an export of a project here, in text."""
    return folder if (folder / "images.txt").is_file() else folder / "text"


def _stages(surface: Path, options: CheckOptions, root: Path, catalogue: tuple[type[Stage], ...]) -> Iterator[Stage]:
    oriented = options.block is not None or options.project is not None
    settings: dict[str, dict[str, Any]] = {
        "dsm_check": {
            "surface": {
                "kind": "file",
                "path": relative_to(surface, root),
                "system": options.system,
                "shift": "remove" if options.remove_shift else "keep",
                "holes": "fill" if options.fill else "keep",
                "sigma": options.sigma,
                "epoch": "earlier" if options.earlier else "same",
            },
            "pairs_per_place": 3,
        }
    }
    if oriented:
        settings["orientation"] = {"exterior": _exterior(_cameras_of(options, root), root)}
    if not options.fill:
        settings["epipolar"] = {"images": "none"}
    wanted: dict[InspectionPart, bool] = {
        "cameras": True,
        "ties": not oriented or _examines(options, root),
        "surface": True,
        "filling": options.fill,
        "orthoimage": options.ortho,
    }
    yield from _inspecting(tuple(part for part, needed in wanted.items() if needed), settings, catalogue)


def _inspecting(
    wanted: tuple[InspectionPart, ...], settings: dict[str, dict[str, Any]], catalogue: tuple[type[Stage], ...]
) -> Iterator[Stage]:
    """The stages that take one of the parts, with their settings by kind."""
    for stage in catalogue:
        if stage.inspects in wanted:
            yield stage.model_validate(settings.get(kind_of(stage), {}))


def _examines(options: CheckOptions, root: Path) -> bool:
    """Whether tie points are needed: for a block of which the heights of the ground are not known."""
    return _crs_of_block(_cameras_of(options, root)) is None


def _exterior(block: Path, root: Path) -> dict[str, Any]:
    """The orientation stage's source for a block, by what the file is."""
    if not block.exists():
        raise WorkflowError(f"There is no block {shown(block)}; give {_BLOCKS}, or COLMAP's folder of texts.")
    if block.is_dir():
        texts = _colmap_texts(block)
        if not all((texts / name).is_file() for name in ("cameras.txt", "images.txt")):
            raise WorkflowError(
                f"{shown(block)} holds no cameras.txt and images.txt; give the folder with COLMAP's texts (colmap model_converter "
                f"--output_type TXT), or a file: {_BLOCKS}."
            )
        folder = relative_to(texts, root)
        files = {key: f"{folder}/{name}.txt" for key, name in (("cameras_path", "cameras"), ("images_path", "images"))}
        # Coordinates of which the texts say what they are need no positions to place them.
        return {"kind": "colmap", **files} | ({"placed": "project"} if _noted_system(block) else {})
    path = relative_to(block, root)
    if block.suffix.lower() in (".csv", ".txt"):
        return {"kind": "csv", "path": path}
    if block.suffix.lower() != ".json":
        raise WorkflowError(
            f"{shown(block)} is no block that can be read; export the orientation as a table (Metashape: Export Cameras, Omega Phi "
            f"Kappa), or give {_BLOCKS}."
        )
    return {"kind": "orthomill" if _crs_of_block(block) is not None else "opensfm", "path": path}


def relative_to(path: Path, root: Path) -> str:
    """The path relative to the root, by a link where it lies outside: a project names only what is inside."""
    top, full = Path(os.path.abspath(root)), Path(os.path.abspath(path))
    if full.is_relative_to(top):
        return full.relative_to(top).as_posix()
    # The whole path in its name: surfaces of two folders are often called alike.
    link = top / _LINKS / f"{hashlib.sha256(str(full).encode()).hexdigest()[:8]}-{full.name}"
    link.parent.mkdir(exist_ok=True)
    if not link.is_symlink():
        link.symlink_to(full)
    return link.relative_to(top).as_posix()
