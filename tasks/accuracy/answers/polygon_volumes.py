"""Volume and area of a polygon on a surface: above a level, above the plane through its border, or against another surface.

A cell counts by the part of it that lies inside. Cut is what lies above the base, fill what lies below. Noise alone makes some of
both out of nothing: that part is told beside them, not subtracted.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from orthomill.tasks.accuracy.answers.error_correlation import ErrorCorrelation
from orthomill.tasks.accuracy.answers.linear_answer import ErrorShares, SurfacePart, error_of

_FINE = 4
"""subdivisions of a cell along a side, by which its part inside a polygon is counted"""
BORDER = 3.0
"""cells from the border within which the plane through it is fitted"""
_MOSTLY = 0.5
"""share of these cells that must be measured for the plane to rest on measured ones alone"""


@dataclass(frozen=True)
class VolumeAnswer:
    """A volume in m3 with the parts of its standard error; cut and fill with theirs."""

    volume: float
    error: ErrorShares
    cut: float
    cut_sigma: float
    fill: float
    fill_sigma: float
    noise: float
    """m3 of cut and of fill each that noise alone would make of ground that lies on the base"""
    area: float
    """m2 with heights"""
    missing: float
    """m2 of the polygon without heights: in no figure"""
    estimated: float
    """share of the area whose heights are estimated"""


def inside_share(ring: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Which part of each cell (rows, cols) lies in a polygon; ring (N, 2) (col, row), cell centres at whole numbers."""
    rows, cols = shape
    y = (np.arange(rows * _FINE) + 0.5) / _FINE - 0.5
    x = (np.arange(cols * _FINE) + 0.5) / _FINE - 0.5
    filled = np.zeros((rows * _FINE, cols * _FINE), bool)
    a, b = ring, np.roll(ring, -1, axis=0)
    for i, at in enumerate(y):
        crosses = (a[:, 1] <= at) != (b[:, 1] <= at)
        if crosses.any():
            p, q = a[crosses], b[crosses]
            where = np.sort(p[:, 0] + (at - p[:, 1]) / (q[:, 1] - p[:, 1]) * (q[:, 0] - p[:, 0]))
            filled[i] = np.searchsorted(where, x) % 2 == 1
    return filled.reshape(rows, _FINE, cols, _FINE).mean(axis=(1, 3))


def volume_of(
    part: SurfacePart, share: np.ndarray, cell: float, base: np.ndarray | float | None, correlation: ErrorCorrelation
) -> VolumeAnswer:
    """The volume of a polygon.

    share (rows, cols) of each cell inside; base: a level m, heights (rows, cols) m without errors of their own, or None for the
    plane through the border of the polygon: through its measured cells, where most are, for a guess there moves the whole base.
    """
    known = np.isfinite(part.height) & (share > 0)
    if isinstance(base, np.ndarray):
        known &= np.isfinite(base)
    area = np.where(known, share, 0.0) * cell**2
    heights = np.where(known, part.height, 0.0).astype(np.float64)
    weights = volume_weights(area, part.measured, border=base is None)
    level = _border_plane(area, part.measured)[1](heights) if base is None else np.broadcast_to(np.asarray(base), known.shape)
    above, total = np.where(known, heights - level, 0.0), float(area.sum())
    spread = np.where(known, np.hypot(np.nan_to_num(part.relative), np.nan_to_num(part.datum)), 0.0)
    cut, fill = (float((area * np.maximum(side * above, 0.0)).sum()) for side in (1.0, -1.0))
    signs = [np.where(known & (side * above > 0), side * area, 0.0) for side in (1.0, -1.0)]
    return VolumeAnswer(
        volume=float((area * above).sum()),
        error=error_of(weights, part, correlation),
        cut=cut,
        cut_sigma=error_of(signs[0], part, correlation).sigma,
        fill=fill,
        fill_sigma=error_of(signs[1], part, correlation).sigma,
        noise=_of_noise(area, above, spread),
        area=total,
        missing=float((share * cell**2).sum()) - total,
        estimated=float(area[known & ~part.measured].sum() / total) if total else 0.0,
    )


def volume_weights(area: np.ndarray, measured: np.ndarray, border: bool) -> np.ndarray:
    """The weight m2 of each cell in a volume, from its area inside (rows, cols) m2 and whether it is measured: above a level, or
    above the plane through the border of the polygon."""
    return area - _border_plane(area, measured)[0] if border else area


def _border_plane(area: np.ndarray, measured: np.ndarray) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
    """What the volume under the plane through the cells near the border takes back from each cell's weight (rows, cols) m2, and the
    plane (rows, cols) itself for heights (rows, cols)."""
    from scipy.ndimage import distance_transform_edt

    border = (area > 0) & (distance_transform_edt(np.pad(area > 0, 1))[1:-1, 1:-1] <= BORDER)
    if (border & measured).sum() >= _MOSTLY * border.sum():
        border &= measured
    rows, cols = np.indices(area.shape, dtype=np.float64)
    design = np.stack([np.ones_like(rows), rows - rows.mean(), cols - cols.mean()], axis=-1)
    inverse = np.linalg.pinv(design[border].T @ design[border])
    back = np.zeros_like(area)
    back[border] = design[border] @ (inverse @ np.einsum("ij,ijk->k", area, design))
    return back, lambda heights: design @ (inverse @ (design[border].T @ heights[border]))


def _of_noise(area: np.ndarray, above: np.ndarray, spread: np.ndarray) -> float:
    """Expected max(d, 0) of normal errors beyond that of the heights themselves: cells near the base count for both sides."""
    used = (area > 0) & (spread > 0)
    z = np.abs(above[used]) / spread[used]
    return float((area[used] * spread[used] * (np.exp(-(z**2) / 2) / math.sqrt(2 * math.pi) - z * ndtr(-z))).sum())


def area_of(ring: np.ndarray, sigma: float) -> tuple[float, float]:
    """Area (m2) of a polygon in plan and its standard error; ring (N, 2) m, sigma: that of a coordinate of a corner, m."""
    after, before = np.roll(ring, -1, axis=0), np.roll(ring, 1, axis=0)
    area = 0.5 * abs(float((ring[:, 0] * after[:, 1] - after[:, 0] * ring[:, 1]).sum()))
    return area, 0.5 * sigma * float(np.sqrt(((after - before) ** 2).sum()))


def crosses_itself(ring: np.ndarray) -> bool:
    """Whether two sides of a polygon cross: it then encloses parts on both hands, whose areas take each other away; ring (N, 2)."""
    ends = np.roll(ring, -1, axis=0)
    for k in range(len(ring) - 2):
        # A side against those after its neighbour: touching ends are no crossing.
        first, last, starts, stops = ring[k], ends[k], ring[k + 2 :], ends[k + 2 :]
        apart = _side(first, last, starts) * _side(first, last, stops) < 0
        if (apart & (_side(starts, stops, first) * _side(starts, stops, last) < 0)).any():
            return True
    return False


def _side(first: np.ndarray, last: np.ndarray, place: np.ndarray) -> np.ndarray:
    """-1, 0 or 1: on which side of the line from `first` to `last` places (..., 2) lie."""
    along, to = last - first, place - first
    return np.sign(along[..., 0] * to[..., 1] - along[..., 1] * to[..., 0])
