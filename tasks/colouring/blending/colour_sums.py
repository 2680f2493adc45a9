"""What the blended pixels of a tile add up to, and all tiles together: what reports tell of colours."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.tasks.colouring.blending.blending import Blended


class ColourSums(BaseModel):
    """Sums over pixels that photographs colour."""

    model_config = ConfigDict(frozen=True)

    seen: tuple[int, int, int, int]
    """pixels that 0, 1, 2, 3 or more photographs see"""
    values: int
    rejected: int
    """of the values"""
    difference_sum: float
    difference_count: int
    """sum and number of the mean absolute differences at pixels where two photographs or more were blended, grey levels"""
    shares: dict[str, float]
    """photograph -> its part in the colours, px"""

    @property
    def difference(self) -> float | None:
        """Mean absolute difference of the blended colours from their blend, grey levels; None where nothing was blended."""
        return self.difference_sum / self.difference_count if self.difference_count else None


def sum_of(parts: Iterable[ColourSums]) -> ColourSums:
    """The sums over all tiles."""
    every, shares = tuple(parts), Counter[str]()
    for part in every:
        shares.update(part.shares)
    # Shares of pixels are formed from sums over all tiles: a mean of the tiles' shares would weight tiles at the border too much.
    none, one, two, more = (sum(part.seen[count] for part in every) for count in range(4))
    return ColourSums(
        seen=(none, one, two, more),
        values=sum(part.values for part in every),
        rejected=sum(part.rejected for part in every),
        difference_sum=sum(part.difference_sum for part in every),
        difference_count=sum(part.difference_count for part in every),
        shares=dict(shares),
    )


@dataclass
class ColourTally:
    """The sums over what is blended of a tile, one strip of it after the other; `share` (photos,) px."""

    share: np.ndarray
    values: int = 0
    rejected: int = 0
    difference_sum: float = 0.0
    difference_count: int = 0

    def add(self, blended: Blended) -> None:
        """Counts one strip."""
        self.share += blended.share
        self.values += int(blended.seen.sum(dtype=np.int64))
        self.rejected += int(blended.rejected.sum(dtype=np.int64))
        # float64: a tile sums a million float32 differences.
        self.difference_sum += float(np.nansum(blended.difference, dtype=np.float64))
        self.difference_count += int(np.isfinite(blended.difference).sum())

    def sums(self, names: Sequence[str], coverage: np.ndarray) -> ColourSums:
        """The sums so far; `names` of the photographs, `coverage` (...) uint8: how many of them see each pixel."""
        none, one, two, more = np.bincount(np.minimum(coverage, 3).ravel(), minlength=4).tolist()
        return ColourSums(
            seen=(none, one, two, more),
            values=self.values,
            rejected=self.rejected,
            difference_sum=self.difference_sum,
            difference_count=self.difference_count,
            shares={name: float(share) for name, share in zip(names, self.share, strict=True)},
        )
