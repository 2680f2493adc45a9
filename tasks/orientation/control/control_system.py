"""Control in the project's reference system, and tests for wrong systems, which put points on another site.

Control far from where the photographs were taken is set aside with a finding that says in which system it would fit; positions
then define the datum. Where only the order of the axes is the other one, or coordinates can only be degrees, control is used so.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.findings.control_findings import (
    ControlElsewhere,
    ControlExchanged,
    ControlFinding,
    ControlInDegrees,
    HeightsNotTransformed,
)
from orthomill.schemas.observations import Control, ControlPoint, RegisteredPoints
from orthomill.schemas.photo import Photos
from orthomill.schemas.project import ANY_CRS, ControlFromFiles, ControlFromGcpList, ControlFromScans, ControlFromTargets
from orthomill.tasks.geometry.reference_system import in_area_of_use, on_earth
from orthomill.tasks.geometry.survey_system import (
    fitting_system,
    from_geocentric,
    middle_degrees,
    plan_of,
    refuse_unfit_place,
    survey_crs,
    transform_surveyed,
)
from orthomill.tasks.orientation.control.absent_photographs import Rule
from orthomill.tasks.orientation.control.coded_points import PhotoCodes, coded_points
from orthomill.tasks.orientation.control.control_datum import datum_apart
from orthomill.tasks.orientation.control.control_files import control_at, in_photographs, read_control, read_points
from orthomill.tasks.orientation.control.control_heights import (
    about_feet,
    at_the_heights_of_positions,
    with_free_heights,
    without_stand_ins,
)
from orthomill.tasks.orientation.control.control_rows import StatedControl
from orthomill.tasks.orientation.control.gcp_list import read_gcp_list
from orthomill.tasks.orientation.control.ground_distances import on_the_map
from orthomill.tasks.orientation.control.reduced_photographs import read_in_frame
from orthomill.tasks.orientation.control.written_coordinates import with_rounded_errors

_FAR = 10.0
"""Control is on another site when it is farther from the photographs than this multiple of their extent plus flying height."""
_LEAST_FAR = 3000.0
"""m: positions from navigation receivers and control of a whole town differ by less; wrong zones and systems by far more"""
_DEGREES = "EPSG:4326"


def control_from_files(
    photos: Photos,
    points: str,
    measurements: str | None,
    own: str | None,
    crs: str,
    distances: str | None = None,
    absent: Rule = "skip",
    source: ControlFromFiles | None = None,
) -> Control:
    """Control from the texts of files in the project's system `crs`; `own`: the system of the texts (None: what they name, or the
    project's); `absent`: whether measurements in photographs that the project does not have are skipped; `source`: what the
    workflow states where the files do not. Raises WorkflowError."""
    stated = stated_of(source)
    found, photos, of_originals = read_in_frame(
        photos, lambda frame: read_control(frame, points, measurements, distances, absent, stated), lambda control: control
    )
    named = own or (found.read.crs if found.read else "") or None
    return _in_project(_with(found, of_originals), photos, named, crs, source.points if source else "")


def points_from_file(photos: Photos, text: str, own: str | None, crs: str) -> Control:
    """Points of a file in the project's system `crs`, as in `control_from_files`, that are measured nowhere yet. Raises
    WorkflowError."""
    found = read_points(photos, text)
    return _in_project(found, photos, own or (found.read.crs if found.read else "") or None, crs)


def stated_of(source: ControlFromFiles | ControlFromTargets | None) -> StatedControl:
    """What the workflow states of points, and of the files that hold their marks."""
    if source is None:
        return StatedControl()
    of_points = StatedControl(
        sigma_plan=source.sigma_plan, sigma_height=source.sigma_height, check=source.check, unit=source.errors_in, crs=source.crs
    )
    if source.kind == "targets":
        return of_points
    return replace(of_points, sigma_px=source.sigma_px, corner=None if source.origin is None else source.origin == "corner")


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
    return _in_project(_with(found.control, of_originals), photos, found.crs, crs, source.path)


def control_from_targets(
    photos: Photos,
    codes: tuple[PhotoCodes, ...],
    source: ControlFromTargets,
    crs: str,
    points: str | None = None,
    distances: str | None = None,
) -> Control:
    """Control from coded targets that were found in the photographs, in the project's system `crs`; `points`, `distances`: texts of
    the files of the source. Raises WorkflowError."""
    found = coded_points(photos, codes, source, stated_of(source), points, distances)
    return _in_project(found.control, photos, source.crs or found.crs or None, crs)


def _with(control: Control, findings: tuple[ControlFinding, ...]) -> Control:
    return control.model_copy(update={"findings": (*control.findings, *findings)})


@dataclass(frozen=True)
class _PlacedControl:
    """Transformed coordinates of the surveyed points by name, none where they are on another site, the system in which they were
    read, and what was found."""

    xyz: dict[str, tuple[float, ...]]
    crs: str
    findings: tuple[ControlFinding, ...] = ()


def _in_project(control: Control, photos: Photos, own: str | None, crs: str, path: str = "") -> Control:
    """Coordinates in the project's system, measurements in pixels of the photographs, distances on its map. Points on another site
    become tie points if a distance needs them: lengths are right whatever the system. `path`: of the file, for sentences."""
    control, about_rounding = with_rounded_errors(control, own or crs, crs)
    given, stand_ins = without_stand_ins(control.points)
    control = control.model_copy(update={"points": given})
    surveyed = [point for point in control.points if point.role != "tie"]
    placed = _place(surveyed, photos, own, crs) if surveyed else _PlacedControl({}, own or crs)
    ends = {name for distance in control.distances for name in (distance.first, distance.second)}
    points = tuple(
        point.model_copy(
            update={
                "xyz": placed.xyz.get(point.name, (0.0, 0.0, 0.0)),
                "role": point.role if point.name in placed.xyz else "tie",
                "measurements": in_photographs(point.measurements, photos),
            }
        )
        for point in control.points
        if point.role == "tie" or point.name in placed.xyz or point.name in ends
    )
    points, about_heights = with_free_heights(points, photos, crs, stand_ins, path)
    read = control.read and control.read.model_copy(update={"crs": placed.crs})
    return Control(
        points=points,
        distances=on_the_map(control.distances, points, photos, crs),
        findings=(*placed.findings, *about_heights, *about_rounding, *control.findings),
        read=read,
    )


def _place(surveyed: list[ControlPoint], photos: Photos, own: str | None, crs: str) -> _PlacedControl:
    """Surveyed points in the project's system."""
    given = np.array([point.xyz for point in surveyed])
    degrees = own is None and _are_degrees(given, crs)
    given, system = from_geocentric(given, _DEGREES if degrees else own or crs)
    found: list[ControlFinding] = [ControlInDegrees(points=len(given))] if degrees else []
    if _fits_exchanged(given, system, crs, photos):
        given = given[:, [1, 0, 2]]
        found.append(ControlExchanged(points=len(given), crs=system))
    xyz, only = transform_surveyed(given, system, crs)
    if elsewhere := _on_another_site(given, xyz, photos, system, crs):
        return _PlacedControl({}, system, (elsewhere,))
    # Without photographs the points are those of products, and whoever reads them sees first that they lie elsewhere.
    if photos.photos and on_earth(crs):
        refuse_unfit_place(np.median(xyz[:, :2], axis=0), crs)
    raised = at_the_heights_of_positions(given, xyz, system, crs, photos)
    found += [raised.finding] if raised.finding else [HeightsNotTransformed(crs=only)] if only else []
    found += about_feet(raised.xyz, system, photos)
    if apart := datum_apart(surveyed, given, raised.xyz, photos, system, crs):
        found.append(apart)
    placed = {point.name: tuple(map(float, place)) for point, place in zip(surveyed, raised.xyz, strict=True)}
    return _PlacedControl(placed, system, tuple(found))


def _are_degrees(given: np.ndarray, crs: str) -> bool:
    """Whether coordinates without a system can only be degrees; those of a local system may be as small as these."""
    small = (np.abs(given[:, :2]) <= 180.0).all() and (np.abs(given[:, :2]).max(axis=0) <= 90.0).any()
    fraction = np.abs(given[:, :2] - np.round(given[:, :2])).max() > 0.0
    return bool(crs != ANY_CRS and small and fraction)


def _site(photos: Photos) -> np.ndarray | None:
    """Median position (3,) of the photographs; None without positions."""
    places = np.array([photo.position for photo in photos.photos if photo.position is not None]).reshape(-1, 3)
    # Medians throughout: one position or one point with a mistyped digit must not condemn the system.
    return np.median(places, axis=0) if len(places) else None


def _reach(photos: Photos) -> float:
    """m: how far control may be from the photographs."""
    places = np.array([photo.position for photo in photos.photos if photo.position is not None]).reshape(-1, 3)
    reach = float(np.linalg.norm(np.ptp(places[:, :2], axis=0))) + abs(float(np.median(places[:, 2])))
    return max(_FAR * reach, _LEAST_FAR)


def _fits_exchanged(given: np.ndarray, system: str, crs: str, photos: Photos) -> bool:
    """Whether points are at the photographs with their first two coordinates exchanged, and only so."""
    site = _site(photos)
    if site is None:
        own_place, other_place = (middle_degrees(given[:, order], system) for order in ([0, 1], [1, 0]))
        return crs != ANY_CRS and not in_area_of_use(own_place, crs) and in_area_of_use(other_place, crs)
    own, other = (_distance(given[:, order], system, crs, site) for order in ([0, 1, 2], [1, 0, 2]))
    return other <= _reach(photos) < own


def _distance(given: np.ndarray, system: str, crs: str, site: np.ndarray) -> float:
    """Median distance (m) in plan of points (N, 3) of a system from a site; inf where they have no place in it."""
    if survey_crs(system).is_geographic and np.abs(given[:, 1]).max() > 90.0:
        return math.inf
    flat = np.column_stack([given[:, :2], np.zeros(len(given))])
    try:
        xyz, _ = transform_surveyed(flat, plan_of(system), plan_of(crs))
    except WorkflowError:
        return math.inf
    return float(np.median(np.linalg.norm(xyz[:, :2] - site[:2], axis=1)))


def _on_another_site(given: np.ndarray, xyz: np.ndarray, photos: Photos, own: str, crs: str) -> ControlElsewhere | None:
    """The finding where the control is far from the positions of the photographs; None where it is not, or there are no
    positions."""
    site = _site(photos)
    if site is None:
        return None
    distance = float(np.median(np.linalg.norm(xyz[:, :2] - site[:2], axis=1)))
    if distance <= _reach(photos):
        return None
    # The report names the remedy where one of the usual mistakes explains the distance.
    fits = fitting_system(given, own, crs, site[:2])
    # Some kilometres off in the system that it names, it is control of another site.
    named = fits is not None and fits.crs == own and not fits.exchanged
    remedy = {"fits": fits.crs, "exchanged": fits.exchanged} if fits and not named else {}
    return ControlElsewhere(points=len(xyz), crs=own, distance_m=distance, **remedy)
