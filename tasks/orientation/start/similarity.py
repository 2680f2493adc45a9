"""The seven-parameter similarity transformation from a model to the project's system, weighted and robust.

Points on one line leave the rotation about it undetermined; a direction of the model that should be vertical (verticality
constraint) determines it. Source: Horn 1987 / Umeyama 1991 for the closed form.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.geometry.rotation import nearest_rotation

WIDENED = (1.0, 2.0, 4.0, 8.0, 16.0)
"""Factors of the tolerances of known points, the first of which half of the points keep."""

LEAST_REDUNDANCY = 8
"""Five points: fewer may agree with any model by chance."""
SHOWN = 0.2
"""Standard error of an approximate scale, in units of it. A rotation that is fitted to mere errors finds a scale of 2.5 of its own
standard errors in them, seldom of 4."""


@dataclass(frozen=True, eq=False)
class Similarity:
    """X = scale * rotation @ x + shift."""

    scale: float
    rotation: np.ndarray
    shift: np.ndarray

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Transformed points (n, 3)."""
        return self.scale * points @ self.rotation.T + self.shift


@dataclass(frozen=True, eq=False)
class VerticalityConstraint:
    """A verticality constraint: the direction (3,) of the model that should be the vertical, and its weight in 1/rad^2 (0:
    none)."""

    direction: np.ndarray
    weight: float


def fit_similarity(model: np.ndarray, ground: np.ndarray, sigma: np.ndarray, vertical: VerticalityConstraint) -> Similarity:
    """The similarity that takes `model` (n, 3) to `ground` (n, 3) m with standard errors `sigma` (n,) m.

    Huber's weights make single wrong points harmless. Raises GeometryError with fewer than two points.
    """
    if len(model) < 2:
        raise GeometryError(f"{len(model)} known points cannot place the block; two or more are needed.")
    weight = 1.0 / sigma**2
    for _ in range(20):
        result = _closed_form(model, ground, weight, vertical)
        size = np.linalg.norm(result.apply(model) - ground, axis=1) / sigma
        # 1.54 is the median length of three normal components: the limit follows the actual misfit where all sigmas are too small.
        limit = 2.0 * max(1.0, float(np.median(size)) / 1.54)
        before, weight = weight, np.where(size <= limit, 1.0, limit / np.maximum(size, limit)) / sigma**2
        if np.array_equal(before, weight):
            break
    return result


def approximate_scale(model: np.ndarray, ground: np.ndarray, sigma: np.ndarray) -> tuple[float, float] | None:
    """The scale that takes `model` (n, 3) to `ground` (n, 3) m, and its standard error in units of it; None where the points do not
    show it.

    The residuals tell how precise the points are relative to each other: errors that they have in common change no scale, and
    stated standard errors contain them.
    """
    redundancy = 3 * len(model) - 7
    if redundancy < LEAST_REDUNDANCY:
        return None
    fit = fit_similarity(model, ground, sigma, VerticalityConstraint(np.zeros(3), 0.0))
    size = np.sqrt(((fit.apply(model) - ground) ** 2).sum() / redundancy)
    share = size / max(fit.scale * np.sqrt(((model - model.mean(axis=0)) ** 2).sum()), 1e-300)
    return (fit.scale, float(share)) if share <= SHOWN else None


def consensus(
    model: np.ndarray, ground: np.ndarray, sigma: np.ndarray, vertical: VerticalityConstraint, trusted: np.ndarray
) -> np.ndarray:
    """(n,) residuals of all points from the similarity on which most of them agree, in units of their tolerances.

    The tolerance is three standard errors plus a fiftieth of the extent of the model, because a free model bends; twice as much,
    four times ... where not even half of the points agree within it. `trusted` points (n,) bool (surveyed control) win over the
    others where three or more of them agree, because a whole set of positions may have a common error. All points, the trusted
    ones, the others, and seeded triples are tried. Raises GeometryError.
    """
    # Three points have a redundancy of two: too little to say which of them is wrong.
    if len(model) < 4:
        return np.zeros(len(model))
    fits = [(fit_similarity(model[own], ground[own], sigma[own], vertical), bonus) for own, bonus in _samples(trusted)]
    extent = float(np.linalg.norm(np.ptp(model, axis=0)))
    misses = [(np.linalg.norm(fit.apply(model) - ground, axis=1) / (3.0 * sigma + 0.02 * fit.scale * extent), b) for fit, b in fits]
    # Standard errors may be stated far too small for all points: any three of them would then agree with nobody but themselves.
    for factor in WIDENED:
        best = min(((miss / factor, bonus) for miss, bonus in misses), key=lambda one: _loss(one[0], one[1], trusted))[0]
        if (best < 1.0).mean() >= 0.5 or _agreed(best, trusted):
            break
    return best


def _loss(miss: np.ndarray, bonus: float, trusted: np.ndarray) -> float:
    """What residuals (n,) in units of their tolerances speak against a similarity."""
    # Truncated at 1, so that a point far off costs no more than one that is just outside; the bonus outweighs all points.
    # Squared, so that a whole strip is not given up for the others to fit better: a free model bends within the tolerance.
    return float((np.minimum(miss, 1.0) ** 2).sum()) - bonus - (len(miss) if _agreed(miss, trusted) else 0.0)


def _agreed(miss: np.ndarray, trusted: np.ndarray) -> bool:
    """Whether the control agrees: not all of it must, for single points may be misidentified or mistyped."""
    return bool((miss[trusted] < 1.0).sum() >= max(3, 0.7 * trusted.sum()))


def _samples(trusted: np.ndarray) -> Iterator[tuple[np.ndarray, float]]:
    """Subsets of points, each with a bonus; all points together win a tie."""
    everything = np.arange(len(trusted))
    yield everything, 1e-6
    for own in (np.flatnonzero(trusted), np.flatnonzero(~trusted)):
        if 3 <= len(own) < len(trusted):
            yield own, 0.0
    # Triples are the smallest sets that fix a similarity; with half of the points wrong, 60 hold one without a wrong point.
    rng = np.random.default_rng(11)
    for _ in range(60):
        yield rng.choice(everything, 3, replace=False), 0.0


def _closed_form(model: np.ndarray, ground: np.ndarray, weight: np.ndarray, vertical: VerticalityConstraint) -> Similarity:
    """The weighted least-squares similarity."""
    column = weight[:, None]
    centre_model, centre_ground = ((points * column).sum(axis=0) / column.sum(axis=0) for points in (model, ground))
    x, X = model - centre_model, ground - centre_ground
    extent = (weight * (x**2).sum(axis=1)).sum()
    # The ratio of the extents is independent of the rotation and starts the alternation between rotation and scale, which are
    # coupled by the verticality constraint only.
    scale = np.sqrt((weight * (X**2).sum(axis=1)).sum() / extent)
    upright = vertical.weight * np.outer([0.0, 0.0, 1.0], vertical.direction)
    for _ in range(3):
        H = scale * (X * column).T @ x + upright
        rotation = nearest_rotation(H)
        scale = float((weight * (X * (x @ rotation.T)).sum(axis=1)).sum() / extent)
        scale = max(scale, 1e-9)
    return Similarity(scale, rotation, centre_ground - scale * rotation @ centre_model)


def turn_precision(points: np.ndarray, sigma: np.ndarray) -> float:
    """Standard error (rad) of the rotation about the line that fits points (n, 3) m with standard errors `sigma` (n,) m best; inf
    for fewer than three points.

    Points on one line, or no farther from it than their own errors, do not determine this rotation.
    """
    if len(points) < 3:
        return np.inf
    weight = 1.0 / sigma**2
    offset = points - np.average(points, axis=0, weights=weight)
    scatter = np.linalg.eigvalsh((offset * weight[:, None]).T @ offset)
    # Errors alone scatter points across the line: their expected contribution, two components of n - 2 points, is subtracted.
    dof = max(len(points) - 2.0, 0.0)
    return 1.0 / np.sqrt(max(scatter[0] + scatter[1] - 2.0 * dof, 1e-12))
