"""What tie points tell of epipolar pairs: residual y-parallaxes, the standard error of the rows that follows, the pyramid level on
which rows are good enough to be matched, and how near ground can be.

Source: Karfis 2009, section 5.3 (sources/epipolar.md#row-test).
"""

import math
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.epipolar import EpipolarPair, EpipolarPairs
from orthomill.schemas.observations import ImageResiduals
from orthomill.schemas.orientation import Block
from orthomill.tasks.geometry.normal_case import Side, epipolar_view
from orthomill.tasks.geometry.view import block_view

SIDES: tuple[Side, Side] = ("left", "right")


@dataclass(frozen=True)
class RowResiduals:
    """Statistics of the residual y-parallaxes (px) of the tie points of a pair; NaN without tie points."""

    points: int
    mean: float
    rms: float
    median: float
    greatest: float


ROWS_AGREE = 0.4
"""px: standard error of the rows up to which images are matched as they are: four of five homologous pixels lie on the same row"""
LEAST_POINTS = 10
"""tie points from which their y-parallaxes tell the standard error of a pair's rows to about a quarter"""
NEAREST = 2.0
"""times the parallax of its nearest tie point that a pair is searched to: what stands half as far from the cameras as all ground
that they share is rarely seen by both, and a photograph from low over the ground would show it in very many pixels"""
_NORMAL = 1.4826
"""standard deviation of a normal distribution over its median absolute value"""


def with_measured_ties(pairs: EpipolarPairs, block: Block, measured: ImageResiduals, photos: tuple[str, ...]) -> EpipolarPairs:
    """The pairs with what their tie points measured, where there are enough: the `row_sigma` (px), and a range of parallaxes that
    ends where nothing near their ground lies; `photos`: the names by number."""
    ties = kept_ties(measured)
    return pairs.model_copy(update={"pairs": tuple(_with_ties(pair, block, ties, photos) for pair in pairs.pairs)})


def _with_ties(pair: EpipolarPair, block: Block, ties: ImageResiduals, photos: tuple[str, ...]) -> EpipolarPair:
    left, right = tie_places(pair, block, ties, photos)
    if len(left) < LEAST_POINTS:
        return pair
    # About zero, not about their mean: an offset of the rows is an error of the orientation as well. The median, because a few
    # wrong tie points that the adjustment kept say nothing about the rows of the others.
    sigma = _NORMAL * summary(right[:, 1] - left[:, 1]).median
    nearest = float((left[:, 0] - pair.left_col0 - (right[:, 0] - pair.right_col0)).max())
    high = min(pair.parallax_high, max(NEAREST * nearest, pair.parallax_low))
    return pair.model_copy(update={"row_sigma": sigma, "parallax_high": high})


def matched_level(pairs: EpipolarPairs) -> int:
    """The finest pyramid level on which the rows of the median pair agree, as tie points measured them.

    pairs: on level 0, after `with_measured_ties`.

    Photographs that do not fit together to a pixel (a stabiliser, a moving shutter, a lens that the camera model cannot follow)
    show the same place on different rows: neither windows nor signatures compare what belongs together, and nearly nothing is
    measured. Their coarser levels fit. One level for all pairs, because all meet in one surface.
    """
    # Predictions do not count: the covariance of a weak block predicts many pixels where tie points measure a tenth.
    sigmas = [pair.row_sigma for pair in pairs.pairs if pair.row_sigma != pair.row_sigma_predicted]
    return math.ceil(math.log2(max(float(np.median(sigmas)) / ROWS_AGREE, 1.0))) if sigmas else 0


def kept_ties(measured: ImageResiduals) -> ImageResiduals:
    """The measurements of tie points that the adjustment kept."""
    # Points of track < 0 are control and check points: their targets were measured by hand, in another precision.
    return measured.take(measured.used & (measured.track >= 0))


def row_residuals(pair: EpipolarPair, block: Block, ties: ImageResiduals, photos: tuple[str, ...]) -> np.ndarray:
    """y_left - y_right (N,) px of the tie points that both photographs of a pair measured; `photos`: the names by number."""
    left, right = tie_places(pair, block, ties, photos)
    # rows count downwards, y upwards: hence right minus left
    return right[:, 1] - left[:, 1]


def tie_places(pair: EpipolarPair, block: Block, ties: ImageResiduals, photos: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows (N, 2), (N, 2) in the two images of a pair of the tie points that both photographs measured."""
    # Measured pixels, not adjusted ones: the check must see what matching will see, the lens residuals included.
    left, right = common_measurements(ties, photos.index(pair.left), photos.index(pair.right))
    in_left, in_right = (
        epipolar_view(pair, side, block_view(block, name)).from_photo(np.column_stack([ties.col[at], ties.row[at]]))
        for side, name, at in zip(SIDES, (pair.left, pair.right), (left, right), strict=True)
    )
    return in_left, in_right


def common_measurements(ties: ImageResiduals, left: int, right: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the table (N,), (N,) that measure the same tie point in the photographs `left` and `right` (numbers)."""
    in_left, in_right = np.flatnonzero(ties.photo == left), np.flatnonzero(ties.photo == right)
    _, at_left, at_right = np.intersect1d(ties.track[in_left], ties.track[in_right], return_indices=True)
    return in_left[at_left], in_right[at_right]


def summary(residuals: np.ndarray) -> RowResiduals:
    """Mean, RMS, median and maximum of residual y-parallaxes (N,) px; median and maximum of the absolute values."""
    if not len(residuals):
        return RowResiduals(0, *[float("nan")] * 4)
    size = np.abs(residuals)
    rms = float(np.sqrt((residuals**2).mean()))
    return RowResiduals(len(residuals), float(residuals.mean()), rms, float(np.median(size)), float(size.max()))
