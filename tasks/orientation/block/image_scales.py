"""How much larger a photograph shows what it has in common with others: steps between photographs of one camera are zoom, another
lens, or another flying height.

Two photographs of the same ground differ in scale by their camera constants and their distances. Ratios of distances between tie
points need neither orientation nor camera, so that a constant that differs by half is seen before the block breaks on it.
"""

from collections.abc import Iterator

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from orthomill.schemas.orientation import RelativeOrientation
from orthomill.schemas.photo import Photos
from orthomill.tasks.adjustment.model.network import Rays
from orthomill.tasks.imagery.photograph_rows import rows_of_photos
from orthomill.tasks.orientation.block.own_constants import OwnConstant
from orthomill.tasks.orientation.start.block_growth import GrowthMaterial

LEAST_MATCHES = 12
"""Common points of a pair whose scale is worth knowing"""
STEP = np.log(1.1)
"""Smaller steps are those of relief, tilt and flying height."""
CLEAR_STEP = 3.0
"""A step is so many times larger than the scales scatter on its sides."""
LEAST_PHOTOS = 3
"""on each side of a step"""
LIFTED = 3.0
"""Standard errors of heights from which on two groups of positions are flights at two heights"""


def image_scales(rays: Rays, names: tuple[str, ...], pairs: tuple[RelativeOrientation, ...]) -> np.ndarray:
    """(P,) logarithms of the scales of photographs relative to one of them; NaN for those that no pair connects to it."""
    number = {name: i for i, name in enumerate(names)}
    own = rows_of_photos(rays.photo, len(names))
    steps: dict[tuple[int, int], float] = {}
    costs: list[float] = []
    for pair in pairs:
        i, j = number[pair.left], number[pair.right]
        if pair.matches >= LEAST_MATCHES and (step := _step(rays, own[i], own[j])) is not None:
            steps[i, j] = step
            costs.append(1.0 / pair.matches)
    scale = np.full(len(names), np.nan)
    if not steps:
        return scale
    ends = np.array(list(steps))
    # The pairs with most matches, of which none is needed twice: the tree with the smallest sum of their inverses.
    tree = minimum_spanning_tree(coo_matrix((costs, ends.T), (len(names), len(names))))
    root = int(np.bincount(ends.ravel(), minlength=len(names)).argmax())
    order, before = breadth_first_order(tree, root, directed=False)
    scale[root] = 0.0
    for photo in order[1:]:
        other = before[photo]
        scale[photo] = scale[other] + (steps[other, photo] if (other, photo) in steps else -steps[photo, other])
    return scale


def _step(rays: Rays, left: np.ndarray, right: np.ndarray) -> float | None:
    """The logarithm of the scale of the right photograph over that of the left, by the rows of their rays."""
    _, a, b = np.intersect1d(rays.point[left], rays.point[right], return_indices=True)
    if len(a) < LEAST_MATCHES:
        return None
    here, there = rays.xy[left[a]], rays.xy[right[b]]
    # Each point with one half of all further on: distances as long as the common ground, without those between neighbours.
    turn = np.lexsort((here[:, 1], here[:, 0]))
    other = np.roll(turn, len(turn) // 2)
    lengths = [np.linalg.norm(one[turn] - one[other], axis=1) for one in (here, there)]
    known = (lengths[0] > 0) & (lengths[1] > 0)
    return float(np.median(np.log(lengths[1][known] / lengths[0][known]))) if known.any() else None


def shown_constants(photos: Photos, material: GrowthMaterial) -> tuple[OwnConstant, ...]:
    """The photographs that show the ground larger or smaller than the others of their camera, from the same height."""
    scale = image_scales(material.rays, material.names, material.relative)
    rows = [photos[name] for name in material.names]
    height = np.array([np.nan if photo.position is None else photo.position[2] for photo in rows])
    sigma = np.array([np.nan if photo.position_sigma is None else photo.position_sigma[2] for photo in rows])
    return tuple(stepped_constants(scale, material.camera_of, material.names, height, sigma))


def stepped_constants(
    scale: np.ndarray, camera_of: np.ndarray, names: tuple[str, ...], height: np.ndarray, sigma: np.ndarray
) -> Iterator[OwnConstant]:
    """For each camera the photographs that show the ground clearly larger or smaller than its others, where positions do not say
    that they were taken from another height; `height`, `sigma` (P,) m of these, NaN where there are none."""
    for camera in np.unique(camera_of):
        own = np.flatnonzero((camera_of == camera) & np.isfinite(scale))
        own = own[np.argsort(scale[own], kind="stable")]
        if len(own) < 2 * LEAST_PHOTOS:
            continue
        at = LEAST_PHOTOS + int(np.argmax(np.diff(scale[own])[LEAST_PHOTOS - 1 : len(own) - LEAST_PHOTOS]))
        low, high = own[:at], own[at:]
        step = float(np.median(scale[high]) - np.median(scale[low]))
        scatter = 1.5 * max(float(np.median(np.abs(scale[part] - np.median(scale[part])))) for part in (low, high))
        if step < max(STEP, CLEAR_STEP * scatter) or _lifted(height, sigma, low, high):
            continue
        fewer, sign = (high, 1.0) if len(high) <= len(low) else (low, -1.0)
        yield OwnConstant(tuple(names[i] for i in sorted(fewer)), float(np.exp(sign * step)))


def _lifted(height: np.ndarray, sigma: np.ndarray, low: np.ndarray, high: np.ndarray) -> bool:
    """Whether positions say that two groups were taken from different heights."""
    known = [part[np.isfinite(height[part])] for part in (low, high)]
    if not all(map(len, known)):
        return False
    apart = abs(float(np.median(height[known[0]]) - np.median(height[known[1]])))
    return apart > LIFTED * float(np.median(sigma[np.concatenate(known)]))
