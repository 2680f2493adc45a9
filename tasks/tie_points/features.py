"""Interest points with descriptors: SIFT, part by part, evenly distributed over the photograph.

A part of a photograph is searched with a halo that holds the neighbourhood of the largest point that is kept (`LARGEST`), and
starts at a multiple of 16 px, so that every octave is sampled at the same pixels as in the whole photograph: the division does
not change the points beyond the rounding of OpenCV's filters. For independence of the project's tiles even of that, the parts have
a size of their own (`SEARCHED`). The strongest points of each cell of 64 px are kept, and of these the photograph keeps the best of
every cell, then the second best, and so on up to its limit: weakly textured fields get points next to richly textured roofs.

Descriptors are stored as bytes of RootSIFT, whose Euclidean distance is the Hellinger distance of the histograms.

Source: Lowe 2004; Arandjelovic & Zisserman 2012.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from orthomill.schemas.raster import Tile, Window, tiles_of
from orthomill.tasks.imagery.masked_pixels import is_masked, picture_of
from orthomill.tasks.imagery.pyramid import full_to_level, level_to_full
from orthomill.tasks.imagery.radiometry import grey_bytes, grey_range
from orthomill.tasks.tie_points.match_records import DESCRIPTOR, Features, FeatureTables, Values

HALO = 96
"""px of the level: 5.3 times the largest diameter, rounded up to a multiple of 16"""
SEARCHED = 800
"""approximate side of the parts that are searched, px of the level; SIFT then needs a few hundred MB"""
SMALLEST, LARGEST = 2.5, 18.0
"""Diameters of points, px of the level. The many points below 2.5 px are rarely found again in another photograph."""
CELL = 64
"""px of the level: side of the cells over which points are distributed evenly"""
_DESCRIPTOR_REACH = 5.3
"""diameters of a point from its centre"""
_OCTAVE_STEP = 16  # px: 2^4, so that four octaves are sampled at the same pixels in every part
_SPARE = 2  # a cell offers this many times its fair share
_LEAST_PER_CELL = 8
_HARDLY_ANY, _FAINTER = 8, 4
"""a part with less than one of so many points of its fair share is searched again, at so many times less contrast"""
# OpenCV packs octave and layer of a key point into one integer: 255 is octave -1 (the image doubled), 1 << 8 its first layer.
_FIRST_OCTAVE = 255 | (1 << 8)
# 512 scales the root of a share to a byte: shares above a quarter, of which a histogram has four at most, are clipped.
_ROOT_SIFT_SCALE = 512.0


def searched_parts(shape: tuple[int, int]) -> Iterator[Tile]:
    """The parts of a level that are searched: its rows and columns in equal parts, rounded up to a multiple of 16 px.

    The halo costs the same whatever it surrounds: a narrow last part would consist of halo only.
    """
    return tiles_of(shape, (_searched_side(shape[0]), _searched_side(shape[1])))


def _searched_side(length: int) -> int:
    parts = max(1, round(length / SEARCHED))
    return -(-length // (_OCTAVE_STEP * parts)) * _OCTAVE_STEP


@dataclass(frozen=True)
class Detection:
    """Where and how a part is searched: the pyramid level, its shape, the part's core window in it, and the photograph's limits."""

    level: int
    shape: tuple[int, int]
    core: Window
    max_features: int
    contrast: float

    @property
    def window(self) -> Window:
        """The window of the level that has to be read."""
        return self.core.grown(HALO).clipped(self.shape)

    @property
    def fair_share(self) -> float:
        """Points that the part would have, were the photograph's spread evenly."""
        return self.max_features * self.core.cells / (self.shape[0] * self.shape[1])

    @property
    def per_cell(self) -> int:
        """Points that a cell may offer: several times its fair share, to compensate for empty cells."""
        cells = -(-self.shape[0] // CELL) * -(-self.shape[1] // CELL)
        return max(_LEAST_PER_CELL, -(-_SPARE * self.max_features // cells))


def tile_features(pixels: np.ndarray, overview: np.ndarray, detection: Detection) -> FeatureTables:
    """Features and descriptors of one part. pixels: `detection.window` of the level; overview: the coarsest level."""
    grey = grey_bytes(pixels, grey_range(overview))
    # OpenCV's own limit would be that of the part; the photograph's is applied to all parts together.
    sift, points = _points(grey, detection)
    numbers = np.array([(*point.pt, point.size, point.angle, point.response) for point in points]).reshape(-1, 5)
    if is_masked(pixels):
        whole = _whole_descriptors(numbers, picture_of(pixels))
        numbers, points = numbers[whole], [points[number] for number in whole]
    # Descriptors are most of the work: they are computed for points that the photograph may keep only.
    chosen = _strongest_in_core(numbers, detection)
    descriptors = _descriptors(sift, grey, [points[number] for number in chosen])
    return FeatureTables(_features(numbers[chosen], detection), Values(descriptors.ravel()))


def _points(grey: np.ndarray, detection: Detection) -> tuple[cv2.SIFT, list[cv2.KeyPoint]]:
    """Points of a part and what describes them. A part in haze, under water or at dusk has its points as well, at a fraction of the
    usual contrast: where hardly any has that, they are searched for among the fainter ones."""
    for contrast in (detection.contrast, detection.contrast / _FAINTER):
        sift = cv2.SIFT.create(nfeatures=0, contrastThreshold=contrast)
        points = [point for point in sift.detect(grey, None) if SMALLEST <= point.size <= LARGEST]
        if len(points) >= detection.fair_share / _HARDLY_ANY:
            break
    return sift, points


def _whole_descriptors(numbers: np.ndarray, picture: np.ndarray) -> np.ndarray:
    """Numbers of the points whose descriptors reach no pixel outside of the picture: the edge of a mask stays where it is in the
    frame, or moves with a person, and would be matched with itself."""
    away = cv2.distanceTransform(picture.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    col, row = (np.rint(numbers[:, axis]).astype(int) for axis in (0, 1))
    inside = away[np.clip(row, 0, picture.shape[0] - 1), np.clip(col, 0, picture.shape[1] - 1)]
    return np.flatnonzero(inside > _DESCRIPTOR_REACH * numbers[:, 2])


def _strongest_in_core(numbers: np.ndarray, detection: Detection) -> np.ndarray:
    """Numbers of the points in the core that the photograph may keep, whatever its other parts offer, in a fixed order."""
    core, window = detection.core, detection.window
    col, row = numbers[:, 0] + window.col, numbers[:, 1] + window.row
    inside = (col >= core.col) & (col < core.col + core.width) & (row >= core.row) & (row < core.row + core.height)
    kept = np.flatnonzero(inside)
    # Position and direction break ties of equal strength: OpenCV's own order depends on its threads.
    order = kept[np.lexsort((numbers[kept, 3], col[kept], row[kept], -numbers[kept, 4]))]
    order = order[_rank_in_cell(col[order], row[order]) < detection.per_cell]
    return order[_best_of_cells(col[order], row[order], numbers[order, 4], detection.max_features)]


def strongest_in_cells(col: np.ndarray, row: np.ndarray, strength: np.ndarray, per_cell: int) -> np.ndarray:
    """Numbers of the points, px of the level, that are among the `per_cell` strongest of their cell, in a fixed order."""
    order = np.lexsort((col, row, -strength))
    return order[_rank_in_cell(col[order], row[order]) < per_cell]


def _best_of_cells(col: np.ndarray, row: np.ndarray, strength: np.ndarray, most: int) -> np.ndarray:
    """Numbers of at most `most` points, px of the level: the best point of every cell before the second best of any."""
    by_strength = np.lexsort((col, row, -strength))
    rank = np.empty(len(col), dtype=np.int64)
    rank[by_strength] = _rank_in_cell(col[by_strength], row[by_strength])
    return np.lexsort((col, row, -strength, rank))[:most]


def _rank_in_cell(col: np.ndarray, row: np.ndarray) -> np.ndarray:
    """How many points of the same cell precede each one."""
    cell = (row // CELL).astype(np.int64) * 2**20 + (col // CELL).astype(np.int64)
    order = np.argsort(cell, kind="stable")
    _, starts, counts = np.unique(cell[order], return_index=True, return_counts=True)
    rank = np.empty(len(cell), dtype=np.int64)
    rank[order] = np.arange(len(cell)) - np.repeat(starts, counts)
    return rank


def _descriptors(sift: cv2.SIFT, grey: np.ndarray, points: Sequence[cv2.KeyPoint]) -> np.ndarray:
    """RootSIFT (N, 128) uint8.

    OpenCV builds its pyramid from the finest octave among the points; an additional point of the very finest octave makes it
    independent of the points that a part happens to hold.
    """
    if not points:
        return np.empty((0, DESCRIPTOR), dtype=np.uint8)
    finest = cv2.KeyPoint(grey.shape[1] / 2, grey.shape[0] / 2, 2.0, 0.0, 0.0, _FIRST_OCTAVE)
    _, raw = sift.compute(grey, [finest, *points])
    raw = np.asarray(raw)[1:]
    shares = raw / np.maximum(raw.sum(axis=1, keepdims=True), 1.0)
    return np.clip(np.rint(_ROOT_SIFT_SCALE * np.sqrt(shares)), 0, 255).astype(np.uint8)


def _features(numbers: np.ndarray, detection: Detection) -> Features:
    window, scale = detection.window, 2**detection.level
    return Features(
        col=level_to_full(numbers[:, 0] + window.col, detection.level),
        row=level_to_full(numbers[:, 1] + window.row, detection.level),
        size=(numbers[:, 2] * scale).astype(np.float32),
        angle=numbers[:, 3].astype(np.float32),
        response=numbers[:, 4].astype(np.float32),
    )


def photo_features(features: tuple[Features, ...], descriptors: tuple[Values, ...], level: int, max_features: int) -> FeatureTables:
    """The features of a photograph from those of its parts: at most `max_features`, evenly distributed, in order of their rows."""
    col, row, response = (np.concatenate([getattr(part, name) for part in features]) for name in ("col", "row", "response"))
    best = _best_of_cells(full_to_level(col, level), full_to_level(row, level), response, max_features)
    size, angle = (np.concatenate([getattr(part, name) for part in features]) for name in ("size", "angle"))
    chosen = best[np.lexsort((angle[best], col[best], row[best]))]
    values = np.concatenate([part.rows(DESCRIPTOR) for part in descriptors])[chosen]
    return FeatureTables(Features(col[chosen], row[chosen], size[chosen], angle[chosen], response[chosen]), Values(values.ravel()))
