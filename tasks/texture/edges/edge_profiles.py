"""How strongly a photograph changes across an edge, at places across it: profiles of the height of the upper surface.

A piece of the edge is a few cells long, in three parts; the colours of each part are averaged along the edge, so that a profile has
the precision of all its pixels. Around a place a photograph is an affine picture of the plane.
"""

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from orthomill.tasks.colouring.sampling.photograph_colours import PhotoPixelsAt, colours_at
from orthomill.tasks.geometry.view import View

HALF_PIECE = 4.0
"""cells to both sides of a place along the edge"""
SEARCH = 1.5
"""cells to both sides of a place across which the edge may lie"""
SHIFT = 1.0
"""cells by which a height that is wrong may displace the edge in a photograph besides"""
PARTS = 3
"""of a piece along the edge"""
ROWS = 3
"""profiles of a part"""
STEPS = 2
"""values of a profile for a pixel"""
_BLUR = 0.7  # px: standard deviation of the Gaussian whose derivative is taken
_FADE = 3.0  # px that a profile is longer than its changes


class EdgePlanes(NamedTuple):
    """Places (N,) in space: `point` (N, 3) m; `normal` and `tangent` (N, 2), unit vectors (x, y) across and along the edge;
    `across` and `along` (N,), slopes of the upper surface in these directions, m per m."""

    point: np.ndarray
    normal: np.ndarray
    tangent: np.ndarray
    across: np.ndarray
    along: np.ndarray


def offsets(divisor: int) -> np.ndarray:
    """Distances (S,) px across the edge of the values of a profile."""
    reach = round((SEARCH + SHIFT) * divisor * STEPS)
    return np.arange(-reach, reach + 1) / STEPS


def along_parts(divisor: int) -> np.ndarray:
    """Distances (PARTS, ROWS) px along the edge of the profiles whose mean is that of a part."""
    each = 2.0 * HALF_PIECE * divisor / (PARTS * ROWS)
    return (each * (np.arange(PARTS * ROWS) - 0.5 * (PARTS * ROWS - 1))).reshape(PARTS, ROWS)


def edge_changes(view: View, part: PhotoPixelsAt, planes: EdgePlanes, cell: float, divisor: int) -> np.ndarray:
    """Changes (N, PARTS, S) float32 of the photograph across the edges, grey levels per px, root of the sum over the channels; NaN
    where it does not show a place. `cell`: side of a pixel of the orthoimage, m."""
    s, a = offsets(divisor), along_parts(divisor)
    wide = np.arange(s[0] * STEPS - _FADE * STEPS, s[-1] * STEPS + _FADE * STEPS + 1) / STEPS
    out = np.full((len(planes.point), PARTS, len(s)), np.nan, np.float32)
    shown, colours = edge_colours(view, part, planes, cell, a.ravel(), wide)
    rows = colours.reshape(len(shown), PARTS, ROWS, len(wide), colours.shape[-1])
    # Of so few rows a mean along the axis takes longer than all the rest.
    mean = sum((rows[:, :, k] for k in range(ROWS)), np.float32(0)) / np.float32(ROWS)
    slope = ndimage.gaussian_filter1d(mean, _BLUR * STEPS, axis=2, order=1, truncate=_FADE) * STEPS
    fade = round(_FADE * STEPS)
    out[shown] = np.sqrt((slope[:, :, fade:-fade] ** 2).sum(axis=-1))
    return out


def edge_colours(
    view: View, part: PhotoPixelsAt, planes: EdgePlanes, cell: float, along: np.ndarray, across: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (M,) of the places whose piece the photograph shows, and its colours (M, T, S, bands) float32 at the distances
    `along` (T,) and `across` (S,) px of the orthoimage, NaN where the part does not hold them. `cell`: side of its pixel, m."""
    foot, right, up = (view.project(point) for point in _frame_points(planes, cell))
    right, up = right - foot, up - foot
    # A piece is a parallelogram in the photograph: it is inside if its corners are.
    corners = [foot + t * up + u * right for t in (along.min(), along.max()) for u in (across[0], across[-1])]
    shown = np.flatnonzero(np.all([view.contains(corner, 1.0) for corner in corners], axis=0))
    foot, right, up = (vectors[shown, None, None] for vectors in (foot, right, up))
    places = foot + along[:, None, None] * up + across[:, None] * right
    colour, held = colours_at(part, (view.camera.height, view.camera.width), places.reshape(-1, 2))
    colour[~held] = np.nan
    return shown, colour.reshape(*places.shape[:-1], colour.shape[1])


def _frame_points(planes: EdgePlanes, cell: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (N, 3) m: the places, and those a pixel across and along from them on the plane of the upper surface."""
    out = [planes.point]
    for direction, slope in ((planes.normal, planes.across), (planes.tangent, planes.along)):
        out.append(planes.point + cell * np.column_stack([direction, slope]))
    return out[0], out[1], out[2]


def lean_of(centre: np.ndarray, planes: EdgePlanes) -> np.ndarray:
    """How far (N,) a metre of height displaces the edge outwards on the plane of the upper surface, m."""
    away = planes.point - centre
    tangent = (away[:, :2] * planes.normal).sum(axis=1) / np.maximum(-away[:, 2], 1e-6)
    # Where the plane rises with the ray, it is met sooner.
    return tangent / np.maximum(1.0 + tangent * planes.across, 0.2)
