"""The part of the error of heights that the orientation brings, predicted against what happens."""

import numpy as np
import pytest
from orienting import orient
from simulated_block import one_strip, two_strips

from orthomill.tasks.densification.ground_intersection import orientation_sigma
from orthomill.tasks.epipolar.pair_choice import PairChoice
from orthomill.tasks.epipolar.row_precision import border_points
from orthomill.tasks.epipolar.selection import choose_pairs
from orthomill.tasks.geometry.normal_case import epipolar_view, intersect_pair
from orthomill.tasks.geometry.view import block_view


def standardised_heights(block, result):
    """Errors of heights, intersected from true pixels with the found orientation, in their predicted standard errors."""
    true, found = {v.name: v for v in block.views}, []
    for pair in choose_pairs(result, PairChoice(), 0.1).pairs:
        xy = border_points(pair)
        pixels = np.column_stack([xy[:, 0] + pair.left_col0, pair.row0 - xy[:, 1]])
        guess = intersect_pair(pair, pixels, np.full(len(xy), (pair.parallax_low + pair.parallax_high) / 2))
        sides = [
            epipolar_view(pair, side, block_view(result, name)).from_photo(true[name].project(guess))
            for side, name in (("left", pair.left), ("right", pair.right))
        ]
        x = [sides[0][:, 0] - pair.left_col0, sides[1][:, 0] - pair.right_col0]
        measured = intersect_pair(pair, sides[0], x[0] - x[1])
        sigma = orientation_sigma(pair, *guess.T)
        assert np.allclose(sigma, pair.height_sigmas, rtol=1e-3)
        found.append((measured[:, 2] - guess[:, 2]) / sigma)
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize("make", [one_strip, two_strips], ids=["positions on a line, camera from EXIF", "control, calibrated"])
def test_expected_errors_of_heights_are_what_happens(make):
    found = []
    for seed in range(8):
        block = make(seed, tracks=600)
        found.append(standardised_heights(block, orient(block)["block"]))
    assert 0.4 < np.sqrt((np.concatenate(found) ** 2).mean()) < 1.6
