"""The surface model: rasters that `densification` writes and later stages read, all on one map grid."""

from enum import IntEnum

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
"""uint8 code of Provenance"""
# A raster of its own: the report compares it with the measured height, and the check can be repeated without matching again.
CORRECTED = "dsm_check/height"
"""float32 m, the height after the check"""
ORTHO = "texture/ortho"
"""uint8 (rows, cols, 4): red, green, blue, alpha (0 where no photograph sees the ground)"""


class Provenance(IntEnum):
    """Where the height of a cell comes from; uint8 in rasters."""

    # The numbers are part of the product dsm_provenance.tif: users' maps are classified by them, so they never change.
    EMPTY = 0
    ONE_PAIR = 1
    AGREED = 2
    DISPUTED = 3
    FILLED = 4


PROVENANCE_CODES: tuple[tuple[int, str, str], ...] = (
    (Provenance.EMPTY, "#000000", "empty: not measured"),
    (Provenance.ONE_PAIR, "#2c7bb6", "matched in one pair"),
    (Provenance.AGREED, "#1a9641", "matched in two or more pairs that agree"),
    (Provenance.DISPUTED, "#fdae61", "matched in several pairs that disagree: the best supported height"),
    (Provenance.FILLED, "#d7191c", "filled from its neighbours"),
)
"""(code, colour, meaning) for pictures and tables"""


class Surface(BaseModel):
    """The map grid of the surface model."""

    model_config = ConfigDict(frozen=True)

    grid: MapGrid
    height_low: float
    height_high: float
    """bounds of the heights that may be measured, m"""


SURFACE = Table("densification/surface.json", Surface)
