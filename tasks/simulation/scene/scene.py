"""The height model and the materials of a simulated scene, for any window of any map grid.

Each cell is a column with its own height at the centre; the ground is smooth, roofs are planes, walls are vertical and on the
borders of cells. Everything is a function of world coordinates and the layout, so tiles need neither a halo nor an order.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.truth import Material
from orthomill.tasks.simulation.scene.crowns import stamp_crowns, stand_at_rest
from orthomill.tasks.simulation.scene.hash_noise import uniform_of
from orthomill.tasks.simulation.scene.layout import STREET_SPACING, Scene, pond_blend, pond_distance, terrain_factors

PARCEL = (96.0, 132.0, 0.33)
"""Width and depth of a field (m) and the angle of the fields (radians)."""
_ROW_SHIFT, _FALLOW = 11, 12  # layers of hashed noise, added to the seed
_FIELD_PATH = 1.3  # m: half the width of the paths of open ground between fields
_FALLOW_SHARE = 0.34
_HILL_REACH = 2.6  # sigmas of the steep hill within which there are no fields
_POND_REACH = 1.8  # half axes of the pond beyond which it does not change the ground (its shore ends at 1.7)
_GROUND, _FIELD, _ROAD = int(Material.OPEN_GROUND), int(Material.FIELD), int(Material.ROAD)
_ROOF, _TREE, _WATER = int(Material.ROOF), int(Material.TREE), int(Material.WATER)


@dataclass(frozen=True, eq=False)
class SurfaceWindow:
    """height float32 m, material uint8 (code of Material), building uint16 (0: none); all (rows, cols)."""

    height: np.ndarray
    material: np.ndarray
    building: np.ndarray


def surface_window(scene: Scene, grid: MapGrid, window: Window) -> SurfaceWindow:
    """The surface of `window` of `grid`; the window may extend beyond the grid."""
    # float64 until the end: trees are compared with each other and roofs with the ground before rounding to float32.
    x, y = grid.centres(window)
    height = bare_ground(scene, x, y)
    material = _ground_material(scene, x, y)
    building = np.zeros(window.shape, np.uint16)
    _stamp_buildings(height, material, building, x, y, scene.buildings.table)
    # The surface of a crown is its envelope at rest; leaves begin at it or below it.
    number = np.zeros(window.shape, np.int32)
    stamp_crowns(height, building, number, (x, y), stand_at_rest(scene), scene.settings.seed)
    material[number > 0] = _TREE
    return SurfaceWindow(height.astype(np.float32), material, building)


def bare_ground(scene: Scene, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Height of the ground (rows, cols) at the coordinates of columns and rows, float64 m; the same in any window."""
    height = _sum_of_products(*terrain_factors(scene, x, y))
    pond = scene.pond
    near_x, near_y = np.abs(x - pond.x) < _POND_REACH * pond.a, np.abs(y - pond.y) < _POND_REACH * pond.b
    if near_x.any() and near_y.any():
        at = np.ix_(near_y, near_x)
        height[at] = scene.pond.level + (height[at] - scene.pond.level) * pond_blend(scene.pond, x[None, near_x], y[near_y, None])
    return height


@njit()
def _sum_of_products(fx, fy):
    """(M, N) sum over k of fx[k, N] * fy[k, M], always added in the same order."""
    # BLAS chooses its order by the shape of the matrices: windows of different size would differ in the last bit.
    out = np.zeros((fy.shape[1], fx.shape[1]))
    for row in range(out.shape[0]):
        for k in range(fx.shape[0]):
            factor = fy[k, row]
            for col in range(out.shape[1]):
                out[row, col] += factor * fx[k, col]
    return out


class _Places(NamedTuple):
    """Town and hill for the kernel: centres, radii and half widths in m, direction of the streets."""

    town_x: float
    town_y: float
    town_radius: float
    cos: float
    sin: float
    street_half_width: float
    hill_x: float
    hill_y: float
    hill_radius: float


def _ground_material(scene: Scene, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Roads, fields, water and open ground (rows, cols) uint8."""
    town, hill = scene.town, scene.hills[0]
    direction = float(np.cos(town.angle)), float(np.sin(town.angle))
    hill_place = float(hill[0]), float(hill[1]), float(_HILL_REACH * hill[3])
    places = _Places(float(town.x), float(town.y), town.radius, *direction, town.street_half_width, *hill_place)
    material = np.empty((len(y), len(x)), np.uint8)
    _classify(material, x, y, places, scene.settings.seed)
    # Roads after fields and streets, water after roads: the later one covers the earlier one.
    _set_roads(scene, x, y, material)
    near_x, near_y = np.abs(x - scene.pond.x) <= scene.pond.a, np.abs(y - scene.pond.y) <= scene.pond.b
    if near_x.any() and near_y.any():
        wet = pond_distance(scene.pond, x[None, near_x], y[near_y, None]) < 1.0
        at = np.ix_(near_y, near_x)
        material[at] = np.where(wet, _WATER, material[at])
    return material


def _set_roads(scene: Scene, x: np.ndarray, y: np.ndarray, material: np.ndarray) -> None:
    """Sets the country roads in `material` (rows, cols)."""
    roads = scene.roads
    for k, along_x in enumerate(roads.along_x):
        line, slope = roads.centre_line(k, x if along_x else y)
        # Measured along one axis, a road is wider by the secant of its direction.
        half = roads.half_width[k] * np.hypot(1.0, slope)
        across, centre = (y[:, None], line[None, :]) if along_x else (x[None, :], line[:, None])
        material[np.abs(across - centre) < (half[None, :] if along_x else half[:, None])] = _ROAD


@njit(inline="always")
def parcel_at(seed, x, y):
    """The field that a point belongs to: its two numbers and the distance to its border, m."""
    cos, sin = np.cos(PARCEL[2]), np.sin(PARCEL[2])
    u, v = x * cos + y * sin, y * cos - x * sin
    row = np.floor(v / PARCEL[1])
    # Every row of fields is shifted by another amount: borders of a regular grid would be matched one field off.
    u += PARCEL[0] * uniform_of(seed + _ROW_SHIFT, np.int64(row), 0)
    col = np.floor(u / PARCEL[0])
    fu, fv = u - col * PARCEL[0], v - row * PARCEL[1]
    return np.int64(col), np.int64(row), min(min(fu, PARCEL[0] - fu), min(fv, PARCEL[1] - fv))


@njit()
def _classify(material, x, y, places, seed):
    """Fields outside the town and off the hill, streets inside the town, open ground elsewhere."""
    for row in range(material.shape[0]):
        for col in range(material.shape[1]):
            dx, dy = x[col] - places.town_x, y[row] - places.town_y
            hx, hy = x[col] - places.hill_x, y[row] - places.hill_y
            code = _GROUND
            if dx * dx + dy * dy < places.town_radius * places.town_radius:
                u, v = dx * places.cos + dy * places.sin, dy * places.cos - dx * places.sin
                off_u = abs(u - STREET_SPACING[0] * np.rint(u / STREET_SPACING[0]))
                off_v = abs(v - STREET_SPACING[1] * np.rint(v / STREET_SPACING[1]))
                if min(off_u, off_v) < places.street_half_width:
                    code = _ROAD
            elif hx**2 + hy**2 > places.hill_radius * places.hill_radius:
                i, j, border = parcel_at(seed, x[col], y[row])
                if border > _FIELD_PATH and uniform_of(seed + _FALLOW, i, j) > _FALLOW_SHARE:
                    code = _FIELD
            material[row, col] = code


@njit(inline="always")
def _range_of(low, high, first, step, count):
    """The cells whose centres first + k * step may lie in [low, high]."""
    a, b = (low - first) / step, (high - first) / step
    if a > b:
        a, b = b, a
    return max(int(np.floor(a)), 0), min(int(np.ceil(b)) + 1, count)


@njit()
def _stamp_buildings(height, material, building, x, y, table):
    """Sets roof heights on all cells whose centre lies inside a floor plan. `table` as in `Buildings.table`."""
    dx, dy = x[1] - x[0], y[1] - y[0]
    for k in range(table.shape[0]):
        cx, cy, cos, sin, length, width, eaves, rise = table[k]
        reach = np.sqrt(length * length + width * width)
        left, right = _range_of(cx - reach, cx + reach, x[0], dx, len(x))
        top, bottom = _range_of(cy - reach, cy + reach, y[0], dy, len(y))
        for row in range(top, bottom):
            for col in range(left, right):
                p = (x[col] - cx) * cos + (y[row] - cy) * sin
                q = (y[row] - cy) * cos - (x[col] - cx) * sin
                if abs(p) <= length and abs(q) <= width:
                    height[row, col] = eaves + rise * (1.0 - abs(q) / width)
                    material[row, col] = _ROOF
                    building[row, col] = k + 1
