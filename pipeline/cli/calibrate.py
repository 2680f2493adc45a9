"""The workflow of a calibration alone: photographs of chessboards, one stage, no other project data.

It is made from the command line rather than read from a file; the run writes it next to its results like any other workflow, so
that it can be run again.
"""

import json
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError
from pydantic_core import ErrorDetails
from rich.table import Table as Lines

from orthomill.pipeline.cli.terminal import out
from orthomill.pipeline.storage.file_names import shown
from orthomill.pipeline.storage.photographs.file_kinds import is_image_name
from orthomill.pipeline.storage.photographs.folder_listing import image_files
from orthomill.pipeline.workflow.workflow_checks import kind_of
from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow
from orthomill.pipeline.workflow.workflow_text import workflow_text
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.project import ANY_CRS, CameraFromChessboards, PhotoFolder, PhotoList, Project
from orthomill.schemas.stage_contract import Stage

_STAGE = "calibration"


@dataclass(frozen=True)
class BoardOptions:
    """What the command line says about the boards, still as text where it is parsed here."""

    corners: str
    square: float
    boards: int
    arrangement: str
    parameters: str


def calibration_workflow(
    name: str, photos: Sequence[Path], options: BoardOptions, root: Path, catalogue: tuple[type[Stage], ...]
) -> LoadedWorkflow:
    """The workflow of a calibration with results in runs/<name> below `root`. Raises WorkflowError with one sentence."""
    files = PhotoList(kind="list", paths=_files(photos, root))
    stage_type = next(stage for stage in catalogue if kind_of(stage) == _STAGE)
    try:
        cameras = _cameras(files, options)
        project = Project(project=name, crs=ANY_CRS, photographs=files, cameras=cameras)
        parameters = tuple(part.strip() for part in options.parameters.split(",") if part.strip())
        stage = stage_type.model_validate({"parameters": parameters})
    except ValidationError as error:
        raise WorkflowError("; ".join(_mistake(detail) for detail in error.errors()) + ".") from error
    return LoadedWorkflow(project, (stage,), root / f"{name}.yaml", root, workflow_text(project, (stage,)))


def _cameras(files: PhotoList, options: BoardOptions) -> CameraFromChessboards:
    settings = {
        "kind": "chessboards",
        "photographs": files,
        "corners": _corners(options.corners),
        "square": options.square,
        "boards": options.boards,
        "arrangement": options.arrangement,
    }
    return CameraFromChessboards.model_validate(settings)


def _mistake(detail: ErrorDetails) -> str:
    # The options have the names of the settings, except for the name of the project, which is called --name here.
    option = str(detail["loc"][0]) if detail["loc"] else "the calibration"
    return f"--{'name' if option == 'project' else option}: {detail['msg']} (found: {detail['input']})"


def _files(photos: Sequence[Path], root: Path) -> tuple[str, ...]:
    """Image files, and all images of folders, relative to `root`."""
    files: list[str] = []
    # relpath and not relative_to: boards may be photographed into a folder outside the current one.
    for path in photos:
        relative = Path(os.path.relpath(path, root)).as_posix()
        if path.is_dir():
            files += image_files(root, PhotoFolder(kind="folder", path=relative))
        elif not path.is_file():
            raise WorkflowError(f"There is no photograph {shown(path)}; correct the path.")
        elif not is_image_name(path.name):
            raise WorkflowError(f"{shown(path)} is not a JPEG, TIFF or PNG image; leave it out.")
        else:
            files.append(relative)
    # A photograph may be given both alone and in a folder; its corners must not be counted as two observations.
    return tuple(dict.fromkeys(files))


def _corners(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"\s*(\d+)\s*[x×,]\s*(\d+)\s*", text)
    if not found:
        raise WorkflowError(f"--corners is '{text}'; write columns x rows of inner corners, such as 5x6.")
    return int(found[1]), int(found[2])


def print_calibration(folder: Path) -> None:
    """Print the parameters with their standard errors, if the run got that far."""
    path = folder / "products" / "calibration.json"
    if not path.exists():
        return
    record = json.loads(path.read_text())
    lines = Lines("parameter", "value", "standard error", box=None)
    for number, (name, value) in enumerate(zip(record["parameters"], record["values"], strict=True)):
        sigma = record["covariance"][number][number] ** 0.5
        if sigma > 0:  # 0: the parameter was not estimated
            lines.add_row(name, f"{value:.7g}", f"{sigma:.2g}")
    out.print(lines)
    held_out = "" if record["held_out"] is None else f", held out {record['held_out']:.3f} px RMS"
    out.print(f"sigma0 {record['sigma0']:.3f} px{held_out}, {record['redundancy']} redundant observations")
