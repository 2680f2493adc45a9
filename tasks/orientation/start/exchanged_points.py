"""Two surveyed points whose names or coordinates were exchanged: the control fits the model only the other way round."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from orthomill.tasks.adjustment.model.network import State
from orthomill.tasks.orientation.start.georeference import BENDS, UPWARD, Known, mean_up, rms
from orthomill.tasks.orientation.start.similarity import Similarity, VerticalityConstraint, fit_similarity

FEWEST = 4
"""Points: three fit a model in any order, nearly"""
MOST = 8
"""Points, those that fit worst as given, of which every pair is tried"""
CLEAR = 4.0
"""The control fits so many times better the other way round"""
RIVAL = 2.0
"""and so many times worse with any other pair."""


@dataclass(frozen=True)
class Exchanged:
    """The numbers of two surveyed points, and the root mean square misfit (m) of the control with them the other way round and as
    given (None: it fits, but the photographs look up from below the ground)."""

    first: int
    second: int
    exchanged_m: float
    given_m: float | None


def exchanged_points(model: State, known: Known) -> Exchanged | None:
    """Which two points of the control are exchanged; None where none are, or it cannot be told."""
    numbers = np.flatnonzero(known.placed & np.isfinite(known.control_sigma).all(axis=1))
    if len(numbers) < FEWEST:
        return None
    control = _Control(
        known.control_model[numbers],
        known.control[numbers] - known.control[numbers].mean(axis=0),
        np.sqrt((known.control_sigma[numbers] ** 2).mean(axis=1)),
        mean_up(model),
    )
    given = control.misfit(control.ground)
    if given < CLEAR * control.tolerance:
        return None
    found = sorted((control.misfit(ground), pair) for pair, ground in control.pairs())
    (best, (first, second)), rival = found[0], found[1][0]
    if best > control.tolerance or given < CLEAR * best or rival < RIVAL * best:
        return None
    return Exchanged(int(numbers[first]), int(numbers[second]), best, given if np.isfinite(given) else None)


def without_exchanged(known: Known, exchanged: Exchanged) -> Known:
    """What is known without the places of the two points in the model."""
    places = known.control_model.copy()
    places[[exchanged.first, exchanged.second]] = np.nan
    return replace(known, control_model=places)


@dataclass(frozen=True, eq=False)
class _Control:
    """Points in the model and on the ground (n, 3), m from their middle, their standard errors (n,) m, and the mean axis (3,) of
    the photographs in the model."""

    model: np.ndarray
    ground: np.ndarray
    sigma: np.ndarray
    up: np.ndarray

    @property
    def tolerance(self) -> float:
        """m: by what control may miss a free model, which bends."""
        return float(np.hypot(3.0 * np.median(self.sigma), BENDS * np.linalg.norm(np.ptp(self.ground, axis=0))))

    def misfit(self, ground: np.ndarray) -> float:
        """Root mean square distance (m) of the points in the model from `ground` (n, 3) m; inf where the photographs would look
        up."""
        fit = self._fit(ground)
        return np.inf if (fit.rotation @ self.up)[2] < -UPWARD else rms(fit, self.model, ground)

    def pairs(self) -> Iterator[tuple[tuple[int, int], np.ndarray]]:
        """Pairs of points, and the ground with them exchanged."""
        missed = self._fit(self.ground).apply(self.model) - self.ground
        worst = np.argsort(-np.linalg.norm(missed, axis=1), kind="stable")[:MOST]
        for first, second in combinations(sorted(worst.tolist()), 2):
            ground = self.ground.copy()
            ground[[first, second]] = ground[[second, first]]
            yield (first, second), ground

    def _fit(self, ground: np.ndarray) -> Similarity:
        return fit_similarity(self.model, ground, self.sigma, VerticalityConstraint(self.up, 0.0))
