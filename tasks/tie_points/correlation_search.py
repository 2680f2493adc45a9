"""The published method for near-vertical pairs: interest points, correlation in a window about the mean parallax, back-matching.

A photograph is represented by Harris points with Noble's measure, the strongest of every part of it. Each point of the left
photograph is searched in the right one, in a window centred by the mean parallax: the median over a few points that are correlated
over the whole of two small images. A match that reaches the correlation threshold and is confirmed by back-matching is assigned to
the interest point of the right photograph at its place, so that tracks continue to further photographs; without such a point the
match is not used. Scales must agree within a few per cent and photographs must not be rotated against each other; in all other
cases features with descriptors are needed.

Source: Karfis 2009, sections 2.3, 4.3, 4.4 and 8.3 (sources/epipolar.md#interest-points to #return).
"""

import cv2
import numpy as np
from scipy.spatial import cKDTree

from orthomill.schemas.camera import Cameras
from orthomill.tasks.imagery.masked_pixels import picture_of
from orthomill.tasks.imagery.pyramid import full_to_level, level_to_full
from orthomill.tasks.imagery.radiometry import grey_bytes, grey_range, real_grey
from orthomill.tasks.matching.points.correlation import correlate, correlation_surface
from orthomill.tasks.matching.points.interest_points import interest_points
from orthomill.tasks.tie_points.features import Detection, strongest_in_cells
from orthomill.tasks.tie_points.match_records import DESCRIPTOR, Features, FeatureTables, MatchedPair, Values
from orthomill.tasks.tie_points.pair_matching import PairRules, PhotoPair, accepted_matches
from orthomill.tasks.tie_points.search_settings import CorrelationSearch

# Longer side, px, of the images from which the mean parallax is found: small enough to correlate a template over the whole image.
_SMALL = 240
# Points along each side, half side of their templates, and the least correlation. 21 x 21 px of such an image show a twelfth of the
# photograph: hardly ambiguous, and relief distorts it little.
_SPARSE, _SPARSE_HALF, _SPARSE_LEAST = 7, 10, 0.6
_FEWEST_MOVES = 4  # of 49 points; fewer agree by chance in photographs without common ground
# px of the level: a match belongs to an interest point within this distance. Harris points are located to about a pixel.
_JOIN = 1.5
_STD_FLOOR = 2.0  # grey levels: templates with less contrast are not correlated


def tile_interest_points(
    pixels: np.ndarray, overview: np.ndarray, detection: Detection, search: CorrelationSearch
) -> FeatureTables:
    """Interest points of one tile, as features without direction, all of one size.

    pixels: `detection.window` of the level; overview: the coarsest level.
    """
    grey = grey_bytes(pixels, grey_range(overview))
    window, core = detection.window, detection.core
    inner = core.clipped(detection.shape)
    found = interest_points(grey, search.points, picture_of(pixels), inner.within(window))
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
    # Descriptors of zeros let all later jobs treat both kinds of points alike; they are never compared.
    return FeatureTables(features, Values(np.zeros(count * DESCRIPTOR, np.uint8)))


def correlate_pair(
    features: tuple[Features, Features],
    pixels: tuple[np.ndarray, np.ndarray],
    cameras: Cameras,
    names: tuple[str, str],
    levels: tuple[int, int],
    rules: PairRules,
    search: CorrelationSearch,
) -> MatchedPair:
    """Matches of two photographs and their summary, as from descriptors. pixels: the complete searched levels of both."""
    # 0 means "no data" to the correlation.
    images = [real_grey(one, grey_range(one)) for one in pixels]
    places = [full_to_level(np.column_stack([one.col, one.row]), level) for one, level in zip(features, levels, strict=True)]
    pairs = np.zeros((0, 2), dtype=np.int64)
    parallax = mean_parallax(images[0], images[1])
    if parallax is not None and len(features[0]) and len(features[1]):
        found = correlate(images[0], images[1], places[0], places[0] + parallax, search.correlation)
        pairs = joined(np.column_stack([found.col, found.row]), found.converged, places[1])
    return accepted_matches(features, pairs, PhotoPair.of(cameras, names), rules)


def mean_parallax(left: np.ndarray, right: np.ndarray) -> np.ndarray | None:
    """(2,) right minus left (col, row), px: the median over a few points; None when too few of them correlate."""
    factor = max(max(left.shape), max(right.shape)) / _SMALL
    small = [
        cv2.resize(image, None, fx=1 / factor, fy=1 / factor, interpolation=cv2.INTER_AREA).astype(np.float32)
        for image in (left, right)
    ]
    rows, cols = small[0].shape
    moves = []
    for row in np.linspace(_SPARSE_HALF, rows - 1 - _SPARSE_HALF, _SPARSE).astype(int):
        for col in np.linspace(_SPARSE_HALF, cols - 1 - _SPARSE_HALF, _SPARSE).astype(int):
            template = small[0][row - _SPARSE_HALF : row + _SPARSE_HALF + 1, col - _SPARSE_HALF : col + _SPARSE_HALF + 1]
            surface = correlation_surface(template, small[1], _STD_FLOOR)
            best = np.unravel_index(np.nanargmax(surface), surface.shape)
            if surface[best] > _SPARSE_LEAST:
                moves.append((best[1] + _SPARSE_HALF - col, best[0] + _SPARSE_HALF - row))
    return _densest(np.array(moves, dtype=float).reshape(-1, 2)) * factor if len(moves) >= _FEWEST_MOVES else None


def _densest(moves: np.ndarray) -> np.ndarray:
    """(2,) the median of the parallaxes that agree with most others within a tenth of the small image; wrong ones lie anywhere."""
    near = np.linalg.norm(moves[:, None] - moves[None], axis=2) < 0.1 * _SMALL
    return np.median(moves[near[near.sum(axis=1).argmax()]], axis=0)


def joined(places: np.ndarray, good: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(M, 2) numbers of left points and of the right interest points at their places, each used once, nearest first."""
    # Failed matches are moved out of reach: the tree takes no NaN.
    distance, number = cKDTree(points).query(np.where(good[:, None], places, -1e9), distance_upper_bound=_JOIN)
    left = np.flatnonzero(np.isfinite(distance) & good)
    order = left[np.argsort(distance[left], kind="stable")]
    _, once = np.unique(number[order], return_index=True)
    chosen = np.sort(order[once])
    return np.column_stack([chosen, number[chosen]])
