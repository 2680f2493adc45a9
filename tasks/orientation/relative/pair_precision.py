"""How well tie points determine the relative orientation of a pair: what they scatter, and what the camera may be wrong by.

Strategy. The standard errors of the published adjustment take every coordinate as an error of its own and the camera as known. Tie
points next to each other err together (texture, what the lens leaves), and an error of the principal point is one of the tilts.
- Scatter: the pair is oriented again without the points of one part of the photograph after the other (delete-a-group jackknife:
  variance (g - 1)/g times the sum of squares about the mean). What neighbours share shows there, whatever it comes from.
- Camera: the pair is oriented again with the camera changed along each axis of its covariance by one standard error.
Sources: Quenouille 1956, Kott 2001 (delete-a-group jackknife).
"""

from collections.abc import Callable

import numpy as np

from orthomill.schemas.errors import GeometryError

GROUPS = 4
"""parts along a side of the left photograph: sixteen at most, each much larger than what a texture or a lens error spans"""
_FEWEST = 6
"""groups from which on their scatter is told from chance"""

Oriented = Callable[[np.ndarray], np.ndarray]
"""matches (s, 4) to the unknowns (5,) of a form"""


def scatter(observations: np.ndarray, orient: Oriented) -> np.ndarray | None:
    """Variances (5,) of the unknowns by leaving out one part of the left photograph after the other; None with points in too few
    parts. observations (s, 4) px."""
    places = observations[:, :2]
    low, high = places.min(axis=0), places.max(axis=0)
    cell = np.minimum(((places - low) / np.maximum(high - low, 1e-9) * GROUPS).astype(int), GROUPS - 1)
    group = cell[:, 1] * GROUPS + cell[:, 0]
    parts = [part for part in np.unique(group) if (group != part).sum() >= _FEWEST]
    if len(parts) < _FEWEST:
        return None
    found = []
    for part in parts:
        try:
            found.append(orient(observations[group != part]))
        except GeometryError:
            return None
    moved = np.array(found) - np.mean(found, axis=0)
    return (len(parts) - 1) / len(parts) * (moved**2).sum(axis=0)


def camera_effect(changed: list[np.ndarray], orient: Oriented, unknowns: np.ndarray) -> np.ndarray:
    """Variances (5,) by the errors of the cameras. changed: the matches (s, 4) with the cameras moved along each axis of their
    covariance by one standard error."""
    variance = np.zeros(len(unknowns))
    for observations in changed:
        try:
            variance += (orient(observations) - unknowns) ** 2
        except GeometryError:
            return np.full(len(unknowns), np.nan)
    return variance


def axes(covariance: np.ndarray) -> np.ndarray:
    """(n, 17) changes of the interior parameters by one standard error along each axis of their covariance (17, 17)."""
    # In units of the standard errors: c in px and k3 without a unit cannot share a matrix otherwise.
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    free = np.flatnonzero(sigma > 0)
    scaled = covariance[np.ix_(free, free)] / np.outer(sigma[free], sigma[free])
    value, vector = np.linalg.eigh(scaled)
    out = np.zeros((len(free), len(covariance)))
    out[:, free] = (vector * np.sqrt(np.maximum(value, 0.0))).T * sigma[free]
    return out
