"""Control in the project's reference system, and told when it cannot be: a wrong system puts points on another site.

Control that lies far from where the photographs were taken is set aside with a sentence that says in which system it would fit; the
block is then held by the positions.
"""

import numpy as np

from orthomill.schemas.observations import Control
from orthomill.schemas.photo import Photos
from orthomill.schemas.project import ControlFromGcpList
from orthomill.tasks.geometry.survey_system import fitting_system, survey_crs, transform_surveyed
from orthomill.tasks.orientation.control.control_files import in_photographs, read_control
from orthomill.tasks.orientation.control.gcp_list import read_gcp_list

_FAR = 10.0
"""Control is on another site when it lies farther from the photographs than this many times their flying height and extent."""
_LEAST_FAR = 3000.0
"""m"""


def control_from_files(
    photos: Photos, points: str, measurements: str, own: str | None, crs: str, distances: str | None = None
) -> Control:
    """Control of CSV texts in the project's system, `own` that of the texts (None: the same). Raises WorkflowError."""
    return _in_project(read_control(photos, points, measurements, distances), photos, own or crs, crs)


def control_from_list(photos: Photos, text: str, source: ControlFromGcpList, crs: str) -> Control:
    """Control of a GCP list in the project's system. Raises WorkflowError."""
    found = read_gcp_list(photos, text, source)
    survey_crs(found.crs)
    return _in_project(found.control, photos, found.crs, crs)


def _in_project(control: Control, photos: Photos, own: str, crs: str) -> Control:
    """Coordinates in the project's system, measurements in the photographs as they are used here. Points on another site keep
    their distances and become tie points."""
    surveyed = [point for point in control.points if point.role != "tie"]
    placed, remark = {}, None
    if surveyed:
        given = np.array([point.xyz for point in surveyed])
        xyz, remark = transform_surveyed(given, own, crs)
        stranger = _on_another_site(given, xyz, photos, own, crs)
        remark = stranger or remark
        placed = {} if stranger else {point.name: tuple(map(float, place)) for point, place in zip(surveyed, xyz, strict=True)}
    ends = {name for distance in control.distances for name in (distance.first, distance.second)}
    points = (
        point.model_copy(
            update={
                "xyz": placed.get(point.name, (0.0, 0.0, 0.0)),
                "role": point.role if point.name in placed else "tie",
                "measurements": in_photographs(point.measurements, photos),
            }
        )
        for point in control.points
        if point.role == "tie" or point.name in placed or point.name in ends
    )
    return Control(points=tuple(points), distances=control.distances, remarks=(remark,) if remark else ())


def _on_another_site(given: np.ndarray, xyz: np.ndarray, photos: Photos, own: str, crs: str) -> str | None:
    """A sentence when the control lies far from the photographs' positions; None when it does not, or nothing is known."""
    places = np.array([photo.position for photo in photos.photos if photo.position is not None]).reshape(-1, 3)
    if not len(places):
        return None
    site = np.median(places, axis=0)
    reach = float(np.linalg.norm(np.ptp(places[:, :2], axis=0))) + abs(float(np.median(places[:, 2])))
    distance = float(np.median(np.linalg.norm(xyz[:, :2] - site[:2], axis=1)))
    if distance <= max(_FAR * reach, _LEAST_FAR):
        return None
    fits = fitting_system(given, own, crs, site[:2])
    advice = f"they would lie there {fits}" if fits else "check the reference system, the order of the axes and the zone"
    return (
        f"The {len(xyz)} control points, read as {own}, lie {distance / 1000:.0f} km from where the photographs were taken; "
        f"{advice}. "
        "They were set aside, and the block is held without them."
    )
