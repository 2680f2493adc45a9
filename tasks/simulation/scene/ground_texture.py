"""The colours of a simulated scene: what a true orthoimage of it shows, sunlight and shadows included.

Brightness of open ground follows a mosaic of real photographs (textures/ATTRIBUTION.md), flattened by division through its local
mean; colours come from the materials; fields, roofs and roads have patterns of their own, crowns are made of leaves (crowns.py).
Fine noise reaches down to half a metre everywhere but on water and trees, so that every patch of ground can be matched.
"""

from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.errors import ResourceError
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.truth import Material
from orthomill.tasks.simulation.scene.crowns import paint_crowns, stamp_crowns, stand_at_rest
from orthomill.tasks.simulation.scene.hash_noise import uniform_of, value_noise
from orthomill.tasks.simulation.scene.layout import HouseColumn, Scene
from orthomill.tasks.simulation.scene.scene import SurfaceWindow, parcel_at, surface_window
from orthomill.tasks.simulation.scene.sunlight import SHADOW_REACH, light_on

MOSAIC_FILE = Path(__file__).parents[1] / "textures" / "village.jpg"
MOSAIC_CELL = 0.507
"""m"""
_FLAT = 110.0  # value of the flattened mosaic where it is as bright as its surroundings
_MOSAIC_MEAN = 81  # px, 41 m: larger than fields' furrows and trees, smaller than fields, whose own tones are painted below
_GROUND, _FIELD, _ROAD = int(Material.OPEN_GROUND), int(Material.FIELD), int(Material.ROAD)
_ROOF, _TREE, _WATER = int(Material.ROOF), int(Material.TREE), int(Material.WATER)
WATER_COLOUR = (46.0, 70.0, 78.0)


class _Layer(IntEnum):
    """Layers of hashed noise: numbers added to the seed, so that no two patterns are correlated."""

    FINE = 31
    MIDDLE = 32
    ROOF_KIND = 33
    ROOF_TONE = 34
    ROAD = 36
    DRYNESS = 37
    FIELD_KIND = 38
    FIELD_TURN = 39
    FURROWS = 40
    ROOF_PATTERN = 40
    """seven numbers per building from here on"""


_FIELDS = np.array([[148.0, 128.0, 92.0], [118.0, 138.0, 72.0], [176.0, 160.0, 104.0], [96.0, 122.0, 62.0], [134.0, 112.0, 84.0]])
_TILES = np.array([[168.0, 92.0, 66.0], [186.0, 112.0, 78.0], [150.0, 82.0, 62.0], [172.0, 126.0, 96.0]])
_FLATS = np.array([[176.0, 172.0, 164.0], [142.0, 140.0, 138.0], [192.0, 184.0, 168.0], [122.0, 118.0, 116.0]])


@dataclass(frozen=True, eq=False)
class PaintedWindow:
    """A window of the scene with its colours uint8 (rows, cols, 3)."""

    surface: SurfaceWindow
    colours: np.ndarray


class _Canvas(NamedTuple):
    """What the colours depend on: coordinates (cols,), (rows,) m; material, building and light (rows, cols); the mosaic and the
    corner (west, north) where it begins; the houses as in the layout; the seed."""

    x: np.ndarray
    y: np.ndarray
    material: np.ndarray
    building: np.ndarray
    light: np.ndarray
    mosaic: np.ndarray
    west: float
    north: float
    houses: np.ndarray
    seed: int


def painted_window(scene: Scene, grid: MapGrid, window: Window) -> PaintedWindow:
    """Surface and colours of `window` of `grid`, the same in any tiling: the surroundings are read as far as shadows reach."""
    reach = int(np.ceil(SHADOW_REACH / grid.cell))
    grown = Window(window.row - 1, window.col - 1, window.height + 1 + reach, window.width + 1 + reach)
    wide = surface_window(scene, grid, grown)
    inner = slice(1, 1 + window.height), slice(1, 1 + window.width)
    light = light_on(wide.height, grid.cell)[inner]
    surface = SurfaceWindow(*(np.ascontiguousarray(part[inner]) for part in (wide.height, wide.material, wide.building)))
    colours, settings = np.empty((*window.shape, 3), np.uint8), scene.settings
    corner = float(settings.west), float(settings.north)
    ground = *grid.centres(window), surface.material, surface.building, light
    _paint(colours, _Canvas(*ground, flat_mosaic(), *corner, scene.buildings.table, settings.seed))
    _paint_trees(scene, colours, surface, grid.centres(window), grid.cell)
    return PaintedWindow(surface, colours)


def _paint_trees(
    scene: Scene, colours: np.ndarray, surface: SurfaceWindow, axes: tuple[np.ndarray, np.ndarray], cell: float
) -> None:
    """Sets `colours` (rows, cols, 3) of the crowns: what is seen of them straight from above, without wind."""
    height, number = np.full(surface.height.shape, -np.inf), np.zeros(surface.height.shape, np.int32)
    stand, seed = stand_at_rest(scene), scene.settings.seed
    stamp_crowns(height, surface.building, number, axes, stand, seed)
    paint_crowns(colours, number, height, (float(axes[0][0]), float(axes[1][0]), cell), stand, seed)


@lru_cache(maxsize=1)
def flat_mosaic() -> np.ndarray:
    """The shipped mosaic divided by its local mean (40 m), uint8 (rows, cols); `_FLAT` is as bright as its surroundings."""
    grey = cv2.imread(str(MOSAIC_FILE), cv2.IMREAD_GRAYSCALE)
    if grey is None:
        raise ResourceError(f"The ground texture {MOSAIC_FILE} cannot be read; install orthomill again with its data files.")
    mean = cv2.blur(grey, (_MOSAIC_MEAN, _MOSAIC_MEAN), borderType=cv2.BORDER_REFLECT)
    # The real photographs have shadows of their own: where even the mean is dark, their noise would be amplified.
    return np.asarray(cv2.divide(grey, np.maximum(mean, 20), scale=_FLAT))


@njit(inline="always")
def _mosaic_at(mosaic, x, y):
    """Brightness ratio of the mosaic (1: as its surroundings) at x, y in its pixels, mirrored at its borders."""
    rows, cols = mosaic.shape
    x, y = abs(x), abs(y)
    x = x % (2.0 * (cols - 1))
    y = y % (2.0 * (rows - 1))
    x = min(x, 2.0 * (cols - 1) - x)
    y = min(y, 2.0 * (rows - 1) - y)
    i, j = min(int(x), cols - 2), min(int(y), rows - 2)
    fx, fy = x - i, y - j
    top = mosaic[j, i] * (1.0 - fx) + mosaic[j, i + 1] * fx
    bottom = mosaic[j + 1, i] * (1.0 - fx) + mosaic[j + 1, i + 1] * fx
    return (top * (1.0 - fy) + bottom * fy) / _FLAT


@njit(inline="always")
def _roof_factor(seed, house, x, y, building):
    """Pattern of a roof: rows of tiles along the slope of a gabled one, patches of felt on a flat one."""
    cos, sin = house[HouseColumn.COS], house[HouseColumn.SIN]
    east, north = x - house[HouseColumn.X], y - house[HouseColumn.Y]
    p, q = east * cos + north * sin, north * cos - east * sin
    key = seed + _Layer.ROOF_PATTERN + 7 * building
    if house[HouseColumn.RISE] > 0.0:
        return 1.0 + 0.13 * value_noise(key, p / 0.9, q / 2.6) + 0.10 * value_noise(key + 1, p / 4.0, q / 3.0)
    patch = uniform_of(key + 2, np.int64(np.floor(p / 3.4)), np.int64(np.floor(q / 4.3))) - 0.5
    return 1.0 + 0.24 * patch + 0.10 * value_noise(key + 3, p / 1.1, q / 1.1)


@njit()
def _paint(colours, canvas):
    """Fills `colours` (rows, cols, 3)."""
    seed = canvas.seed
    for row in range(colours.shape[0]):
        for col in range(colours.shape[1]):
            code = canvas.material[row, col]
            x, y = canvas.x[col], canvas.y[row]
            east, north = x - canvas.west, canvas.north - y
            # Water has no texture that stays: the waves and glints of a photograph are not part of a true orthoimage.
            if code == _WATER:
                for band in range(3):
                    colours[row, col, band] = np.uint8(WATER_COLOUR[band])
                continue
            if code == _TREE:
                continue
            # Lattices of 0.8 and 2.3 m: no multiples of each other nor of a cell, so that no regular pattern appears.
            fine = value_noise(seed + _Layer.FINE, east / 0.8, north / 0.8)
            middle = value_noise(seed + _Layer.MIDDLE, east / 2.3, north / 2.3)
            red, green, blue = 0.0, 0.0, 0.0
            factor = 1.0 + 0.13 * fine + 0.10 * middle
            if code == _ROOF:
                number = int(canvas.building[row, col])
                house = canvas.houses[number - 1]
                kind = int(4.0 * uniform_of(seed + _Layer.ROOF_KIND, number, 0))
                tone = _TILES[kind] if house[HouseColumn.RISE] > 0.0 else _FLATS[kind]
                red, green, blue = tone[0], tone[1], tone[2]
                bright = 0.9 + 0.2 * uniform_of(seed + _Layer.ROOF_TONE, number, 0)
                factor = bright * _roof_factor(seed, house, x, y, number)
                factor += 0.07 * fine
            elif code == _ROAD:
                red, green, blue = 128.0, 126.0, 124.0
                factor = 1.0 + 0.10 * fine + 0.07 * middle + 0.06 * value_noise(seed + _Layer.ROAD, east / 7.0, north / 7.0)
            else:
                ratio = min(max(_mosaic_at(canvas.mosaic, east / MOSAIC_CELL, north / MOSAIC_CELL), 0.45), 1.7)
                dry = 0.5 + 0.5 * value_noise(seed + _Layer.DRYNESS, east / 90.0, north / 90.0)
                red, green, blue = 112.0 + 44.0 * dry, 118.0 + 20.0 * dry, 76.0 + 22.0 * dry
                strength = 0.75
                if code == _FIELD:
                    i, j, _ = parcel_at(seed, x, y)
                    tone = _FIELDS[int(5.0 * uniform_of(seed + _Layer.FIELD_KIND, i, j))]
                    turn = uniform_of(seed + _Layer.FIELD_TURN, i, j) * 3.1416
                    along = east * np.cos(turn) + north * np.sin(turn)
                    across = north * np.cos(turn) - east * np.sin(turn)
                    red, green, blue = tone[0], tone[1], tone[2]
                    factor += 0.09 * value_noise(seed + _Layer.FURROWS, across / 1.3, along / 14.0)
                    strength = 0.45
                factor *= 1.0 + strength * (ratio - 1.0)
            factor *= canvas.light[row, col]
            # Never black nor white: saturated grey values would be left out by matching and by the radiometric balance.
            colours[row, col, 0] = np.uint8(min(max(red * factor, 6.0), 250.0) + 0.5)
            colours[row, col, 1] = np.uint8(min(max(green * factor, 6.0), 250.0) + 0.5)
            colours[row, col, 2] = np.uint8(min(max(blue * factor, 6.0), 250.0) + 0.5)
