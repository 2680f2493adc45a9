"""What is above the ground without standing on all of it: crowns that sway, and wires. Rays pass through their gaps and below.

While a photo is rendered the cells below such things are columns up to their top, with the ground inside: a ray that enters one
meets leaves, the wire or the ground, or leaves it again and walks on.
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.truth import Material
from orthomill.tasks.simulation.scene.crowns import LAYER, LOWEST, TreeColumn, leaves_at, paint_litter, stamp_crowns, stand_in_wind
from orthomill.tasks.simulation.scene.ground_texture import PaintedWindow
from orthomill.tasks.simulation.scene.layout import Scene
from orthomill.tasks.simulation.scene.scene import SurfaceWindow, bare_ground
from orthomill.tasks.simulation.scene.traversal import NOTHING, TOP, exit_of, first_hit
from orthomill.tasks.simulation.scene.wires import (
    POLE_COLOUR,
    POLE_NUMBER,
    WIRE_RADIUS,
    SpanColumn,
    near_spans,
    off_span,
    spans_of,
    wire_height,
)

LEAF, CABLE = 3, 4
"""What a ray met, beside the codes of traversal.py: leaves of a crown, a wire."""
_NUDGE = 1e-6  # m: a walk that goes on behind a cell must not find itself in that cell again by rounding


class Aloft(NamedTuple):
    """number int32 (rows, cols): of the tree, from 1; of the span of wire, from -1 downwards; 0 where there is nothing.

    ground float32 (rows, cols) m: below them. The stand and the spans as in crowns.py and wires.py; the grid's corner and cell (m).
    """

    number: np.ndarray
    ground: np.ndarray
    stand: np.ndarray
    spans: np.ndarray
    west: float
    north: float
    cell: float
    seed: int


def nothing_aloft() -> Aloft:
    """A scene in which every column is solid."""
    return Aloft(
        number=np.zeros((0, 0), np.int32),
        ground=np.zeros((0, 0), np.float32),
        stand=np.zeros((0, 7)),
        spans=np.zeros((0, 6)),
        west=0.0,
        north=0.0,
        cell=1.0,
        seed=0,
    )


def lifted(scene: Scene, painted: PaintedWindow, grid: MapGrid, window: Window, photo: int) -> tuple[PaintedWindow, Aloft]:
    """The window while photo number `photo` is taken, with the ground under its crowns and wires, and poles."""
    x, y = grid.centres(window)
    surface = painted.surface
    height, colours, building = surface.height.copy(), painted.colours.copy(), surface.building.copy()
    crowned = surface.material == Material.TREE
    _uncover(scene, height, crowned, x, y)
    paint_litter(colours, crowned, (float(x[0]), float(y[0]), grid.cell), scene.settings.seed)
    material = np.where(crowned, np.uint8(Material.OPEN_GROUND), surface.material)
    spans = spans_of(scene)
    _set_poles(height, colours, building, (x, y), spans, max(0.5 * grid.cell, 0.2))
    stand, number, ground = stand_in_wind(scene, photo), np.zeros(window.shape, np.int32), height.copy()
    stamp_crowns(height, building, number, (x, y), stand, scene.settings.seed)
    _hang_wires(height, building, number, (x, y), spans)
    aloft = Aloft(
        number=number,
        ground=ground,
        stand=stand,
        spans=spans,
        west=float(grid.west),
        north=float(grid.north),
        cell=grid.cell,
        seed=scene.settings.seed,
    )
    return PaintedWindow(SurfaceWindow(height, material, building), colours), aloft


def _uncover(scene: Scene, height: np.ndarray, crowned: np.ndarray, x: np.ndarray, y: np.ndarray) -> None:
    """Sets the crowned cells of `height` to the ground below them."""
    rows, cols = np.flatnonzero(crowned.any(axis=1)), np.flatnonzero(crowned.any(axis=0))
    if len(rows):
        part = slice(rows[0], rows[-1] + 1), slice(cols[0], cols[-1] + 1)
        ground = bare_ground(scene, x[part[1]], y[part[0]]).astype(np.float32)
        height[part] = np.where(crowned[part], ground, height[part])


def _set_poles(
    height: np.ndarray,
    colours: np.ndarray,
    building: np.ndarray,
    axes: tuple[np.ndarray, np.ndarray],
    spans: np.ndarray,
    half: float,
) -> None:
    """Columns of one or two cells' width up to the ends of the spans."""
    x, y = axes
    for px, py, pz in (
        *spans[:, [SpanColumn.X, SpanColumn.Y, SpanColumn.Z]],
        *spans[:, [SpanColumn.TO_X, SpanColumn.TO_Y, SpanColumn.TO_Z]],
    ):
        at = np.ix_(np.flatnonzero(np.abs(y - py) <= half), np.flatnonzero(np.abs(x - px) <= half))
        height[at], building[at], colours[at] = pz, POLE_NUMBER, POLE_COLOUR


@njit()
def _hang_wires(height, building, number, axes, spans):
    """Raises cells that a wire crosses to its top, where nothing else stands."""
    x, y = axes
    near = np.zeros(height.shape, np.int32)
    # A cell's corner is 0.71 cells from its centre.
    near_spans(near, axes, spans, 0.75 * (x[1] - x[0]) + WIRE_RADIUS)
    for row in range(height.shape[0]):
        for col in range(height.shape[1]):
            k = near[row, col]
            if k > 0 and number[row, col] == 0 and building[row, col] == 0:
                share, _ = off_span(spans[k - 1], x[col], y[row])
                z = wire_height(spans[k - 1], share) + WIRE_RADIUS
                if z > height[row, col]:
                    height[row, col] = z
                    number[row, col] = -k


@njit()
def first_seen(columns, aloft, ray, start, end):
    """As `first_hit`, but rays pass through the gaps of what is aloft."""
    kind, s, row, col = first_hit(columns, ray, start, end)
    # Most scenes under a ray are solid; only here the walk is interrupted and goes on behind the cell.
    while kind != NOTHING and aloft.number.shape[0] > 0 and aloft.number[row, col] != 0:
        leave, _ = exit_of(col + columns.col, row + columns.row, 1.0, ray)
        met, depth = _met_aloft(aloft, ray, row, col, float(columns.tops[row, col, 0]), s, leave)
        if met != NOTHING:
            return met, depth, row, col
        kind, s, row, col = first_hit(columns, ray, leave + _NUDGE, end)
    return kind, s, row, col


@njit()
def _met_aloft(aloft, ray, row, col, top, enter, leave):
    """What a ray meets in the cell (row, col) below `top` (m) between the depths `enter` and `leave`: (kind, depth)."""
    number = aloft.number[row, col]
    ground = aloft.ground[row, col]
    leave = min(leave, ray.z0 - ground)
    if number > 0:
        depth = _first_leaves(aloft, ray, number - 1, top, enter, leave)
        if depth >= 0.0:
            return LEAF, depth
    elif number < 0:
        span = aloft.spans[-number - 1]
        depth = ray.z0 - (top - WIRE_RADIUS)
        if enter <= depth <= leave:
            x, y = aloft.west + aloft.cell * (ray.u0 + depth * ray.du), aloft.north - aloft.cell * (ray.v0 + depth * ray.dv)
            _, distance = off_span(span, x, y)
            if distance <= WIRE_RADIUS:
                return CABLE, depth
    if ray.z0 - leave <= ground:
        return TOP, max(enter, ray.z0 - ground)
    return NOTHING, leave


@njit()
def _first_leaves(aloft, ray, k, top, enter, leave):
    """The depth at which the ray meets leaves of tree `k`, layer by layer; -1 where it meets none."""
    foot = aloft.stand[k, TreeColumn.FOOT]
    end = min(leave, ray.z0 - foot - LOWEST * (aloft.stand[k, TreeColumn.TOP] - foot))
    layer = np.floor((ray.z0 - enter) / LAYER)
    while enter < end:
        upto = min(ray.z0 - layer * LAYER, end)
        if upto > enter:
            # The middle of the ray's way through the layer: at its ends rounding would decide about the layer.
            s = 0.5 * (enter + upto)
            x, y = aloft.west + aloft.cell * (ray.u0 + s * ray.du), aloft.north - aloft.cell * (ray.v0 + s * ray.dv)
            if leaves_at(aloft.stand, k, aloft.seed, x, y, ray.z0 - s, top) > 0.0:
                return s
            enter = upto
        layer -= 1.0
    return -1.0
