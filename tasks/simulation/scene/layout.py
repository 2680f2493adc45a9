"""The layout of a simulated scene: relief, pond, roads, town, buildings and trees, and the distance of a point from them.

A layout is a handful of small arrays (drawn by `settlement.py`); the content of a window of the scene follows from them and from
world coordinates alone (`scene.py`), so that any tile can be made independently.
"""

from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache

import numpy as np

FULL_HEIGHT = 1043.0
"""m: the flying height (1:6800, c = 153.353 mm) for which relief and building heights below are stated."""
LATTICE_STEP = 10.0
"""m, of the coarse relief from which height bounds are taken"""
STREET_SPACING = (64.0, 84.0)
"""m between the streets of the town, in its two directions"""
_HEIGHT_MARGIN = 1.5  # m: crowns are rough by 0.3 m, and the ground under a roof is no plane


@dataclass(frozen=True)
class SceneSettings:
    """What determines a scene completely. Bounds in m in the project's CRS."""

    seed: int
    west: float
    south: float
    east: float
    north: float
    flying_height: float
    buildings: int
    wood: float = 0.0
    """radius of a closed wood, m; 0: none"""

    @property
    def scale(self) -> float:
        """Size of the relief relative to that of the full block."""
        return self.flying_height / FULL_HEIGHT

    @property
    def roof_top(self) -> float:
        """Greatest height of a roof above its ground, m."""
        return float(np.clip(25.0 * self.scale, 12.0, 25.0))

    def place(self, across: float, up: float) -> tuple[float, float]:
        """The point at a fraction of the width and of the height of the bounds."""
        return self.west + across * (self.east - self.west), self.south + up * (self.north - self.south)


@dataclass(frozen=True)
class Pond:
    """An ellipse of still water at one level, half axes `a` (east) and `b` (north), m."""

    x: float
    y: float
    a: float
    b: float
    level: float


@dataclass(frozen=True)
class Town:
    """A disc with a rectangular net of streets, turned by `angle` (radians)."""

    x: float
    y: float
    radius: float
    angle: float
    street_half_width: float

    def local(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """World to the town's own axes, m."""
        dx, dy = x - self.x, y - self.y
        return dx * np.cos(self.angle) + dy * np.sin(self.angle), dy * np.cos(self.angle) - dx * np.sin(self.angle)

    def world(self, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The town's axes to the world, m."""
        return (self.x + u * np.cos(self.angle) - v * np.sin(self.angle), self.y + u * np.sin(self.angle) + v * np.cos(self.angle))


@dataclass(frozen=True, eq=False)
class Roads:
    """Country roads: sine curves along x (`along_x` true: y = f(x)) or along y. All (R,)."""

    along_x: np.ndarray
    offset: np.ndarray
    amplitude: np.ndarray
    wavenumber: np.ndarray
    phase: np.ndarray
    half_width: np.ndarray

    def centre_line(self, road: int, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The other coordinate of the centre line and its slope, at `along` (m)."""
        angle = self.wavenumber[road] * along + self.phase[road]
        return (
            self.offset[road] + self.amplitude[road] * np.sin(angle),
            self.amplitude[road] * self.wavenumber[road] * np.cos(angle),
        )


class HouseColumn(IntEnum):
    """Columns of `Buildings.table`, for kernels."""

    X = 0
    Y = 1
    COS = 2
    SIN = 3
    HALF_LENGTH = 4
    HALF_WIDTH = 5
    EAVES = 6
    RISE = 7


@dataclass(frozen=True, eq=False)
class Buildings:
    """Rectangular houses, all (B,). `eaves` is the height of the eaves (m, absolute), `rise` of the ridge above them (0: flat)."""

    x: np.ndarray
    y: np.ndarray
    cos: np.ndarray
    sin: np.ndarray
    half_length: np.ndarray
    half_width: np.ndarray
    eaves: np.ndarray
    rise: np.ndarray

    def __len__(self) -> int:
        return len(self.x)

    @property
    def table(self) -> np.ndarray:
        """(B, 8) float64 in the order of the fields (`HouseColumn`), for kernels."""
        return np.column_stack([self.x, self.y, self.cos, self.sin, self.half_length, self.half_width, self.eaves, self.rise])


@dataclass(frozen=True, eq=False)
class Scene:
    """The layout of a scene."""

    settings: SceneSettings
    waves: np.ndarray
    """(W, 4): amplitude (m), wavenumbers along x and y (1/m), phase"""
    hills: np.ndarray
    """(H, 5): x, y, height, sigma along x and y (m)"""
    pond: Pond
    town: Town
    roads: Roads
    buildings: Buildings
    trees: np.ndarray
    """(T, 4): x, y, crown radius, top (m, absolute)"""
    tree_feet: np.ndarray
    """(T,): height of the ground under the tree, m"""


def terrain_factors(scene: Scene, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The relief as a sum of products: height(x, y) = sum over k of fx[k] * fy[k], before the pond is cut in.

    x (N,) and y (M,) m; returns fx (K, N) and fy (K, M). Waves and hills separate, so a window needs no transcendental function
    per cell.
    """
    # sin(a + b) = sin a cos b + cos a sin b: a wave in any direction is a sum of two products.
    west, south = scene.settings.west, scene.settings.south
    fx, fy = [np.full(len(x), 1.0)], [_plain(scene, y)]
    for amplitude, kx, ky, phase in scene.waves:
        east, north = kx * (x - west) + phase, ky * (y - south)
        fx += [amplitude * np.sin(east), amplitude * np.cos(east)]
        fy += [np.cos(north), np.sin(north)]
    for hx, hy, height, sx, sy in scene.hills:
        fx.append(height * np.exp(-0.5 * ((x - hx) / sx) ** 2))
        fy.append(np.exp(-0.5 * ((y - hy) / sy) ** 2))
    return np.array(fx), np.array(fy)


def _plain(scene: Scene, y: np.ndarray) -> np.ndarray:
    """The plain rises gently to the north."""
    s = scene.settings
    return 27.0 + 22.0 * s.scale * (y - s.south) / (s.north - s.south)


def ground_at(scene: Scene, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Height of the bare ground at points (N,), m, pond included."""
    fx, fy = terrain_factors(scene, x, y)
    z = (fx * fy).sum(axis=0)
    return scene.pond.level + (z - scene.pond.level) * pond_blend(scene.pond, x, y)


def pond_blend(pond: Pond, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """0 on the water, 1 away from the shore, smooth between."""
    t = np.clip((pond_distance(pond, x, y) - 1.0) / 0.7, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def pond_distance(pond: Pond, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Distance from the pond's centre in units of its half axes: 1 is the shore."""
    return np.hypot((x - pond.x) / pond.a, (y - pond.y) / pond.b)


def road_clearance(scene: Scene, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Distance from the edge of the nearest road or street at points (N,), m; negative on it."""
    clear = np.full(np.shape(x), np.inf)
    for k, along_x in enumerate(scene.roads.along_x):
        along, across = (x, y) if along_x else (y, x)
        centre, slope = scene.roads.centre_line(k, along)
        clear = np.minimum(clear, np.abs(across - centre) / np.hypot(1.0, slope) - scene.roads.half_width[k])
    u, v = scene.town.local(x, y)
    off_u = np.abs(u - STREET_SPACING[0] * np.rint(u / STREET_SPACING[0]))
    off_v = np.abs(v - STREET_SPACING[1] * np.rint(v / STREET_SPACING[1]))
    street = np.minimum(off_u, off_v) - scene.town.street_half_width
    return np.where(np.hypot(u, v) < scene.town.radius, np.minimum(clear, street), clear)


def building_clearance(buildings: Buildings, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Distance from the nearest wall at points (N,), m; 0 or less inside a building."""
    clear = np.full(len(x), np.inf)
    for bx, by, cos, sin, length, width, _, _ in buildings.table:
        p = np.abs((x - bx) * cos + (y - by) * sin) - length
        q = np.abs((y - by) * cos - (x - bx) * sin) - width
        outside = np.hypot(np.maximum(p, 0.0), np.maximum(q, 0.0))
        clear = np.minimum(clear, np.where(np.maximum(p, q) < 0.0, np.maximum(p, q), outside))
    return clear


def height_bounds(scene: Scene, bounds: tuple[float, float, float, float]) -> tuple[float, float]:
    """Heights (m) between which everything inside (west, south, east, north) lies, objects included, with a margin of 1.5 m."""
    ground = _ground_lattice(scene)
    west, south, east, north = bounds
    step, origin_x, origin_y = LATTICE_STEP, scene.settings.west, scene.settings.south
    left, right = int((west - origin_x) // step), int((east - origin_x) // step) + 2
    bottom, top = int((south - origin_y) // step), int((north - origin_y) // step) + 2
    part = ground[max(min(bottom, len(ground) - 1), 0) : max(top, 1), max(min(left, ground.shape[1] - 1), 0) : max(right, 1)]
    # No ground between lattice points lies farther than this beyond them: slope 0.65 over 0.7 of the step.
    rise = 0.5 * LATTICE_STEP
    return float(part.min()) - rise, float(part.max()) + rise + scene.settings.roof_top + _HEIGHT_MARGIN


@lru_cache(maxsize=4)
def _ground_lattice(scene: Scene) -> np.ndarray:
    """Bare ground on a lattice of LATTICE_STEP from the south-west corner, (rows northwards, cols), m."""
    s = scene.settings
    x, y = np.arange(s.west, s.east + LATTICE_STEP, LATTICE_STEP), np.arange(s.south, s.north + LATTICE_STEP, LATTICE_STEP)
    fx, fy = terrain_factors(scene, x, y)
    z = fy.T @ fx
    return scene.pond.level + (z - scene.pond.level) * pond_blend(scene.pond, x[None, :], y[:, None])


def scene_bounds(settings: SceneSettings) -> tuple[float, float, float, float]:
    """(west, south, east, north), m."""
    return settings.west, settings.south, settings.east, settings.north
