"""The published experiment, regenerated: one start list, bands of the pair, and the published measures of accuracy.

Strategy. The pair is rendered band by band, with the rows that the largest window needs around each, so that the full experiment
fits a laptop; a point is matched in its band as it would be in the whole. Truth is the ray-surface intersection of the point's left
pixel, and what is matched is intersected by least squares without a test of the parallax, as published.

Source: Skarlatos (sources/surface_check.md#experiments, #measures, sources/matching.md#synthetic-pair); sources/measured.md.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from benchmarks.matching.dissertation_pair import CLEAN, GroundTexture, PairCrop, PairRadiometry, check_points, pair_crop
from benchmarks.matching.dissertation_surface import PublishedPhoto, intersected, surface_points, true_matches
from orthomill.schemas.raster import Window
from orthomill.tasks.matching.least_squares.matching import Matches

PIXEL_HEIGHT = 0.414
"""m of height per px of parallax"""
LIMITS = np.array([0.14, 0.14, 0.21])
"""m: beyond one of them in X, Y or Z a point is a blunder (4.10)"""
_SEED = 2009
_ROUND = 80
"""px around the points of a band"""
_BAND = 1100


@dataclass(frozen=True, eq=False)
class Experiment:
    """The points that are tested (N, 2), whole left pixels (col, row), on one texture."""

    texture: GroundTexture
    points: np.ndarray

    @classmethod
    def full(cls, texture: GroundTexture, every: int = 1) -> "Experiment":
        """The 10 m grid of the overlap, in every n-th of ten bands of rows."""
        points = check_points(110.4, 26)
        return cls(texture, points[points[:, 1] // _BAND % every == every // 2])

    @classmethod
    def quick(cls, texture: GroundTexture) -> "Experiment":
        """A lattice of 24 px on a small part."""
        cols, rows = np.meshgrid(np.arange(7000.0, 7600.0, 24), np.arange(4600.0, 5100.0, 24))
        return cls(texture, np.column_stack([cols.ravel(), rows.ravel()]))

    @cached_property
    def truth(self) -> np.ndarray:
        """(N, 2) right pixels"""
        return true_matches(self.points)

    @cached_property
    def ground(self) -> np.ndarray:
        """(N, 3) m"""
        return surface_points(self.points, PublishedPhoto.LEFT)

    @cached_property
    def starts(self) -> np.ndarray:
        """(N, 2): truth and table 4.4's errors, 1.5 px along and 0.5 px across the base, the same for all settings."""
        return self.truth + np.random.default_rng(_SEED).normal(size=self.truth.shape) * [1.5, 0.5]

    def bands(self, radiometry: PairRadiometry = CLEAN) -> Iterator["Band"]:
        """The experiment in bands of rows."""
        for number in np.unique(self.points[:, 1] // _BAND):
            rows = np.flatnonzero(self.points[:, 1] // _BAND == number)
            yield Band(self, rows, pair_crop(self.texture, window_around(self.points[rows], _ROUND), _ROUND, radiometry))


def window_around(points: np.ndarray, margin: int) -> Window:
    """The window of the left photograph that holds points and `margin` px around them."""
    (left, top), (right, bottom) = points.min(axis=0).astype(int) - margin, points.max(axis=0).astype(int) + margin + 1
    return Window(int(top), int(left), int(bottom - top), int(right - left))


@dataclass(frozen=True, eq=False)
class Band:
    """Some points of an experiment, `rows` of its tables, and the images around them."""

    experiment: Experiment
    rows: np.ndarray
    crop: PairCrop

    @property
    def points(self) -> np.ndarray:
        """(n, 2) in pixels of the band's left image"""
        return self.experiment.points[self.rows] - self.crop.left_origin

    @property
    def starts(self) -> np.ndarray:
        """(n, 2) in pixels of the band's right image"""
        return self.experiment.starts[self.rows] - self.crop.right_origin

    def errors(self, found: Matches) -> np.ndarray:
        """(n, 3) computed - true ground coordinates, m; NaN where nothing was returned."""
        ground = intersected(found.reference + self.crop.left_origin, found.position + self.crop.right_origin)
        return ground - self.experiment.ground[self.rows]


@dataclass(frozen=True)
class Score:
    """The published measures of one setting. Shares in per cent of all points tested, lengths in m."""

    tested: int
    assigned: float
    returned: float
    blunders: int
    correct: float
    rms: tuple[float, float, float]

    @property
    def blunder_share(self) -> float:
        return 100.0 * self.blunders / self.tested

    @property
    def horizontal(self) -> float:
        """FGDC 95 % (4.14)"""
        return 2.4477 * 0.5 * (self.rms[0] + self.rms[1])

    @property
    def vertical(self) -> float:
        """FGDC 95 % (4.15)"""
        return 1.96 * self.rms[2]


def score(errors: np.ndarray, assigned: np.ndarray | None = None) -> Score:
    """Measures of errors (N, 3) m, NaN where nothing was returned; assigned (N,) bool, None for all."""
    known = np.isfinite(errors[:, 2])
    blunder = known & (np.abs(errors) > LIMITS).any(axis=1)
    count = max(len(errors), 1)
    rms = tuple(float(v) for v in np.sqrt((errors[known] ** 2).mean(axis=0))) if known.any() else (np.nan,) * 3
    return Score(
        len(errors),
        100.0 if assigned is None else 100.0 * float(assigned.mean()),
        100.0 * known.sum() / count,
        int(blunder.sum()),
        100.0 * (known.sum() - blunder.sum()) / count,
        rms,
    )
