"""Surveyed points transformed from their own reference system to the project's, heights included where both define them.

Where only one of the two systems has a vertical datum, heights keep their values, because their relation is unknown; the caller is
told. Where both have one, PROJ needs the grid of the geoid: without it the heights would silently be wrong by tens of metres.
"""

from itertools import product
from typing import NamedTuple

import numpy as np
from pyproj import CRS, Transformer
from pyproj.aoi import AreaOfInterest
from pyproj.crs import GeographicCRS
from pyproj.database import query_crs_info
from pyproj.enums import PJType
from pyproj.exceptions import CRSError, ProjError
from pyproj.transformer import TransformerGroup

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.maps.geoid_grids import how_to_get, leaves_heights, missing_grids, with_grids_of_the_system
from orthomill.schemas.maps.map_scale import is_unfit, map_scale, unfit_sentence
from orthomill.schemas.maps.system_names import known_crs
from orthomill.tasks.geometry.reference_system import ground_crs
from orthomill.tasks.geometry.topocentric import degrees_of

_ZONES_IN_FRONT = ("EPSG:5651", "EPSG:4647", "EPSG:5650")
"""ETRS89 / UTM zones 31 to 33 with the zone before the easting, as German offices write it"""
_REGION = 5_000.0
"""square degrees: systems of a larger area are those of the whole Earth or of a continent's statistics"""
_LONG = 60
"""letters of the name of a system, beyond which it is its whole definition"""
_NEIGHBOURHOOD = 0.01  # degrees
_RADIUS, _SURFACE, _HIGHEST = 6_368_000.0, 40_000.0, 100_000.0
"""m: the Earth, how far from it its ellipsoid and the flights above it are, and a height that is none"""
_NEAR = 20_000.0
"""m: points within this distance of the photographs belong to the same site; zones, systems and axes in error are farther off"""


def survey_crs(text: str) -> CRS:
    """The reference system of surveyed points: anything known to PROJ, geographic or in feet as well. Raises WorkflowError."""
    known = known_crs(text)
    # Vertical and temporal systems are systems as well, but none of points.
    plane = known.sub_crs_list[0] if known is not None and known.is_compound else known
    if (
        known is None
        or plane is None
        or not (plane.is_geographic or plane.is_projected or plane.is_geocentric or plane.is_engineering)
    ):
        raise WorkflowError(
            f"The reference system '{text[:_LONG]}' of the control points is not known to PROJ; name it in the workflow (control > "
            "crs) or in their file like EPSG:32634, EPSG:4326, EPSG:2100+5773 or as a PROJ string."
        )
    return known


def from_geocentric(points: np.ndarray, system: str) -> tuple[np.ndarray, str]:
    """Points (N, 3) of a geocentric system as longitude, latitude and height above the ellipsoid of its datum, and that system;
    those of others as they are."""
    known = survey_crs(system)
    if not known.is_geocentric:
        return points, system
    geographic = ellipsoidal("EPSG:4326")
    if not known.equals(CRS.from_epsg(4978)):
        geographic = ellipsoidal(str(GeographicCRS(name=known.name, datum=known.datum).to_wkt()))
    to_degrees = Transformer.from_crs(known, geographic, always_xy=True)
    return np.column_stack(to_degrees.transform(*points.T)), geographic


def are_geocentric(points: np.ndarray) -> bool:
    """Whether coordinates (N, 3) can only be those of a geocentric system: no map has points 6400 km from its origin in space, but
    near the surface of the Earth."""
    away = np.linalg.norm(points[:, :3], axis=1)
    return bool(len(points) and (np.abs(away - _RADIUS) < _SURFACE).all() and np.abs(points[:, 2]).min() > _HIGHEST)


def vertical_name(text: str) -> str | None:
    """The vertical datum of a reference system; None when it has none."""
    crs = survey_crs(text)
    if crs.is_compound:
        return crs.sub_crs_list[1].name
    # A geographic or projected system with three axes has ellipsoidal heights.
    base = crs.geodetic_crs
    return f"ellipsoid of {base.name}" if base is not None and len(crs.axis_info) == 3 else None


def system_name(text: str) -> str:
    """A reference system as people call it, its heights, and its code; the text itself where PROJ does not know it."""
    try:
        crs = CRS.from_user_input(text)
    except CRSError:
        return text
    if crs.is_compound:
        plan, heights = (part.name for part in crs.sub_crs_list[:2])
        name = f"{plan}, heights: {heights}"
    else:
        name = f"{crs.name}, heights above the ellipsoid" if crs.is_projected and len(crs.axis_info) == 3 else crs.name
    return f"{name} ({text})" if len(text) < _LONG else name


def height_unit(text: str) -> float:
    """The length (m) of the unit of heights in a reference system: that of its vertical part, or else that of its plan."""
    crs = survey_crs(text)
    axes = crs.sub_crs_list[1].axis_info if crs.is_compound else crs.axis_info[2:]
    # Lists in feet have feet throughout; degrees say nothing of heights.
    axes = axes or ([] if crs.is_geographic else _plane(crs).axis_info)
    return float(axes[0].unit_conversion_factor) if axes else 1.0


def plan_of(text: str) -> str:
    """The horizontal part of a system, whose coordinates need no grid of a geoid."""
    return str(_plane(survey_crs(text)).to_wkt())


def ellipsoidal(text: str) -> str:
    """A system in plan with heights above its ellipsoid: EPSG:4979 for EPSG:4326."""
    crs = survey_crs(text)
    return "EPSG:4979" if crs.equals(CRS.from_epsg(4326)) else str(_plane(crs).to_3d().to_wkt())


def transform_surveyed(points: np.ndarray, source: str, target: str) -> tuple[np.ndarray, str | None]:
    """Points (N, 3), east or longitude first, from one system to the other, heights in metres (NaN: unknown); and, where heights
    kept their reference because only one of the systems has a vertical datum, the name of that system.

    Raises WorkflowError when a grid that the heights need is not installed, or a point cannot be transformed.
    """
    start, end = survey_crs(source), CRS.from_user_input(target)
    heights = (vertical_name(source), vertical_name(target))
    if start.equals(end):
        return points, None
    unknown = np.isnan(points[:, 2])
    if all(heights):
        # A height of the neighbourhood: PROJ returns nothing for points without one.
        stand_in = float(np.median(points[~unknown, 2])) if not unknown.all() else 0.0
        out = _with_heights(np.column_stack([points[:, :2], np.where(unknown, stand_in, points[:, 2])]), start, end, source, target)
        return np.column_stack([out[:, :2], np.where(unknown, np.nan, out[:, 2])]), None
    transformer = Transformer.from_crs(_plane(start), ground_crs(target), always_xy=True)
    x, y = transformer.transform(points[:, 0], points[:, 1])
    out = np.column_stack([x, y, points[:, 2] * height_unit(source)])
    _check_finite(out[:, :2], source, target)
    return out, source if heights[0] else target if heights[1] else None


def middle_degrees(xy: np.ndarray, system: str) -> np.ndarray | None:
    """Longitude and latitude (2,) of the median of points (N, 2) of a system, east or longitude first; None where it has
    no place."""
    middle, start = np.median(xy, axis=0), survey_crs(system)
    if start.is_geographic and not (abs(middle[0]) <= 180.0 and abs(middle[1]) <= 90.0):
        return None
    try:
        degrees = Transformer.from_crs(_plane(start), CRS.from_epsg(4326), always_xy=True).transform(*middle)
    except ProjError:
        return None
    return np.array(degrees) if np.isfinite(degrees).all() else None


def _plane(crs: CRS) -> CRS:
    """The horizontal part of a reference system."""
    return crs.sub_crs_list[0] if crs.is_compound else crs.to_2d()


def _with_heights(points: np.ndarray, start: CRS, end: CRS, source: str, target: str) -> np.ndarray:
    """Points (N, 3) transformed in all three coordinates. Raises WorkflowError when PROJ lacks the best operation's grid."""
    with_grids_of_the_system()
    # A Transformer falls back silently on a ballpark operation, which leaves heights as they are; the group says that it does.
    place = _around(points, source)
    group = TransformerGroup(start, end, always_xy=True, area_of_interest=place)  # type: ignore[arg-type]
    if leaves_heights(group):
        missing = missing_grids(group.unavailable_operations)
        raise WorkflowError(
            f"Heights cannot be transformed from {_named(start, source)} to {_named(end, target)}: PROJ lacks the grid "
            f"{', '.join(missing[:3]) or 'for it'}; {how_to_get(missing)}; or leave the height part out of both systems."
        )
    out = np.column_stack(group.transformers[0].transform(*points.T))
    _check_finite(out, source, target)
    return out


def _around(points: np.ndarray, source: str) -> AreaOfInterest | None:
    """The place of points, so that PROJ offers the grids that are for it; None where they have no place."""
    place = middle_degrees(points[:, :2], source)
    if place is None:
        return None
    west, south, east, north = (float(value) for value in np.concatenate([place - _NEIGHBOURHOOD, place + _NEIGHBOURHOOD]))
    return AreaOfInterest(west, south, east, north)


def _named(crs: CRS, text: str) -> str:
    """A system by what it was called; WKT by its name."""
    return text if len(text) < _LONG else f"{crs.name} with heights above the ellipsoid"


def _check_finite(points: np.ndarray, source: str, target: str) -> None:
    if not np.isfinite(points).all():
        raise WorkflowError(
            f"Coordinates cannot be transformed from {source[:_LONG]} to {target}: they lie outside of it. State the reference "
            "system in which they were surveyed."
        )


class FittingSystem(NamedTuple):
    """A reference system in which points would be at the site, and whether their first two coordinates are exchanged in it."""

    crs: str
    exchanged: bool


def fitting_system(points: np.ndarray, source: str, target: str, site: np.ndarray) -> FittingSystem | None:
    """In which system, or with which order of axes, points (N, 3) given as `source` would be near `site` (2,), a place in the
    projected system `target`; None where none of the usual mistakes explains them."""
    to_degrees = Transformer.from_crs(ground_crs(target), CRS.from_epsg(4326), always_xy=True)
    longitude, latitude = to_degrees.transform(*site)
    zone = int((longitude + 180.0) // 6.0) + 1
    utm = [f"EPSG:{(32600 if latitude >= 0 else 32700) + z}" for z in (zone, zone - 1, zone + 1) if 1 <= z <= 60]
    # The neighbouring zones, because surveys near the edge of a zone are often kept in the next one; Web Mercator, because maps on
    # the web hand out such coordinates. Then the grids of the country, because a receiver's surveyor works in them.
    usual = [source, target, "EPSG:4326", *utm, *_ZONES_IN_FRONT, "EPSG:3857"]
    for systems in (lambda: usual, lambda: _regional_systems(longitude, latitude)):
        for name, swapped in product(systems(), (False, True)):
            xy = points[:, [1, 0]] if swapped else points[:, :2]
            if _median_distance(xy, name, target, site) < _NEAR:
                return FittingSystem(name, swapped)
    return None


def _regional_systems(longitude: float, latitude: float) -> list[str]:
    """The projected systems that are kept for the land around a place, those of the largest area first: a country's grid before
    that of a railway."""
    here = AreaOfInterest(longitude, latitude, longitude, latitude)
    known = query_crs_info("EPSG", PJType.PROJECTED_CRS, area_of_interest=here, contains=True)
    wide = {info.code: info.area_of_use for info in known if info.area_of_use}
    size = {code: (area.east - area.west) * (area.north - area.south) for code, area in wide.items()}
    return [f"EPSG:{code}" for code in sorted(size, key=lambda code: (-size[code], int(code))) if size[code] < _REGION]


def _median_distance(xy: np.ndarray, name: str, target: str, site: np.ndarray) -> float:
    """Median distance (m) of points, read in the system `name`, from the site; inf where they cannot be transformed."""
    try:
        transformer = Transformer.from_crs(CRS.from_user_input(name), ground_crs(target), always_xy=True)
        moved = np.column_stack(transformer.transform(*xy.T))
    except ProjError:
        return np.inf
    distance = np.linalg.norm(moved - site, axis=1)
    return float(np.median(distance)) if np.isfinite(distance).all() else np.inf


def scale_at(xy: np.ndarray, crs: str) -> float:
    """Metres of the project's map to a metre on the ellipsoid at a place (2,); 1 where the projection has no inverse."""
    longitude, latitude = _degrees(xy, crs)
    return map_scale(ground_crs(crs), longitude, latitude).factor if np.isfinite([longitude, latitude]).all() else 1.0


def map_factor_at(xy: np.ndarray, crs: str) -> float | None:
    """Metres of a projected map to a metre on the ellipsoid at a place (2,) of it; None where it is no such map."""
    known = known_crs(crs) if crs else None
    flat = known.sub_crs_list[0] if known is not None and known.is_compound else known
    return scale_at(xy, crs) if flat is not None and flat.is_projected else None


def _degrees(xy: np.ndarray, crs: str) -> np.ndarray:
    to_map = Transformer.from_crs(CRS.from_epsg(4326), ground_crs(crs), always_xy=True)
    return degrees_of(to_map, np.asarray(xy, float)[None])[0]


def refuse_unfit_place(xy: np.ndarray, crs: str) -> None:
    """Raises WorkflowError where a metre of the map at a place (2,) is none on the ground."""
    factor = scale_at(xy, crs)
    if is_unfit(factor):
        raise WorkflowError(unfit_sentence(crs, ground_crs(crs), factor, *_degrees(xy, crs)))
