"""Least-squares matching lowers sigma0 of a relative orientation (sources/epipolar.md, check 12: published 0.25 to 0.17, and 0.27
to 0.20 px)."""

import cv2
import numpy as np
import pytest
from village_pair import normal_case, render, village

from orthomill.tasks.matching.least_squares.least_squares_settings import LeastSquaresMatching
from orthomill.tasks.matching.least_squares.matching import match_points, prepare
from orthomill.tasks.matching.points.correlation import correlate
from orthomill.tasks.matching.points.interest_points import interest_points
from orthomill.tasks.matching.points.point_settings import HarrisPoints, TemplateCorrelation
from orthomill.tasks.orientation.relative.relative_orientation import orient_robust


@pytest.mark.slow
def test_matches_sharpened_by_least_squares_contradict_each_other_less():
    pair = normal_case(700)
    seen = render(village(700, 6, seed=2), pair)
    # A turned right photograph: homologous rows fall between pixels, as those of any photographs do.
    turned = cv2.warpAffine(seen.right, cv2.getRotationMatrix2D((pair.right_col0, pair.row0), 0.7, 1.0), seen.right.shape[::-1][:2])
    found = interest_points(seen.left, HarrisPoints(min_strength=150.0, radius=12))
    points = np.column_stack([np.rint(found.col), np.rint(found.row)])
    starts = points - [np.nanmedian(seen.parallax) + pair.left_col0 - pair.right_col0, 0.0]
    rough = correlate(seen.left, turned, points, starts, TemplateCorrelation(template=21, search=81, max_return=2.0))
    points = points[rough.converged]
    # The publication stops at the pixel of the greatest correlation.
    whole = np.rint(np.column_stack([rough.col, rough.row])[rough.converged])
    settings = LeastSquaresMatching(window=21)
    sharp = match_points(prepare(seen.left, settings), prepare(turned, settings), points, whole, settings)
    kept = sharp.converged
    assert kept.sum() > 100
    sigmas = []
    for right, left in ((whole[kept], points[kept]), (sharp.position[kept], sharp.reference[kept])):
        centred = [(at - [col0, pair.row0]) * [1.0, -1.0] for at, col0 in ((left, pair.left_col0), (right, pair.right_col0))]
        sigmas.append(orient_robust(np.hstack(centred), pair.c, pair.c).solution.sigma0)
    assert 0.1 < sigmas[0] < 0.35
    assert sigmas[1] < 0.8 * sigmas[0]
