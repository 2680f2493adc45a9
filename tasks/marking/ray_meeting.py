"""Where most of the rays of a marked point meet: from the intersections of pairs, by robust steps from the best of them."""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from orthomill.tasks.adjustment.model.collinearity import derivatives, residuals
from orthomill.tasks.adjustment.model.network import Rays
from orthomill.tasks.geometry.intersection import intersect_rays
from orthomill.tasks.marking.belief import Belief

MOST_PAIRS = 60
"""Pairs of rays that are tried as the place of a point."""
STEPS = 4
"""Gauss-Newton steps on the rays that meet there."""
FAR_OFF = 50.0
"""px: rays that miss a place by more say nothing about it."""


@dataclass(frozen=True, eq=False)
class MarkedRays:
    """Marks in the numbers of a `Belief`: `rays` sorted by point; `known` (N, 3) local coordinates, m, NaN where they are not
    known, and their standard errors `sigma` (N, 3)."""

    rays: Rays
    known: np.ndarray
    sigma: np.ndarray

    def without(self, dropped: np.ndarray) -> "MarkedRays":
        """Without the rays (M,) bool."""
        return replace(self, rays=self.rays.take(~dropped))


def placed(belief: Belief, marked: MarkedRays) -> np.ndarray:
    """(N, 3) m, local: where most rays of each point meet; its known coordinates where it has fewer than two rays; NaN where it has
    neither."""
    rays = marked.rays
    directions = ray_directions(belief, rays.photo, rays.xy)
    out = np.where(np.isfinite(marked.known).all(axis=1, keepdims=True), marked.known, np.nan)
    for point in range(len(out)):
        own = np.flatnonzero(rays.point == point)
        if len(own) >= 2:
            found = _meeting(belief, rays, own, directions)
            if found is not None:
                out[point] = found
    return out


def ray_directions(belief: Belief, photo: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """(M, 3) unit vectors of rays to marks xy (M, 2) px from the image centre, y up, in photographs (M,)."""
    out = np.empty((len(photo), 3))
    for number in np.unique(photo):
        own, view = photo == number, belief.view_of(number)
        width, height = view.camera.width, view.camera.height
        out[own] = view.rays(np.column_stack([xy[own, 0] + (width - 1) / 2, (height - 1) / 2 - xy[own, 1]]))
    return out


def _meeting(belief: Belief, rays: Rays, own: np.ndarray, directions: np.ndarray) -> np.ndarray | None:
    """Where most of the rays `own` meet; None where no two of them do in front of their cameras."""
    centres = belief.state.centre[rays.photo]
    pairs = list(combinations(own, 2))[:: max(1, len(own) * (len(own) - 1) // 2 // MOST_PAIRS)]
    ends = np.array(pairs)
    places, _ = intersect_rays(centres[ends.T], directions[ends.T])
    places = places[np.isfinite(places).all(axis=1)]
    best, least = None, np.inf
    for place in places:
        cost = np.minimum(np.linalg.norm(_missed(belief, rays, own, place), axis=1), FAR_OFF).sum()
        if cost < least:
            best, least = place, cost
    if best is None:
        return None
    for _ in range(STEPS):
        missed = _missed(belief, rays, own, best)
        size = np.linalg.norm(missed, axis=1)
        # Redescending: a ray that misses the place by many times the usual is no part of it.
        scale = max(1.5 * float(np.median(size)), 0.5)
        weight = 1.0 / (1.0 + (size / scale) ** 2) ** 2
        state = replace(belief.state, point=best[None])
        jp = derivatives(state, replace(rays.take(own), point=np.zeros(len(own), np.int32)), belief.network.camera_of)[1]
        normal = np.einsum("m,mki,mkj->ij", weight, jp, jp)
        step = np.linalg.lstsq(normal, np.einsum("m,mki,mk->i", weight, jp, missed), rcond=1e-12)[0]
        # Rays that are nearly parallel ask for any distance.
        nearest = np.linalg.norm(centres[own] - best, axis=1).min()
        best = best + step * min(1.0, 0.3 * nearest / max(np.linalg.norm(step), 1e-12))
    return best


def _missed(belief: Belief, rays: Rays, own: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(m, 2) px by which rays miss a place (3,)."""
    state = replace(belief.state, point=place[None])
    return residuals(state, replace(rays.take(own), point=np.zeros(len(own), np.int32)), belief.network.camera_of)
