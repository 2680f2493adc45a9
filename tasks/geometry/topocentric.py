"""Topocentric coordinates (east, north, up about a reference point), as used by OpenSfM and OpenDroneMap, and map coordinates.

A map is not a Cartesian system: its plane has a scale factor and a meridian convergence, and its heights follow the curved earth.
Points are transformed exactly; the axes at a point by the derivative of the transformation there, reduced to a rotation. Heights
refer to whatever surface the altitude of the reference point refers to.
"""

from dataclasses import dataclass

import numpy as np
from pyproj import CRS, Transformer

from orthomill.tasks.geometry.reference_system import ground_crs, on_earth

_STEP = 10.0
"""m, of the numerical derivative: rounding of geocentric coordinates (1e-9 m) and curvature of the map both stay below 1e-9 rad"""


@dataclass(frozen=True)
class Reference:
    """The origin of a topocentric system: WGS 84 degrees and metres."""

    latitude: float
    longitude: float
    altitude: float


class Topocentric:
    """The transformation between a topocentric system and a projected CRS with heights."""

    def __init__(self, reference: Reference, crs: str) -> None:
        geographic, geocentric = CRS.from_epsg(4979), CRS.from_epsg(4978)
        self._to_earth = Transformer.from_crs(geographic, geocentric, always_xy=True)
        self._to_map = Transformer.from_crs(CRS.from_epsg(4326), ground_crs(crs), always_xy=True)
        self._origin = np.array(self._to_earth.transform(reference.longitude, reference.latitude, reference.altitude))
        lon, lat = np.radians(reference.longitude), np.radians(reference.latitude)
        # Unit vectors to east, north and up at the reference point, in geocentric coordinates, become the rows of the rotation.
        east = [-np.sin(lon), np.cos(lon), 0.0]
        north = [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)]
        up = [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
        self._axes = np.array([east, north, up])

    @property
    def on_earth(self) -> tuple[np.ndarray, np.ndarray]:
        """Rotation (3, 3) and origin (3,) m that lead to geocentric coordinates (EPSG:4978)."""
        return self._axes.T, self._origin

    def to_map(self, points: np.ndarray) -> np.ndarray:
        """East, north, up (N, 3) m to X, Y, height (N, 3)."""
        earth = points @ self._axes + self._origin
        lon, lat, height = self._to_earth.transform(earth[:, 0], earth[:, 1], earth[:, 2], direction="INVERSE")
        x, y = self._to_map.transform(lon, lat)
        return np.column_stack([x, y, height])

    def from_map(self, points: np.ndarray) -> np.ndarray:
        """X, Y, height (N, 3) to east, north, up (N, 3) m."""
        lon, lat = degrees_of(self._to_map, points[:, :2]).T
        earth = np.column_stack(self._to_earth.transform(lon, lat, points[:, 2]))
        return (earth - self._origin) @ self._axes.T

    def turn(self, point: np.ndarray) -> np.ndarray:
        """(3, 3): the rotation from east, north, up to the axes of the map at a topocentric point (3,)."""
        steps = _STEP * np.eye(3)
        derivative = (self.to_map(point + steps) - self.to_map(point - steps)).T / (2.0 * _STEP)
        # The derivative holds the scale of the map, too; a camera's attitude takes the nearest rotation only.
        U, _, Vt = np.linalg.svd(derivative)
        return U @ Vt


def degrees_of(to_map: Transformer, xy: np.ndarray) -> np.ndarray:
    """Longitude and latitude (N, 2) that `to_map` carries to xy (N, 2).

    PROJ's inverse of a two-dimensional datum transformation is off by millimetres, because it drops the height; iteration removes
    that.
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


def place_on_earth(crs: str, point: np.ndarray) -> np.ndarray | None:
    """As `geocentric_matrix`; None for a system that lies nowhere on the earth."""
    return geocentric_matrix(crs, point) if on_earth(crs) else None


def geocentric_matrix(crs: str, point: np.ndarray) -> np.ndarray:
    """(4, 4): from metres about a point (3,) of the map, along its axes, to geocentric coordinates (EPSG:4978).

    The scale of the map is left out; heights are taken as ellipsoidal.
    """
    to_earth = Transformer.from_crs(ground_crs(crs).to_3d(), CRS.from_epsg(4978), always_xy=True)
    steps = np.vstack([np.zeros(3), _STEP * np.eye(3), -_STEP * np.eye(3)]) + point
    earth = np.column_stack(to_earth.transform(*steps.T))
    left, _, right = np.linalg.svd((earth[1:4] - earth[4:7]).T / (2.0 * _STEP))
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = left @ right, earth[0]
    return out
