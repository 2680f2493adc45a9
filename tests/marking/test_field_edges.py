"""Plates whose fields are not in the same light: their centre by their edges."""

import cv2
import numpy as np
import pytest

from orthomill.tasks.targets.field_edges import crossing_edges
from orthomill.tasks.targets.photo_targets import photo_targets
from orthomill.tasks.targets.symmetric_centre import symmetric_centre

CENTRE = np.array([30.3, 29.6])
EDGES = np.array([0.35, 1.75])
FINER = 8


def plate(levels, side=60, half=9.0):
    """A picture (side, side) of four fields of these grey values about CENTRE, on darker ground with noise of 2 grey values."""
    axis = (np.arange(side * FINER) + 0.5) / FINER - 0.5
    col, row = np.meshgrid(axis - CENTRE[0], axis - CENTRE[1])
    first, second = (row * np.cos(a) - col * np.sin(a) > 0 for a in EDGES)
    fine = np.select([first & second, ~first & ~second, first & ~second], levels[:3], levels[3]).astype(np.float32)
    fine[np.hypot(col, row) > half] = 90.0
    blurred = cv2.GaussianBlur(fine, (0, 0), 0.6 * FINER).reshape(side, FINER, side, FINER).mean(axis=(1, 3))
    return (blurred + np.random.default_rng(3).normal(0, 2, blurred.shape)).astype(np.float32)


@pytest.mark.parametrize("levels", [(40, 40, 220, 220), (60, 110, 230, 230), (170, 230, 60, 40)])
def test_edges_cross_in_the_centre_whatever_the_light_of_the_fields(levels):
    found = crossing_edges(plate(levels), np.round(CENTRE), 5.5, EDGES + np.array([0.1, -0.1]))
    assert found is not None and found.unexplained < 0.02
    assert np.abs(found.place - CENTRE).max() < 3 * found.sigma < 0.2


def test_a_plate_with_a_crease_is_found_although_it_is_not_symmetric():
    picture = plate((60, 110, 230, 230))
    symmetric = symmetric_centre(picture, np.round(CENTRE), 6.5)
    assert symmetric is None or symmetric.unexplained > 0.06
    (one,) = (one for one in photo_targets(picture) if one.kind == "chequered")
    assert np.abs(one.place - CENTRE).max() < 0.1


@pytest.mark.parametrize("levels", [(40, 220, 220, 220), (120, 120, 120, 120), (40, 150, 160, 220)])
def test_corners_even_ground_and_shades_that_do_not_alternate_are_no_plate(levels):
    assert crossing_edges(plate(levels), np.round(CENTRE), 5.5, EDGES) is None


def test_a_patch_that_leaves_the_image_has_no_edges():
    assert crossing_edges(plate((40, 40, 220, 220)), np.array([3.0, 30.0]), 5.5, EDGES) is None
