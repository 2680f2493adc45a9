"""The check of an epipolar pair: residual y-parallaxes of its tie points.

Source: Karfis 2009, section 5.3 (methods/relative_orientation_and_epipolar.md, 1.11).
"""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.epipolar import EpipolarPair
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


def row_residuals(pair: EpipolarPair, block: Block, ties: ImageResiduals, photos: tuple[str, ...]) -> np.ndarray:
    """y_left - y_right (N,) px of the tie points that both photographs of a pair measured; `photos`: the names by number."""
    # Measured pixels, not adjusted ones: the check must see what matching will see, the lens residuals included.
    left, right = common_measurements(ties, photos.index(pair.left), photos.index(pair.right))
    rows = [
        epipolar_view(pair, side, block_view(block, name)).from_photo(np.column_stack([ties.col[at], ties.row[at]]))[:, 1]
        for side, name, at in zip(SIDES, (pair.left, pair.right), (left, right), strict=True)
    ]
    # rows count downwards, y upwards: hence right minus left
    return rows[1] - rows[0]


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
