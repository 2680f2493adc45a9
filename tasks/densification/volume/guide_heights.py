"""Heights near which the surface lies, from an existing height model, and whether that model can belong to the block.

Strategy: the model is compared with the tie points at the places of the terrain. A model elsewhere, in feet, or in another vertical
datum is refused in one sentence, for it would send the search astray everywhere; a model with holes is not: the tie points close
them.
"""

from typing import NamedTuple

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.schemas.observations import GroundPoints
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid
from orthomill.tasks.densification.volume.guide_reach import near_tie_points
from orthomill.tasks.densification.volume.terrain import known_terrain, terrain
from orthomill.tasks.geometry.coordinate_ranges import in_feet

_OFFSET, _SCATTERS = 5.0, 4.0
"""m, and multiples of the scatter, by which a model must differ throughout to lie in another datum"""
_FEWEST = 3
"""places that tie points and model have in common, below which nothing can be judged"""


class GuidedTerrain(NamedTuple):
    """At the places of the terrain: `heights` (rows, cols) float32 m near which the surface lies; `reach` (rows, cols, 2) float32
    m, how far below and above them it may lie."""

    heights: np.ndarray
    reach: np.ndarray


def guided_terrain(
    points: GroundPoints, block: Block, guide: np.ndarray, grid: MapGrid, path: str, reach: float | None = None
) -> GuidedTerrain:
    """The terrain of an existing model at the places `grid`, and how far the surface may lie from it.

    guide (rows, cols): heights of the model there, NaN where it has none. reach: the same to both sides everywhere, m; None: tie
    points say it. Raises GeometryError for a model that does not cover the block, is in feet, or lies in another vertical datum.
    """
    if not np.isfinite(guide).any():
        raise GeometryError(f"The height model {path} does not cover the block; check its CRS, or name another one.")
    known = known_terrain(points, grid)
    both = np.isfinite(known) & np.isfinite(guide)
    if both.sum() >= _FEWEST:
        _check(guide[both].astype(np.float64), known[both].astype(np.float64), path)
    model = np.where(np.isfinite(guide), guide, terrain(points, block, grid)).astype(np.float32)
    if reach is not None:
        return GuidedTerrain(model, np.full((*grid.shape, 2), reach, np.float32))
    return GuidedTerrain(*near_tie_points(points, model, grid))


def _check(guide: np.ndarray, known: np.ndarray, path: str) -> None:
    away = guide - known
    if in_feet(guide, known):
        raise GeometryError(f"The heights of {path} are in feet; convert them to metres.")
    offset = float(np.median(away))
    scatter = 1.4826 * float(np.median(np.abs(away - offset)))
    if abs(offset) > max(_OFFSET, _SCATTERS * scatter):
        side = "above" if offset > 0 else "below"
        raise GeometryError(
            f"The height model {path} lies {abs(offset):.1f} m {side} the tie points throughout; it is in another vertical datum "
            "(ellipsoidal and orthometric heights differ by tens of metres): convert one of them."
        )
