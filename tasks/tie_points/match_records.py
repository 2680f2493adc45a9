"""The tables that pass between the jobs of this stage. All pixel coordinates are those of the full-size photograph."""

from dataclasses import dataclass
from typing import NamedTuple

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
    """Bytes of many records of one length in sequence: descriptors (N x 128) or patches (N x side x side)."""

    values: np.ndarray
    """uint8"""

    def rows(self, length: int) -> np.ndarray:
        """(N, length)"""
        return self.values.reshape(-1, length)


class FeatureTables(NamedTuple):
    """Features of a photograph or of a tile, and their descriptors in the same order."""

    features: Features
    descriptors: Values


@dataclass(frozen=True)
class PairMatches(Columns):
    """Features of two photographs that show the same point, by their numbers in the two feature tables."""

    left: np.ndarray
    right: np.ndarray
    """int32"""


class PairSummary(BaseModel):
    """The result of matching one pair."""

    model_config = ConfigDict(frozen=True)

    left: str
    right: str
    tentative: int
    """mutual best matches that pass the ratio test"""
    inliers: int
    """of these, matches near their epipolar lines; 0 when the pair was not accepted"""
    alike: bool = False
    """whether the two show no parallax: the same picture twice, or two from one place with the same view"""

    @property
    def accepted(self) -> bool:
        """Whether the pair shows common ground."""
        return self.inliers > 0


class MatchedPair(NamedTuple):
    """Matches of two photographs, none when the pair is not accepted, and their summary."""

    matches: PairMatches
    summary: PairSummary


class MatchCounts(BaseModel):
    """How much tracks are made from."""

    model_config = ConfigDict(frozen=True)

    matches: int
    features: int
    """that take part in a match"""


@dataclass(frozen=True)
class MatchedFeatures(Columns):
    """Features of all photographs that tracks are made from; sorted by photograph, then number."""

    photo: np.ndarray
    number: np.ndarray
    """int32: of the photograph, and of the feature in its table"""


class KeptFeatures(NamedTuple):
    """The features that tracks are made from, and how many they and the matches between them are."""

    counts: MatchCounts
    kept: MatchedFeatures


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
    """Pairs of photographs (lower number, higher number) of which one is the reference of a track that the other one shows."""

    model_config = ConfigDict(frozen=True)

    pairs: tuple[tuple[int, int], ...]
    """sorted"""
    tracks: int
    conflicts: int
    """tracks dropped because they meet one photograph in two places"""

    @property
    def first(self) -> tuple[int, ...]:
        """The photographs that are the first of pairs, in order."""
        return tuple(sorted({left for left, _ in self.pairs}))


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
    """Scatter of the refined observations of a pair about their epipolar lines."""

    model_config = ConfigDict(frozen=True)

    points: int
    sigma: float | None
    """robust standard error of a coordinate, px; None with too few points"""


class RefinedPair(NamedTuple):
    """Refined observations of either photograph of a pair, and their scatter about epipolar lines."""

    refined: Refined
    scatter: Scatter


class Scatters(BaseModel):
    """Scatter of the pairs of a photograph with others, in their order."""

    model_config = ConfigDict(frozen=True)

    pairs: tuple[Scatter, ...]


class RefinedPairs(NamedTuple):
    """Refined observations of the pairs of a photograph with others, and the scatter of each pair."""

    refined: Refined
    scatters: Scatters
