"""Listed positions in the project's system: which system they are in, the order of their axes, heights, attitudes.

Degrees are recognised by their numbers and never read as metres; exchanged axes by the tags of the photographs, or by the area that
the project's system is for. Heights follow the same rules as those of control.
"""

import math
from dataclasses import dataclass

import numpy as np
from pyproj import CRS, Transformer

from orthomill.schemas.errors import WorkflowError, first_of, some_of
from orthomill.schemas.findings.position_findings import HeightsOfPositions, ToldBy
from orthomill.schemas.maps.map_scale import map_scale
from orthomill.schemas.photo import Photo
from orthomill.schemas.project import ANY_CRS
from orthomill.schemas.survey_files.written_numbers import STAND_INS
from orthomill.tasks.geometry.coordinate_ranges import height_mistake
from orthomill.tasks.geometry.reference_system import ground_crs, in_area_of_use
from orthomill.tasks.geometry.survey_system import (
    are_geocentric,
    ellipsoidal,
    from_geocentric,
    middle_degrees,
    survey_crs,
    transform_surveyed,
    vertical_name,
)
from orthomill.tasks.photos.position_files.against_tags import NOTHING_TO_COMPARE, OffTags, off_tags
from orthomill.tasks.photos.position_files.attitude_conventions import from_yaw_pitch_roll, is_line_of_sight
from orthomill.tasks.photos.position_files.listed_positions import ListedPosition, PositionList, Triple

_FAR, _NEAR = 0.2, 0.02
"""degrees between positions and the tags of the photographs: axes that are exchanged are farther, those in order nearer"""


@dataclass(frozen=True)
class PlacedPositions:
    """The positions in the project's system by the order of the list, the system that they were read in, what told it, whether
    their axes were exchanged, what was done with their heights, whether they were written in degrees, which of them have the height
    of their tags, and by how much they are off these."""

    xyz: np.ndarray
    crs: str
    by: ToldBy
    exchanged: bool
    heights: HeightsOfPositions
    in_degrees: bool = False
    without_height: tuple[bool, ...] = ()
    off_tags: OffTags = NOTHING_TO_COMPARE

    @property
    def above_ellipsoid(self) -> bool:
        """Whether the placed heights are above the ellipsoid."""
        return self.heights.target is None and (self.heights.system or "").startswith("ellipsoid")


def place(listed: PositionList, stated: str | None, crs: str, photos: list[Photo]) -> PlacedPositions:
    """The positions in the project's system `crs`; `stated`: the system that the workflow names.

    Raises WorkflowError where the system is unknown, the place is not one of the project's, or a grid for heights is missing.
    """
    points = np.array([one.xyz for one in listed.positions], float)
    # Numbers that programs write where they know no height.
    points[np.isin(points[:, 2], list(STAND_INS)), 2] = np.nan
    system, by = _system(listed, points, stated, crs)
    _known(system)
    in_degrees = _known(system).is_geographic
    points, system = from_geocentric(points, system)
    _check_heights(listed, points)
    geographic = _known(system).is_geographic
    if listed.order_of_system and geographic:
        points = points[:, [1, 0, 2]]
    exchanged = _exchanged(points, system, crs, photos)
    points = points[:, [1, 0, 2]] if exchanged else points
    missing = _missing_heights(points, crs)
    points = _with_tag_heights(listed, points, missing, photos)
    xyz, _ = transform_surveyed(points, system, crs)
    off = NOTHING_TO_COMPARE if crs == ANY_CRS else off_tags(xyz, *_tags_of(listed, photos, crs), system)
    return PlacedPositions(
        xyz=xyz,
        crs=system,
        by=by,
        exchanged=exchanged,
        heights=heights_of(system, crs, len(points)),
        in_degrees=in_degrees,
        without_height=tuple(missing.tolist()),
        off_tags=off,
    )


def _missing_heights(points: np.ndarray, crs: str) -> np.ndarray:
    """Which points (N, 3) have no height: no flight keeps to exactly 0 m, but tables without heights do."""
    nothing = len(points) > 1 and crs != ANY_CRS and not points[:, 2].any()
    return np.isnan(points[:, 2]) | nothing


def _tags_of(listed: PositionList, photos: list[Photo], crs: str) -> tuple[list[Photo], np.ndarray]:
    """The photographs of the positions, and the places (N, 2) of their tags on the map; NaN without tags."""
    of_name = {photo.name: photo for photo in photos}
    own = [of_name[one.name] for one in listed.positions]
    degrees = np.array([(photo.longitude, photo.latitude) for photo in own], float)
    to_map = Transformer.from_crs(CRS.from_epsg(4326), ground_crs(crs), always_xy=True)
    tags = np.column_stack(to_map.transform(degrees[:, 0], degrees[:, 1]))
    return own, np.where(np.isfinite(tags), tags, np.nan)


def _check_heights(listed: PositionList, points: np.ndarray) -> None:
    """Raises WorkflowError for heights that no camera has."""
    mistakes = [
        f"Line {one.line} of the positions file is wrong: z {mistake}."
        for one, z in zip(listed.positions, points[:, 2].tolist(), strict=True)
        if not math.isnan(z) and (mistake := height_mistake(z))
    ]
    if mistakes:
        raise WorkflowError(first_of(mistakes))


def heights_of(system: str, crs: str, count: int) -> HeightsOfPositions:
    """What becomes of the heights of `count` positions of a system in the project's."""
    own, target = vertical_name(system), vertical_name(crs)
    transformed = count if own and target and not survey_crs(system).equals(CRS.from_user_input(crs)) else 0
    return HeightsOfPositions(system=own, target=target, transformed=transformed, unknown=0 if own else count)


def _known(system: str) -> CRS:
    try:
        return survey_crs(system)
    except WorkflowError:
        raise WorkflowError(
            f"The reference system '{system[:60]}' of the positions is not known to PROJ; name it in the workflow (positions > "
            "crs) like EPSG:4979, EPSG:32634 or EPSG:2100+5773."
        ) from None


def _system(listed: PositionList, points: np.ndarray, stated: str | None, crs: str) -> tuple[str, ToldBy]:
    """The system of a list, and what tells it."""
    if stated:
        _known(stated)
        return stated, "workflow"
    above = ellipsoidal if listed.heights == "ellipsoidal" else str
    if not listed.crs and crs != ANY_CRS and are_geocentric(points):
        return "EPSG:4978", "geocentric"
    if listed.crs:
        return above(listed.crs) if vertical_name_of(listed.crs) is None else listed.crs, "file"
    # A local system has its origin among the photographs; one on the Earth has none within 180 m of any site.
    if listed.degrees or (crs != ANY_CRS and _are_degrees(points)):
        return above("EPSG:4326"), "degrees"
    return above(crs) if vertical_name(crs) is None else crs, "project"


def vertical_name_of(system: str) -> str | None:
    """The vertical datum of the system that a positions file names. Raises WorkflowError."""
    _known(system)
    return vertical_name(system)


def _are_degrees(points: np.ndarray) -> bool:
    return bool((np.abs(points[:, :2]) <= 180.0).all() and (np.abs(points[:, :2]).min(axis=0) <= 90.0).any())


def _exchanged(points: np.ndarray, system: str, crs: str, photos: list[Photo]) -> bool:
    """Whether the northing comes first. Raises WorkflowError where neither order is where the project's system is for."""
    if crs == ANY_CRS:
        return False
    site = _site_of_tags(photos)
    own, other = (middle_degrees(points[:, order], system) for order in ([0, 1], [1, 0]))
    if site is not None:
        far, near = _apart(own, site), _apart(other, site)
        return far > _FAR and near < _NEAR
    if in_area_of_use(own, crs):
        return False
    if in_area_of_use(other, crs):
        return True
    where = "nowhere" if own is None else f"at longitude {own[0]:.4f}, latitude {own[1]:.4f}"
    raise WorkflowError(
        f"The positions file, read as {system[:60]}, puts the photographs {where}, which the project's crs {crs} is not for; state "
        "what the coordinates are in (positions > crs), or give the crs of the site."
    )


def _site_of_tags(photos: list[Photo]) -> np.ndarray | None:
    """Median longitude and latitude (2,) of the tags; None without them."""
    places = [(photo.longitude, photo.latitude) for photo in photos if photo.longitude is not None and photo.latitude is not None]
    return np.median(np.array(places, float), axis=0) if places else None


def _apart(place: np.ndarray | None, site: np.ndarray) -> float:
    return float(np.abs(place - site).max()) if place is not None else math.inf


def _with_tag_heights(listed: PositionList, points: np.ndarray, missing: np.ndarray, photos: list[Photo]) -> np.ndarray:
    """Points (N, 3) with the heights of the tags where the list has none. Raises WorkflowError where there are neither."""
    if not missing.any():
        return points
    of_name = {photo.name: photo.altitude for photo in photos}
    heights = np.array([of_name.get(one.name) or math.nan for one in listed.positions])
    filled = np.where(missing, heights, points[:, 2])
    if np.isnan(filled).any():
        names = [one.name or str(one.line) for one, value in zip(listed.positions, filled, strict=True) if math.isnan(value)]
        raise WorkflowError(
            f"The positions file gives no height for {some_of(names)}, and the GPS tags have none; add heights, or take these "
            "lines out."
        )
    return np.column_stack([points[:, :2], filled])


def attitudes(listed: PositionList, placed: PlacedPositions, crs: str) -> tuple[Triple | None, ...]:
    """omega, phi, kappa (degrees) of the positions that have angles."""
    turns = [one.yaw_pitch_roll for one in listed.positions if one.yaw_pitch_roll]
    lift = 90.0 if is_line_of_sight([turn[1] for turn in turns]) else 0.0
    # senseFly's files count the roll the other way round.
    roll = -1.0 if listed.format.startswith("senseFly") else 1.0
    north = _north(placed, crs) if turns else 0.0
    return tuple(one.omega_phi_kappa or _turned(one, lift, roll, north) for one in listed.positions)


def _turned(one: ListedPosition, lift: float, roll: float, north: float) -> Triple | None:
    if one.yaw_pitch_roll is None:
        return None
    yaw, pitch, own = one.yaw_pitch_roll
    return from_yaw_pitch_roll(yaw, pitch + lift, roll * own, north)


def _north(placed: PlacedPositions, crs: str) -> float:
    """The direction of north on the map of the project, degrees."""
    if crs == ANY_CRS:
        return 0.0
    ground = ground_crs(crs)
    to_degrees = Transformer.from_crs(ground, CRS.from_epsg(4326), always_xy=True)
    return map_scale(ground, *to_degrees.transform(*np.median(placed.xyz[:, :2], axis=0))).north
