"""The job that reads the control, whatever it comes from."""

from collections.abc import Callable, Iterator
from typing import Any

from orthomill.schemas.job import Job, Raster, Region, Stream, Table, TextFile
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.observations import CONTROL, REGISTERED_POINTS, Control
from orthomill.schemas.photo import PHOTOS, photo_raster
from orthomill.schemas.project import (
    ControlFromFiles,
    ControlFromGcpList,
    ControlFromScans,
    ControlFromTargets,
    NoControl,
    SimulatedControl,
)
from orthomill.schemas.stage_contract import ProjectView
from orthomill.tasks.orientation.control.coded_points import PhotoCodes, codes_in_photograph, search_windows
from orthomill.tasks.orientation.control.control_files import no_control
from orthomill.tasks.orientation.control.control_system import (
    control_from_files,
    control_from_list,
    control_from_scans,
    control_from_targets,
)

Reads = dict[str, Region | tuple[Region, ...]]
_OfFiles = ControlFromFiles | ControlFromGcpList | ControlFromScans | NoControl | SimulatedControl
_PER_SEARCHED = 24
"""bytes a pixel of what a search for codes holds: grey values, and their thresholds at several window sizes"""
_SIMULATED = ("photographs/control.csv", "photographs/measurements.csv")


def control_jobs(view: ProjectView) -> Iterator[Job]:
    """The job that reads the control, and before it those that look for targets in the photographs."""
    source = view.project.control
    if source.kind == "targets":
        yield from _target_jobs(view, source)
    else:
        yield _file_job(view, source)


def _target_jobs(view: ProjectView, source: ControlFromTargets) -> Iterator[Job]:
    photos = view.table(PHOTOS).photos
    for photo in photos:
        windows = search_windows(photo.height, photo.width)
        yield Job(
            stage="orientation",
            item=f"{photo.name} targets",
            function=codes_in_photograph,
            reads={"parts": Stream(tuple(Raster(photo_raster(photo.name), window) for window in windows))},
            writes={"codes": _codes(photo.name)},
            params={"photo": photo.name, "windows": windows},
            scratch=max(array_bytes(_PER_SEARCHED, window) for window in windows),
        )
    reads: Reads = {"photos": PHOTOS, "codes": tuple(_codes(photo.name) for photo in photos)}
    reads |= {name: TextFile(path) for name in ("points", "distances") if (path := getattr(source, name))}
    yield _read_by(control_from_targets, reads, {"source": source, "crs": view.project.crs})


def _codes(photo: str) -> Table[PhotoCodes]:
    """The table that holds the codes of a photograph."""
    return Table(f"orientation/codes/{photo}.json", PhotoCodes)


def _file_job(view: ProjectView, source: _OfFiles) -> Job:
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
