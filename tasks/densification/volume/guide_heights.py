"""Heights near which the surface lies, from an existing height model, and whether that model can belong to the block.

Strategy: the model is compared with the tie points at the places of the terrain. A model elsewhere, in feet, or in another vertical
datum is refused in one sentence, for it would send the search astray everywhere; a model with holes is not: the tie points close
them.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field
from scipy.ndimage import map_coordinates

from orthomill.schemas.errors import GeometryError
from orthomill.schemas.observations import GroundPoints
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid
from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.densification.volume.terrain import known_terrain, terrain
from orthomill.tasks.geometry.coordinate_ranges import in_feet

_OFFSET, _SCATTERS = 5.0, 4.0
"""m, and multiples of the scatter, by which a model must differ throughout to lie in another datum"""
_FEW, _SPARE = 0.005, 2.0
_FEWEST = 3
"""places that tie points and model have in common, below which nothing can be judged"""


class TiePointGuide(Settings):
    """The tie points alone."""

    kind: Literal["tie_points"] = "tie_points"


class GuideFile(Settings):
    """An existing height model in any CRS; tie points close its holes."""

    kind: Literal["file"]
    path: str = setting(..., "GeoTIFF with heights in metres, relative to the project's root.")


Guide = Annotated[TiePointGuide | GuideFile, Field(discriminator="kind")]


def guided_terrain(points: GroundPoints, block: Block, guide: np.ndarray, grid: MapGrid, path: str) -> np.ndarray:
    """Heights (rows, cols) float32, m, of the places `grid`; guide: those of the model there, NaN where it has none.

    Raises GeometryError for a model that does not cover the block, is in feet, or lies in another vertical datum.
    """
    if not np.isfinite(guide).any():
        raise GeometryError(f"The height model {path} does not cover the block; check its CRS, or name another one.")
    known = known_terrain(points, grid)
    both = np.isfinite(known) & np.isfinite(guide)
    if both.sum() >= _FEWEST:
        _check(guide[both].astype(np.float64), known[both].astype(np.float64), path)
    return np.where(np.isfinite(guide), guide, terrain(points, block, grid)).astype(np.float32)


class GuideReach(BaseModel):
    """How far the surface may lie below and above the guide, m."""

    model_config = ConfigDict(frozen=True)

    below: float
    above: float


def equal_reach(metres: float) -> GuideReach:
    """The same reach to both sides."""
    return GuideReach(below=metres, above=metres)


def guide_reach(points: GroundPoints, guide: np.ndarray, grid: MapGrid) -> GuideReach:
    """The reach that the tie points ask for: they stand on roofs and in gullies that a coarse model does not have.

    guide (rows, cols): its heights at the places `grid`. Twice as far as all but a few of the points depart from it, for the
    highest roof or mast carries no tie point; the few may be wrong.
    """
    col, row = grid.pixel(points.x, points.y)
    inside = (col >= 0) & (row >= 0) & (col <= grid.cols - 1) & (row <= grid.rows - 1) & np.isfinite(points.z)
    away = points.z[inside] - map_coordinates(guide.astype(np.float64), [row[inside], col[inside]], order=1)
    away = away[np.isfinite(away)]
    if not len(away):
        return GuideReach(below=np.inf, above=np.inf)
    low, high = np.quantile(away, [_FEW, 1.0 - _FEW])
    return GuideReach(below=max(-_SPARE * float(low), 0.0), above=max(_SPARE * float(high), 0.0))


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
