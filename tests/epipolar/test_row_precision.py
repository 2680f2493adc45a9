"""The expected y-parallax of pairs against truth: blocks with a weak datum and a doubtful camera constant."""

import numpy as np
import pytest
from orienting import orient
from simulated_block import DRONE, one_strip, two_strips

from orthomill.tasks.epipolar.pair_choice import PairChoice
from orthomill.tasks.epipolar.row_precision import border_points, row_sigmas
from orthomill.tasks.epipolar.selection import choose_pairs
from orthomill.tasks.geometry.normal_case import epipolar_view
from orthomill.tasks.geometry.view import view_of


def standardised_rows(block, result):
    """True y-parallaxes at the border of every pair in their predicted standard errors."""
    true, found = {v.name: v for v in block.views}, []
    for pair in choose_pairs(result, PairChoice(), 0.1).pairs:
        left = border_points(pair)
        rays = np.column_stack([left, np.full(len(left), -pair.c)]) @ np.array(pair.rotation)
        ground = np.array(pair.left_centre) + rays * 2.0 * pair.base / (pair.parallax_low + pair.parallax_high)
        ground = true[pair.left].centre + (ground - np.array(pair.left_centre)) @ _turn(true[pair.left], result.of(pair.left)).T
        rows = [
            epipolar_view(pair, side, view_of(result.of(name), result.camera_of(name))).from_photo(true[name].project(ground))[:, 1]
            for side, name in (("left", pair.left), ("right", pair.right))
        ]
        found.append((rows[0] - rows[1]) / row_sigmas(pair, result, left))
    return np.array(found)


def _turn(view, photo):
    """From the found to the true attitude of a photograph."""
    return view.rotation.T @ view_of(photo, view.camera).rotation


def strip_of_any_camera(seed, **options):
    """A strip whose constant and principal point are drawn from what EXIF leaves open, as standard errors take them to be."""
    c, x0, y0 = np.random.default_rng(seed + 70).normal((1165.0, 0.0, 0.0), (0.03 * 1165.0, 20.0, 20.0))
    return one_strip(seed, camera=DRONE.changed(c=c, x0=x0, y0=y0), **options)


@pytest.mark.parametrize(
    "make", [strip_of_any_camera, two_strips], ids=["positions on a line, camera from EXIF", "control, calibrated"]
)
def test_expected_row_error_is_what_happens(make):
    found = []
    for seed in range(5):
        block = make(seed, tracks=600)
        found.append(standardised_rows(block, orient(block)["block"]))
    spread = np.sqrt((np.concatenate(found) ** 2).mean())
    assert 0.6 < spread < 1.5
