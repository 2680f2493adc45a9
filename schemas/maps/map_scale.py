"""The scale of a map at a place: how much longer its metres are than those on the ground, and in which direction north lies on it.

Web maps are 1.5 times too large in middle latitudes; UTM is right to 0.04 % in its zone, which measured distances feel.
"""

from typing import NamedTuple

import numpy as np
from pyproj import CRS, Geod, Transformer

LARGEST = 0.0035
"""Part by which the scale of a map may differ from 1: Lambert-93, the widest of the national grids, reaches 0.0030 in Corsica."""
_STEP = 100.0  # m
_EARTH = 6_371_000.0  # m, mean radius


class MapScale(NamedTuple):
    """Metres of a map to a metre on the ellipsoid, and the direction of north on it, degrees clockwise from the y axis."""

    factor: float
    north: float


def map_scale(crs: CRS, longitude: float, latitude: float) -> MapScale:
    """The scale of a projected system at a place (WGS 84, degrees), by steps on the ellipsoid."""
    to_map = Transformer.from_crs(CRS.from_epsg(4326), crs, always_xy=True)
    lon, lat, _ = Geod(ellps="WGS84").fwd([longitude] * 4, [latitude] * 4, [0.0, 90.0, 180.0, 270.0], [_STEP] * 4)
    x, y = (np.array(values) for values in to_map.transform(lon, lat))
    north, east = np.array([x[0] - x[2], y[0] - y[2]]), np.array([x[1] - x[3], y[1] - y[3]])
    unit = crs.axis_info[0].unit_conversion_factor if crs.axis_info else 1.0
    factor = np.sqrt(np.linalg.norm(north) * np.linalg.norm(east)) / (2.0 * _STEP) * unit
    return MapScale(float(factor), float(np.degrees(np.arctan2(north[0], north[1]))))


def on_the_map(factor: float, height: float) -> float:
    """Metres of the map to a metre on the ground at a `height` (m), for a scale `factor` on the ellipsoid."""
    return factor * _EARTH / (_EARTH + height)


def is_unfit(factor: float) -> bool:
    """Whether a map is no place to measure on."""
    return not abs(factor - 1.0) <= LARGEST


def utm_zone(longitude: float, latitude: float) -> str:
    """The EPSG code of the UTM zone (WGS 84) of a position, e.g. "EPSG:32634", with the exceptions of Norway and Svalbard."""
    zone = min(int((longitude + 180) // 6) + 1, 60)
    # Zone 32 is widened to cover south-western Norway; around Svalbard only the odd zones 31 to 37 are used.
    if 56 <= latitude < 64 and 3 <= longitude < 12:
        zone = 32
    if 72 <= latitude <= 84 and 0 <= longitude < 42:
        zone = 31 + 2 * int((longitude + 3) // 12)
    return f"EPSG:{'326' if latitude >= 0 else '327'}{zone:02d}"


def unfit_sentence(text: str, crs: CRS, factor: float, longitude: float, latitude: float) -> str:
    """What is wrong with a system of such a scale, and what to take."""
    return (
        f"{text} ({crs.name}) is {factor:.4g} times as large as the ground at the site, so that lengths, areas and heights "
        f"would disagree; take the UTM zone of the site, {utm_zone(longitude, latitude)}, or a national grid, and project the "
        "products afterwards."
    )
