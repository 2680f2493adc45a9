"""The surface model: rasters that `densification` writes and later stages read, all on one map grid."""

from pydantic import BaseModel, ConfigDict

from orthomill.schemas.job import Table
from orthomill.schemas.raster import MapGrid

HEIGHT = "densification/height"
"""float32 m, NaN where nothing was measured"""
PRECISION = "densification/precision"
"""float32 m, standard error of the height"""
COUNT = "densification/count"
"""uint8, pairs that agree on the height"""
PROVENANCE = "densification/provenance"
"""uint8 code of PROVENANCE_CODES"""
CORRECTED = "dsm_check/height"
"""float32 m, the height after the check"""
ORTHO = "texture/ortho"
"""uint8 (rows, cols, 4): red, green, blue, alpha (0 where no photograph sees the ground)"""

PROVENANCE_CODES: tuple[tuple[int, str, str], ...] = (
    (0, "#000000", "empty: not measured"),
    (1, "#2c7bb6", "matched in one pair"),
    (2, "#1a9641", "matched in two or more pairs that agree"),
    (3, "#fdae61", "matched in several pairs that disagree: the best supported height"),
    (4, "#d7191c", "filled from its neighbours"),
)


class Surface(BaseModel):
    """The map grid of the surface model."""

    model_config = ConfigDict(frozen=True)

    grid: MapGrid
    height_low: float
    height_high: float
    """bounds of what may be measured, m"""


SURFACE = Table("densification/surface.json", Surface)
