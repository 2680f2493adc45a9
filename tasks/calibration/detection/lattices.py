"""Chessboard lattices of any size and outline in a grey image: what a detector for a stated number of corners cannot find.

A corner of four squares is a saddle of the smoothed image, where the determinant of the Hessian has a minimum. The Hessian also
gives the two directions without curvature of the grey value: the edges of the squares. From a saddle that has a neighbour along all
four of its edges, with black and white exchanged, the lattice grows neighbour by neighbour; where the frame cuts a row, it ends.
"""

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

# Wide enough for the second derivatives of a noisy image, and narrow enough for squares of six pixels.
_SMOOTH = 1.2
"""px: standard deviation of the Gaussian"""
_APART = 5
"""px: side of the window in which only the strongest saddle counts."""
_STRONG = 0.1
"""Least determinant of a saddle, as a share of that of the strong ones."""
_MOST = 6000
"""Saddles that are considered, strongest first: vegetation has more of them than any set of boards."""
_ALONG = np.cos(np.radians(22.0))
"""Least cosine between an edge and the direction to the neighbour along it."""
_BALANCED = 1.8
"""Largest ratio of the distances to opposite neighbours: perspective shortens a square less than that from one to the next."""
_EXCHANGED = 0.6
"""Least |cosine| between the bright axis of a saddle and the dark axis of its neighbour."""
_OFF = 0.3
"""Largest distance of a saddle from its prediction, in steps of the lattice."""
_STEPS = ((0, 1), (1, 0), (0, -1), (-1, 0))


@dataclass(frozen=True, eq=False)
class _Saddles:
    """`xy` (n, 2) px, strongest first; `edges` (n, 2, 2) unit vectors; `bright` (n, 2) unit vectors towards the white squares."""

    xy: np.ndarray
    edges: np.ndarray
    bright: np.ndarray
    tree: cKDTree

    def exchanged(self, one: int, other: np.ndarray) -> np.ndarray:
        """Whether black and white change places between a saddle and others (m,)."""
        dark = np.array([-self.bright[one, 1], self.bright[one, 0]])
        return np.abs(self.bright[other] @ dark) > _EXCHANGED


def lattices(image: np.ndarray, fewest: int) -> list[np.ndarray]:
    """Lattices (rows, cols, 2) (col, row) px with `fewest` corners or more in a grey image (rows, cols) uint8, largest first; NaN
    where no corner was found. Corners are at integer pixels: they are refined afterwards."""
    saddles = _saddles(image)
    free = np.ones(len(saddles.xy), bool)
    out = []
    for seed in range(len(saddles.xy)):
        if free[seed]:
            lattice = _grown(saddles, seed, free)
            if len(lattice) >= fewest:
                free[list(lattice.values())] = False
                out.append(_as_array(saddles, lattice))
    return sorted(out, key=lambda grid: -np.isfinite(grid).sum())


def _saddles(image: np.ndarray) -> _Saddles:
    # float32 is enough: places are integer pixels, and only ratios of the derivatives are used.
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), _SMOOTH)
    xx, xy, yy = (cv2.Sobel(smooth, cv2.CV_32F, *order, ksize=3) for order in ((2, 0), (1, 1), (0, 2)))
    strength = xy * xy - xx * yy
    best = cv2.dilate(strength, np.ones((_APART, _APART), np.uint8))
    # A percentile instead of the maximum: one specular highlight would otherwise hide all corners. 1.0 keeps flat images empty.
    peaks = (strength == best) & (strength > _STRONG * max(float(np.percentile(best, 99.5)), 1.0))
    row, col = np.nonzero(peaks)
    order = np.argsort(-strength[row, col], kind="stable")[:_MOST]
    row, col = row[order], col[order]
    values, axes = np.linalg.eigh(np.stack([xx[row, col], xy[row, col], xy[row, col], yy[row, col]], axis=-1).reshape(-1, 2, 2))
    bright, dark = axes[:, :, 1], axes[:, :, 0]
    # Along the edges the curvatures towards white and towards black cancel.
    towards = np.sqrt(np.abs(values[:, 0]) / np.maximum(values[:, 1] - values[:, 0], 1e-9))[:, None]
    aside = np.sqrt(np.clip(1.0 - towards**2, 0.0, 1.0))
    edges = np.stack([towards * bright + aside * dark, towards * bright - aside * dark], axis=1)
    places = np.column_stack([col, row]).astype(np.float64)
    # cKDTree refuses an empty set; without saddles the tree is never asked.
    return _Saddles(places, edges, bright, cKDTree(places) if len(places) else cKDTree(np.zeros((1, 2))))


def _grown(saddles: _Saddles, seed: int, free: np.ndarray) -> dict[tuple[int, int], int]:
    """Saddles by row and column of the lattice around a seed; empty where the seed lacks one of four neighbours."""
    around = _four(saddles, seed, free)
    if around is None:
        return {}
    lattice = {(0, 0): seed, **dict(zip(_STEPS, around, strict=True))}
    taken, queue = set(lattice.values()), deque(_STEPS)
    while queue:
        at = queue.popleft()
        for step in _STEPS:
            place = (at[0] + step[0], at[1] + step[1])
            if place in lattice:
                continue
            found = _at(saddles, lattice[at], _expected(saddles, lattice, at, step))
            # A saddle has one place: distorted lattices could otherwise fold back onto themselves.
            if found is not None and free[found] and found not in taken:
                lattice[place] = found
                taken.add(found)
                queue.append(place)
    return lattice


def _four(saddles: _Saddles, seed: int, free: np.ndarray) -> list[int] | None:
    """The neighbours along the edges of a saddle, in the order of _STEPS."""
    _, near = saddles.tree.query(saddles.xy[seed], k=min(16, len(saddles.xy)))
    near = np.atleast_1d(near)[1:]
    near = near[free[near]]
    if len(near) < 4:
        return None
    away = saddles.xy[near] - saddles.xy[seed]
    length = np.linalg.norm(away, axis=1)
    fits = saddles.exchanged(seed, near)
    first, second = saddles.edges[seed]
    out = []
    for edge in (first, second, -first, -second):
        along = np.flatnonzero(fits & (away @ edge > _ALONG * length))
        if not len(along):
            return None
        out.append(int(near[along[length[along].argmin()]]))
    sizes = np.linalg.norm(saddles.xy[out] - saddles.xy[seed], axis=1)
    balanced = max(sizes[0] / sizes[2], sizes[2] / sizes[0], sizes[1] / sizes[3], sizes[3] / sizes[1]) < _BALANCED
    return out if balanced and len(set(out)) == 4 else None


def _expected(saddles: _Saddles, lattice: dict[tuple[int, int], int], at: tuple[int, int], step: tuple[int, int]) -> np.ndarray:
    """The vector (2,) to the neighbour: the step before it, or the parallel step of an adjacent row or column."""
    (row, col), (down, right) = at, step
    for i, j in ((row - down, col - right), (row + right, col + down), (row - right, col - down)):
        if (i, j) in lattice and (i + down, j + right) in lattice:
            return saddles.xy[lattice[i + down, j + right]] - saddles.xy[lattice[i, j]]
    return saddles.xy[lattice[0, 0]] - saddles.xy[lattice[-down, -right]]


def _at(saddles: _Saddles, here: int, vector: np.ndarray) -> int | None:
    distance, found = saddles.tree.query(saddles.xy[here] + vector)
    near = distance < _OFF * float(np.linalg.norm(vector)) and saddles.exchanged(here, np.array([found]))[0]
    return int(found) if near else None


def _as_array(saddles: _Saddles, lattice: dict[tuple[int, int], int]) -> np.ndarray:
    place = np.array(list(lattice))
    place -= place.min(axis=0)
    grid = np.full((*(place.max(axis=0) + 1), 2), np.nan)
    grid[place[:, 0], place[:, 1]] = saddles.xy[list(lattice.values())]
    return grid
