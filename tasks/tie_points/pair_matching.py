"""Homologous features of two photographs: mutual nearest neighbours, ratio test, epipolar check.

Descriptors are bytes, so all dot products of 128 of them are whole numbers below 2^24 and exact in float32: BLAS computes
distances fast, and the same on every machine. The epipolar geometry is found robustly (MAGSAC) from ideal image coordinates,
the lens distortion removed as far as it is known: as an essential matrix (Nister 2004) for calibrated cameras, as a
fundamental matrix when a camera is nominal only. A pair is accepted by Brown & Lowe's rule, which weighs the agreeing matches
against those that chance would give.

Source: Lowe 2004 (ratio test); Barath et al. 2020 (MAGSAC++); Brown & Lowe 2007 (acceptance); Nister 2004.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from schemas.camera import Camera, Cameras
from tasks.geometry.distortion import pixel_to_image
from tasks.tie_points.records import DESCRIPTOR, Features, PairMatches, PairSummary, Scatter, Values

cv2.setNumThreads(1)

_BLOCK = 256
"""rows of distances at a time: 8 MB of them with 8000 points stay in the cache"""
_FEWEST = 16
_STILL = 1.5
"""px"""
_FEWEST_FOR_SCATTER = 60
_TRIMMINGS = 4


@dataclass(frozen=True)
class PairRules:
    """ratio: largest ratio of best to second best distance; tolerance: distance from the epipolar line, full-size px."""

    ratio: float
    tolerance: float


def match_pair(
    left: tuple[Features, Values], right: tuple[Features, Values], cameras: Cameras, names: tuple[str, str], rules: PairRules
) -> dict[str, Any]:
    """Matches of two photographs and their summary; no matches when the pair is not accepted."""
    pairs = mutual_matches(left[1].rows(DESCRIPTOR), right[1].rows(DESCRIPTOR), rules.ratio)
    return accepted_matches(left[0], right[0], pairs, cameras, names, rules)


def accepted_matches(
    left: Features, right: Features, pairs: np.ndarray, cameras: Cameras, names: tuple[str, str], rules: PairRules
) -> dict[str, Any]:
    """What is left of matches (M, 2), numbers of features, after the epipolar check: table and summary."""
    points = _pixels(left)[pairs[:, 0]], _pixels(right)[pairs[:, 1]]
    agree = epipolar_agreement(points, (cameras.of(names[0]), cameras.of(names[1])), rules.tolerance)
    inliers = int(agree.sum())
    alike = stand_still(points)
    accepted = not alike and inliers >= max(_FEWEST, 8.0 + 0.3 * len(pairs))
    kept = pairs[agree] if accepted else pairs[:0]
    summary = PairSummary(left=names[0], right=names[1], tentative=len(pairs), inliers=len(kept), alike=alike)
    return {"matches": PairMatches(kept[:, 0].astype(np.int32), kept[:, 1].astype(np.int32)), "summary": summary}


def stand_still(points: tuple[np.ndarray, np.ndarray]) -> bool:
    """Whether most matches (M, 2) px have the same place in both photographs: then they show no parallax, and a link between them
    would only count the same measurements twice."""
    if len(points[0]) < _FEWEST:
        return False
    return bool((np.abs(points[0] - points[1]).max(axis=1) < _STILL).mean() > 0.7)


def _pixels(features: Features) -> np.ndarray:
    return np.column_stack([features.col, features.row])


def mutual_matches(left: np.ndarray, right: np.ndarray, ratio: float) -> np.ndarray:
    """Rows (M, 2) of descriptors (N, 128) uint8 that are each other's nearest, the nearest closer than `ratio` times the second.

    Sorted by the left number.
    """
    if len(left) < 2 or len(right) < 2:
        return np.empty((0, 2), dtype=np.int64)
    nearest, first, second, closest = _nearest(left.astype(np.float32), right.astype(np.float32))
    mutual = first == closest[nearest]
    chosen = np.flatnonzero(mutual & (first < ratio**2 * second))
    _, once = np.unique(nearest[chosen], return_index=True)
    chosen = chosen[np.sort(once)]
    return np.column_stack([chosen, nearest[chosen]])


def _nearest(left: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """For each left row the number of the nearest right one and the squared distances of the nearest two; for each right row the
    squared distance of the nearest left one. Distances are exact, so that equality tells who is whose."""
    nearest = np.empty(len(left), dtype=np.int64)
    first, second = np.empty(len(left), dtype=np.float32), np.empty(len(left), dtype=np.float32)
    closest = np.full(len(right), np.inf, dtype=np.float32)
    power = (right**2).sum(axis=1)
    for start in range(0, len(left), _BLOCK):
        block = left[start : start + _BLOCK]
        squared = block @ (-2.0 * right.T)
        squared += power
        squared += (block**2).sum(axis=1)[:, None]
        np.minimum(closest, squared.min(axis=0), out=closest)
        rows, part = np.arange(len(block)), slice(start, start + len(block))
        nearest[part] = squared.argmin(axis=1)
        first[part] = squared[rows, nearest[part]]
        squared[rows, nearest[part]] = np.inf
        second[part] = squared.min(axis=1)
    return nearest, first, second, closest


def epipolar_agreement(points: tuple[np.ndarray, np.ndarray], cameras: tuple[Camera, Camera], tolerance: float) -> np.ndarray:
    """Which matches lie within `tolerance` px of their epipolar lines. points: (M, 2) px in each photograph."""
    if len(points[0]) < _FEWEST:
        return np.zeros(len(points[0]), dtype=bool)
    left, right = _ideal(points, cameras)
    if any(camera.source == "exif" for camera in cameras):
        matrix, _ = cv2.findFundamentalMat(left, right, cv2.USAC_MAGSAC, tolerance, 0.9999, 5000)
    else:
        matrix = _essential(left / cameras[0].c, right / cameras[1].c, tolerance / max(camera.c for camera in cameras))
        if matrix is not None:
            scale = [np.diag([1 / camera.c, 1 / camera.c, 1.0]) for camera in cameras]
            matrix = scale[1] @ matrix @ scale[0]
    if matrix is None or matrix.shape != (3, 3):
        return np.zeros(len(left), dtype=bool)
    return sampson_distance(matrix, left, right) < tolerance


def _ideal(points: tuple[np.ndarray, np.ndarray], cameras: tuple[Camera, Camera]) -> tuple[np.ndarray, np.ndarray]:
    return pixel_to_image(cameras[0], points[0]), pixel_to_image(cameras[1], points[1])


def epipolar_scatter(points: tuple[np.ndarray, np.ndarray], cameras: tuple[Camera, Camera]) -> Scatter:
    """Robust standard error of a matched coordinate, from what is left about the best fundamental matrix.

    points: (M, 2) px in each photograph, of which one is taken as free of error (it defines the point), so that all of the distance
    belongs to the other: the Sampson distance shares it between both and is smaller by the root of 2. Lens distortion that the
    cameras do not describe counts as scatter, and rightly so.
    """
    count = len(points[0])
    if count < _FEWEST_FOR_SCATTER:
        return Scatter(points=count, sigma=None)
    left, right = _ideal(points, cameras)
    matrix, _ = cv2.findFundamentalMat(left, right, cv2.USAC_MAGSAC, 1.0, 0.9999, 5000)
    sigma, limit = None, 1.0
    for _ in range(_TRIMMINGS):
        if matrix is None or matrix.shape != (3, 3):
            break
        near = sampson_distance(matrix, left, right) < limit
        if near.sum() < _FEWEST_FOR_SCATTER // 2:
            break
        matrix, _ = cv2.findFundamentalMat(left[near], right[near], cv2.FM_8POINT)
        if matrix is not None and matrix.shape == (3, 3):
            sigma = float(np.sqrt(2.0) * 1.4826 * np.median(sampson_distance(matrix, left, right)))
            limit = 3.0 * sigma
    return Scatter(points=count, sigma=sigma)


def _essential(left: np.ndarray, right: np.ndarray, tolerance: float) -> np.ndarray | None:
    matrix, _ = cv2.findEssentialMat(
        left, right, np.eye(3), method=cv2.USAC_MAGSAC, prob=0.9999, threshold=tolerance, maxIters=5000
    )
    return matrix


def sampson_distance(matrix: np.ndarray, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """First-order distance (M,) of points (M, 2) from the epipolar geometry right' F left = 0, in units of the points.

    Source: Hartley & Zisserman 2003, equation 11.9.
    """
    ones = np.ones((len(left), 1))
    in_right = np.hstack([left, ones]) @ matrix.T
    in_left = np.hstack([right, ones]) @ matrix
    product = np.abs((np.hstack([right, ones]) * in_right).sum(axis=1))
    slope = (in_right[:, :2] ** 2).sum(axis=1) + (in_left[:, :2] ** 2).sum(axis=1)
    return product / np.sqrt(np.maximum(slope, 1e-300))
