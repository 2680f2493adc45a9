"""Crowns have two surfaces that photographs truly see: the leaves, and through their gaps the ground below. Which one a height is.

The reference of all other figures is the envelope of the crown, so that the ground seen through it counts as an error of metres:
that stands. These counts say besides whether a height is at least that of something that was seen, and whether it knows.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.job import Columns
from orthomill.schemas.surface import Provenance
from orthomill.tasks.evaluation.accuracy import percent

_AT = 1.0
"""m: a height this near to a surface is that surface's"""


@dataclass(frozen=True)
class CrownCounts(Columns):
    """One row per code of Provenance: cells of trees that two photographs or more see and that have a height."""

    code: np.ndarray
    """uint8"""
    cells: np.ndarray
    crown: np.ndarray
    ground: np.ndarray
    """int64: all of them, those at the crown, and those that are not but lie at the ground below it"""
    rated: np.ndarray
    within_2: np.ndarray
    beyond_4: np.ndarray
    """int64: those with a standard error among neighbours, and how many of them lie within 2, and beyond 4 of these errors from the
    nearer one of the two surfaces, without the error of the datum"""


def no_crowns() -> CrownCounts:
    """The counts where no crowns are known."""
    return CrownCounts(np.zeros(0, np.uint8), *(np.zeros(0, np.int64) for _ in range(6)))


@dataclass(frozen=True)
class CrownCells:
    """Cells of trees, flat (N,): code, height above the envelope and above the ground below (m, without the error of the datum, NaN
    where there is no height), standard error among neighbours (m)."""

    code: np.ndarray
    above_crown: np.ndarray
    above_ground: np.ndarray
    sigma: np.ndarray


def crown_counts(cells: CrownCells) -> CrownCounts:
    """The counts of all codes."""
    crown, ground = np.abs(cells.above_crown), np.abs(cells.above_ground)
    known, at_crown = np.isfinite(crown), crown <= _AT
    rated = known & (cells.sigma > 0)
    # fmin: where nothing is known below, the crown alone counts
    ratio = np.fmin(crown, ground) / np.where(rated, cells.sigma, np.nan)
    masks = known, at_crown, ~at_crown & known & (ground <= _AT), rated, ratio <= 2, ratio > 4
    codes = np.array([int(c) for c in Provenance], np.uint8)
    return CrownCounts(codes, *(np.bincount(cells.code[mask], minlength=256)[codes].astype(np.int64) for mask in masks))


def crown_shares(parts: tuple[CrownCounts, ...], codes: tuple[Provenance, ...]) -> dict[str, float]:
    """Of the heights of these codes, %: at the crown, at the ground below it, at neither; within 2 and beyond 4 of their standard
    errors from the nearer one. NaN where there are none."""
    cells, crown, ground, rated, within, beyond = (
        sum(int(getattr(part, name)[np.isin(part.code, codes)].sum()) for part in parts)
        for name in ("cells", "crown", "ground", "rated", "within_2", "beyond_4")
    )
    return {
        "at_crown": percent(crown, cells),
        "at_ground": percent(ground, cells),
        "at_neither": percent(cells - crown - ground, cells),
        "nearer_within_2": percent(within, rated),
        "nearer_beyond_4": percent(beyond, rated),
    }
