"""The seven-parameter similarity transformation from a model to the project's system, weighted and robust.

Points fix what they can; a direction that ought to be vertical helps where all points lie on one line and say nothing of the
rotation about it. Source: Horn 1987 / Umeyama 1991 for the closed form.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.geometry.rotation import nearest_rotation


@dataclass(frozen=True, eq=False)
class Similarity:
    """X = scale * rotation @ x + shift."""

    scale: float
    rotation: np.ndarray
    shift: np.ndarray

    def apply(self, points: np.ndarray) -> np.ndarray:
        return self.scale * points @ self.rotation.T + self.shift


@dataclass(frozen=True, eq=False)
class Upward:
    """The model's direction (3,) that ought to be the vertical, and its weight in 1/rad^2 (0: unknown)."""

    direction: np.ndarray
    weight: float


def fit_similarity(model: np.ndarray, ground: np.ndarray, sigma: np.ndarray, upward: Upward) -> Similarity:
    """The similarity that takes `model` (n, 3) to `ground` (n, 3) m with standard errors `sigma` (n,) m.

    Huber's weights on the residuals make single wrong positions harmless. Raises GeometryError with fewer than two points.
    """
    if len(model) < 2:
        raise GeometryError(f"{len(model)} known points cannot place the block; two or more are needed.")
    weight = 1.0 / sigma**2
    for _ in range(20):
        result = _closed_form(model, ground, weight, upward)
        size = np.linalg.norm(result.apply(model) - ground, axis=1) / sigma
        limit = 2.0 * max(1.0, float(np.median(size)) / 1.54)
        before, weight = weight, np.where(size <= limit, 1.0, limit / np.maximum(size, limit)) / sigma**2
        if np.array_equal(before, weight):
            break
    return result


def consensus(model: np.ndarray, ground: np.ndarray, sigma: np.ndarray, upward: Upward, trusted: np.ndarray) -> np.ndarray:
    """(n,) how far each point misses the similarity that most points agree on, in units of what it may miss.

    A point may miss by three standard errors and by a fiftieth of the model's extent, for a free model bends. `trusted` (n,) bool
    (surveyed control) wins over the others where three or more of it agree among themselves, for a whole set of positions may be
    wrong alike. All points, the trusted ones, the others, and seeded triples are tried. Raises GeometryError.
    """
    if len(model) < 4:
        return np.zeros(len(model))
    best, lowest = np.zeros(len(model)), np.inf
    for own, bonus in _samples(trusted):
        fit = fit_similarity(model[own], ground[own], sigma[own], upward)
        allowed = 3.0 * sigma + 0.02 * fit.scale * float(np.linalg.norm(np.ptp(model, axis=0)))
        miss = np.linalg.norm(fit.apply(model) - ground, axis=1) / allowed
        agreed = (miss[trusted] < 1.0).sum() >= max(3, 0.7 * trusted.sum())
        loss = float(np.minimum(miss, 1.0).sum()) - bonus - (len(model) if agreed else 0.0)
        if loss < lowest:
            best, lowest = miss, loss
    return best


def _samples(trusted: np.ndarray) -> Iterator[tuple[np.ndarray, float]]:
    """Sets of points to begin with; all points together win a tie."""
    everything = np.arange(len(trusted))
    yield everything, 1e-6
    for own in (np.flatnonzero(trusted), np.flatnonzero(~trusted)):
        if 3 <= len(own) < len(trusted):
            yield own, 0.0
    rng = np.random.default_rng(11)
    for _ in range(60):
        yield rng.choice(everything, 3, replace=False), 0.0


def _closed_form(model: np.ndarray, ground: np.ndarray, weight: np.ndarray, upward: Upward) -> Similarity:
    centre_model, centre_ground = np.average(model, axis=0, weights=weight), np.average(ground, axis=0, weights=weight)
    x, X = model - centre_model, ground - centre_ground
    scale = np.sqrt((weight * (X**2).sum(axis=1)).sum() / (weight * (x**2).sum(axis=1)).sum())
    for _ in range(3):
        H = scale * (X * weight[:, None]).T @ x + upward.weight * np.outer([0.0, 0.0, 1.0], upward.direction)
        rotation = nearest_rotation(H)
        scale = float((weight * (X * (x @ rotation.T)).sum(axis=1)).sum() / (weight * (x**2).sum(axis=1)).sum())
        scale = max(scale, 1e-9)
    return Similarity(scale, rotation, centre_ground - scale * rotation @ centre_model)


def turn_precision(points: np.ndarray, sigma: np.ndarray) -> float:
    """Standard error in radians of the rotation about the line that fits known points (n, 3) m with `sigma` (n,) m best; inf
    without any.

    Points on one line, or points as far from it as their own errors, do not fix this rotation.
    """
    if len(points) < 3:
        return np.inf
    weight = 1.0 / sigma**2
    offset = points - np.average(points, axis=0, weights=weight)
    scatter = np.linalg.eigvalsh((offset * weight[:, None]).T @ offset)
    dof = max(len(points) - 2.0, 0.0)
    return 1.0 / np.sqrt(max(scatter[0] + scatter[1] - 2.0 * dof, 1e-12))
