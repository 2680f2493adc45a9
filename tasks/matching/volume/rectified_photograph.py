"""A photograph rectified once for a whole volume, and where the cells of the volume lie in it at every candidate.

Strategy. The photograph is resampled to a horizontal plane Z0, oriented as the map and free of distortion. A cell at another
height Z lies in that image where the ray through it meets Z0: about the nadir point this is a similarity, X' = Xc + (X - Xc) s
with s = (Zc - Z0) / (Zc - Z), exactly. So signatures are computed once, and a candidate costs two multiplications and a lookup.
An epipolar pair has the same form: s = 1, and the right image is offset by the parallax.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.geometry.view import View, ViewNumbers, project_point
from orthomill.tasks.imagery.pyramid import full_to_level

_NODES = 8
"""px of the rectified image between exactly projected points: between them the projection is linear to 0.01 px, even 45 deg off
nadir"""
_WIDEST = 3.0
"""Sides of a rectified image in sides of the cells it serves; what lies farther out is seen under a very flat angle only."""
_ABOVE = 0.05
"""share of the distance to Z0 that a projection centre must stay above a plane"""


@dataclass(frozen=True, eq=False)
class RectifiedPhotograph:
    """Signatures (rows, cols) of a rectified image, and per candidate plane (K, 3) float64 (scale, column, row): the cell (r, c) of
    the volume lies at column scale * c + column, row scale * r + row. A plane that the photograph cannot show has NaN. `pixel`: the
    side of a pixel of the photograph itself, in cells."""

    signatures: np.ndarray
    planes: np.ndarray
    pixel: float = 1.0


@dataclass(frozen=True)
class CellFrame:
    """Where the cells of a volume lie: the centre of the first cell (m), the side of a cell (m), and their number."""

    x: float
    y: float
    cell: float
    rows: int
    cols: int


@dataclass(frozen=True, eq=False)
class PhotographPixels:
    """Grey values float32 (rows, cols) of a pyramid level; `col`, `row` the place of the first one in the whole level."""

    grey: np.ndarray
    level: int
    col: int
    row: int


@dataclass(frozen=True)
class PlaneFrame:
    """Pixels of an image on a horizontal plane: centre of the first one (m), pitch (m), and their number."""

    x: float
    y: float
    pitch: float
    rows: int
    cols: int


def plane_scales(view: View, heights: np.ndarray, reference: float) -> np.ndarray:
    """Scales s (K,) of the similarity from the planes `heights` to the plane `reference` (m); NaN above the projection centre."""
    above, distance = view.centre[2] - heights, view.centre[2] - reference
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(above > _ABOVE * abs(distance), distance / above, np.nan)


def reference_plane(view: View, heights: np.ndarray) -> float:
    """The height (m) to which a photograph is rectified: the middle of the planes that lie below it."""
    below = heights[heights < view.centre[2]]
    return float((below[0] + below[-1]) / 2) if len(below) else float(view.centre[2] - 1.0)


def rectified(
    pixels: PhotographPixels, view: View, cells: CellFrame, heights: np.ndarray, oversampling: int
) -> tuple[np.ndarray, np.ndarray]:
    """A photograph on the middle plane: grey values float32, NaN where it shows nothing, and the planes (see RectifiedPhotograph).

    heights (K,) m, ascending; `oversampling` pixels of the rectified image along the side of a cell.
    """
    z0 = reference_plane(view, heights)
    scales = plane_scales(view, heights, z0)
    frame = _frame(view, cells, heights, oversampling)
    scale = scales * cells.cell / frame.pitch
    col = (view.centre[0] - frame.x + scales * (cells.x - view.centre[0])) / frame.pitch
    row = (frame.y - view.centre[1] - scales * (cells.y - view.centre[1])) / frame.pitch
    return on_plane(pixels, view, frame, z0), np.column_stack([scale, col, row])


def on_plane(pixels: PhotographPixels, view: View, frame: PlaneFrame, z: float) -> np.ndarray:
    """A photograph on the horizontal plane z (m): grey values (frame.rows, frame.cols) float32, NaN where it shows nothing."""
    x = frame.x + frame.pitch * np.arange(0, frame.cols + _NODES, _NODES)
    y = frame.y - frame.pitch * np.arange(0, frame.rows + _NODES, _NODES)
    nodes = _nodes(view.numbers, x, y, z)
    level = full_to_level(nodes, pixels.level) - np.array([pixels.col, pixels.row])
    out = np.empty((frame.rows, frame.cols), np.float32)
    _resample(np.ascontiguousarray(pixels.grey), level.astype(np.float32), out)
    return out


def rectified_pixels(view: View, cells: CellFrame, heights: np.ndarray, oversampling: int) -> int:
    """Pixels of the rectified image; memory is planned with it."""
    frame = _frame(view, cells, heights, oversampling)
    return frame.rows * frame.cols


def _frame(view: View, cells: CellFrame, heights: np.ndarray, oversampling: int) -> PlaneFrame:
    """The pixels that the cells need at any of the planes."""
    pitch, reference = cells.cell / oversampling, reference_plane(view, heights)
    scales = plane_scales(view, heights, reference)
    known = scales[np.isfinite(scales)]
    ends = np.array([known.min(), known.max()]) if len(known) else np.ones(2)
    x = np.array([cells.x, cells.x + (cells.cols - 1) * cells.cell])
    y = np.array([cells.y - (cells.rows - 1) * cells.cell, cells.y])
    bounds = []
    shown = _footprint(view, reference)
    for axis, side in ((0, x), (1, y)):
        centre = view.centre[axis]
        reached = centre + (side[None, :] - centre) * ends[:, None]
        spare = 0.5 * (_WIDEST - 1.0) * (side[1] - side[0] + cells.cell)
        low, high = max(reached.min(), side[0] - spare, shown[0][axis]), min(reached.max(), side[1] + spare, shown[1][axis])
        bounds.append((low, max(low, high)))
    (west, east), (south, north) = bounds
    return PlaneFrame(west, north, pitch, int(np.ceil((north - south) / pitch)) + 2, int(np.ceil((east - west) / pitch)) + 2)


def _footprint(view: View, z: float) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest X and Y (2,), (2,) m of what the photograph shows of the plane z; infinite when it shows the horizon."""
    along = np.linspace(0.0, 1.0, 9)
    col, row = (view.camera.width - 1) * along, (view.camera.height - 1) * along
    sides = [(col, 0 * col), (col, 0 * col + row[-1]), (0 * row, row), (0 * row + col[-1], row)]
    ground = view.at_height(np.concatenate([np.column_stack(side) for side in sides]), z)[:, :2]
    if np.isnan(ground).any():
        return np.full(2, -np.inf), np.full(2, np.inf)
    return ground.min(axis=0), ground.max(axis=0)


@njit()
def _nodes(n: ViewNumbers, x, y, z):
    """(r, c, 2): pixels (col, row) of the ground at `x` (c,), `y` (r,) and the height `z`, m."""
    out = np.empty((y.size, x.size, 2))
    for i in range(y.size):
        for j in range(x.size):
            out[i, j, 0], out[i, j, 1], _ = project_point(n, x[j], y[i], z)
    return out


@njit()
def _resample(grey, nodes, out):
    """Bilinear; the places of the pixels are interpolated between the nodes, every _NODES pixels."""
    rows, cols = grey.shape
    place = np.empty((2, out.shape[1]), np.float32)
    step = np.float32(1.0 / _NODES)
    for i in range(out.shape[0]):
        a, t = i // _NODES, np.float32(i % _NODES) * step
        for b in range((out.shape[1] + _NODES - 1) // _NODES):
            for q in range(2):
                here = nodes[a, b, q] + t * (nodes[a + 1, b, q] - nodes[a, b, q])
                there = nodes[a, b + 1, q] + t * (nodes[a + 1, b + 1, q] - nodes[a, b + 1, q])
                for j in range(b * _NODES, min((b + 1) * _NODES, out.shape[1])):
                    place[q, j] = here + np.float32(j - b * _NODES) * step * (there - here)
        for j in range(out.shape[1]):
            c, r = place[0, j], place[1, j]
            # Stated as "not inside", so that places behind the camera (NaN) have no value either.
            if not (c >= 0 and r >= 0 and c <= cols - 1 and r <= rows - 1):
                out[i, j] = np.float32(np.nan)
                continue
            left, top = min(int(c), cols - 2), min(int(r), rows - 2)
            u, v = c - np.float32(left), r - np.float32(top)
            upper = grey[top, left] + u * (grey[top, left + 1] - grey[top, left])
            lower = grey[top + 1, left] + u * (grey[top + 1, left + 1] - grey[top + 1, left])
            out[i, j] = upper + v * (lower - upper)
