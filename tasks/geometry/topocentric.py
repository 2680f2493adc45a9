"""East, north, up about a reference point, as OpenSfM and OpenDroneMap count, and the project's map coordinates.

A map is not a Cartesian system: its plane has a scale and a north of its own, and its heights follow the curved earth. Points are
carried exactly; the axes at a point by the derivative of the transformation there, made a pure rotation again. Heights keep their
number: an altitude counts from wherever the reference's altitude counts.
"""

from dataclasses import dataclass

import numpy as np
from pyproj import CRS, Transformer

from orthomill.tasks.geometry.reference_system import ground_crs

_STEP = 10.0
"""m, of the numerical derivative"""


@dataclass(frozen=True)
class Reference:
    """The origin of a topocentric system: WGS 84 degrees and metres."""

    latitude: float
    longitude: float
    altitude: float


class Topocentric:
    """The way between a topocentric system and the plane of a CRS with heights."""

    def __init__(self, reference: Reference, crs: str) -> None:
        geographic, geocentric = CRS.from_epsg(4979), CRS.from_epsg(4978)
        self._to_earth = Transformer.from_crs(geographic, geocentric, always_xy=True)
        self._to_map = Transformer.from_crs(CRS.from_epsg(4326), ground_crs(crs), always_xy=True)
        place = (reference.longitude, reference.latitude, reference.altitude)
        self._origin = np.array(self._to_earth.transform(*place))
        lon, lat = np.radians(place[:2])
        east = [-np.sin(lon), np.cos(lon), 0.0]
        north = [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)]
        up = [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
        self._axes = np.array([east, north, up])

    def to_map(self, points: np.ndarray) -> np.ndarray:
        """East, north, up (N, 3) m to X, Y, height (N, 3)."""
        earth = points @ self._axes + self._origin
        lon, lat, height = self._to_earth.transform(*earth.T, direction="INVERSE")
        x, y = self._to_map.transform(lon, lat)
        return np.column_stack([x, y, height])

    def from_map(self, points: np.ndarray) -> np.ndarray:
        """X, Y, height (N, 3) to east, north, up (N, 3) m."""
        lon, lat = degrees_of(self._to_map, points[:, :2]).T
        earth = np.column_stack(self._to_earth.transform(lon, lat, points[:, 2]))
        return (earth - self._origin) @ self._axes.T

    def turn(self, point: np.ndarray) -> np.ndarray:
        """(3, 3): the rotation from east, north, up to the map's axes at a topocentric point (3,)."""
        steps = _STEP * np.eye(3)
        derivative = (self.to_map(point + steps) - self.to_map(point - steps)).T / (2.0 * _STEP)
        U, _, Vt = np.linalg.svd(derivative)
        return U @ Vt


def degrees_of(to_map: Transformer, xy: np.ndarray) -> np.ndarray:
    """Longitude and latitude (N, 2) that `to_map` carries to xy (N, 2).

    A shift of datum in the plane leaves millimetres between PROJ's way there and its way back; they are taken off.
    """
    aim = xy
    for _ in range(3):
        degrees = np.column_stack(to_map.transform(aim[:, 0], aim[:, 1], direction="INVERSE"))
        aim = aim + xy - np.column_stack(to_map.transform(degrees[:, 0], degrees[:, 1]))
    return degrees


def reference_of(crs: str, point: np.ndarray) -> Reference:
    """The reference point at X, Y, height (3,) of the map."""
    to_map = Transformer.from_crs(CRS.from_epsg(4326), ground_crs(crs), always_xy=True)
    ((lon, lat),) = degrees_of(to_map, point[None, :2])
    return Reference(float(lat), float(lon), float(point[2]))
