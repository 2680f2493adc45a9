"""Edges of roofs and walls at places along them: their positions in space, measured in all photographs."""

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np

from orthomill.schemas.job import Columns
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.colouring.edges.sharpened_ground import PartedPixels
from orthomill.tasks.colouring.sampling.balanced_photograph import BalancedPhotograph
from orthomill.tasks.texture.edges.edge_places import edge_places
from orthomill.tasks.texture.edges.edge_positions import edge_fits
from orthomill.tasks.texture.edges.edge_profiles import EdgePlanes, along_parts, edge_changes, lean_of

_AT_ONCE = 256  # places whose profiles are held
_COUNTS = ("photos", "asked")


@dataclass(frozen=True)
class MeasuredEdges(Columns):
    """One row for every place along an edge that two photographs or more show."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    """float64 m: on the edge"""
    away_x: np.ndarray
    away_y: np.ndarray
    """float64: unit vector across the edge, from the upper surface outwards"""
    climb: np.ndarray
    """float64 m per m: slope of the edge to the left of that vector"""
    step: np.ndarray
    """float64 m: from the lower surface up to the edge"""
    sigma_across: np.ndarray
    sigma_height: np.ndarray
    """float64 m: standard errors across the edge and of its height, among photographs of the block"""
    rms: np.ndarray
    """float64 px of the orthoimage: of the residuals in the photographs"""
    photos: np.ndarray
    asked: np.ndarray
    """int64: photographs that show the edge, and those that show the place"""


def measured_edges(
    parted: PartedPixels | None, grid: MapGrid, window: Window, core: Window, photos: list[BalancedPhotograph], divisor: int
) -> MeasuredEdges:
    """The edges whose places lie in the pixels `core` of `window`, to which `parted` belongs; None where there are no walls.

    `divisor`: pixels along a cell; photos: the parts that show HALO cells around the core.
    """
    if parted is None:
        return no_edges()
    known = np.isfinite(parted.upper) & np.isfinite(parted.lower)
    places = edge_places(parted.raised, known, (window.row, window.col), core.within(window).slices, divisor)
    at = places.row, places.col
    x = grid.west + (window.col + places.col + 0.5) * grid.cell
    y = grid.north - (window.row + places.row + 0.5) * grid.cell
    # Rows run to the south.
    normal = places.normal * np.array([1.0, -1.0])
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    slopes = parted.slopes[at].astype(np.float64) * np.array([1.0, -1.0]) / (grid.cell * divisor)
    height = parted.upper[at].astype(np.float64)
    across, along = (slopes * normal).sum(axis=1), (slopes * tangent).sum(axis=1)
    planes, step = EdgePlanes(np.column_stack([x, y, height]), normal, tangent, across, along), height - parted.lower[at]
    some = [slice(first, first + _AT_ONCE) for first in range(0, max(len(x), 1), _AT_ONCE)]
    return joined_edges(
        [_measured(EdgePlanes(*(values[part] for values in planes)), step[part], photos, grid.cell, divisor) for part in some]
    )


def no_edges() -> MeasuredEdges:
    """The table without rows."""
    return MeasuredEdges(**{f.name: np.zeros(0, np.int64 if f.name in _COUNTS else np.float64) for f in fields(MeasuredEdges)})


def joined_edges(parts: Iterable[MeasuredEdges]) -> MeasuredEdges:
    """All places, one after the other."""
    kept = list(parts)
    return MeasuredEdges(**{f.name: np.concatenate([getattr(part, f.name) for part in kept]) for f in fields(MeasuredEdges)})


def _measured(planes: EdgePlanes, step: np.ndarray, photos: list[BalancedPhotograph], cell: float, divisor: int) -> MeasuredEdges:
    if not photos or not len(step):
        return no_edges()
    changes = [edge_changes(photo.view, photo.part, planes, cell, divisor) for photo in photos]
    lean = np.column_stack([lean_of(photo.view.centre, planes) / cell for photo in photos])
    fit = edge_fits(np.stack(changes, axis=1), lean, along_parts(divisor).mean(axis=1), cell, divisor)
    found = fit.photos >= 2
    across, turn = fit.across[found] * cell, fit.turn[found]
    point, normal, tangent = planes.point[found], planes.normal[found], planes.tangent[found]
    turned = normal - turn[:, None] * tangent
    turned /= np.hypot(*turned.T)[:, None]
    z = point[:, 2] + across * planes.across[found] + fit.height[found]
    climb = (planes.along[found] + turn * planes.across[found]) / np.hypot(1.0, turn)
    return MeasuredEdges(
        x=point[:, 0] + across * normal[:, 0],
        y=point[:, 1] + across * normal[:, 1],
        z=z,
        away_x=turned[:, 0],
        away_y=turned[:, 1],
        climb=climb,
        step=step[found] + z - point[:, 2],
        sigma_across=fit.sigma_across[found] * cell,
        sigma_height=fit.sigma_height[found],
        rms=fit.rms[found],
        photos=fit.photos[found],
        asked=fit.asked[found],
    )
