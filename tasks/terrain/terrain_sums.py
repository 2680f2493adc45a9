"""What the report and the contours know of the terrain: sums over its tiles."""

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.bare_ground import CellClass, TerrainCode


class TerrainSums(BaseModel):
    """Cells of a tile by code of the terrain, with the sums of the squares of their standard errors (m2), and by class."""

    model_config = ConfigDict(frozen=True)

    cells: tuple[int, ...]
    squares: tuple[float, ...]
    relative: float
    """m2, of measured ground: the sum of the squares of its standard errors against the ground around"""
    classes: tuple[int, ...]
    tallest: float
    """m above the ground; 0 where nothing is"""
    lowest: float | None
    highest: float | None
    """m: of the ground; None where there is none"""


def sums_of_tile(
    height: np.ndarray, precision: np.ndarray, relative: np.ndarray, code: np.ndarray, cell_class: np.ndarray, above: np.ndarray
) -> TerrainSums:
    """The sums of rasters (rows, cols)."""
    count, classes = len(TerrainCode), max(CellClass) + 1
    squares = np.bincount(code.ravel(), np.nan_to_num(precision.ravel().astype(np.float64)) ** 2, count)
    ground = height[np.isfinite(height)]
    standing = above[np.isin(cell_class, (CellClass.BUILDING, CellClass.HIGH_VEGETATION))]
    return TerrainSums(
        cells=tuple(np.bincount(code.ravel(), minlength=count).tolist()),
        squares=tuple(squares.tolist()),
        relative=float((relative[code == TerrainCode.MEASURED].astype(np.float64) ** 2).sum()),
        classes=tuple(np.bincount(cell_class.ravel(), minlength=classes).tolist()),
        tallest=round(float(np.nanmax(standing)), 3) if len(standing) else 0.0,
        lowest=float(ground.min()) if len(ground) else None,
        highest=float(ground.max()) if len(ground) else None,
    )
