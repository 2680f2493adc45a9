"""Which share of independent observations lay within the errors that were promised for them."""

from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.job import Columns, Table

MULTIPLES = (1.0, 2.0, 3.0)
"""of the promised standard errors"""
EXPECTED = (0.6827, 0.9545, 0.9973)
"""shares within these of normal errors whose standard errors are right"""

BEYOND_CHANCE = 0.001
"""as for errors that check points share"""


class KeptPromises(BaseModel):
    """Observations of one kind against the standard errors promised for them."""

    model_config = ConfigDict(frozen=True)

    kind: str
    independent: bool
    """whether they took no part; otherwise each was compared with what all others say (left out in turn)"""
    items: int
    """points, photographs or distances"""
    values: int
    """coordinates of all of them"""
    within: tuple[float, float, float]
    """shares within MULTIPLES"""
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    """95 % confidence intervals of these shares, for so many items"""
    factor: float
    """what the promised errors must be multiplied with for 68 % to lie within one; offered, never applied"""
    chance: float | None = None
    """probability that of so many items no more lie within one promised error where all promises are right; None: not stated"""

    @property
    def holds(self) -> bool:
        """Whether the share within one promised error may be the one that normal errors have."""
        return self.low[0] <= EXPECTED[0] <= self.high[0]

    @property
    def too_sure(self) -> bool:
        """Whether fewer lie within than were promised, by the 95 % interval: of eleven kinds one may be by chance."""
        return self.high[0] < EXPECTED[0]

    @property
    def broken(self) -> bool:
        """Whether that is beyond chance, however many kinds a project has."""
        return self.too_sure and (self.chance is None or self.chance < BEYOND_CHANCE)


class Reliability(BaseModel):
    """All kinds of a project."""

    model_config = ConfigDict(frozen=True)

    kinds: tuple[KeptPromises, ...] = ()


@dataclass(frozen=True)
class PairDifferences(Columns):
    """One row for a place where two pairs without a common photograph measured the height."""

    difference: np.ndarray
    promised: np.ndarray
    """float64 m: of the two heights, and its standard error by theirs among neighbours"""


def pair_differences_table(row: int, col: int) -> Table[PairDifferences]:
    """The differences in a tile of the surface model."""
    return Table(f"accuracy/disjoint_pairs/{row}-{col}.parquet", PairDifferences)


@dataclass(frozen=True)
class PromisedHeights(Columns):
    """One row for a place of the surface where a check point could test its height."""

    sigma: np.ndarray
    """float64 m: its standard error, that of the block's place included"""


def promised_heights_table(row: int, col: int) -> Table[PromisedHeights]:
    """Those in a tile of the surface model."""
    return Table(f"accuracy/promised_heights/{row}-{col}.parquet", PromisedHeights)


@dataclass(frozen=True)
class PhotographDifferences(Columns):
    """One row for a coordinate of a point that photographs without a common one determined."""

    kind: np.ndarray
    """int8: 0 two strips, m; 1 a photograph against all others, px"""
    group: np.ndarray
    """int32: rows with the same photographs"""
    difference: np.ndarray
    promised: np.ndarray
    """float64: its standard error by the covariances of the block"""


PHOTOGRAPH_DIFFERENCES = Table("accuracy/photograph_differences.parquet", PhotographDifferences)
RELIABILITY = Table("accuracy/reliability.json", Reliability)
