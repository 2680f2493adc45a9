"""How straight the edges of roofs are in an orthoimage: the departure of an edge from its best straight line.

Strategy. Roofs of the truth have straight sides. At places along them profiles across the edge are compared with those of the true
orthoimage, one beside the other over a piece of the side: where the true profile is found again says how far the edge is displaced
there. A piece that is displaced or turned as a whole is still straight, so a line is taken off; what is left is the comb that a
surface of cells makes of an eave.
"""

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from orthomill.tasks.imagery.edge_departures import peak_between, without_line

SPACING = 8
"""px: about one place in so many along an edge"""
_ALONG, _ACROSS, _SEARCH = 10, 4.0, 6.0
"""px to both sides of a place: length of the piece, of the profiles, and how far the edge is looked for"""
_STEP = 0.5
"""px between the values of a profile"""
_SMOOTH = 2.0
"""px: the direction of an edge is that of the roof smoothed so far"""
_CONTRAST, _ALIKE, _ENOUGH = 6.0, 0.7, 15
"""grey levels of a true profile (standard deviation), correlation, and profiles of a piece that are needed for a judgement"""


class EdgeLines(NamedTuple):
    """Sum of the squared departures from the line, px^2, and their number."""

    squares: float
    places: int


def edge_lines(
    grey: np.ndarray, true_grey: np.ndarray, roof: np.ndarray, seen: np.ndarray, corner: tuple[int, int], core: tuple[slice, slice]
) -> EdgeLines:
    """Sums of the departures of the edges of roofs whose places lie in `core`; arguments as of `departures`."""
    left = departures(grey, true_grey, roof, seen, corner, core)
    return EdgeLines(float(np.nansum(left**2)), int(np.isfinite(left).sum()))


def departures(
    grey: np.ndarray, true_grey: np.ndarray, roof: np.ndarray, seen: np.ndarray, corner: tuple[int, int], core: tuple[slice, slice]
) -> np.ndarray:
    """Departures (pieces, profiles) px of the edges of roofs, whose places lie in `core`, from their lines; NaN where the edge is
    not found.

    grey, true_grey (rows, cols): mean of the channels, NaN where unknown; roof and seen (rows, cols) bool: of the truth, and where
    places count; corner: row and column of the first pixel in the whole image, so that every tiling takes the same places.
    """
    place = np.argwhere(_places(roof, corner, core) & seen)
    if not len(place):
        return np.zeros((0, 2 * _ALONG + 1))
    away = _displacements(grey, true_grey, place.astype(np.float64), _normals(roof, place))
    known = np.isfinite(away)
    pieces = away[known.sum(axis=1) >= _ENOUGH]
    return without_line(pieces)


def _places(roof: np.ndarray, corner: tuple[int, int], core: tuple[slice, slice]) -> np.ndarray:
    """(rows, cols) bool: pixels of roofs along their edges, about one in SPACING of them, in the core."""
    edge = roof & ~ndimage.binary_erosion(roof, border_value=1)
    row, col = np.indices(roof.shape)
    chosen = np.zeros(roof.shape, bool)
    chosen[core] = (edge & ((3 * (row + corner[0]) + col + corner[1]) % SPACING == 0))[core]
    return chosen


def _normals(roof: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Unit vectors (places, 2) (row, col) across the edge, from the roof outwards."""
    smooth = ndimage.gaussian_filter(roof.astype(np.float64), _SMOOTH)
    down, right = (-slope[tuple(place.T)] for slope in np.gradient(smooth))
    return np.column_stack([down, right]) / np.maximum(np.hypot(down, right), 1e-12)[:, None]


def _displacements(grey: np.ndarray, true_grey: np.ndarray, place: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """How far (places, profiles) the edge lies outwards of the true one, px; NaN where it is not found."""
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    along = np.arange(-_ALONG, _ALONG + 1)
    foot = place[:, None] + along[:, None] * tangent[:, None]
    tried = int(_SEARCH / _STEP)
    true = _profiles(true_grey, foot, normal, _ACROSS)
    found = _profiles(grey, foot, normal, _ACROSS + _SEARCH)
    pieces = np.lib.stride_tricks.sliding_window_view(found, true.shape[-1], axis=-1)
    alike = _correlation(pieces, true[..., None, :])
    alike = np.where(np.isfinite(alike) & (true.std(axis=-1) >= _CONTRAST)[..., None], alike, -1.0)
    best = np.argmax(alike, axis=-1)
    inside = np.clip(best, 1, 2 * tried - 1)
    # At the ends of the search the edge may lie anywhere beyond.
    sure = (best == inside) & (alike.max(axis=-1) >= _ALIKE)
    return np.where(sure, (inside - tried + peak_between(alike, inside)) * _STEP, np.nan)


def _profiles(image: np.ndarray, foot: np.ndarray, normal: np.ndarray, reach: float) -> np.ndarray:
    """Values (places, profiles, steps) across the edges, bilinear; NaN beyond the image."""
    steps = np.arange(-round(reach / _STEP), round(reach / _STEP) + 1) * _STEP
    at = foot[:, :, None] + steps[:, None] * normal[:, None, None]
    return ndimage.map_coordinates(image.astype(np.float64), [at[..., 0], at[..., 1]], order=1, cval=np.nan)


def _correlation(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Of the last axis."""
    one, other = (values - values.mean(axis=-1, keepdims=True) for values in (one, other))
    spread = np.sqrt((one**2).sum(axis=-1) * (other**2).sum(axis=-1))
    return (one * other).sum(axis=-1) / np.where(spread > 0, spread, np.nan)
