"""Matching in three steps: find with a large smoothed window, measure with it sharp, sharpen with a smaller one.

Strategy
- Every step starts from position and affine of the one before. Large windows of smoothed images pull in from several pixels; sharp
  ones measure better; small ones are not led astray by curved ground, but noise tells in them.
- Which window measures best is therefore a matter of the images, point by point: the small one where its own standard error is
  below `precise`, else the large one. On clean photographs that is the small one nearly everywhere, on noisy ones the large one.
- A wrong place looks like a badly determined one: half of the texture finds no counterpart, residuals are large, and so is the
  standard error. A point whose standard error exceeds `max_sigma` is not returned.

For single points whose start is known to a few pixels: tie points, check points, nodes of a coarse surface.

Source: methods/measured.md, window experiments.
"""

import numpy as np

from schemas.outcome import Outcome
from schemas.settings import Settings, setting
from tasks.matching.least_squares.matching import Matches, match_points, prepare
from tasks.matching.least_squares.model import LeastSquaresMatching
from tasks.matching.strategies.match_tables import merged, rejected, taken

_FIND = LeastSquaresMatching(window=27, smoothing=1.2, interpolation="bilinear", stop=0.05, min_gradient=0.1)
_MEASURE = LeastSquaresMatching(window=27, smoothing=0.6, max_shift=1.5, min_gradient=0.1)
_SHARPEN = _MEASURE.model_copy(update={"window": 17})


class CascadeMatching(Settings):
    """How points are matched in three steps."""

    find: LeastSquaresMatching = setting(_FIND, "Large and smooth: pulls in from the start.")
    measure: LeastSquaresMatching = setting(_MEASURE, "Large and sharp.")
    sharpen: LeastSquaresMatching = setting(_SHARPEN, "Small and sharp: measures the points that it determines well.")
    precise: float = setting(0.05, "Standard error up to which the small window is taken for the better one.", "px", gt=0.0)
    max_sigma: float = setting(0.12, "Standard error beyond which a point is not returned.", "px", gt=0.0)


def match_cascade(left: np.ndarray, right: np.ndarray, points: np.ndarray, starts: np.ndarray, settings: CascadeMatching,
                  affine: np.ndarray | None = None) -> Matches:
    """Match points of the left image in the right one; arguments as of `match_points`, images not yet prepared.

    `Matches.half` tells the window whose result is handed over, or the one that lost the point.
    """
    points = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    find = settings.find
    found = match_points(prepare(left, find), prepare(right, find), points, starts, find, affine)
    alive = found.converged
    found = merged(found, _again(left, right, points, found, alive, settings.measure), alive)
    alive = found.converged
    sharpened = _again(left, right, points, found, alive, settings.sharpen)
    error, large_error = largest_sigma(sharpened), largest_sigma(taken(found, alive))
    better = (error <= settings.precise) | (error < large_error)
    found = merged(found, taken(sharpened, better), np.flatnonzero(alive)[better])
    return rejected(found, found.converged & ~(largest_sigma(found) <= settings.max_sigma), Outcome.IMPRECISE)


def largest_sigma(matches: Matches) -> np.ndarray:
    """(N,) px: the larger standard error of column and row, NaN where nothing is matched."""
    return np.maximum(matches.sigma_col, matches.sigma_row)


def _again(left: np.ndarray, right: np.ndarray, points: np.ndarray, found: Matches, alive: np.ndarray,
           step: LeastSquaresMatching) -> Matches:
    """Matches of one more step for some points (N,) bool, from where each is now."""
    return match_points(prepare(left, step), prepare(right, step), points[alive], found.position[alive], step, found.affine[alive])
