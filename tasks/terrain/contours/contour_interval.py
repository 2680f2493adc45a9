"""Which contours the terrain can bear.

Source: a map is accurate to an interval if nine of ten heights are within half of it (National Map Accuracy Standards, 1947): the
interval is 3.3 standard errors. Of the shape of the ground: what a block without control is off as a whole moves all contours
alike, and would leave a field of a hectare without any.
"""

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.bare_ground import TerrainCode
from orthomill.tasks.terrain.terrain_sums import TerrainSums

NINE_OF_TEN = 2 * 1.645
"""standard errors along an interval of which half holds nine of ten errors"""
ROUND_INTERVALS = tuple(m * 10.0**e for e in range(-2, 3) for m in (1.0, 2.0, 2.5, 5.0))
"""m"""
LEAST_STEP = 0.05
"""m: closer contours than these nobody reads"""
MOST_CONTOURS = 100
"""lines between the lowest and the highest ground"""


class ContourInterval(BaseModel):
    """The interval of contours, m, and why."""

    model_config = ConfigDict(frozen=True)

    interval: float
    sigma: float | None
    """root mean square of the standard errors of measured ground against the ground around, m; None where none was measured"""


def contour_interval(sums: tuple[TerrainSums, ...], asked: float | None) -> ContourInterval:
    """The interval that is `asked` for, m; None: the least round one that the measured ground of all tiles bears."""
    cells = sum(tile.cells[TerrainCode.MEASURED] for tile in sums)
    sigma = float(np.sqrt(sum(tile.relative for tile in sums) / cells)) if cells else None
    if asked is not None:
        return ContourInterval(interval=asked, sigma=sigma)
    low = [tile.lowest for tile in sums if tile.lowest is not None]
    high = [tile.highest for tile in sums if tile.highest is not None]
    relief = max(high) - min(low) if low and high else 0.0
    least = max(NINE_OF_TEN * (sigma or 0.0), LEAST_STEP, relief / MOST_CONTOURS)
    return ContourInterval(interval=next((step for step in ROUND_INTERVALS if step >= least), ROUND_INTERVALS[-1]), sigma=sigma)
