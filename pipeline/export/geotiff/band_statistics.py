"""Least, largest and mean value of the bands of a raster, gathered tile by tile, as GDAL writes them into a file.

Means and sums of squares are joined as Chan, Golub and LeVeque (1979) do, without the loss of digits of plain sums.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

NAMES = ("MINIMUM", "MAXIMUM", "MEAN", "STDDEV", "VALID_PERCENT")
"""of GDAL's tags, behind STATISTICS_"""


@dataclass(frozen=True)
class BandStatistics:
    """Of every band: how many cells have a value, the least, the largest and the mean one, and the sum of the squares of what they
    differ from it: (bands,) each."""

    count: np.ndarray
    least: np.ndarray
    largest: np.ndarray
    mean: np.ndarray
    squares: np.ndarray

    def joined(self, other: "BandStatistics") -> "BandStatistics":
        """Of both areas."""
        count, apart = self.count + other.count, other.mean - self.mean
        share = other.count / np.maximum(count, 1)
        return BandStatistics(
            count,
            np.minimum(self.least, other.least),
            np.maximum(self.largest, other.largest),
            np.where(self.count == 0, other.mean, self.mean + apart * share),
            self.squares + other.squares + np.where(self.count == 0, 0.0, apart**2 * self.count * share),
        )

    def tags(self, cells: int) -> list[dict[str, str]]:
        """Of every band of a raster of so many cells; `of_tags` reads them without loss of the counts."""
        found = []
        for count, least, largest, mean, squares in zip(*map(np.ndarray.tolist, vars(self).values()), strict=True):
            values = (least, largest, mean, (squares / count) ** 0.5) if count else ()
            told = [*map(repr, values), repr(100 * count / cells)] if count else ["0"]
            found.append({f"STATISTICS_{name}": text for name, text in zip(NAMES[-len(told) :], told, strict=True)})
        return found


def none_yet(bands: int) -> BandStatistics:
    """Of no cell."""
    return BandStatistics(np.zeros(bands, int), np.full(bands, np.inf), np.full(bands, -np.inf), np.zeros(bands), np.zeros(bands))


def of_tile(values: np.ndarray, valid: np.ndarray) -> BandStatistics:
    """Of (bands, rows, cols) values where they are `valid`, of the same shape."""
    axes, count = (1, 2), valid.sum(axis=(1, 2))
    known = np.where(valid, values, 0).astype(np.float64)
    mean = known.sum(axis=axes) / np.maximum(count, 1)
    apart = np.where(valid, known - mean[:, None, None], 0.0)
    least = np.where(valid, known, np.inf).min(axis=axes, initial=np.inf)
    return BandStatistics(
        count, least, np.where(valid, known, -np.inf).max(axis=axes, initial=-np.inf), mean, (apart**2).sum(axis=axes)
    )


def of_tags(bands: list[dict[str, Any]], cells: int) -> BandStatistics:
    """What `tags` told of a raster of so many cells."""
    missing = (np.inf, -np.inf, 0.0, 0.0, 0.0)
    told = [[float(tags.get(f"STATISTICS_{name}", other)) for name, other in zip(NAMES, missing, strict=True)] for tags in bands]
    least, largest, mean, deviation, percent = np.array(told).reshape(len(bands), len(NAMES)).T
    count = np.rint(percent * cells / 100).astype(int)
    return BandStatistics(count, least, largest, mean, deviation**2 * count)
