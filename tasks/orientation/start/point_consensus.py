"""The largest set of rays of a point that meet: a wrong ray must not cost the right ones.

Least squares spread the error of one wrong ray over all of them, and where the wrong one is long (along the base) a right one shows
the largest residual. Every pair of rays is intersected instead, and the place that most rays of the point agree with is taken
(RANSAC of all samples: Fischler and Bolles 1981).
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit

MOST = 12
"""Rays of a point that are paired: 66 pairs; the others only vote."""
LEAST = 3
"""Two rays nearly always meet somewhere; from three on that is no chance."""


class PointRays(NamedTuple):
    """Rays sorted by point, as the kernel takes them: rays first[i] to first[i + 1] belong to point i; `origin`, unit `direction`
    (m, 3); `rotation` (P, 3, 3) of the photographs `photo` (m,); `ideal` (m, 2) in units of c; `tolerance` (m,) in the same."""

    first: np.ndarray
    origin: np.ndarray
    direction: np.ndarray
    rotation: np.ndarray
    photo: np.ndarray
    ideal: np.ndarray
    tolerance: np.ndarray


@njit()
def _meeting(a, b, origin, direction, out):
    """Writes the middle of the shortest connection of two rays; False where they are parallel, or meet behind a photograph."""
    w, u, v = origin[a] - origin[b], direction[a], direction[b]
    uv, uw, vw = np.dot(u, v), np.dot(u, w), np.dot(v, w)
    below = 1.0 - uv * uv
    if below < 1e-8:
        return False
    s, t = (uv * vw - uw) / below, (vw - uv * uw) / below
    if s <= 0.0 or t <= 0.0:
        return False
    for k in range(3):
        out[k] = 0.5 * (origin[a, k] + s * u[k] + origin[b, k] + t * v[k])
    return True


@njit()
def _miss(i, place, rays):
    """By how many tolerances a ray misses a place; inf behind its photograph."""
    R, d = rays.rotation[rays.photo[i]], place - rays.origin[i]
    depth = -(R[2, 0] * d[0] + R[2, 1] * d[1] + R[2, 2] * d[2])
    if depth <= 0.0:
        return np.inf
    x = (R[0, 0] * d[0] + R[0, 1] * d[1] + R[0, 2] * d[2]) / depth - rays.ideal[i, 0]
    y = (R[1, 0] * d[0] + R[1, 1] * d[1] + R[1, 2] * d[2]) / depth - rays.ideal[i, 1]
    return np.sqrt(x * x + y * y) / rays.tolerance[i]


@njit()
def _agreeing(rays):
    """(n,) the number of rays that agree with the best place of each point, and (n, 3) these places."""
    count, best = np.zeros(len(rays.first) - 1, np.int64), np.zeros((len(rays.first) - 1, 3))
    place = np.empty(3)
    for point in range(len(rays.first) - 1):
        low, high = rays.first[point], rays.first[point + 1]
        least = np.inf
        for a in range(low, min(high, low + MOST)):
            for b in range(a + 1, min(high, low + MOST)):
                if not _meeting(a, b, rays.origin, rays.direction, place):
                    continue
                agree, total = 0, 0.0
                for i in range(low, high):
                    miss = _miss(i, place, rays)
                    if miss < 1.0:
                        agree += 1
                        total += miss * miss
                if agree > count[point] or (agree == count[point] and total < least):
                    count[point], least = agree, total
                    best[point] = place
    return count, best


def consensus(rays: PointRays) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (n, 3) that most rays of each point agree with, how many they are (n,), and (m,) bool: rays that agree; no ray of a
    point on which fewer than LEAST agree does."""
    count, place = _agreeing(rays)
    away = np.repeat(place, np.diff(rays.first), axis=0) - rays.origin
    seen = np.einsum("mij,mj->mi", rays.rotation[rays.photo], away)
    depth = np.where(seen[:, 2] < 0, -seen[:, 2], np.nan)
    miss = np.linalg.norm(seen[:, :2] / depth[:, None] - rays.ideal, axis=1) / rays.tolerance
    enough = np.repeat(count >= LEAST, np.diff(rays.first))
    return place, count, enough & (np.nan_to_num(miss, nan=np.inf) < 1.0)
