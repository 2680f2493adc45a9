"""Control in the project's reference system, and a test for wrong systems, which put points on another site.

Control far from where the photographs were taken is set aside with a finding that says in which system it would fit; positions
then define the datum.
"""

import numpy as np

from orthomill.schemas.findings.control_findings import ControlElsewhere, ControlFinding, HeightsAllZero, HeightsNotTransformed
from orthomill.schemas.observations import Control, ControlPoint, RegisteredPoints
from orthomill.schemas.photo import Photos
from orthomill.schemas.project import ANY_CRS, ControlFromGcpList, ControlFromScans
from orthomill.tasks.geometry.survey_system import fitting_system, survey_crs, transform_surveyed
from orthomill.tasks.orientation.control.absent_photographs import Rule
from orthomill.tasks.orientation.control.control_files import control_at, in_photographs, read_control
from orthomill.tasks.orientation.control.gcp_list import read_gcp_list
from orthomill.tasks.orientation.control.reduced_photographs import read_in_frame

_FAR = 10.0
"""Control is on another site when it is farther from the photographs than this multiple of their extent plus flying height."""
_LEAST_FAR = 3000.0
"""m: positions from navigation receivers and control of a whole town differ by less; wrong zones and systems by far more"""
_ENOUGH_HEIGHTS = 3
"""Points that are all at the height 0 by more than chance"""


def control_from_files(
    photos: Photos, points: str, measurements: str, own: str | None, crs: str, distances: str | None = None, absent: Rule = "skip"
) -> Control:
    """Control from CSV texts in the project's system `crs`; `own`: the system of the texts (None: the same); `absent`: whether
    measurements in photographs that the project does not have are skipped. Raises WorkflowError."""
    found, photos, of_originals = read_in_frame(
        photos, lambda frame: read_control(frame, points, measurements, distances, absent), lambda control: control
    )
    return _in_project(_with(found, of_originals), photos, own or crs, crs)


def control_from_scans(
    photos: Photos, registered: RegisteredPoints, measurements: str, source: ControlFromScans, crs: str
) -> Control:
    """Control from targets of registered scans, which are in the project's system `crs` already. Raises WorkflowError."""
    known = {}
    for i, name in enumerate(registered.name.tolist()):
        # Of the covariance of a target the block takes the standard errors of its coordinates; their correlation, mostly that of
        # the tilt of a scan, stays below a half where scans stand round an object.
        x, y, z = (float(values[i]) for values in (registered.x, registered.y, registered.z))
        sx, sy, sz = (float(values[i]) for values in (registered.sigma_x, registered.sigma_y, registered.sigma_z))
        role = "check" if name in source.check else "control"
        known[name] = ControlPoint(name=name, role=role, xyz=(x, y, z), sigma=(sx, sy, sz), measurements={})
    return _in_project(control_at(known, photos, measurements, source.absent), photos, crs, crs)


def control_from_list(photos: Photos, text: str, source: ControlFromGcpList, crs: str) -> Control:
    """Control from a GCP list in the project's system `crs`. Raises WorkflowError."""
    found, photos, of_originals = read_in_frame(photos, lambda frame: read_gcp_list(frame, text, source), lambda read: read.control)
    # Refuses an unknown system even where the list holds no surveyed point that would need it.
    survey_crs(found.crs)
    return _in_project(_with(found.control, of_originals), photos, found.crs, crs)


def _with(control: Control, findings: tuple[ControlFinding, ...]) -> Control:
    return control.model_copy(update={"findings": (*control.findings, *findings)})


def _in_project(control: Control, photos: Photos, own: str, crs: str) -> Control:
    """Coordinates in the project's system, measurements in pixels of the photographs. Points on another site become tie points if a
    distance needs them: lengths are right whatever the system."""
    placed, findings = _placed(control, photos, own, crs)
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
    return Control(points=tuple(points), distances=control.distances, findings=(*findings, *control.findings))


def _placed(
    control: Control, photos: Photos, own: str, crs: str
) -> tuple[dict[str, tuple[float, ...]], tuple[ControlFinding, ...]]:
    """Transformed coordinates of the surveyed points by name, none where they are on another site, and what was found."""
    surveyed = [point for point in control.points if point.role != "tie"]
    if not surveyed:
        return {}, ()
    given = np.array([point.xyz for point in surveyed])
    xyz, only = transform_surveyed(given, own, crs)
    elsewhere = _on_another_site(given, xyz, photos, own, crs)
    if elsewhere:
        return {}, (elsewhere,)
    placed = {point.name: tuple(map(float, place)) for point, place in zip(surveyed, xyz, strict=True)}
    found: list[ControlFinding] = [HeightsNotTransformed(crs=only)] if only else []
    if _without_heights(given, crs):
        found.append(HeightsAllZero(points=len(given)))
    return placed, tuple(found)


def _without_heights(given: np.ndarray, crs: str) -> bool:
    """Whether all points (n, 3) have the height 0, as lists have them that were made from a map."""
    # A local system may have its origin in the floor on which all targets lie; and two points may well be equally high.
    return crs != ANY_CRS and len(given) >= _ENOUGH_HEIGHTS and not given[:, 2].any()


def _on_another_site(given: np.ndarray, xyz: np.ndarray, photos: Photos, own: str, crs: str) -> ControlElsewhere | None:
    """The finding where the control is far from the positions of the photographs; None where it is not, or there are no
    positions."""
    places = np.array([photo.position for photo in photos.photos if photo.position is not None]).reshape(-1, 3)
    if not len(places):
        return None
    # Medians throughout: one position or one point with a mistyped digit must not condemn the system.
    site = np.median(places, axis=0)
    reach = float(np.linalg.norm(np.ptp(places[:, :2], axis=0))) + abs(float(np.median(places[:, 2])))
    distance = float(np.median(np.linalg.norm(xyz[:, :2] - site[:2], axis=1)))
    if distance <= max(_FAR * reach, _LEAST_FAR):
        return None
    # The report names the remedy where one of the usual mistakes explains the distance.
    fits = fitting_system(given, own, crs, site[:2])
    remedy = {"fits": fits.crs, "exchanged": fits.exchanged} if fits else {}
    return ControlElsewhere(points=len(xyz), crs=own, distance_m=distance, **remedy)
