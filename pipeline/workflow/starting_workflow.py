"""A commented starting workflow, made from the EXIF tags of the photographs and from what lies beside them.

The headers of all photographs are read, no pixels. What the tags and the files beside the photographs contain is filled in (CRS,
cameras, positions, control); what they do not contain is left open with a comment that says what is needed, and the loader asks for
it in one sentence. Where nothing tells the CRS and nothing would need it, the block gets a system of its own. The stages are listed
in order with their first settings commented out, so that a newcomer sees what can be changed.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from textwrap import wrap

from pyproj.exceptions import CRSError

from orthomill.pipeline.storage.file_names import shown
from orthomill.pipeline.workflow.camera_tags import camera_name
from orthomill.pipeline.workflow.field_words import bounds, sentence, type_words, unit, variants
from orthomill.pipeline.workflow.photograph_survey import Survey, survey_photographs
from orthomill.pipeline.workflow.workflow_checks import kind_of, unfit_map
from orthomill.pipeline.workflow.workflow_text import default_text, flow
from orthomill.schemas.errors import StoreError, WorkflowError
from orthomill.schemas.findings.flight_findings import FirstLook, PositionsBeside
from orthomill.schemas.photo import Header
from orthomill.schemas.project import ANY_CRS, PhotoFolder, Project
from orthomill.schemas.stage_contract import Stage

SETTINGS_SHOWN = 4
"""settings of a stage that a starting workflow shows; `orthomill reference` has all"""
_STRANGERS = 3
"""photographs of a camera of their own that are named"""
_WIDTH = 120
"""characters of a line of comments"""
_ELLIPSOIDAL = "+4979"
"""what makes heights above the ellipsoid part of a system on WGS 84, as PROJ reads it"""

Look = Callable[[tuple[Header, ...], str | None, PositionsBeside | None], FirstLook]
"""From the headers of all photographs, the CRS and the positions file beside them, if any, to what is found in them."""


@dataclass(frozen=True)
class StartingWorkflow:
    """The file that was written, and what the user should do next, one sentence each."""

    path: Path
    survey: Survey
    look: FirstLook
    notes: tuple[str, ...]


def _asks(stage: type[Stage]) -> bool:
    """Whether a stage has a setting without a default: what the photographs cannot answer is added by whoever wants it."""
    return any(field.is_required() for field in stage.model_fields.values())


def only_photographs(headers: tuple[Header, ...], crs: str | None, beside: PositionsBeside | None = None) -> FirstLook:
    """A look that finds nothing and sets aside what is no photograph."""
    return FirstLook(findings=(), used=tuple(header.path for header in headers if not header.unusable))


def write_starting_workflow(
    name: str, photos: Path, root: Path, catalogue: tuple[type[Stage], ...], crs: str | None = None, look: Look = only_photographs
) -> StartingWorkflow:
    """Write workflows/<name>.yaml below `root`. `look` tells what the tags say, and which photographs make the block. Raises
    WorkflowError rather than overwrite anything."""
    path = new_workflow(name, root)
    survey = survey_photographs(photos, root)
    if crs and (mistake := unfit_crs(crs, survey)):
        raise WorkflowError(mistake)
    seen = _seen(look, survey, crs)
    # What is set aside says nothing of the cameras and places of the block.
    block = replace(survey, headers=tuple(header for header in survey.headers if header.path in set(seen.used)))
    text = starting_text(name, block, catalogue, crs, seen)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # "x": whatever has appeared under this name since the check is not overwritten either.
        with open(path, "x", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise StoreError(f"{shown(path)} cannot be written ({error.strerror}).") from error
    return StartingWorkflow(path, survey, seen, tuple(_notes(block, crs)))


def new_workflow(name: str, root: Path) -> Path:
    """Where the workflow of a new project goes. Raises WorkflowError for a name that cannot be one, or is taken."""
    _check_name(name)
    path = root / "workflows" / f"{name}.yaml"
    if path.exists():
        raise WorkflowError(f"{shown(path)} exists already and is not overwritten; choose another name or delete it.")
    return path


def unfit_crs(crs: str, survey: Survey) -> str:
    """What is wrong with a system that photographs of a place cannot be measured in, "" where nothing is known to be."""
    # What is no system at all, or one in degrees, is told when the workflow is loaded.
    try:
        return unfit_map(crs, list(survey.places))
    except CRSError:
        return ""


def _seen(look: Look, survey: Survey, crs: str | None) -> FirstLook:
    """The look at the headers. Expected errors are those of the positions and of tags: not said where control or a camera beside
    the photographs are used."""
    beside = survey.beside
    positions = PositionsBeside(path=beside.positions, text=beside.positions_text) if beside.positions else None
    seen = look(survey.headers, crs or beside.projected or survey.utm, positions)
    if not (beside.control or beside.camera):
        return seen
    unknown = "Expected accuracy: not foreseen, for control or a camera beside the photographs is used; the run states it."
    told = {"bend": None, "accuracy": unknown if seen.expected.accuracy else None}
    return seen.model_copy(update={"expected": seen.expected.model_copy(update=told)})


def _check_name(name: str) -> None:
    field = Project.model_fields["project"]
    pattern = next(item.pattern for item in field.metadata if getattr(item, "pattern", None))
    if not re.match(pattern, name):
        raise WorkflowError(f"'{name}' is not a possible project name; it must be {bounds(field)[0]}.")


def starting_text(
    name: str, survey: Survey, catalogue: tuple[type[Stage], ...], crs: str | None = None, look: FirstLook | None = None
) -> str:
    """The text of a starting workflow; what a `look` found stands in its head."""
    # What is unknown is written as an empty setting: the loader then names the line, and no placeholder can be run by mistake.
    stages = [stage for stage in catalogue if stage.for_own_photographs and not _asks(stage)]
    lines = [
        *_head(name, survey, look.lines if look else ()),
        *_crs(survey, crs, look is not None and look.ellipsoidal),
        "",
        "photographs:",
        "  kind: folder",
        f"  path: {flow(survey.folder)}",
        *_folders(survey),
        *_band(look),
        *_masks(survey),
        "",
        *_cameras(survey),
        "",
        *_positions(survey),
        "",
        *_control(survey),
        "",
        *_tile(),
        "",
        "# The stages run in this order. A setting that is commented out has the value shown; remove the '#' to change it.",
        "# `orthomill reference` lists all settings.",
        "stages:",
    ]
    for stage in stages:
        lines += ["", *_stage(stage)]
    return "\n".join(lines) + "\n"


def _folders(survey: Survey) -> Iterator[str]:
    if survey.source.folders != "none":
        yield f"  folders: {survey.source.folders}  # {sentence(PhotoFolder.model_fields['folders'])}"


def _band(look: FirstLook | None) -> Iterator[str]:
    if look and look.band:
        # So that the next run, with a few photographs more, cannot choose another one.
        yield f"  band: {flow(look.band)}  # {sentence(PhotoFolder.model_fields['band'])}"


def _masks(survey: Survey) -> Iterator[str]:
    if survey.source.masks is not None:
        yield f"  masks: {flow(survey.source.masks)}  # found: black in them is not used by any stage"


def _head(name: str, survey: Survey, found: tuple[str, ...]) -> Iterator[str]:
    yield f"# Starting workflow of the project {name}, made from the EXIF tags of {len(survey.headers)} photographs."
    yield f"# Check it, then run:  make project={name} run   (or: orthomill run {name})"
    for camera, photos in survey.cameras.most_common():
        yield f"#   camera: {camera} ({photos} photographs)"
    for length, photos in survey.focal_lengths.most_common():
        yield f"#   focal length: {length:g} mm ({photos} photographs)"
    yield f"#   GPS position: {len(survey.places)} of {len(survey.headers)} photographs"
    for sentence_found in found:
        yield from wrap(sentence_found, _WIDTH, initial_indent="# ", subsequent_indent="#   ")
    yield ""
    yield f"project: {flow(name)}  # results go to runs/{name}"


def _crs(survey: Survey, crs: str | None, ellipsoidal: bool) -> Iterator[str]:
    yield ""
    yield "# A projected coordinate reference system in metres. Heights may have their own after a '+', e.g. EPSG:2100+5773."
    if crs:
        yield f"crs: {flow(crs)}"
    elif survey.beside.projected:
        yield f"crs: {flow(survey.beside.projected)}  # that of {survey.beside.control or survey.beside.positions}"
    elif survey.utm and ellipsoidal and not (survey.beside.control or survey.beside.positions):
        yield f"crs: {flow(survey.utm + _ELLIPSOIDAL)}  # the UTM zone of the positions, and their heights above the ellipsoid"
    elif survey.utm:
        yield f"crs: {flow(survey.utm)}  # the UTM zone of the positions; a national grid is possible as well"
    elif survey.placeless:
        yield f"crs: {ANY_CRS}  # stands for a local system in metres: nothing tells where the photographs were taken"
    elif survey.beside.unknown_system:
        named = (
            f"what {survey.beside.gcp_list} calls '{survey.beside.system}', or another"
            if survey.beside.system
            else "that of the site"
        )
        yield f"crs:  # to be filled in, e.g. EPSG:32634: {named}"
    else:
        yield "crs:  # to be filled in, e.g. EPSG:32634: that of the positions or of the control"


def _cameras(survey: Survey) -> Iterator[str]:
    yield "# Where the interior orientation comes from: exif, file, given or chessboards."
    yield "cameras:"
    if survey.beside.camera:
        yield "  kind: file  # an earlier calibration, found beside the photographs"
        yield f"  path: {flow(survey.beside.camera)}"
        return
    if survey.focal_lengths:
        yield "  kind: exif  # nominal values, refined by the block adjustment; a calibration from chessboards is better"
        return
    yield "  kind: exif  # no tags give a focal length: a camera constant is guessed and refined by the block; better give it:"
    longer = max(survey.headers[0].width, survey.headers[0].height)
    yield "  # kind: given"
    yield f"  # c:             # camera constant in px: focal length / sensor width * {longer}"
    yield "  # x0: 0.0        # principal point, px right of the image centre"
    yield "  # y0: 0.0        # principal point, px above the image centre"
    yield "  # k1: 0.0        # radial distortion, radius in units of c, as in OpenCV"
    yield "  # pixel_um: 4.5  # side of a pixel on the sensor, micrometres, if known"


def _positions(survey: Survey) -> Iterator[str]:
    yield "# Where the photographs were taken: exif, file (a CSV file, e.g. from RTK) or none."
    yield "positions:"
    if survey.beside.positions:
        yield f"  kind: file  # found beside the photographs: {survey.beside.positions_format}"
        yield f"  path: {flow(survey.beside.positions)}"
        yield "  # crs: EPSG:4979  # what the file is in, where it does not say so; by default the project's crs, or degrees"
        return
    if not survey.places:
        yield "  kind: none  # no photograph has GPS tags; without positions, control points must define the datum"
        return
    yield "  kind: exif"
    for name in ("sigma_plan", "sigma_height"):
        field = variants(Project.model_fields["positions"].annotation)["exif"].model_fields[name]
        yield f"  # {name}:  # {sentence(field)} [{unit(field)}]"


def _control(survey: Survey) -> Iterator[str]:
    yield "# Ground control and check points: none, or files as below (docs/guide.md describes their columns)."
    yield "control:"
    if survey.beside.gcp_list:
        yield f"  kind: gcp_list  # found beside the photographs; its system: {survey.beside.system or 'not named'}"
        yield f"  path: {flow(survey.beside.gcp_list)}"
        if survey.beside.unknown_system:
            wrong = f"'{survey.beside.system}' is not known to PROJ" if survey.beside.system else "the list names none"
            yield f"  crs:  # to be filled in, e.g. EPSG:32634: {wrong}"
        for name in ("sigma_plan", "sigma_height", "sigma_px"):
            setting = variants(Project.model_fields["control"].annotation)["gcp_list"].model_fields[name]
            yield f"  # {name}: {flow(setting.default)}  # {sentence(setting)} [{unit(setting)}]"
        return
    if survey.beside.points:
        yield f"  kind: files  # found beside the photographs: {survey.beside.control_format}"
        yield f"  points: {flow(survey.beside.points)}"
        if survey.beside.marks:
            yield f"  measurements: {flow(survey.beside.marks)}"
        yield "  # crs: EPSG:4326  # what the points are in, where the file does not say so; by default the project's crs"
        return
    yield "  kind: none"
    yield "  # kind: files"
    yield "  # points: control/points.csv"
    yield "  # measurements: control/measurements.csv"


def _tile() -> Iterator[str]:
    field = Project.model_fields["tile"]
    yield f"# tile: {field.default}  # {sentence(field)} [{unit(field)}] Smaller tiles need less memory."


def _stage(stage: type[Stage]) -> Iterator[str]:
    yield f"  - kind: {kind_of(stage)}  # {stage.title}"
    shown_fields = [(name, field) for name, field in stage.model_fields.items() if name != "kind" and not field.is_required()]
    for name, field in shown_fields[:SETTINGS_SHOWN]:
        measure = f" [{unit(field)}]" if unit(field) else ""
        choices = f" ({type_words(field.annotation)})" if variants(field.annotation) else ""
        yield f"    # {name}: {default_text(field)}  # {sentence(field)}{measure}{choices}"
    for name, field in stage.model_fields.items():
        if field.is_required():
            yield f"    {name}:  # to be filled in: {sentence(field)}"


def _fewest(survey: Survey) -> str:
    """The photographs of the cameras that have few of them, which may be of something else."""
    few = {camera for camera, count in survey.cameras.items() if count <= _STRANGERS < survey.cameras.most_common(1)[0][1]}
    names = [Path(header.path).name for header in survey.headers if camera_name(header) in few]
    return f" ({', '.join(names)} of another than most)" if 0 < len(names) <= _STRANGERS else ""


def _notes(survey: Survey, crs: str | None) -> Iterator[str]:
    beside = survey.beside
    for path, use, form in (
        (beside.control, "ground control", beside.control_format),
        (beside.positions, "positions", beside.positions_format),
        (beside.camera, "camera", ""),
    ):
        if path:
            yield f"{path} lies beside the photographs and is used for the {use}{f' ({form})' * bool(form)}."
    yield from beside.unused
    if beside.unknown_system:
        wrong = f"PROJ does not know the system '{beside.system}' that {beside.gcp_list} names"
        yield f"Fill in 'control > crs': {wrong if beside.system else f'{beside.gcp_list} names no reference system'}."
    if not (crs or survey.utm or beside.projected) and not survey.placeless:
        yield "Fill in 'crs': neither the photographs nor the files beside them tell it."
    if not survey.focal_lengths and not beside.camera:
        yield (
            "No photograph has a focal length in its EXIF tags: a camera constant is guessed and refined by the block; if it is "
            "known, give it ('cameras > c')."
        )
    elif survey.without_focal and not beside.camera:
        yield (
            f"{survey.without_focal} of {len(survey.headers)} photographs have no focal length; they are assigned the camera of "
            "the others of their size. Remove images that do not belong to the block."
        )
    if survey.places and len(survey.places) < len(survey.headers) and not beside.positions:
        missing = len(survey.headers) - len(survey.places)
        yield f"{missing} of {len(survey.headers)} photographs have no GPS position; they are oriented through their overlap."
    if survey.placeless:
        yield (
            "No photograph has a GPS position and no control was found: the block gets a local system, without scale and place on "
            "the ground. Give control points or a positions file, and their CRS, if these matter."
        )
    if len(survey.cameras) > 1:
        yield (
            f"The photographs come from {len(survey.cameras)} cameras or image sizes{_fewest(survey)}; check that none is included "
            "by mistake."
        )
