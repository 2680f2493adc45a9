"""The job that reads the control, whatever it comes from."""

from collections.abc import Callable
from typing import Any

from orthomill.schemas.job import Job, Region, TextFile
from orthomill.schemas.observations import CONTROL, REGISTERED_POINTS, Control
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.stage_contract import ProjectView
from orthomill.tasks.orientation.control.control_files import no_control
from orthomill.tasks.orientation.control.control_system import control_from_files, control_from_list, control_from_scans

Reads = dict[str, Region | tuple[Region, ...]]
_SIMULATED = ("photographs/control.csv", "photographs/measurements.csv")


def control_job(view: ProjectView) -> Job:
    source = view.project.control
    if source.kind == "none":
        return Job(stage="orientation", item="control", function=no_control, reads={}, writes={"control": CONTROL})
    if source.kind == "gcp_list":
        listed: Reads = {"photos": PHOTOS, "text": TextFile(source.path)}
        return _read_by(control_from_list, listed, {"source": source, "crs": view.project.crs})
    if source.kind == "scans":
        scanned: Reads = {"photos": PHOTOS, "registered": REGISTERED_POINTS, "measurements": TextFile(source.measurements)}
        return _read_by(control_from_scans, scanned, {"source": source, "crs": view.project.crs})
    if source.kind == "simulated":
        points, measurements = map(view.run_file, _SIMULATED)
        return _read_by(control_from_files, _control_texts(points, measurements), {"own": None, "crs": view.project.crs})
    reads: Reads = {"photos": PHOTOS, "points": TextFile(source.points)}
    stated: dict[str, Any] = {"own": source.crs, "crs": view.project.crs, "absent": source.absent, "source": source}
    if source.measurements:
        reads["measurements"] = TextFile(source.measurements)
    else:
        stated["measurements"] = None
    # Optional in the project, and then a parameter of the function with a default.
    if source.distances:
        reads["distances"] = TextFile(source.distances)
    return _read_by(control_from_files, reads, stated)


def _control_texts(points: str, measurements: str) -> Reads:
    return {"photos": PHOTOS, "points": TextFile(points), "measurements": TextFile(measurements)}


def _read_by(function: Callable[..., Control], reads: Reads, params: dict[str, Any]) -> Job:
    return Job(stage="orientation", item="control", function=function, reads=reads, writes={"control": CONTROL}, params=params)
