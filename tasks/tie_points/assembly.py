"""The stage's result: every observation at its refined place, with an honest standard error.

The reference observation of a track defines its point, so it has no matching error of its own; it gets the floor, as does every
refined observation beside the precision of its matching. The floor stands for what a matching's own covariance does not see: the
perspective difference between two windows.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from schemas.observations import TiePoints
from schemas.outcome import Outcome
from tasks.tie_points.records import Observations, Refined


@dataclass(frozen=True)
class Weighting:
    """floor, unrefined: standard errors in px; unmatched: what becomes of observations that were not refined."""

    floor: float
    unrefined: float
    unmatched: Literal["keep", "drop"]


class RefinementSummary(BaseModel):
    """What became of the observations."""

    model_config = ConfigDict(frozen=True)

    outcomes: dict[int, int]
    """outcome code -> observations"""
    median_shift: float | None
    """from the SIFT position to the refined one, px"""
    median_sigma: float | None
    """of the refined observations, px"""


def assemble(
    observations: tuple[Observations, ...], refined: tuple[Refined, ...], weighting: Weighting
) -> tuple[TiePoints, RefinementSummary]:
    """Tie points of all photographs, sorted by track, then photograph. observations: one table per photograph."""
    photo = np.repeat(np.arange(len(observations), dtype=np.int32), [len(table) for table in observations])
    track, reference, col, row = (
        np.concatenate([getattr(table, name) for table in observations]) for name in ("track", "reference", "col", "row")
    )
    outcome = np.full(len(track), int(Outcome.NOT_TRIED), dtype=np.uint8)
    sigma = np.where(photo == reference, weighting.floor, weighting.unrefined).astype(np.float32)
    order = np.lexsort((photo, track))
    photo, track, reference, col, row, sigma = (values[order] for values in (photo, track, reference, col, row, sigma))
    moved = _insert(photo, track, col, row, sigma, outcome, refined, weighting.floor)
    lost = (photo != reference) & (outcome != int(Outcome.CONVERGED))
    keep = _usable(track, ~lost if weighting.unmatched == "drop" else np.ones(len(track), dtype=bool))
    summary = _summary(outcome[photo != reference], moved, sigma[outcome == int(Outcome.CONVERGED)])
    number = np.unique(track[keep], return_inverse=True)[1].ravel().astype(np.int32)
    return TiePoints(number, photo[keep], col[keep], row[keep], sigma[keep]), summary


def _insert(
    photo: np.ndarray, track: np.ndarray, col: np.ndarray, row: np.ndarray, sigma: np.ndarray, outcome: np.ndarray,
    refined: tuple[Refined, ...], floor: float,
) -> np.ndarray:  # fmt: skip
    """Put the refined places into the arrays; returns how far they moved (M,) px."""
    raise NotImplementedError
