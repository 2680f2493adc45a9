"""Corners as saddles: spacing, bilinear grey values, sub-pixel places on drawn boards, contrast signs and blur of edges."""

import cv2
import numpy as np
import pytest
from drawn_boards import BLACK, WHITE, corner_grid, drawn, homography_of
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.tasks.calibration.detection.saddles import contrast, edge_blur, refined, sampled, signs, spacings

SIZE = (5, 4)
H = homography_of(20.0, 12.0, (60.3, 38.7), (0.004, -0.003))
BOARD, GRID = drawn(H, SIZE, (140, 190)), corner_grid(H, SIZE)


def test_spacings_are_the_steps_to_both_neighbours():
    grid = np.stack(np.meshgrid([0.0, 10.0, 30.0], [0.0, 5.0]), axis=-1)
    across, down = spacings(grid)
    assert across[0, :, 0].tolist() == [10.0, 15.0, 20.0] and down[:, :, 1].tolist() == [[5.0] * 3] * 2


def test_spacings_bridge_a_missing_neighbour_and_are_unknown_without_any():
    grid = np.stack(np.meshgrid([0.0, 10.0, 30.0], [0.0, 5.0]), axis=-1)
    grid[0, 1] = np.nan
    across, _ = spacings(grid)
    assert np.isnan(across[0]).all() and across[1, :, 0].tolist() == [10.0, 15.0, 20.0]
    grid = np.stack(np.meshgrid([0.0, 10.0, 30.0, 40.0], [0.0]), axis=-1)
    grid[0, 3] = np.nan
    assert spacings(grid)[0][0, :3, 0].tolist() == [10.0, 15.0, 20.0], "the last known corner uses its only neighbour"


@settings(deadline=None, max_examples=50)
@given(col=st.floats(0, 28.99), row=st.floats(0, 18.99))
def test_bilinear_values_are_exact_on_a_plane_of_grey(col, row):
    image = np.add.outer(3 * np.arange(20), 2 * np.arange(30)).astype(np.uint8)
    assert sampled(image, np.array([col, row])) == pytest.approx(2 * col + 3 * row)


def test_grey_values_outside_are_unknown():
    image = np.full((20, 30), 7, np.uint8)
    points = np.array([[[-0.1, 5.0], [29.0, 5.0], [5.0, 19.0], [np.nan, 5.0], [28.9, 18.9]]])
    assert np.isnan(sampled(image, points)).tolist() == [[True, True, True, True, False]]


@pytest.mark.parametrize(("x", "y", "angle"), [(0.0, 0.0, 5.0), (0.25, 0.6, -17.0), (0.5, 0.5, 33.0)])
def test_corners_of_drawn_boards_are_found_to_a_tenth_of_a_pixel(x, y, angle):
    here = homography_of(16.0, angle, (40.0 + x, 40.0 + y), (0.003, 0.002))
    image, truth = cv2.GaussianBlur(drawn(here, (4, 3), (110, 110)), (0, 0), 0.8), corner_grid(here, (4, 3))
    for seed in range(5):
        start = truth + np.random.default_rng(seed).uniform(-1.0, 1.0, truth.shape)
        assert np.abs(refined(image, start) - truth).max() < 0.1


def test_a_corner_that_moves_out_of_its_window_keeps_its_start():
    image = np.full((80, 80), 100, np.uint8)
    image[:40, 42:] = 200
    image[40:, :42] = 200
    start = np.stack(np.meshgrid([30.0, 50.0], [20.0, 33.0]), axis=-1)
    moved = refined(image, start)
    assert (np.abs(moved - start).max(axis=2) <= 11).all()


def test_corners_outside_and_unknown_ones_stay():
    start = GRID.copy()
    start[0, 0] = np.nan
    start[3, 4] = [400.0, 400.0]
    moved = refined(BOARD, start)
    assert np.isnan(moved[0, 0]).all() and moved[3, 4].tolist() == [400.0, 400.0]


def test_the_contrast_of_a_board_has_the_signs_of_its_squares():
    values = contrast(BOARD, GRID, *spacings(GRID))
    assert (np.sign(values) == signs(4, 5)).all()
    assert np.abs(values) == pytest.approx(np.full((4, 5), WHITE - BLACK), abs=12.0)


def test_an_edge_has_no_contrast_although_its_squares_differ():
    image = np.full((60, 60), 50, np.uint8)
    image[:, 30:] = 200
    steps = np.array([[12.0, 0.0]]), np.array([[0.0, 12.0]])
    assert contrast(image, np.array([[29.5, 30.0]]), *steps) == pytest.approx([0.0])
    assert np.isnan(contrast(image, np.array([[1.0, 1.0]]), *steps)).all(), "a square outside the image"


def test_inverted_grey_values_invert_the_contrast():
    across, down = spacings(GRID)
    assert contrast(255 - BOARD, GRID, across, down) == pytest.approx(-contrast(BOARD, GRID, across, down))


def test_the_first_square_of_the_signs_is_black():
    assert signs(2, 3).tolist() == [[-1.0, 1.0, -1.0], [1.0, -1.0, 1.0]]


@pytest.mark.parametrize("sigma", [1.0, 1.6, 2.4])
def test_the_blur_of_edges_is_the_one_that_was_applied(sigma):
    here = homography_of(30.0, 8.0, (50.3, 45.7))
    image = cv2.GaussianBlur(drawn(here, (4, 3), (170, 210)), (0, 0), sigma)
    # The pixel itself adds the variance of a square, 1/12, and bilinear interpolation a little more.
    assert edge_blur(image, corner_grid(here, (4, 3))) == pytest.approx(np.hypot(sigma, 0.4), rel=0.08)
