"""A commented starting workflow, made from the EXIF tags of the photographs and from what lies beside them.

The headers of all photographs are read, no pixels. What the tags and the files beside the photographs contain is filled in (CRS,
cameras, positions, control); what they do not contain is left open with a comment that says what is needed, and the loader asks for
it in one sentence. Where nothing tells the CRS and nothing would need it, the block gets a system of its own. The stages are listed
in order with their first settings commented out, so that a newcomer sees what can be changed.
"""

import os
import re
import shlex
import statistics
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from textwrap import wrap

from orthomill.pipeline.storage.image_files import image_files, read_header, shown
from orthomill.pipeline.workflow.camera_tags import camera_name, focal_mm, longitude_latitude, utm_zone
from orthomill.pipeline.workflow.field_words import bounds, sentence, type_words, unit, variants
from orthomill.pipeline.workflow.lying_beside import NOTHING, Beside, look_beside
from orthomill.pipeline.workflow.workflow_checks import SIMULATION, kind_of
from orthomill.pipeline.workflow.workflow_text import default_text, flow
from orthomill.schemas.errors import PhotoError, StoreError, WorkflowError
from orthomill.schemas.findings.flight_findings import FirstLook
from orthomill.schemas.photo import Header
from orthomill.schemas.project import ANY_CRS, PhotoFolder, Project
from orthomill.schemas.stage_contract import Stage

SETTINGS_SHOWN = 4
"""settings of a stage that a starting workflow shows; docs/settings.md has all"""
_NOT_AT_FIRST = frozenset({SIMULATION, "evaluation"})
"""Stages that need known truth or a reference."""
_WIDTH = 120
"""characters of a line of comments"""

Look = Callable[[tuple[Header, ...], str | None], FirstLook]
"""From the headers of all photographs and the CRS, if any, to what is found in them."""


@dataclass(frozen=True)
class Survey:
    """What the headers of a folder of photographs contain, and what lies beside them."""

    folder: str
    headers: tuple[Header, ...]
    beside: Beside = NOTHING

    @cached_property
    def cameras(self) -> Counter[str]:
        """Number of photographs by the camera they name."""
        return Counter(name for header in self.headers if (name := camera_name(header)))

    @cached_property
    def focal_lengths(self) -> Counter[float]:
        """Number of photographs by focal length in mm."""
        return Counter(length for header in self.headers if (length := focal_mm(header.tags)))

    @cached_property
    def places(self) -> tuple[tuple[float, float], ...]:
        """Longitude and latitude in degrees of the photographs that have them."""
        return tuple(place for header in self.headers if (place := longitude_latitude(header.tags)))

    @property
    def utm(self) -> str | None:
        """The UTM zone of the middle of the photographs, if any of them has a position."""
        if not self.places:
            return utm_zone(*self.beside.site) if self.beside.site else None
        # The median ignores single photographs taken before the receiver had a fix, or elsewhere.
        longitudes, latitudes = zip(*self.places, strict=True)
        return utm_zone(statistics.median(longitudes), statistics.median(latitudes))

    @property
    def placeless(self) -> bool:
        """Whether nothing is known of the place of the photographs: any system in metres will do."""
        return not (self.places or self.beside.positions or self.beside.control)

    @property
    def without_focal(self) -> int:
        """Number of photographs without a focal length."""
        return len(self.headers) - self.focal_lengths.total()


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


def survey_photographs(photos: Path, root: Path) -> Survey:
    """Read the headers of all photographs of a folder. Raises WorkflowError, or PhotoError naming every unusable file."""
    return survey_folder(_inside(photos, root), root)


def survey_folder(folder: str, root: Path) -> Survey:
    """Read the headers of all photographs of a folder, which may lie outside of the root. Raises WorkflowError, or PhotoError
    naming every unusable file."""
    photos = Path(folder)
    files = image_files(root, PhotoFolder(kind="folder", path=folder))
    headers, problems = [], []
    # All files are read before anything is refused: a card with twenty damaged files is reported once, not twenty times.
    for file in files:
        try:
            headers.append(read_header(root / file))
        except PhotoError as error:
            problems.append(str(error))
    if problems:
        raise PhotoError("\n".join(problems))
    if len(headers) < 2:
        raise WorkflowError(
            f"{files[0]} is the only photograph in {shown(photos)}; heights come from overlap, so at least two "
            "photographs of the same ground are needed."
        )
    # The same way as `_inside`: a link inside of the project is no way out of it.
    top = Path(os.path.abspath(root))
    names = tuple(Path(header.path).stem for header in headers)
    return Survey(folder, tuple(headers), look_beside(top / folder, top, {(h.width, h.height) for h in headers}, names))


def _inside(photos: Path, root: Path) -> str:
    """The folder relative to the root; links are not followed, so that a link inside the project is accepted."""
    # normpath and not resolve: resolving would follow the link and lead out of the project again.
    top = Path(os.path.abspath(root))
    folder = Path(os.path.normpath(top / photos))
    if not folder.is_relative_to(top):
        link = f"ln -s {shlex.quote(str(folder))} {shlex.quote(str(top / folder.name))}"
        raise WorkflowError(
            f"The photographs in {photos} are outside the project's folder {top}; copy them into it, or create a link "
            f"there ({link}) and give --photos {folder.name}."
        )
    if not folder.is_dir():
        raise WorkflowError(f"The folder of photographs {photos} does not exist; give an existing one with --photos.")
    return folder.relative_to(top).as_posix()


def only_photographs(headers: tuple[Header, ...], crs: str | None) -> FirstLook:
    """A look that finds nothing and sets nothing aside."""
    return FirstLook(findings=(), used=tuple(header.path for header in headers))


def write_starting_workflow(
    name: str, photos: Path, root: Path, catalogue: tuple[type[Stage], ...], crs: str | None = None, look: Look = only_photographs
) -> StartingWorkflow:
    """Write workflows/<name>.yaml below `root`. `look` tells what the tags say, and which photographs make the block. Raises
    WorkflowError rather than overwrite anything."""
    _check_name(name)
    path = root / "workflows" / f"{name}.yaml"
    if path.exists():
        raise WorkflowError(f"{shown(path)} exists already and is not overwritten; choose another name or delete it.")
    survey = survey_photographs(photos, root)
    seen = _seen(look, survey, crs)
    text = starting_text(name, survey, catalogue, crs, seen)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # "x": whatever has appeared under this name since the check is not overwritten either.
        with open(path, "x", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise StoreError(f"{shown(path)} cannot be written ({error.strerror}).") from error
    return StartingWorkflow(path, survey, seen, tuple(_notes(name, survey, crs)))


def _seen(look: Look, survey: Survey, crs: str | None) -> FirstLook:
    """The look at the headers. Expected errors are those of tags alone: not said where files beside the photographs are used."""
    seen, beside = look(survey.headers, crs or survey.beside.projected or survey.utm), survey.beside
    if not (beside.control or beside.positions or beside.camera):
        return seen
    unknown = "Expected accuracy: not foreseen from tags, for the files beside the photographs are used; the run states it."
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
    stages = [stage for stage in catalogue if kind_of(stage) not in _NOT_AT_FIRST and not _asks(stage)]
    lines = [
        *_head(name, survey, look.lines if look else ()),
        *_crs(survey, crs),
        "",
        "photographs:",
        "  kind: folder",
        f"  path: {flow(survey.folder)}",
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
        "# All settings are listed in docs/settings.md.",
        "stages:",
    ]
    for stage in stages:
        lines += ["", *_stage(stage)]
    return "\n".join(lines) + "\n"


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


def _crs(survey: Survey, crs: str | None) -> Iterator[str]:
    yield ""
    yield "# A projected coordinate reference system in metres. Heights may have their own after a '+', e.g. EPSG:2100+5773."
    if crs:
        yield f"crs: {flow(crs)}"
    elif survey.beside.projected:
        yield f"crs: {flow(survey.beside.projected)}  # that of {survey.beside.control or survey.beside.positions}"
    elif survey.utm:
        yield f"crs: {flow(survey.utm)}  # the UTM zone of the positions; a national grid is possible as well"
    elif survey.placeless:
        yield f"crs: {ANY_CRS}  # stands for a local system in metres: nothing tells where the photographs were taken"
    elif survey.beside.unknown_system:
        yield f"crs:  # to be filled in, e.g. EPSG:32634: what {survey.beside.gcp_list} calls '{survey.beside.system}', or another"
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
        yield f"  kind: gcp_list  # found beside the photographs; its system: {survey.beside.system}"
        yield f"  path: {flow(survey.beside.gcp_list)}"
        if survey.beside.unknown_system:
            yield f"  crs:  # to be filled in, e.g. EPSG:32634: '{survey.beside.system}' is not known to PROJ"
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


def _notes(name: str, survey: Survey, crs: str | None) -> Iterator[str]:
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
        yield f"Fill in 'control > crs': PROJ does not know the system '{beside.system}' that {beside.gcp_list} names."
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
    if survey.places and len(survey.places) < len(survey.headers):
        missing = len(survey.headers) - len(survey.places)
        yield f"{missing} of {len(survey.headers)} photographs have no GPS position; they are oriented through their overlap."
    if survey.placeless:
        yield (
            "No photograph has a GPS position and no control was found: the block gets a local system, without scale and place on "
            "the ground. Give control points or a positions file, and their CRS, if these matter."
        )
    if len(survey.cameras) > 1:
        yield f"The photographs come from {len(survey.cameras)} cameras or image sizes; check that none is included by mistake."
    yield f"Then run: make project={name} run"
