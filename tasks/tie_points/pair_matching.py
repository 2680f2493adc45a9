"""Homologous features of two photographs: mutual nearest neighbours, ratio test, epipolar check.

The largest features are compared first: where enough of them agree, all others are looked for about their epipolar lines only
(descriptor_search.py). The epipolar geometry is found robustly (MAGSAC) from ideal image coordinates,
the lens distortion removed as far as it is known: as an essential matrix (Nister 2004) for calibrated cameras, as a
fundamental matrix when a camera is nominal only. A pair is accepted by Brown & Lowe's rule, which weighs the agreeing matches
against those that chance would give.

Source: Lowe 2004 (ratio test); Barath et al. 2020 (MAGSAC++); Brown & Lowe 2007 (acceptance); Nister 2004.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from orthomill.schemas.camera import Camera, Cameras
from orthomill.tasks.geometry.distortion import pixel_to_image
from orthomill.tasks.tie_points.descriptor_search import matches_along_lines, mutual_matches
from orthomill.tasks.tie_points.match_records import DESCRIPTOR, Features, PairMatches, PairSummary, Scatter, Values

cv2.setNumThreads(1)

_FIRST = 2000
"""The largest features of each photograph, which are found again most surely, tell how two photographs lie to each other."""
_SURE = 20
"""So many of their matches must agree, so that the others are looked for about epipolar lines only,"""
_BAND = 6.0
"""within so many times the tolerance."""
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
    pairs = _searched(left, right, (cameras.of(names[0]), cameras.of(names[1])), rules)
    return accepted_matches(left[0], right[0], pairs, cameras, names, rules)


def _searched(
    left: tuple[Features, Values], right: tuple[Features, Values], cameras: tuple[Camera, Camera], rules: PairRules
) -> np.ndarray:
    """Matches (M, 2), numbers of features: among all, or along epipolar lines where the largest features tell these."""
    descriptors = left[1].rows(DESCRIPTOR), right[1].rows(DESCRIPTOR)
    if min(len(left[0]), len(right[0])) > 2 * _FIRST:
        places = _ideal((_pixels(left[0]), _pixels(right[0])), cameras)
        few = [_largest(side[0]) for side in (left, right)]
        pairs = mutual_matches(descriptors[0][few[0]], descriptors[1][few[1]], rules.ratio)
        points = places[0][few[0][pairs[:, 0]]], places[1][few[1][pairs[:, 1]]]
        matrix = epipolar_matrix(points, cameras, rules.tolerance)
        if matrix is not None and (sampson_distance(matrix, *points) < rules.tolerance).sum() >= max(_SURE, 8.0 + 0.3 * len(pairs)):
            return matches_along_lines(descriptors, places, matrix, _BAND * rules.tolerance, rules.ratio)
    return mutual_matches(*descriptors, rules.ratio)


def _largest(features: Features) -> np.ndarray:
    """Numbers of the largest features."""
    return np.sort(np.argsort(-features.size, kind="stable")[:_FIRST])


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


def epipolar_agreement(points: tuple[np.ndarray, np.ndarray], cameras: tuple[Camera, Camera], tolerance: float) -> np.ndarray:
    """Which matches lie within `tolerance` px of their epipolar lines. points: (M, 2) px in each photograph."""
    left, right = _ideal(points, cameras)
    matrix = epipolar_matrix((left, right), cameras, tolerance)
    if matrix is None:
        return np.zeros(len(left), dtype=bool)
    return sampson_distance(matrix, left, right) < tolerance


def epipolar_matrix(points: tuple[np.ndarray, np.ndarray], cameras: tuple[Camera, Camera], tolerance: float) -> np.ndarray | None:
    """F (3, 3) of right' F left = 0 that most matches agree with; None for too few of them, or where there is none.

    points: (M, 2) image coordinates in px, free of distortion as far as it is known.
    """
    left, right = points
    if len(left) < _FEWEST:
        return None
    if any(camera.source == "exif" for camera in cameras):
        matrix = _fundamental(left, right, tolerance)
    else:
        matrix = _essential(left / cameras[0].c, right / cameras[1].c, tolerance / max(camera.c for camera in cameras))
        if matrix is not None and matrix.shape == (3, 3):
            scale = [np.diag([1 / camera.c, 1 / camera.c, 1.0]) for camera in cameras]
            matrix = scale[1] @ matrix @ scale[0]
    return matrix if matrix is not None and matrix.shape == (3, 3) else None


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
    matrix = _fundamental(left, right, 1.0)
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


def _fundamental(left: np.ndarray, right: np.ndarray, tolerance: float) -> np.ndarray | None:
    """OpenCV's MAGSAC stumbles over a few sets of points ("!model.empty()"), good ones among them; RANSAC finds these."""
    try:
        return cv2.findFundamentalMat(left, right, cv2.USAC_MAGSAC, tolerance, 0.9999, 5000)[0]
    except cv2.error:
        return cv2.findFundamentalMat(left, right, cv2.FM_RANSAC, tolerance, 0.9999, 5000)[0]


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
