"""The oriented block for another program: its files by their paths, the undistorted photographs one at a time."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.observations import Control, GroundPoints, ImageResiduals
from orthomill.schemas.orientation import Block
from orthomill.schemas.photo import Photos
from orthomill.tasks.imagery.undistorted import undistorted_photograph
from orthomill.tasks.orientation.interchange.colmap_project import colmap_project
from orthomill.tasks.orientation.interchange.metashape_cameras import metashape_cameras
from orthomill.tasks.orientation.interchange.odm_files import odm_files
from orthomill.tasks.orientation.interchange.openmvs_scene import openmvs_scene
from orthomill.tasks.orientation.interchange.pinhole_model import file_of, origin_of, pinhole_model
from orthomill.tasks.orientation.interchange.pix4d_params import pix4d_params
from orthomill.tasks.orientation.results.products import outgoing

UNDISTORTED = ("colmap", "openmvs")
"""programs that get photographs without distortion beside the texts"""


@dataclass(frozen=True, eq=False)
class OrientedProject:
    """What is known of the photographs of a project; of a block on a plane, in the system of the survey."""

    name: str
    photos: Photos
    block: Block
    points: GroundPoints
    rays: ImageResiduals
    control: Control


def handed_files(
    project: OrientedProject, program: str, suffix: str, read: Callable[[str], np.ndarray]
) -> Iterator[tuple[str, bytes | np.ndarray]]:
    """Paths with their content, or with the pixels (rows, cols, bands) of an undistorted photograph whose file ends on `suffix`.

    `read` gives the pixels of a photograph, upright. Raises WorkflowError for what the program cannot hold.
    """
    yield from _texts(project, program, suffix).items()
    if program in UNDISTORTED:
        for name in project.block.names:
            yield f"images/{file_of(name, suffix)}", undistorted_photograph(read(name), project.block.camera_of(name))


def _texts(project: OrientedProject, program: str, suffix: str) -> dict[str, bytes]:
    if program in UNDISTORTED:
        model = pinhole_model(project.photos, project.block, project.points, project.rays)
        if program == "colmap":
            return colmap_project(model, suffix, project.block.crs)
        return {"scene.mvs": openmvs_scene(model, suffix)}
    block, crs = outgoing(project.photos, project.block, project.points), project.block.crs
    files = {name: project.photos[name].path.rpartition("/")[2] for name in project.block.names}
    if program == "odm":
        return odm_files(block, files, project.control, project.photos, crs)
    if program == "metashape":
        return {"cameras.xml": metashape_cameras(block, files, crs).encode()}
    return pix4d_params(block, files, origin_of(project.block), project.name)
