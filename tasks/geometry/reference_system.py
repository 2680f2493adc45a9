"""The project's coordinate reference system: projected, in metres, with an optional vertical part after a plus sign.

Everything downstream computes in metres on a plane; a system in degrees or feet is refused here, once. Positions of photographs are
transformed by the horizontal part only: their heights keep their value, because the altitude tag of a camera does not say reliably
whether it refers to the ellipsoid or to the geoid.
"""

from functools import lru_cache

import numpy as np
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError

from orthomill.schemas.errors import WorkflowError

AREA_MARGIN = 5.0
"""Degrees by which photographs may lie outside the area of use of the system: national systems are used across borders."""


@lru_cache(maxsize=16)
def ground_crs(text: str) -> CRS:
    """The horizontal part of the project's reference system, e.g. of "EPSG:2100", "EPSG:32634+5773" or "EPSG:32634+4979".

    Raises WorkflowError when it is unknown, geographic or geocentric, or not in metres.
    """
    try:
        crs = CRS.from_user_input(text)
    except CRSError as error:
        raise WorkflowError(
            f"The reference system crs: {text} is not known to PROJ; give a projected one in metres, "
            "for example EPSG:2100 or the UTM zone of the site such as EPSG:32634."
        ) from error
    horizontal = _plane(crs)
    if horizontal.is_geographic or horizontal.is_geocentric:
        raise WorkflowError(
            f"The reference system crs: {text} ({horizontal.name}) is not projected: its coordinates are in "
            f"{_unit(horizontal)}; give a projected one, for example EPSG:2100 or the UTM zone of the site such as EPSG:32634."
        )
    if not _in_metres(horizontal):
        raise WorkflowError(
            f"The reference system crs: {text} ({horizontal.name}) is not in metres but in {_unit(horizontal)}; "
            "give a projected one in metres, for example the UTM zone of the site."
        )
    return horizontal


def _plane(crs: CRS) -> CRS:
    """A system without its heights: those of a compound one, or those above the ellipsoid."""
    if crs.is_compound:
        return crs.sub_crs_list[0]
    if not crs.is_projected or len(crs.axis_info) < 3:
        return crs
    # By its code where it has one: a system that was made flat has lost its area of use.
    flat = crs.to_2d()
    return CRS.from_epsg(code) if (code := flat.to_epsg()) else flat


def on_earth(crs: str) -> bool:
    """Whether a system lies on the earth: those of a facade and of a block without positions lie nowhere."""
    known = CRS.from_user_input(crs)
    return known.is_projected or known.is_compound


def ground_coordinates(crs: str, longitude_latitude: np.ndarray) -> np.ndarray:
    """X, Y (N, 2) in m in the project's system of WGS 84 longitudes and latitudes (N, 2) in degrees.

    Raises WorkflowError when the system is not defined there, or is meant for another part of the world.
    """
    _check_area(crs, longitude_latitude)
    transformer = Transformer.from_crs(CRS.from_epsg(4326), ground_crs(crs), always_xy=True)
    x, y = transformer.transform(longitude_latitude[:, 0], longitude_latitude[:, 1])
    xy = np.column_stack([x, y])
    if not np.isfinite(xy).all():
        longitude, latitude = longitude_latitude[~np.isfinite(xy).all(axis=1)][0]
        raise WorkflowError(
            f"The reference system crs: {crs} is not defined at longitude {longitude:.4f}, latitude {latitude:.4f}, "
            "where photographs were taken; give the system of the site."
        )
    return xy


def _check_area(text: str, longitude_latitude: np.ndarray) -> None:
    """Refuses positions far outside the area of use: a projection gives numbers there, too, but they mean that the wrong system was
    named."""
    crs = ground_crs(text)
    area = crs.area_of_use
    # An area across the date line has west > east; it cannot be compared as a box and is not checked.
    if area is None or area.west > area.east:
        return
    low, high = np.array([area.west, area.south]) - AREA_MARGIN, np.array([area.east, area.north]) + AREA_MARGIN
    outside = ((longitude_latitude < low) | (longitude_latitude > high)).any(axis=1)
    if outside.any():
        longitude, latitude = longitude_latitude[outside][0]
        raise WorkflowError(
            f"The reference system crs: {text} ({crs.name}) is for longitudes {area.west:g} to {area.east:g} and latitudes "
            f"{area.south:g} to {area.north:g}, but photographs were taken at longitude {longitude:.4f}, latitude {latitude:.4f}; "
            "give the system of the site."
        )


def in_area_of_use(place: np.ndarray | None, text: str) -> bool:
    """Whether a place (2,), longitude and latitude, is where a project's system is meant for; systems that state no area, and those
    across the date line, are for any place."""
    area = ground_crs(text).area_of_use
    if area is None or area.west > area.east:
        return place is not None
    low, high = np.array([area.west, area.south]) - AREA_MARGIN, np.array([area.east, area.north]) + AREA_MARGIN
    return place is not None and bool((low <= place).all() and (place <= high).all())


def _unit(crs: CRS) -> str:
    name = crs.axis_info[0].unit_name if crs.axis_info else "an unnamed unit"
    return {"degree": "degrees", "metre": "metres", "foot": "feet", "US survey foot": "US survey feet"}.get(name, name)


def _in_metres(crs: CRS) -> bool:
    return bool(crs.axis_info) and all(abs(axis.unit_conversion_factor - 1.0) < 1e-9 for axis in crs.axis_info[:2])


def in_system(points: np.ndarray, metres: float, system: str, project: str) -> np.ndarray:
    """Points (N, 3) of a reference `system` in that of the project, m. Heights above a map keep their value, in `metres` a unit;
    those of a system of three dimensions (geocentric, ellipsoidal) become ellipsoidal heights.

    Raises WorkflowError for a system that is not known, or has no values there.
    """
    try:
        own = CRS.from_user_input(system)
    except CRSError as error:
        raise WorkflowError(f"The reference system '{system}' of the surface is unknown to PROJ; give one as EPSG:2100.") from error
    known = np.isfinite(points).all(axis=1)
    out = np.full(points.shape, np.nan)
    solid = own.is_geocentric or len(own.axis_info) == 3
    ground = ground_crs(project)
    transformer = Transformer.from_crs(own, ground.to_3d() if solid else ground, always_xy=True)
    x, y, *z = transformer.transform(*points[known, : 3 if solid else 2].T)
    out[known] = np.column_stack([x, y, z[0] if solid else points[known, 2] * metres])
    if not np.isfinite(out[known]).all():
        raise WorkflowError(f"The coordinates of the surface have no place in the project's system {project}: is it in {system}?")
    return out
