"""The workflow of a calibration alone: photographs of chessboards, one stage, no project around it.

It is made from the command line and never was a file; the run writes it beside its results like any other, so that it can be run
again.
"""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from orthomill.pipeline.storage.image_files import image_files, is_image_name, shown
from orthomill.pipeline.workflow.workflow_checks import kind_of
from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow
from orthomill.pipeline.workflow.workflow_text import workflow_text
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.project import CameraFromChessboards, PhotoFolder, PhotoList, Project
from orthomill.schemas.stage_contract import Stage

_STAGE = "calibration"
_NO_PLACE = "EPSG:3857"
"""A workflow needs a system of coordinates; boards have none, and nothing of a calibration hangs on it."""


@dataclass(frozen=True)
class BoardsSaid:
    """What the command line says of the boards."""

    corners: str
    square: float
    boards: int
    arrangement: str
    parameters: str


def calibration_workflow(
    name: str, photos: Sequence[Path], said: BoardsSaid, root: Path, catalogue: tuple[type[Stage], ...]
) -> LoadedWorkflow:
    """The workflow of a calibration with results in runs/<name> below `root`. Raises WorkflowError in one sentence."""
    files = PhotoList(kind="list", paths=_files(photos, root))
    stage_type = next(stage for stage in catalogue if kind_of(stage) == _STAGE)
    try:
        cameras = CameraFromChessboards(
            kind="chessboards", photographs=files, corners=_corners(said.corners), square=said.square, boards=said.boards,
            arrangement=said.arrangement,
        )  # fmt: skip
        project = Project(project=name, crs=_NO_PLACE, photographs=files, cameras=cameras)
        stage = stage_type(parameters=tuple(part.strip() for part in said.parameters.split(",") if part.strip()))
    except ValidationError as error:
        raise WorkflowError("; ".join(_mistake(detail) for detail in error.errors()) + ".") from error
    return LoadedWorkflow(project, (stage,), root / f"{name}.yaml", root, workflow_text(project, (stage,)))


def _mistake(detail: dict) -> str:
    option = str(detail["loc"][0]) if detail["loc"] else "the calibration"
    return f"--{'name' if option == 'project' else option}: {detail['msg']} (found: {detail['input']})"


def _files(photos: Sequence[Path], root: Path) -> tuple[str, ...]:
    """Image files, and all images of folders, relative to `root`."""
    files: list[str] = []
    for path in photos:
        relative = Path(os.path.relpath(path, root)).as_posix()
        if path.is_dir():
            files += image_files(root, PhotoFolder(kind="folder", path=relative))
        elif not path.is_file():
            raise WorkflowError(f"There is no photograph {shown(path)}; correct the path.")
        elif not is_image_name(path.name):
            raise WorkflowError(f"{shown(path)} is no JPEG, TIFF or PNG image; leave it out.")
        else:
            files.append(relative)
    return tuple(dict.fromkeys(files))


def _corners(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"\s*(\d+)\s*[x×,]\s*(\d+)\s*", text)
    if not found:
        raise WorkflowError(f"--corners is columns x rows of inner corners, such as 5x6, and not '{text}'.")
    return int(found[1]), int(found[2])
