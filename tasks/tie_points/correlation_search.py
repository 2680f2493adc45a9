"""The published way for near-vertical pairs: interest points, correlation in a window about the mean parallax, matching back.

Harris points with Noble's measure stand for a photograph, the strongest of every part of it. Each point of the left photograph is
searched in the right one, in a window whose middle the mean parallax gives: the median of a few points, correlated over the whole
of two small images. A match that reaches the correlation and leads back is joined to the interest point of the right photograph at
its place, so that tracks run on to further photographs; where there is none the match is not used. Scales must agree within some
percent and photographs must not be turned against each other: for all else there are features with descriptors.

Source: Karfis 2009, sections 2.3, 4.3, 4.4 and 8.3 (methods/relative_orientation_and_epipolar.md, 1.3 to 1.6).
"""

from typing import Any, Literal

import cv2
import numpy as np
from scipy.spatial import cKDTree

from orthomill.schemas.camera import Cameras
from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.imagery.pyramid import full_to_level, level_to_full
from orthomill.tasks.imagery.radiometry import grey_bytes, grey_range
from orthomill.tasks.matching.points.correlation import TemplateCorrelation, correlate, correlation_surface
from orthomill.tasks.matching.points.interest_points import HarrisPoints, interest_points
from orthomill.tasks.tie_points.features import Detection, strongest_in_cells
from orthomill.tasks.tie_points.match_records import DESCRIPTOR, Features, Values
from orthomill.tasks.tie_points.pair_matching import PairRules, accepted_matches

_SMALL = 240
"""Longer side of the images that tell the mean parallax, px"""
_FEW, _FEW_HALF, _FEW_LEAST = 7, 10, 0.6
"""Points along each side that tell it, half side of their templates, and the correlation that counts"""
_JOIN = 1.5
"""px of the level: a match belongs to the interest point within this distance"""


class CorrelationSearch(Settings):
    """Interest points and correlation: near-vertical photographs of one scale, not turned against each other."""

    kind: Literal["correlation"]
    points: HarrisPoints = setting(HarrisPoints(), "Interest points.")
    correlation: TemplateCorrelation = setting(
        TemplateCorrelation(), "Search of each point in the other photograph; pixels of the searched level."
    )


def tile_interest_points(
    pixels: np.ndarray, overview: np.ndarray, detection: Detection, search: CorrelationSearch
) -> dict[str, Any]:
    """Interest points of one tile, as features without direction, all of one size.

    pixels: `detection.window` of the level; overview: the coarsest level.
    """
    grey = grey_bytes(pixels, grey_range(overview))
    window, core = detection.window, detection.core
    inner = core.clipped(detection.shape)
    found = interest_points(
        grey, search.points, core=type(core)(inner.row - window.row, inner.col - window.col, inner.height, inner.width)
    )
    col, row = found.col + window.col, found.row + window.row
    chosen = strongest_in_cells(col, row, found.strength, detection.per_cell)
    count = len(chosen)
    features = Features(
        col=level_to_full(col[chosen], detection.level),
        row=level_to_full(row[chosen], detection.level),
        size=np.full(count, 2.0**detection.level, np.float32),
        angle=np.zeros(count, np.float32),
        response=found.strength[chosen].astype(np.float32),
    )
    return {"features": features, "descriptors": Values(np.zeros(count * DESCRIPTOR, np.uint8))}


def correlate_pair(
    left: Features,
    right: Features,
    left_pixels: np.ndarray,
    right_pixels: np.ndarray,
    cameras: Cameras,
    names: tuple[str, str],
    levels: tuple[int, int],
    rules: PairRules,
    search: CorrelationSearch,
) -> dict[str, Any]:
    """Matches of two photographs and their summary, as from descriptors. left_pixels, right_pixels: the searched levels, whole."""
    images = [np.maximum(grey_bytes(pixels, grey_range(pixels)), 1) for pixels in (left_pixels, right_pixels)]
    places = [full_to_level(np.column_stack([one.col, one.row]), level) for one, level in zip((left, right), levels, strict=True)]
    pairs = np.zeros((0, 2), dtype=np.int64)
    parallax = mean_parallax(images[0], images[1])
    if parallax is not None and len(left) and len(right):
        found = correlate(images[0], images[1], places[0], places[0] + parallax, search.correlation)
        pairs = _joined(np.column_stack([found.col, found.row]), found.converged, places[1])
    return accepted_matches(left, right, pairs, cameras, names, rules)


def mean_parallax(left: np.ndarray, right: np.ndarray) -> np.ndarray | None:
    """(2,) right minus left (col, row), px: the median over a few points; None when too few of them are found."""
    factor = max(max(left.shape), max(right.shape)) / _SMALL
    small = [
        cv2.resize(image, None, fx=1 / factor, fy=1 / factor, interpolation=cv2.INTER_AREA).astype(np.float32)
        for image in (left, right)
    ]
    rows, cols = small[0].shape
    moves = []
    for row in np.linspace(_FEW_HALF, rows - 1 - _FEW_HALF, _FEW).astype(int):
        for col in np.linspace(_FEW_HALF, cols - 1 - _FEW_HALF, _FEW).astype(int):
            template = small[0][row - _FEW_HALF : row + _FEW_HALF + 1, col - _FEW_HALF : col + _FEW_HALF + 1]
            surface = correlation_surface(template, small[1], 2.0)
            best = np.unravel_index(np.nanargmax(surface), surface.shape)
            if surface[best] > _FEW_LEAST:
                moves.append((best[1] + _FEW_HALF - col, best[0] + _FEW_HALF - row))
    return _densest(np.array(moves, dtype=float).reshape(-1, 2)) * factor if len(moves) >= 4 else None


def _densest(moves: np.ndarray) -> np.ndarray:
    """(2,) the median of the moves that agree with most others within a tenth of the small image: wrong ones lie anywhere."""
    near = np.linalg.norm(moves[:, None] - moves[None], axis=2) < 0.1 * _SMALL
    return np.median(moves[near[near.sum(axis=1).argmax()]], axis=0)


def _joined(places: np.ndarray, good: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(M, 2) numbers of left points and of the right interest points at their places, each used once, nearest first."""
    distance, number = cKDTree(points).query(np.where(good[:, None], places, -1e9), distance_upper_bound=_JOIN)
    left = np.flatnonzero(np.isfinite(distance) & good)
    order = left[np.argsort(distance[left], kind="stable")]
    _, once = np.unique(number[order], return_index=True)
    chosen = np.sort(order[once])
    return np.column_stack([chosen, number[chosen]])
