"""The small tables that pass between the jobs of this stage. All pixel coordinates are those of the full photograph."""

from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.job import Columns

DESCRIPTOR = 128
"""bytes of one descriptor"""


@dataclass(frozen=True)
class Features(Columns):
    """Interest points of one photograph or one tile of it."""

    col: np.ndarray
    row: np.ndarray
    """float64 px"""
    size: np.ndarray
    """float32: diameter, px"""
    angle: np.ndarray
    """float32: direction in degrees, clockwise from the columns' direction"""
    response: np.ndarray
    """float32: strength"""


@dataclass(frozen=True)
class Values(Columns):
    """Bytes of many equal records behind each other: descriptors (N x 128) or patches (N x side x side)."""

    values: np.ndarray
    """uint8"""

    def rows(self, length: int) -> np.ndarray:
        """(N, length)"""
        return self.values.reshape(-1, length)


@dataclass(frozen=True)
class PairMatches(Columns):
    """Features of two photographs that show the same point, by their numbers in the two feature tables."""

    left: np.ndarray
    right: np.ndarray
    """int32"""


class PairSummary(BaseModel):
    """How the matching of one pair went."""

    model_config = ConfigDict(frozen=True)

    left: str
    right: str
    tentative: int
    """mutual best matches that pass the ratio test"""
    inliers: int
    """of these, matches near their epipolar lines; 0 when the pair was not accepted"""
    alike: bool = False
    """whether the two stand still: the same picture twice, or two from one place with the same view"""

    @property
    def accepted(self) -> bool:
        return self.inliers > 0


@dataclass(frozen=True)
class Observations(Columns):
    """Features of one photograph that belong to tracks; sorted by track."""

    track: np.ndarray
    """int32"""
    reference: np.ndarray
    """int32: number of the photograph in which the track's point is defined"""
    col: np.ndarray
    row: np.ndarray
    """float64 px"""
    size: np.ndarray
    angle: np.ndarray
    """float32, as in Features"""


class Links(BaseModel):
    """Pairs of photographs (lower number, higher number) of which one is the reference of a track that the other shows."""

    model_config = ConfigDict(frozen=True)

    pairs: tuple[tuple[int, int], ...]
    tracks: int
    conflicts: int
    """tracks dropped because they met one photograph twice"""


@dataclass(frozen=True)
class Refined(Columns):
    """Observations matched against the reference photographs of their tracks."""

    photo: np.ndarray
    """int32: the photograph of the observation"""
    track: np.ndarray
    """int32"""
    col: np.ndarray
    row: np.ndarray
    """float64 px; NaN where the matching failed"""
    sigma: np.ndarray
    """float32 px; NaN where the matching failed"""
    outcome: np.ndarray
    """uint8: orthomill.schemas.outcome.Outcome"""


class Scatter(BaseModel):
    """How refined observations of a pair scatter about their epipolar lines."""

    model_config = ConfigDict(frozen=True)

    points: int
    sigma: float | None
    """robust standard error of a coordinate, px; None with too few points"""
