"""Matching in three steps: find with a large smoothed window, measure with it sharp, sharpen with a smaller one.

Strategy
- Every step starts from position and affine of the one before. Large windows of smoothed images converge from several pixels away;
  sharp ones are more precise; small ones are not biased by curved ground, but are sensitive to noise.
- Which window is best therefore depends on the images, point by point: the small one where its own standard error is below
  `precise` or below that of the large one, else the large one. On clean photographs that is the small one nearly everywhere, on
  noisy ones the large one.
- A wrong place shows as a poorly determined one: half of the texture finds no counterpart, residuals are large, and so is the
  standard error. A point whose standard error exceeds `max_sigma` is not returned.

For single points whose start is known to a few pixels: tie points, check points, nodes of a coarse surface.

Source: sources/measured.md#windows.
"""

import numpy as np

from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.least_squares.least_squares_settings import LeastSquaresMatching
from orthomill.tasks.matching.least_squares.matching import Matches, match_points, prepare
from orthomill.tasks.matching.strategies.cascade_settings import CascadeMatching
from orthomill.tasks.matching.strategies.match_tables import merged, rejected, taken


def match_cascade(
    left: np.ndarray,
    right: np.ndarray,
    points: np.ndarray,
    starts: np.ndarray,
    settings: CascadeMatching,
    affine: np.ndarray | None = None,
) -> Matches:
    """Match points of the left image in the right one; arguments as of `match_points`, images not yet prepared.

    `Matches.half` is that of the window whose result is returned, or of the one that lost the point.
    """
    points = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    # Steps of equal smoothing share their prepared images.
    smoothings = {step.smoothing: step for step in (settings.find, settings.measure, settings.sharpen)}
    images = {smoothing: (prepare(left, step), prepare(right, step)) for smoothing, step in smoothings.items()}

    def matched(step: LeastSquaresMatching, rows: np.ndarray, at: np.ndarray, affine: np.ndarray | None) -> Matches:
        return match_points(*images[step.smoothing], points[rows], at, step, affine)

    found = matched(settings.find, np.arange(len(points)), starts, affine)
    alive = np.flatnonzero(found.converged)
    found = merged(found, matched(settings.measure, alive, found.position[alive], found.affine[alive]), alive)
    alive = np.flatnonzero(found.converged)
    sharpened = matched(settings.sharpen, alive, found.position[alive], found.affine[alive])
    # Comparisons with the NaN of a lost point are False: it keeps the result of the large window.
    better = (sharpened.sigma <= settings.precise) | (sharpened.sigma < found.sigma[alive])
    found = merged(found, taken(sharpened, better), alive[better])
    # Stated as "not below", so that a NaN standard error is rejected too.
    return rejected(found, found.converged & ~(found.sigma <= settings.max_sigma), Outcome.IMPRECISE)
