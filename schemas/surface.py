"""The surface model: rasters that `densification` writes and later stages read, all on one map grid."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.job import Columns, Table
from orthomill.schemas.maps.wanted_area import WantedArea
from orthomill.schemas.raster import MapGrid

HEIGHT = "densification/height"
"""float32 m, NaN where nothing was measured"""
PRECISION = "densification/precision"
"""float32 m, standard error of the height: `RELATIVE_PRECISION` and `DATUM_PRECISION` together"""
RELATIVE_PRECISION = "densification/relative_precision"
"""float32 m, standard error of the height among its neighbours: matching and the geometry of the rays"""
DATUM_PRECISION = "densification/datum_precision"
"""float32 m, what the orientation adds: the place of the block and its bend, with what the cameras keep without being known;
neighbours share this error, so it says nothing about the surface within a few photographs"""
COUNT = "densification/count"
"""uint8, pairs that agree on the height"""
PROVENANCE = "densification/provenance"
"""uint8 code of Provenance"""
# A raster of its own: the report compares it with the measured height, and the check can be repeated without matching again.
CORRECTED = "dsm_check/height"
"""float32 m, the height after the check"""
CHECKED_CODE = "dsm_check/code"
"""uint8 `CheckCode`"""
ORTHO = "texture/ortho"
"""uint8 (rows, cols, 4): red, green, blue, alpha (0 where no photograph sees the ground)"""
ORTHO_SOURCE = "texture/source"
"""uint16: number, from 1 in the order of the block, of the photograph of the greatest weight at a pixel of the orthoimage; 0:
none"""
HEIGHT_SOURCE = "texture/height_source"
"""uint8 code of HeightSource, of every pixel of the orthoimage"""


ROUND_CELLS = tuple(m * 10.0**e for e in range(-3, 3) for m in (1.0, 2.0, 2.5, 5.0))
"""cell sizes that are chosen automatically, m"""
GROUND_PIXELS = 1.5
"""cell size that is aimed at, in ground pixels"""


def round_cell_size(ground_pixel: float) -> float:
    """The round cell size (m) nearest to 1.5 ground pixels, by ratio."""
    return min(ROUND_CELLS, key=lambda cell: abs(np.log(cell / (GROUND_PIXELS * ground_pixel))))


class Provenance(IntEnum):
    """Where the height of a cell comes from; uint8 in rasters."""

    # The numbers are part of the product dsm_provenance.tif: users' maps are classified by them, so they never change.
    EMPTY = 0
    ONE_PAIR = 1
    AGREED = 2
    DISPUTED = 3
    INTERPOLATED = 4
    VOLUME = 5
    INCOHERENT = 6
    COARSE = 7
    WATER = 8


MEASURED = (Provenance.ONE_PAIR, Provenance.AGREED, Provenance.DISPUTED, Provenance.VOLUME)
"""codes of heights that photographs measured"""
GUESSED = (Provenance.INTERPOLATED, Provenance.INCOHERENT)
"""codes of heights without evidence of their own, as uncertain as they differ from what was measured around"""
ESTIMATED = (*GUESSED, Provenance.COARSE, Provenance.WATER)
"""codes of heights that no photographs measured in their own cell: a guess, or the height of what is around; never shown or counted
as measured"""


class HeightSource(IntEnum):
    """Where the height of an ortho pixel comes from; uint8 in HEIGHT_SOURCE."""

    # The numbers are those of the product ortho_height_source.tif, so they never change.
    NONE = 0
    MEASURED = 1
    DRAPED = 2
    ESTIMATED = 3


HEIGHT_SOURCE_CODES: tuple[tuple[int, str, str], ...] = (
    (HeightSource.NONE, "#000000", "no height, no texture"),
    (HeightSource.MEASURED, "#9a9a9a", "measured"),
    (HeightSource.DRAPED, "#d7191c", "draped: interpolated for the texture only"),
    (HeightSource.ESTIMATED, "#fdae61", "estimated by the surface model"),
)
"""(code, colour, meaning) for pictures"""


PROVENANCE_CODES: tuple[tuple[int, str, str], ...] = (
    (Provenance.EMPTY, "#000000", "empty: no height"),
    (Provenance.ONE_PAIR, "#2c7bb6", "measured in one pair"),
    (Provenance.AGREED, "#1a9641", "measured in two or more pairs that agree"),
    (Provenance.DISPUTED, "#fdae61", "measured in several pairs that disagree: the best supported height"),
    (Provenance.INTERPOLATED, "#d7191c", "estimated: interpolated between its neighbours"),
    (Provenance.VOLUME, "#a6d96a", "measured by all photographs together, in no single pair"),
    (Provenance.INCOHERENT, "#f46d43", "estimated: the photographs together prefer it, but its neighbours contradict it"),
    (Provenance.COARSE, "#c2a5cf", "estimated: photographs show it, less sharply than its cell: a crown without leaves"),
    (Provenance.WATER, "#08519c", "outlined water: the level of its shore"),
)
"""(code, colour, meaning) for pictures and tables"""


class CheckCode(IntEnum):
    """What the check says of a cell; uint8 in rasters."""

    # Part of the product dsm_check.tif, as Provenance is of dsm_provenance.tif: the numbers never change.
    EMPTY = 0
    AGREES = 1
    CORRECTED = 2
    WRONG = 3
    DISPUTED = 4
    NOT_JUDGED = 5
    ESTIMATE = 6
    BEYOND_REACH = 7
    FILLED = 8


JUDGED = (CheckCode.AGREES, CheckCode.CORRECTED, CheckCode.WRONG, CheckCode.DISPUTED)
"""codes of heights of which the photographs say something"""
UNJUDGED = (CheckCode.NOT_JUDGED, CheckCode.BEYOND_REACH)
"""codes of heights that were to be judged and could not be"""
CHECK_CODES: tuple[tuple[int, str, str], ...] = (
    (CheckCode.EMPTY, "#000000", "empty: no height"),
    (CheckCode.AGREES, "#1a9641", "agrees with the photographs"),
    (CheckCode.CORRECTED, "#2c7bb6", "wrong, and corrected"),
    (CheckCode.WRONG, "#d7191c", "wrong, and left as it is"),
    (CheckCode.DISPUTED, "#fdae61", "the pairs of photographs disagree"),
    (CheckCode.NOT_JUDGED, "#bdbdbd", "not judged: hidden, without texture, or seen by one photograph"),
    (CheckCode.ESTIMATE, "#737373", "an estimated height: not judged"),
    (CheckCode.BEYOND_REACH, "#7b3294", "probably a large error, found in coarse orthoimages only: left as it is"),
    (CheckCode.FILLED, "#80cdc1", "a hole, filled by matching of the photographs"),
)
"""(code, colour, meaning) for pictures and tables"""


class Surface(BaseModel):
    """The map grid of the surface model."""

    model_config = ConfigDict(frozen=True)

    grid: MapGrid
    height_low: float
    height_high: float
    """bounds of the heights that may be measured, m"""
    wanted: WantedArea = WantedArea()
    """where on the grid the surface is wanted"""


SURFACE = Table("densification/surface.json", Surface)
CHECKED_SURFACE = Table("dsm_check/surface.json", Surface)
"""Grid and height bounds of the surface under test."""
GIVEN_HEIGHT, GIVEN_PRECISION, GIVEN_CODE = "dsm_check/given_height", "dsm_check/given_precision", "dsm_check/given_code"
"""A surface from a file as an orthoimage rests on it where nothing was matched: heights in the system of the photographs and their
standard errors, float32 m, and codes of `Provenance`"""


@dataclass(frozen=True)
class SurfacePoints(Columns):
    """Matched nodes of the pairs in a tile, where they were measured.

    They follow each other cell by cell of the surface model, rows first, and in a cell by their standard errors.
    """

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    """float64 m"""
    sigma: np.ndarray
    """float32 m: standard error of the height among its neighbours"""
    rays: np.ndarray
    """uint8: photographs that measured points in the same cell"""
    code: np.ndarray
    """uint8 code of Provenance of the cell"""
    source: np.ndarray
    """uint16: number of the pair in `epipolar/pairs.json`, from 1"""


def points_table(row: int, col: int) -> Table[SurfacePoints]:
    """The points of a tile of the surface model."""
    return Table(f"densification/points/{row}-{col}.parquet", SurfacePoints)
