"""Whether the marks of the control points would meet on the model of the tie points if they were counted in another way."""

from collections.abc import Iterable, Mapping

import numpy as np

from orthomill.schemas.camera import Cameras
from orthomill.schemas.findings.control_findings import MeasurementsOfOriginals, MeasurementsReduced
from orthomill.schemas.findings.observation_findings import MarksInAnotherFrame
from orthomill.schemas.observations import Control, ControlPoint
from orthomill.tasks.orientation.block.assembly import mark_scatter, model_of
from orthomill.tasks.orientation.control.ground_points import approximate_points
from orthomill.tasks.orientation.control.mark_frames import FoundFrame, explaining_frame, recounted
from orthomill.tasks.orientation.measurements import ground_rays
from orthomill.tasks.orientation.sensor_frame import Upright
from orthomill.tasks.orientation.start.block_growth import GrowthMaterial
from orthomill.tasks.orientation.start.block_start import BlockStart

LEAST_MISS = 5.0
"""px: marks that miss by less are counted as the photographs are, and are made as well as they are made"""


def counted_otherwise(
    upright: Upright, cameras: Cameras, material: GrowthMaterial, start: BlockStart, control: Control
) -> tuple[Control, MarksInAnotherFrame] | None:
    """The control with its marks counted so that their rays meet on the model of a start, and how they are counted; None where they
    meet as they were read, or in no way. `cameras`, `control`: of the sensors; lists count in the photographs or in their files."""
    number = {material.names[i]: k for k, i in enumerate(start.photos)}
    model, camera_of = model_of(start), material.camera_of[start.photos]
    constant = float(np.median([material.cameras[k].c for k in camera_of]))

    def scatter(points: list[ControlPoint]) -> float:
        rays = ground_rays([upright.sensor_point(point) for point in points], number, cameras)
        return constant * mark_scatter(rays, approximate_points(model, material.cameras, camera_of, rays, len(points)))

    listed = [upright.upright_point(point) for point in control.points]
    points = _marked_in(listed, number)
    if scatter(points) < LEAST_MISS:
        return None
    found = explaining_frame(points, upright.photos, scatter)
    if found is None:
        return None
    counted = tuple(upright.sensor_point(point) for point in recounted(listed, upright.photos, found))
    return control.model_copy(update={"points": counted}), _finding(found, control, len(points))


def _finding(found: FoundFrame, control: Control, points: int) -> MarksInAnotherFrame:
    factor = found.factor * _read_by(control)
    return MarksInAnotherFrame(
        counted=found.frame.counted,
        change=found.frame.change,
        factor=factor,
        given_px=found.given,
        found_px=found.found,
        points=points,
    )


def _read_by(control: Control) -> float:
    """By which pixels of the list were multiplied when it was read."""
    for finding in control.findings:
        if isinstance(finding, MeasurementsReduced):
            return 1.0 / finding.factor
        if isinstance(finding, MeasurementsOfOriginals):
            return finding.reduced[0] / finding.original[0]
    return 1.0


def _marked_in(points: Iterable[ControlPoint], photographs: Mapping[str, int]) -> list[ControlPoint]:
    """The surveyed points with their marks in these photographs, of those with two or more."""
    own = (
        point.model_copy(update={"measurements": {n: m for n, m in point.measurements.items() if n in photographs}})
        for point in points
        if point.role != "tie"
    )
    return [point for point in own if len(point.measurements) >= 2]
