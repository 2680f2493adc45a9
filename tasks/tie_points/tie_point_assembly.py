"""The stage's result: every observation at its refined position, with a realistic standard error.

The reference observation of a track defines its point, so it has no matching error of its own; it gets the floor, and so does every
refined observation in addition to the precision of its matching. The floor represents what the covariance of a matching does not
contain: perspective within the window, and unknown lens distortion. It is measured: the median over all pairs of the scatter of
refined points about their epipolar lines, but never less than the setting.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.observations import TiePoints
from orthomill.schemas.outcome import Outcome
from orthomill.tasks.tie_points.match_records import Observations, Refined, Scatter


@dataclass(frozen=True)
class Weighting:
    """floor, unrefined: standard errors in px; unmatched: whether observations that were not refined are kept."""

    floor: float
    unrefined: float
    unmatched: Literal["keep", "drop"]


def with_measured_floor(weighting: Weighting, scatters: tuple[Scatter, ...]) -> Weighting:
    """The floor raised to the median scatter of the pairs that have one."""
    known = [scatter.sigma for scatter in scatters if scatter.sigma is not None]
    return replace(weighting, floor=max([weighting.floor, float(np.median(known))])) if known else weighting


class RefinementSummary(BaseModel):
    """Outcomes of the refinement of all observations."""

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
    points, is_reference = _at_sift_positions(observations, weighting)
    at, col, row, sigma, outcome = _gathered(points, refined)
    good = outcome == int(Outcome.CONVERGED)
    moved = np.hypot(col - points.col[at], row - points.row[at])[good]
    points.col[at[good]], points.row[at[good]] = col[good], row[good]
    # Independent errors: of the matching and of the model that it neglects.
    points.sigma[at[good]] = np.hypot(sigma[good], weighting.floor)
    # A reference is kept even when nothing was matched against it; tracks that then have a single ray go below.
    usable = is_reference.copy()
    usable[at] = good if weighting.unmatched == "drop" else True
    summary = RefinementSummary(
        outcomes={int(code): int((outcome == code).sum()) for code in np.unique(outcome)},
        median_shift=float(np.median(moved)) if len(moved) else None,
        median_sigma=float(np.median(sigma[good])) if len(moved) else None,
    )
    return _renumbered(points.take(usable)), summary


def _at_sift_positions(observations: tuple[Observations, ...], weighting: Weighting) -> tuple[TiePoints, np.ndarray]:
    """All observations at their detected positions, sorted by track, then photograph; and which of them are references."""
    photo = np.repeat(np.arange(len(observations), dtype=np.int32), [len(table) for table in observations])
    track, reference, col, row = (
        np.concatenate([getattr(table, name) for table in observations]) for name in ("track", "reference", "col", "row")
    )
    sigma = np.where(photo == reference, weighting.floor, weighting.unrefined).astype(np.float32)
    order = np.lexsort((photo, track))
    return TiePoints(track, photo, col, row, sigma).take(order), (photo == reference)[order]


def _gathered(points: TiePoints, refined: tuple[Refined, ...]) -> tuple[np.ndarray, ...]:
    """Row in `points`, col, row, sigma and outcome of every observation that was matched against its reference."""
    photo, track, col, row, sigma, outcome = (
        np.concatenate([getattr(table, name) for table in refined]) for name in ("photo", "track", "col", "row", "sigma", "outcome")
    )
    photos = int(points.photo.max(initial=0)) + 1
    # (track, photo) as one number: the rows of `points` ascend in it, so a binary search finds each observation.
    key = points.track.astype(np.int64) * photos + points.photo
    return np.searchsorted(key, track.astype(np.int64) * photos + photo), col, row, sigma, outcome


def _renumbered(points: TiePoints) -> TiePoints:
    """Without tracks that only one photograph shows; the others are numbered from 0."""
    _, inverse, rays = np.unique(points.track, return_inverse=True, return_counts=True)
    kept = points.take(rays[inverse] >= 2)
    number = np.unique(kept.track, return_inverse=True)[1].ravel().astype(np.int32)
    return TiePoints(number, kept.photo, kept.col, kept.row, kept.sigma)
