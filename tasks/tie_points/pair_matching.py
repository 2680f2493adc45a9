"""Homologous features of two photographs: mutual nearest neighbours, ratio test, epipolar check.

The largest features are compared first: where enough of them agree, all others are searched near their epipolar lines only
(descriptor_search.py). The epipolar geometry is estimated robustly (MAGSAC) from image coordinates corrected for lens distortion as
far as it is known: as an essential matrix (Nister 2004) for calibrated cameras, as a fundamental matrix when a camera is nominal
only. A pair is accepted by the rule of Brown & Lowe, which compares the agreeing matches with the number expected by chance.

Source: Lowe 2004 (ratio test); Barath et al. 2020 (MAGSAC++); Brown & Lowe 2007 (acceptance); Nister 2004.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from orthomill.schemas.camera import Camera, Cameras
from orthomill.tasks.geometry.distortion import pixel_to_image
from orthomill.tasks.tie_points.descriptor_search import matches_along_lines, mutual_matches
from orthomill.tasks.tie_points.match_records import DESCRIPTOR, Features, MatchedPair, PairMatches, PairSummary, Scatter, Values

# The largest features of each photograph, the most repeatable ones, give the approximate epipolar geometry,
_FIRST = 2000
# if this many of their matches agree with it (beyond the rule of Brown & Lowe): a wrong geometry would hide all good matches.
_SURE = 20
# Other features are searched within this many times the tolerance: the geometry of a few large points is less precise.
_BAND = 6.0
# Brown & Lowe 2007: n matches that agree by chance are exceeded by 8.0 + 0.3 n with certainty.
_CHANCE_OFFSET, _CHANCE_SHARE = 8.0, 0.3
_FEWEST = 16  # twice the eight points that determine a fundamental matrix
# px, and the share of matches: detection repeats within a pixel where nothing moved. Less than all, for clouds and cars move.
_STILL, _STILL_SHARE = 1.5, 0.7
_FEWEST_FOR_SCATTER = 60  # a median of 60 deviations is good to 15 %
_TRIMMINGS = 4
_CONFIDENCE, _MOST_SAMPLES = 0.9999, 5000
_MAD_TO_SIGMA = 1.4826


@dataclass(frozen=True)
class PairRules:
    """ratio: largest ratio of best to second best distance; tolerance: distance from the epipolar line, full-size px."""

    ratio: float
    tolerance: float


class PhotoPair(NamedTuple):
    """Two photographs by name, and their cameras."""

    names: tuple[str, str]
    cameras: tuple[Camera, Camera]

    @classmethod
    def of(cls, cameras: Cameras, names: tuple[str, str]) -> "PhotoPair":
        """The pair with its cameras among all `cameras`."""
        return cls(names, (cameras.of(names[0]), cameras.of(names[1])))


def match_pair(
    left: tuple[Features, Values], right: tuple[Features, Values], cameras: Cameras, names: tuple[str, str], rules: PairRules
) -> MatchedPair:
    """Matches of two photographs and their summary; no matches when the pair is not accepted."""
    pair = PhotoPair.of(cameras, names)
    return accepted_matches((left[0], right[0]), _searched(left, right, pair.cameras, rules), pair, rules)


def _searched(
    left: tuple[Features, Values], right: tuple[Features, Values], cameras: tuple[Camera, Camera], rules: PairRules
) -> np.ndarray:
    """Matches (M, 2), numbers of features: among all, or along epipolar lines where the largest features determine these."""
    descriptors = left[1].rows(DESCRIPTOR), right[1].rows(DESCRIPTOR)
    if min(len(left[0]), len(right[0])) > 2 * _FIRST:
        places = _ideal((_pixels(left[0]), _pixels(right[0])), cameras)
        few = [_largest(side[0]) for side in (left, right)]
        pairs = mutual_matches(descriptors[0][few[0]], descriptors[1][few[1]], rules.ratio)
        points = places[0][few[0][pairs[:, 0]]], places[1][few[1][pairs[:, 1]]]
        matrix = epipolar_matrix(points, cameras, rules.tolerance)
        enough = max(_SURE, _CHANCE_OFFSET + _CHANCE_SHARE * len(pairs))
        if matrix is not None and (sampson_distance(matrix, *points) < rules.tolerance).sum() >= enough:
            return matches_along_lines(descriptors, places, matrix, _BAND * rules.tolerance, rules.ratio)
    return mutual_matches(*descriptors, rules.ratio)


def _largest(features: Features) -> np.ndarray:
    """Numbers of the largest features."""
    return np.sort(np.argsort(-features.size, kind="stable")[:_FIRST])


def accepted_matches(features: tuple[Features, Features], pairs: np.ndarray, pair: PhotoPair, rules: PairRules) -> MatchedPair:
    """The matches (M, 2), numbers of features, that pass the epipolar check: table and summary."""
    points = _pixels(features[0])[pairs[:, 0]], _pixels(features[1])[pairs[:, 1]]
    agree = epipolar_agreement(points, pair.cameras, rules.tolerance)
    alike = without_parallax(points)
    accepted = not alike and int(agree.sum()) >= max(_FEWEST, _CHANCE_OFFSET + _CHANCE_SHARE * len(pairs))
    kept = pairs[agree] if accepted else pairs[:0]
    summary = PairSummary(left=pair.names[0], right=pair.names[1], tentative=len(pairs), inliers=len(kept), alike=alike)
    return MatchedPair(PairMatches(kept[:, 0].astype(np.int32), kept[:, 1].astype(np.int32)), summary)


def without_parallax(points: tuple[np.ndarray, np.ndarray]) -> bool:
    """Whether most matches (M, 2) px have the same place in both photographs.

    Such a pair determines no heights, and a link between the two would only count the same measurements twice.
    """
    if len(points[0]) < _FEWEST:
        return False
    return bool((np.abs(points[0] - points[1]).max(axis=1) < _STILL).mean() > _STILL_SHARE)


def _pixels(features: Features) -> np.ndarray:
    return np.column_stack([features.col, features.row])


def epipolar_agreement(points: tuple[np.ndarray, np.ndarray], cameras: tuple[Camera, Camera], tolerance: float) -> np.ndarray:
    """(M,) bool: matches within `tolerance` px of their epipolar lines. points: (M, 2) px in each photograph."""
    left, right = _ideal(points, cameras)
    matrix = epipolar_matrix((left, right), cameras, tolerance)
    if matrix is None:
        return np.zeros(len(left), dtype=bool)
    return sampson_distance(matrix, left, right) < tolerance


def epipolar_matrix(points: tuple[np.ndarray, np.ndarray], cameras: tuple[Camera, Camera], tolerance: float) -> np.ndarray | None:
    """F (3, 3) of right' F left = 0 with which most matches agree; None for too few matches, or where there is no such matrix.

    points: (M, 2) image coordinates in px, corrected for distortion as far as it is known.
    """
    left, right = points
    if len(left) < _FEWEST:
        return None
    # A camera constant from EXIF is wrong by several per cent: an essential matrix would force the matches onto wrong lines.
    if any(camera.source == "exif" for camera in cameras):
        return _fundamental(left, right, tolerance)
    essential = _essential(left / cameras[0].c, right / cameras[1].c, tolerance / max(camera.c for camera in cameras))
    if essential is None:
        return None
    scale = [np.diag([1 / camera.c, 1 / camera.c, 1.0]) for camera in cameras]
    return scale[1] @ essential @ scale[0]


def _ideal(points: tuple[np.ndarray, np.ndarray], cameras: tuple[Camera, Camera]) -> tuple[np.ndarray, np.ndarray]:
    return pixel_to_image(cameras[0], points[0]), pixel_to_image(cameras[1], points[1])


def epipolar_scatter(points: tuple[np.ndarray, np.ndarray], cameras: tuple[Camera, Camera]) -> Scatter:
    """Robust standard error of a matched coordinate, from the residuals about the best fundamental matrix.

    points: (M, 2) px in each photograph. Lens distortion that the cameras do not describe counts as scatter, as it should: it is an
    error of the observations with respect to the model.
    """
    count = len(points[0])
    if count < _FEWEST_FOR_SCATTER:
        return Scatter(points=count, sigma=None)
    left, right = _ideal(points, cameras)
    # A fundamental matrix even for calibrated cameras: an error of the interior orientation is not one of the matching.
    matrix = _fundamental(left, right, 1.0)
    sigma, limit = None, 1.0
    for _ in range(_TRIMMINGS):
        if matrix is None:
            break
        near = sampson_distance(matrix, left, right) < limit
        if near.sum() < _FEWEST_FOR_SCATTER // 2:
            break
        matrix = _unique(cv2.findFundamentalMat(left[near], right[near], cv2.FM_8POINT)[0])
        if matrix is not None:
            # One of the two points defines the tie point and is free of error, so the other has all of the distance; the Sampson
            # distance divides it between both and is smaller by the root of 2.
            sigma = float(np.sqrt(2.0) * _MAD_TO_SIGMA * np.median(sampson_distance(matrix, left, right)))
            limit = 3.0 * sigma
    return Scatter(points=count, sigma=sigma)


def _fundamental(left: np.ndarray, right: np.ndarray, tolerance: float) -> np.ndarray | None:
    """The fundamental matrix of most matches; None where there is none."""
    try:
        found = cv2.findFundamentalMat(left, right, cv2.USAC_MAGSAC, tolerance, _CONFIDENCE, _MOST_SAMPLES)[0]
    except cv2.error:
        # MAGSAC of OpenCV fails for a few sets of points ("!model.empty()"), good ones among them; RANSAC does not.
        found = cv2.findFundamentalMat(left, right, cv2.FM_RANSAC, tolerance, _CONFIDENCE, _MOST_SAMPLES)[0]
    return _unique(found)


def _essential(left: np.ndarray, right: np.ndarray, tolerance: float) -> np.ndarray | None:
    """The essential matrix of most matches; None where there is none."""
    found, _ = cv2.findEssentialMat(
        left, right, np.eye(3), method=cv2.USAC_MAGSAC, prob=_CONFIDENCE, threshold=tolerance, maxIters=_MOST_SAMPLES
    )
    return _unique(found)


def _unique(found: np.ndarray | None) -> np.ndarray | None:
    """The matrix (3, 3); None where OpenCV found none, or several (it then stacks them)."""
    return None if found is None or found.shape != (3, 3) else np.asarray(found)


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
