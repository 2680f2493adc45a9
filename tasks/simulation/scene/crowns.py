"""Crowns of trees: clusters of leaves at many depths below a lobed envelope, which the wind bends differently in every photograph.

The surface of the truth is the envelope at rest: the height below which leaves begin. A ray meets a cluster of leaves at or below
it, or passes through a gap and meets the ground. Clusters are hashed from places in the crown at rest; a crown that sways carries
them along, the farther the higher they are.
"""

from enum import IntEnum

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.simulation.scene.hash_noise import uniform_of, value_noise
from orthomill.tasks.simulation.scene.layout import Scene
from orthomill.tasks.simulation.scene.sunlight import AMBIENT, SUN

LAYER = 0.5
"""m: height of a cluster of leaves"""
LOWEST = 0.12
"""share of a tree's height below which it has no leaves"""
_SKIRT = 0.22  # the same along the rim: higher, and the ground under a crown would be matched between its trunk and its rim
_CLUSTER = 0.6  # m: width of a cluster
_GUST, _FLUTTER = 0.02, 0.02  # m per m of height: standard deviation of the wind of a photograph, and of each tree in it
_WIND = 5  # draws of the wind: a stream of random numbers of its own
_SHELL, _SHELL_DEPTH, _INSIDE = 0.55, 1.0, 0.34  # share of the clusters that have leaves, in the outermost metre and below
_GAP, _GAP_SHARE = -0.4, 0.15  # where this noise is lower, only this share of them has leaves: openings through the whole crown
_RAGGED = 0.5  # how far the outline withdraws from a circle, in squared radii
_FADE = 0.2  # 1/m: light lost on the way into the crown
_LEAVES = np.array([[74.0, 98.0, 46.0], [58.0, 84.0, 50.0], [88.0, 104.0, 52.0], [66.0, 82.0, 40.0]])
_LITTER = (70.0, 62.0, 46.0)
"""colour of the shaded ground below crowns"""


class _Noise(IntEnum):
    """Layers of hashed noise: numbers added to the seed."""

    ROUGH = 21
    OUTLINE = 22
    LOBES = 23
    GAPS = 24
    TONE = 25
    LITTER = 26
    CLUSTERS = 27


class TreeColumn(IntEnum):
    """Columns of a stand of trees, for kernels."""

    X = 0
    Y = 1
    RADIUS = 2
    TOP = 3
    FOOT = 4
    EAST = 5
    NORTH = 6


def stand_at_rest(scene: Scene) -> np.ndarray:
    """(T, 7) trees without wind: x, y, radius, top, foot (m), and how far the top is bent to the east and to the north (m)."""
    return np.column_stack([scene.trees, scene.tree_feet, np.zeros((len(scene.trees), 2))])


def stand_in_wind(scene: Scene, photo: int) -> np.ndarray:
    """The stand as it is while photo number `photo` is taken."""
    stand = stand_at_rest(scene)
    generator = np.random.default_rng([scene.settings.seed, _WIND, photo])
    # One gust bends all trees alike: alone it would be a tilt of the wood, so each tree moves by itself too.
    bend = generator.normal(0.0, _GUST, 2) + generator.normal(0.0, _FLUTTER, (len(stand), 2))
    stand[:, TreeColumn.EAST :] = bend * (stand[:, TreeColumn.TOP] - stand[:, TreeColumn.FOOT])[:, None]
    return stand


@njit(inline="always")
def crown_top(stand, k, seed, x, y):
    """Height of the envelope of tree `k` at (x, y), m; -inf beside it."""
    # The envelope is carried by the bend at four fifths of the height, where most of it is.
    x, y = x - 0.8 * stand[k, TreeColumn.EAST], y - 0.8 * stand[k, TreeColumn.NORTH]
    radius, foot = stand[k, TreeColumn.RADIUS], stand[k, TreeColumn.FOOT]
    d = ((x - stand[k, TreeColumn.X]) ** 2 + (y - stand[k, TreeColumn.Y]) ** 2) / (radius * radius)
    if d >= 1.0:
        return -np.inf
    d *= 1.0 + _RAGGED * (0.5 + 0.5 * value_noise(seed + _Noise.OUTLINE, x / 1.9, y / 1.9))
    if d >= 1.0:
        return -np.inf
    height = stand[k, TreeColumn.TOP] - foot
    lobes = 0.5 + 0.5 * value_noise(seed + _Noise.LOBES, x / 2.1, y / 2.1)
    rough = 0.25 * value_noise(seed + _Noise.ROUGH, x / 0.9, y / 0.9)
    return foot + height * (0.55 + 0.45 * np.sqrt(1.0 - d) - 0.14 * lobes) + rough


@njit()
def stamp_crowns(height, building, number, axes, stand, seed):
    """Raises `height` (rows, cols) to the crowns where there is no building and sets `number` to that of the tree, from 1; of two
    trees the higher one is visible. `axes`: x (cols,) and y (rows,) of the cells' centres."""
    x, y = axes
    cell = x[1] - x[0]
    for k in range(stand.shape[0]):
        reach = stand[k, TreeColumn.RADIUS] + abs(stand[k, TreeColumn.EAST]) + abs(stand[k, TreeColumn.NORTH])
        cx, cy = stand[k, TreeColumn.X], stand[k, TreeColumn.Y]
        left, right = max(int(np.floor((cx - reach - x[0]) / cell)), 0), min(int(np.ceil((cx + reach - x[0]) / cell)) + 1, len(x))
        top, bottom = max(int(np.floor((y[0] - cy - reach) / cell)), 0), min(int(np.ceil((y[0] - cy + reach) / cell)) + 1, len(y))
        for row in range(top, bottom):
            for col in range(left, right):
                if building[row, col] == 0:
                    z = crown_top(stand, k, seed, x[col], y[row])
                    if z > height[row, col] or (z > -np.inf and number[row, col] == 0):
                        height[row, col] = z
                        number[row, col] = k + 1


@njit(inline="always")
def leaves_at(stand, k, seed, x, y, z, top):
    """Brightness of the leaves of tree `k` at a point, relative to their mean; 0 where there are none. `top`: envelope above it."""
    foot = stand[k, TreeColumn.FOOT]
    height = stand[k, TreeColumn.TOP] - foot
    share = (z - foot) / height
    if z > top or share < LOWEST:
        return 0.0
    x, y = x - share * stand[k, TreeColumn.EAST], y - share * stand[k, TreeColumn.NORTH]
    radius = stand[k, TreeColumn.RADIUS]
    d = ((x - stand[k, TreeColumn.X]) ** 2 + (y - stand[k, TreeColumn.Y]) ** 2) / (radius * radius)
    # The lower side of the crown rises towards its rim.
    if d >= 1.0 or share < _SKIRT - (_SKIRT - LOWEST) * np.sqrt(1.0 - d):
        return 0.0
    filled = _SHELL if top - z < _SHELL_DEPTH else _INSIDE
    if value_noise(seed + _Noise.GAPS, x / 1.7, y / 1.7 + 0.2 * z) < _GAP:
        filled *= _GAP_SHARE
    layer, i, j = np.int64(np.floor(z / LAYER)), np.int64(np.floor(x / _CLUSTER)), np.int64(np.floor(y / _CLUSTER))
    drawn = uniform_of((seed + _Noise.CLUSTERS) * 1000003 + layer, i, j)
    return 0.0 if drawn >= filled else 0.7 + 0.6 * drawn / filled


@njit()
def leaf_colour(stand, k, seed, point, top, brightness, out):
    """Sets `out` to the colour of leaves at `point` (x, y, z): sunlit on the side of the sun, darker inside the crown."""
    x, y, z = point
    radius, foot = stand[k, TreeColumn.RADIUS], stand[k, TreeColumn.FOOT]
    east = (x - stand[k, TreeColumn.X] - 0.8 * stand[k, TreeColumn.EAST]) / radius
    north = (y - stand[k, TreeColumn.Y] - 0.8 * stand[k, TreeColumn.NORTH]) / radius
    # The normal of the dome without its lobes: their own light and shade is in the depth below the envelope.
    steep = 0.45 * (stand[k, TreeColumn.TOP] - foot) / radius / np.sqrt(max(1.0 - east * east - north * north, 0.15))
    nx, ny = east * steep, north * steep
    facing = max((nx * SUN[0] + ny * SUN[1] + SUN[2]) / np.sqrt(1.0 + nx * nx + ny * ny), 0.0)
    light = (AMBIENT + (1.0 - AMBIENT) * facing / SUN[2]) * np.exp(-_FADE * max(top - z, 0.0)) * brightness
    tone = int(4.0 * uniform_of(seed + _Noise.TONE, k, 0))
    for band in range(3):
        out[band] = np.float32(min(_LEAVES[tone, band] * light, 250.0))


@njit(inline="always")
def litter_colour(seed, x, y, out):
    """Sets `out` to the colour of the ground below crowns, in the shade."""
    factor = 0.62 * (1.0 + 0.15 * value_noise(seed + _Noise.LITTER, x / 0.8, y / 0.8))
    for band in range(3):
        out[band] = np.float32(_LITTER[band] * factor)


@njit()
def paint_crowns(colours, number, height, place, stand, seed):
    """Sets `colours` (rows, cols, 3) of cells with a crown to what four vertical rays see of it.

    number: of the tree, from 1; height: envelope (m); place: x and y of the first cell's centre, and the cell (m).
    """
    west, north, cell = place
    colour = np.zeros(3, np.float32)
    for row in range(number.shape[0]):
        for col in range(number.shape[1]):
            k = number[row, col] - 1
            if k < 0:
                continue
            total = np.zeros(3, np.float32)
            for part in range(4):
                x = west + (col + (0.25 if part & 1 else -0.25)) * cell
                y = north - (row + (0.25 if part & 2 else -0.25)) * cell
                _seen_from_above(stand, k, seed, x, y, float(height[row, col]), colour)
                total += np.float32(0.25) * colour
            for band in range(3):
                colours[row, col, band] = np.uint8(total[band] + np.float32(0.5))


@njit()
def _seen_from_above(stand, k, seed, x, y, top, out):
    """Sets `out` to the first leaves below the envelope, or the ground under the crown."""
    layer = int(np.floor(top / LAYER))
    upper = top
    while upper > stand[k, TreeColumn.FOOT]:
        lower = min(layer * LAYER, upper)
        z = 0.5 * (upper + lower)
        brightness = leaves_at(stand, k, seed, x, y, z, top)
        if brightness > 0.0:
            leaf_colour(stand, k, seed, (x, y, z), top, brightness, out)
            return
        upper = lower
        layer -= 1
    litter_colour(seed, x, y, out)


@njit()
def paint_litter(colours, covered, place, seed):
    """Sets `colours` (rows, cols, 3) of the `covered` cells to the ground below crowns; `place` as for `paint_crowns`."""
    west, north, cell = place
    colour = np.zeros(3, np.float32)
    for row in range(covered.shape[0]):
        for col in range(covered.shape[1]):
            if covered[row, col]:
                litter_colour(seed, west + col * cell, north - row * cell, colour)
                for band in range(3):
                    colours[row, col, band] = np.uint8(colour[band] + np.float32(0.5))
