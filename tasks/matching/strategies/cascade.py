"""Matching in steps: a large smoothed window finds the point, a smaller and sharper one measures it.

Strategy. Every step starts from position and affine of the one before. Large windows of smoothed images pull in from several pixels
but average over curved ground; small windows of sharp images measure best but must be started well. A point that any step loses
is not matched: what only the large window finds is where the blunders are. `Matches.half` tells the last window that was tried.

For single points whose start is known to a few pixels: tie points, check points, nodes of a coarse surface.

Source: methods/measured.md, window experiments.
"""

import numpy as np

from schemas.settings import Settings, setting
from tasks.matching.least_squares.matching import Matches, match_points, prepare
from tasks.matching.least_squares.model import LeastSquaresMatching
from tasks.matching.strategies.match_tables import merged

_FIND = LeastSquaresMatching(window=27, smoothing=1.2, interpolation="bilinear", stop=0.05, min_gradient=0.1)
_MEASURE = LeastSquaresMatching(window=21, smoothing=0.6, max_shift=1.5, min_gradient=0.1)


class CascadeMatching(Settings):
    """How points are matched in steps."""

    steps: tuple[LeastSquaresMatching, ...] = setting((_FIND, _MEASURE), "From large and smooth to small and sharp.", min_length=1)


def match_cascade(left: np.ndarray, right: np.ndarray, points: np.ndarray, starts: np.ndarray, settings: CascadeMatching,
                  affine: np.ndarray | None = None) -> Matches:
    """Match points of the left image in the right one; arguments as of `match_points`, images not yet prepared."""
    points = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    first, *others = settings.steps
    found = match_points(prepare(left, first), prepare(right, first), points, starts, first, affine)
    for step in others:
        alive = found.converged
        again = match_points(prepare(left, step), prepare(right, step), points[alive], found.position[alive], step,
                             found.affine[alive])
        found = merged(found, again, alive)
    return found
