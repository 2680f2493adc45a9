"""Least-squares matching of points: position, affine, precision and outcome per point.

Strategy
- Both images are smoothed; pixels without data are NaN (smoothing.py). A window that touches NaN anywhere is OUTSIDE.
- The window is centred on the pixel nearest to the left point; the sub-pixel remainder is transferred by the affine:
  right(point) = t + A (point - pixel).
- Unknowns, gradients and windows are chosen in model.py. The recommended form is in inverse_compositional.py, the published ones
  in forward.py.
- All positions inside the kernels are relative to integer pixels, so a point in a tile moves as it does in the whole image.

Source: Skarlatos (sources/matching.md#least-squares, #window-shape).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.least_squares import result_columns as column
from orthomill.tasks.matching.least_squares.forward import match_forward
from orthomill.tasks.matching.least_squares.inverse_compositional import match_inverse
from orthomill.tasks.matching.least_squares.least_squares_settings import MOST_HALF, Forward, LeastSquaresMatching, reach_of_window
from orthomill.tasks.matching.least_squares.model import LEAST_AREA, rules_of
from orthomill.tasks.matching.least_squares.result_columns import Attempts, Found
from orthomill.tasks.matching.smoothing import smoothed, with_gaps
from orthomill.tasks.matching.windows.sizes import WindowSizes, grey_levels, window_sizes

_FARTHEST = 1e9
"""Coordinates beyond this are not those of a pixel, and would overflow the integers of the kernels."""
_OVERFLOW = float(np.finfo(np.float32).max)
_CONVERGED, _NOT_CONVERGED = int(Outcome.CONVERGED), int(Outcome.NOT_CONVERGED)


@dataclass(frozen=True)
class Matches:
    """One row per point. Where `outcome` is not CONVERGED, positions and covariances are NaN.

    Only there may `affine`, `radiometry`, `sigma0` and `correlation` be numbers: those at which the attempt ended.
    """

    col: np.ndarray
    row: np.ndarray
    """(N,) float64: position in the right image, px"""
    reference: np.ndarray
    """(N, 2) float64 (col, row): the place in the left image that corresponds to it, px: the point, or the centroid"""
    covariance: np.ndarray
    """(N, 2, 2) float32: of (col, row), px^2"""
    sigma0: np.ndarray
    """(N,) float32: standard deviation of the grey value residuals, in grey values of the left image"""
    correlation: np.ndarray
    """(N,) float32: of the matched windows; NaN where the right window was never resampled"""
    affine: np.ndarray
    """(N, 4) float32: d right / d left as a12, a21, b12, b21; col' = a12 x + a21 y, row' = b12 x + b21 y"""
    radiometry: np.ndarray
    """(N, 2) float32: gain and offset, right = gain left + offset"""
    half: np.ndarray
    """(N,) uint8: half side of the window used, or of the square of the ellipse's area, px; 0 where none was assigned"""
    iterations: np.ndarray
    """(N,) uint8"""
    outcome: np.ndarray
    """(N,) uint8: `orthomill.schemas.outcome.Outcome`"""

    def __len__(self) -> int:
        return len(self.col)

    @property
    def converged(self) -> np.ndarray:
        """(N,) bool"""
        return self.outcome == Outcome.CONVERGED

    @property
    def position(self) -> np.ndarray:
        """(N, 2) float64 (col, row) in the right image, px"""
        return np.column_stack([self.col, self.row])

    @property
    def sigma_col(self) -> np.ndarray:
        """(N,) float32 standard error of the column, px"""
        return np.sqrt(self.covariance[:, 0, 0])

    @property
    def sigma_row(self) -> np.ndarray:
        """(N,) float32 standard error of the row, px"""
        return np.sqrt(self.covariance[:, 1, 1])

    @property
    def sigma(self) -> np.ndarray:
        """(N,) float32 the larger of both, px"""
        return np.maximum(self.sigma_col, self.sigma_row)


@dataclass(frozen=True)
class PreparedImage:
    """A grey image prepared for matching, to be reused by many calls: (H, W) float32, smoothed, NaN without data."""

    grey: np.ndarray


def prepare(image: np.ndarray, settings: LeastSquaresMatching, mask: np.ndarray | None = None) -> PreparedImage:
    """Smooth a (H, W) image once; 0, NaN and False of `mask` (H, W) are no data."""
    return PreparedImage(smoothed(with_gaps(image, mask), settings.smoothing))


def match_points(
    left: np.ndarray | PreparedImage,
    right: np.ndarray | PreparedImage,
    points: np.ndarray,
    starts: np.ndarray,
    settings: LeastSquaresMatching,
    affine: np.ndarray | None = None,
    half: np.ndarray | None = None,
    reference: Literal["point", "centroid"] = "point",
) -> Matches:
    """Match points of the left image in the right one.

    left, right: (H, W) of uint8, uint16 or float32, of any two sizes, 0 or NaN is no data; or images from `prepare`.
    points, starts: (N, 2) (col, row) in px, left positions and where to start in the right image. affine: (N, 4) start values as
    in `Matches.affine`, None for identity. half: (N,) half sides of the windows, 0 where a point has none and is not tried; None
    for `settings.window`, a size or a way to choose it. reference: the place in the left window whose match is returned, the point
    itself or the centroid of the squared gradients, where the window is determined best (`Matches.reference` holds it).

    Never raises on the contents of images or points: every point gets its outcome. ValueError when tables differ in length or an
    image is not two-dimensional.
    """
    # The kernels index flat memory, so that views with strides must be copied.
    left, right = (
        np.ascontiguousarray((image if isinstance(image, PreparedImage) else prepare(image, settings)).grey)
        for image in (left, right)
    )
    points, starts = (np.array(table, dtype=np.float64).reshape(-1, 2) for table in (points, starts))
    count = len(points)
    affine = np.tile([1.0, 0.0, 0.0, 1.0], (count, 1)) if affine is None else np.array(affine, dtype=np.float64).reshape(-1, 4)
    chosen = chosen_windows(left, points, settings) if half is None else None
    # Clipped, for the result holds half sides in uint8 and scratch grows with the square of the largest.
    half = np.clip(np.asarray(half if chosen is None else chosen.half, dtype=np.int64).reshape(-1), 0, MOST_HALF)
    _check_shapes((left, right), count, (starts, affine, half))
    attempts = Attempts(points, starts, affine, half)
    found = _before(attempts)
    reach = reach_of_window(int(half.max(initial=1)), settings.shape)
    kernel = match_forward if isinstance(settings.formulation, Forward) else match_inverse
    kernel(left, right, attempts, reach, rules_of(settings, centroid=reference == "centroid"), found)
    _refuse_overflow(found.values, found.outcome)
    if chosen is not None:
        # Why a point has no window says more than that it was not tried.
        found.outcome[half == 0] = chosen.outcome[half == 0]
    return _matches(found, half)


def chosen_windows(left: np.ndarray, points: np.ndarray, settings: LeastSquaresMatching) -> WindowSizes:
    """The windows of points (N, 2) of a prepared left image (H, W)."""
    if isinstance(settings.window, int):
        same = np.full(len(points), settings.half, np.uint8)
        return WindowSizes(same, np.full(len(points), Outcome.NOT_TRIED, np.uint8))
    return window_sizes(grey_levels(left), points, settings.window)


@njit()
def _refuse_overflow(values, outcome):
    """Refuse points with an infinite gain or variance, which grey values near the end of float32 can leave behind."""
    for i in range(len(values)):
        if outcome[i] != _CONVERGED:
            continue
        for k in range(values.shape[1]):
            if not abs(values[i, k]) < _OVERFLOW:
                outcome[i] = _NOT_CONVERGED
        if outcome[i] != _CONVERGED:
            values[i] = np.nan


def _check_shapes(images: tuple[np.ndarray, ...], count: int, tables: tuple[np.ndarray, ...]) -> None:
    """Raise ValueError for arguments that do not fit together: the kernels do not check bounds."""
    if any(image.ndim != 2 for image in images):
        raise ValueError(f"Images to match have rows and columns only, not shapes {[image.shape for image in images]}.")
    if any(len(table) != count for table in tables):
        raise ValueError(f"{count} points need as many starts, affines and window sizes, not {[len(table) for table in tables]}.")


def _before(attempts: Attempts) -> Found:
    """The table of results before anything is tried: its outcome CONVERGED stands for worth trying."""
    count = len(attempts.points)
    values = np.full((count, column.COLUMNS), np.nan)
    values[:, [column.REFERENCE_COL, column.REFERENCE_ROW]] = attempts.points
    outcome = np.full(count, Outcome.CONVERGED, np.uint8)
    known = np.ones(count, bool)
    for table, limit in ((attempts.points, _FARTHEST), (attempts.starts, _FARTHEST), (attempts.affine, np.inf)):
        # Stated with <, so that NaN counts as unknown; column by column, for reducing short rows costs three times as much.
        for k in range(table.shape[1]):
            known &= np.abs(table[:, k]) < limit
    area = attempts.affine[:, 0] * attempts.affine[:, 3] - attempts.affine[:, 1] * attempts.affine[:, 2]
    # In this order the last cause that applies is reported: points without a window were never to be tried.
    outcome[~((area > LEAST_AREA) & (area < 1.0 / LEAST_AREA))] = Outcome.NOT_CONVERGED
    outcome[~known] = Outcome.OUTSIDE
    outcome[attempts.half < 1] = Outcome.NOT_TRIED
    return Found(values, outcome, np.zeros(count, np.uint8))


def _matches(found: Found, half: np.ndarray) -> Matches:
    values = found.values
    covariance = values[:, [column.VAR_COL, column.COVARIANCE, column.COVARIANCE, column.VAR_ROW]]
    return Matches(
        col=values[:, column.COL],
        row=values[:, column.ROW],
        reference=values[:, [column.REFERENCE_COL, column.REFERENCE_ROW]],
        covariance=covariance.astype(np.float32).reshape(-1, 2, 2),
        sigma0=values[:, column.SIGMA0].astype(np.float32),
        correlation=values[:, column.CORRELATION].astype(np.float32),
        affine=values[:, column.A12 : column.A12 + 4].astype(np.float32),
        radiometry=values[:, [column.GAIN, column.OFFSET]].astype(np.float32),
        half=half.astype(np.uint8),
        iterations=found.iterations,
        outcome=found.outcome,
    )
