"""Points to be marked: from a list of coordinates, or from control that has its measurements already."""

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.marks import Mark, MarkedPoint, Marks
from orthomill.schemas.observations import Control, ControlPoint
from orthomill.schemas.photo import Photos
from orthomill.tasks.orientation.control.control_system import points_from_file


def given_points(photos: Photos, text: str, own: str | None, crs: str) -> Marks:
    """The points of a file (CSV or what other programs write) in the project's system `crs`; `own`: their system, None for the one
    that the file names, or the project's. Raises WorkflowError."""
    control = points_from_file(photos, text, own, crs)
    if not control.points:
        raise WorkflowError(
            f"All points of the file are far from the photographs, read in {own or (control.read and control.read.crs) or crs}; "
            f"state their reference system: --crs EPSG:..."
        )
    return marks_of(control)


def marks_of(control: Control) -> Marks:
    """Control with its measurements as marks, and distances as they were measured: the map's scale comes in when marks are read."""
    return Marks(points=tuple(map(_marked, control.points)), distances=tuple(one.on_ground for one in control.distances))


def _marked(point: ControlPoint) -> MarkedPoint:
    marks = {
        photo: Mark(col=col, row=row, sigma=min(sigma, 100.0), by="file") for photo, (col, row, sigma) in point.measurements.items()
    }
    if point.role == "tie":
        return MarkedPoint(name=point.name, role="tie", marks=marks)
    return MarkedPoint(name=point.name, role=point.role, xyz=point.xyz, sigma=point.sigma, marks=marks)
