"""Interest points: pixels whose surroundings can be distinguished from those of all their neighbours.

Strategy
- One structure tensor for both operators: gradients by the undivided 3 x 3 masks of Prewitt, their products smoothed by a
  Gaussian. Noble's measure of the Harris operator, det / trace, is Foerstner's weight up to a factor; Foerstner adds the roundness
  of the error ellipse.
- The sub-pixel place is the peak of a paraboloid through the measure. Foerstner's own second step, the point where the gradients of
  the window intersect, is closer to a true corner but biased towards pixel centres: on texture it follows a shift of the image less
  well.
- A point is the highest pixel within a radius. Of equal ones the first in reading order is chosen, so that synthetic patterns give
  one point and not none.
- Pixels without data are NaN. They have no gradient, nor do their neighbours: the edge of a mask is no edge of the image.
- The neighbourhood is bounded, so a tile with `reach` pixels around it gives what the whole image gives.

Source: Karfis 2009 (sources/epipolar.md#interest-points); Harris and Stephens 1988; Noble 1989; Foerstner and Guelch 1987.
"""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.raster import Window
from orthomill.schemas.settings import setting
from orthomill.tasks.matching.points.point_settings import HarrisPoints, _Detector
from orthomill.tasks.matching.points.sub_pixel import paraboloid_peaks
from orthomill.tasks.matching.smoothing import smoothed, with_gaps

_PREWITT = 6.0
"""response of the mask to a slope of one grey value per px"""


class FoerstnerPoints(_Detector):
    """Foerstner's operator: weight and roundness."""

    kind: Literal["foerstner"] = "foerstner"
    min_weight: float = setting(
        5000.0,
        "Weight that a point must exceed; noise of s grey values leaves s / sqrt(weight) px.",
        "grey values^2 / px^2",
        gt=0.0,
    )
    min_roundness: float = setting(
        0.5, "Roundness of the error ellipse that a point must exceed: 0 is a straight edge, 1 a circle.", ge=0.0, lt=1.0
    )


Detector = Annotated[HarrisPoints | FoerstnerPoints, Field(discriminator="kind")]


@dataclass(frozen=True)
class InterestPoints:
    """One row per point, in reading order."""

    col: np.ndarray
    row: np.ndarray
    """(N,) float64: sub-pixel position, px"""
    strength: np.ndarray
    """(N,) float32: Noble's measure, or Foerstner's weight"""

    def __len__(self) -> int:
        return len(self.col)

    def take(self, chosen: np.ndarray) -> "InterestPoints":
        """The rows `chosen`, numbers or a mask."""
        return InterestPoints(self.col[chosen], self.row[chosen], self.strength[chosen])


def interest_points(
    image: np.ndarray, detector: HarrisPoints | FoerstnerPoints, mask: np.ndarray | None = None, core: Window | None = None
) -> InterestPoints:
    """Interest points of a grey image (H, W) whose pixel lies in `core` (all of it when None).

    0, NaN and False of `mask` (H, W) are no data. Positions count from the image's first pixel.
    """
    # The peak test looks beyond the core, so that neighbouring tiles agree on the points at their border.
    core = core or Window(0, 0, *image.shape)
    # Prewitt masks need 3 x 3 pixels.
    if min(image.shape) < 3 or core.empty:
        return InterestPoints(np.empty(0), np.empty(0), np.empty(0, np.float32))
    tensor = structure_tensor(with_gaps(image, mask), detector.sigma)
    measure = strength(tensor, detector)
    limit = detector.min_strength if isinstance(detector, HarrisPoints) else detector.min_weight
    inside = (core.row, core.col, core.row + core.height, core.col + core.width)
    rows, cols = _peaks(measure, np.float32(limit), detector.radius, inside)
    if isinstance(detector, FoerstnerPoints):
        # Only at the peaks: roundness is not monotonic in the weight and would cut holes into the measure.
        is_round = roundness(tensor)[rows, cols] > detector.min_roundness
        rows, cols = rows[is_round], cols[is_round]
    offsets = _peak_offsets(measure, rows, cols)
    return InterestPoints(cols + offsets[:, 0], rows + offsets[:, 1], measure[rows, cols])


def structure_tensor(grey: np.ndarray, sigma: float) -> np.ndarray:
    """(3, H, W) float32: Gaussian means of gx gx, gx gy and gy gy of grey (H, W) float32, NaN without data or gradient."""
    gx, gy = _gradients(grey)
    return np.stack([smoothed(product, sigma) for product in (gx * gx, gx * gy, gy * gy)])


def strength(tensor: np.ndarray, detector: HarrisPoints | FoerstnerPoints) -> np.ndarray:
    """(H, W) float32 measure of a structure tensor (3, H, W), 0 where all is flat.

    Foerstner's weight is that of as many pixels as the Gaussian effectively averages, 4 pi sigma^2.
    """
    xx, xy, yy = tensor
    trace = xx + yy
    # `out` keeps a trace of zero, and NaN, where there is nothing to divide by.
    noble = np.divide(xx * yy - xy * xy, trace, out=trace.copy(), where=trace > 0.0)
    if isinstance(detector, HarrisPoints):
        return noble
    return noble * np.float32(4.0 * np.pi * detector.sigma**2 / _PREWITT**2)


def roundness(tensor: np.ndarray) -> np.ndarray:
    """(H, W) float32 roundness 4 det / trace^2 of a structure tensor (3, H, W): 0 where all is flat."""
    xx, xy, yy = tensor
    trace = xx + yy
    return np.divide(4.0 * (xx * yy - xy * xy), trace * trace, out=trace.copy(), where=trace > 0.0)


@njit()
def _gradients(grey):
    """(2, H, W) gx, gy by undivided Prewitt masks; NaN along the border and next to missing data."""
    rows, cols = grey.shape
    out = np.full((2, rows, cols), np.nan, np.float32)
    for r in range(1, rows - 1):
        for c in range(1, cols - 1):
            # Symmetric brackets: a pattern and its mirror image give gradients of exactly opposite sign.
            up, down = grey[r - 1], grey[r + 1]
            out[0, r, c] = (up[c + 1] - up[c - 1]) + (grey[r, c + 1] - grey[r, c - 1]) + (down[c + 1] - down[c - 1])
            out[1, r, c] = (down[c - 1] - up[c - 1]) + (down[c] - up[c]) + (down[c + 1] - up[c + 1])
    return out


@njit()
def _is_peak(measure, row, col, radius):
    """Whether a pixel is the highest within `radius`, the first of equal ones."""
    rows, cols = measure.shape
    for r in range(max(0, row - radius), min(rows, row + radius + 1)):
        for c in range(max(0, col - radius), min(cols, col + radius + 1)):
            earlier = r < row or (r == row and c < col)
            if measure[r, c] > measure[row, col] or (earlier and measure[r, c] == measure[row, col]):
                return False
    return True


@njit()
def _peaks(measure, limit, radius, inside):
    """Rows and columns of the largest values of `measure` within `radius` px, above `limit`, `inside` (top, left, bottom,
    right)."""
    top, left, bottom, right = inside
    rows, cols = [], []
    for r in range(top, bottom):
        for c in range(left, right):
            if measure[r, c] > limit and _is_peak(measure, r, c, radius):
                rows.append(r)
                cols.append(c)
    return np.array(rows, dtype=np.int64), np.array(cols, dtype=np.int64)


def _peak_offsets(measure: np.ndarray, rows: np.ndarray, cols: np.ndarray) -> np.ndarray:
    """(N, 2) (col, row) from each pixel to the peak of the measure."""
    reach = np.arange(3)
    # A peak on the border of the image keeps its pixel: the paraboloid needs all eight neighbours.
    padded = np.pad(measure, 1, constant_values=np.nan)
    return paraboloid_peaks(padded[rows[:, None, None] + reach[:, None], cols[:, None, None] + reach])
