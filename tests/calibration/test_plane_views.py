"""Calibration from corners with known truth: recovery, precision that means what it says, and refusals."""

import numpy as np
import pytest

from schemas.camera import INTERIOR, Camera
from schemas.errors import GeometryError
from tasks.calibration.plane_views import PlaneView, calibrate, camera_of, held_out
from tasks.geometry.rotation import rotation_matrix
from tasks.geometry.view import View

TRUTH = Camera(name="t", width=1000, height=800, c=900, x0=7.0, y0=-5.0, k1=-0.08, k2=0.03, p1=0.0008, p2=-0.0005)
SIZE = (TRUTH.width, TRUTH.height)
FREE = ("c", "x0", "y0", "k1", "k2", "p1", "p2")
BOARD = 0.04 * np.stack(np.meshgrid(np.arange(8), np.arange(6)), axis=-1).reshape(-1, 2)


def board_views(seed: int, noise: float, tilt: float = 30.0, photos: int = 12) -> list[PlaneView]:
    """One board per photograph, tilted in all directions, all corners in the frame."""
    generator = np.random.default_rng(seed)
    views = []
    for number in range(photos):
        direction = 2 * np.pi * number / photos
        angles = np.radians(tilt) * np.array([np.cos(direction), np.sin(direction)])
        rotation = rotation_matrix(*angles, number * np.pi / 2)
        aim = np.array([0.14, 0.10, 0.0]) + np.append(generator.uniform(-0.08, 0.08, 2), 0.0)
        view = View("v", TRUTH, rotation, aim + 0.45 * rotation[2])
        pixels = view.project(np.column_stack([BOARD, np.zeros(len(BOARD))]))
        inside = view.contains(pixels, 2)
        views.append(PlaneView(f"p{number:02d}", BOARD[inside], pixels[inside] + generator.normal(0, noise, pixels[inside].shape)))
    return views


def test_exact_corners_give_the_camera_back():
    solution = calibrate(board_views(1, 0.0), SIZE, FREE)
    truth = np.array(TRUTH.interior)
    # float32 inside OpenCV's start values does not matter: the adjustment itself works in double precision
    assert solution.interior == pytest.approx(truth, rel=1e-6, abs=1e-7)
    assert solution.sigma0 < 1e-6


def test_standard_errors_are_what_repetition_shows():
    solutions = [calibrate(board_views(seed, 0.1), SIZE, FREE) for seed in range(24)]
    free = [INTERIOR.index(name) for name in FREE]
    errors = np.array([solution.interior - TRUTH.interior for solution in solutions])[:, free]
    sigmas = np.array([np.sqrt(np.diag(solution.covariance)) for solution in solutions])[:, free]
    ratio = np.sqrt((errors**2).mean(axis=0)) / sigmas.mean(axis=0)
    assert np.all((ratio > 0.6) & (ratio < 1.5)), ratio
    assert np.mean([solution.sigma0 for solution in solutions]) == pytest.approx(0.1, rel=0.05)


def test_parameters_that_are_not_free_stay_zero_with_zero_covariance():
    solution = calibrate(board_views(2, 0.05), SIZE, ("c", "x0", "y0", "k1", "k2"))
    camera = camera_of(solution, "radial", SIZE)
    assert camera.k3 == camera.p1 == camera.p2 == 0.0
    assert not np.array(camera.covariance)[5:].any()


def test_wrong_corners_are_left_out():
    views = board_views(3, 0.05)
    views[4].pixels[7] += [3.0, -2.0]
    solution = calibrate(views, SIZE, FREE)
    assert 1 <= solution.rejected <= 8
    assert solution.interior[0] == pytest.approx(TRUTH.c, abs=5 * np.sqrt(solution.covariance[0, 0]))


def test_held_out_photographs_fit_as_well_when_the_model_is_right():
    check = held_out(board_views(4, 0.1), SIZE, FREE)
    assert check is not None
    assert 0.08 < check.rms < 0.13
    assert held_out(board_views(4, 0.1, photos=6), SIZE, FREE) is None


def test_too_few_boards_and_boards_without_tilt_are_refused():
    with pytest.raises(GeometryError, match="Only 3 chessboards"):
        calibrate(board_views(5, 0.1, photos=3), SIZE, FREE)
    with pytest.raises(GeometryError, match="tilted"):
        calibrate([board_views(5, 0.0, tilt=0.0)[0]] * 6, SIZE, FREE)
