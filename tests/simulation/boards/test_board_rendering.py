"""Rendered boards: grey values, edges, blur, noise, vignetting and bits, and windows that agree with the whole."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.calibration.board_setups import floor_corners
from orthomill.schemas.camera import Camera
from orthomill.schemas.raster import Window
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View
from orthomill.tasks.simulation.boards.board_rendering import BoardFilm, photograph_floor
from orthomill.tasks.simulation.boards.board_scene import BoardType
from orthomill.tasks.simulation.boards.project_boards import BOARD, BoardPhoto, board_places, board_view, render_boards

SMALL = BoardType((4, 3), 0.05, 0.03)
PLACES = np.array([[0.0, 0.0, 0.3]])
CAMERA = Camera(name="t", width=160, height=120, c=180.0, x0=2.0, y0=-1.0, k1=-0.08)
WHOLE = Window(0, 0, 120, 160)
PLAIN = BoardFilm(blur=0.01, noise=0.0)


def view(tilt: float = 0.2) -> View:
    R = rotation_matrix(tilt, -0.1, 0.5)
    return View("v", CAMERA, R, 0.5 * R[2])


def picture(film: BoardFilm = PLAIN, pixels: Window = WHOLE, at: View | None = None) -> np.ndarray:
    return photograph_floor(at or view(), PLACES, SMALL, film, pixels)


def grey_at(points: np.ndarray, film: BoardFilm = PLAIN) -> np.ndarray:
    """Grey values of the pixels where the floor's points (N, 3) are imaged."""
    pixels = np.rint(view().project(points)).astype(int)
    return picture(film)[pixels[:, 1], pixels[:, 0]]


def squares(row: int) -> np.ndarray:
    """(5, 3) m: centres of the squares of one row of the board."""
    cos, sin = np.cos(PLACES[0, 2]), np.sin(PLACES[0, 2])
    u, v = 0.05 * (np.arange(5) - 2.0), np.full(5, 0.05 * (row - 1.5))
    return np.column_stack([u * cos - v * sin, u * sin + v * cos, np.zeros(5)])


def test_squares_alternate_and_the_first_one_is_black():
    assert grey_at(squares(0)).tolist() == [34, 214, 34, 214, 34]
    assert grey_at(squares(1)).tolist() == [214, 34, 214, 34, 214]


def test_the_corner_of_four_squares_is_their_mean():
    corners = view().project(floor_corners(PLACES, SMALL)[0])
    image = picture(BoardFilm(blur=1.5, noise=0.0)).astype(float)
    near = np.rint(corners).astype(int)
    assert image[near[:, 1], near[:, 0]] == pytest.approx(np.full(12, 124.0), abs=25.0)


def test_a_margin_is_white_and_the_floor_beyond_is_grey():
    cos, sin = np.cos(0.3), np.sin(0.3)
    out = np.array([0.125 + 0.015, 0.125 + 0.03 + 0.02])
    white, floor = grey_at(np.column_stack([out * cos, out * sin, np.zeros(2)]))
    assert white == 214 and 110 <= floor <= 146


def test_any_window_agrees_with_the_whole():
    film = BoardFilm(blur=0.8, noise=3.0, vignetting=0.3, seed=5)
    whole = picture(film)
    for window in (Window(0, 0, 50, 60), Window(50, 60, 70, 100), Window(13, 7, 31, 29)):
        assert np.array_equal(picture(film, window), whole[window.slices])


def test_rays_that_miss_the_floor_see_the_wall():
    R = rotation_matrix(np.pi / 2, 0.0, 0.0)
    image = picture(at=View("v", CAMERA, R, np.array([0.0, 0.0, 0.5])))
    assert (image[:40] == 90).all() or (image[-40:] == 90).all()


def test_noise_has_its_standard_deviation_and_its_seed():
    quiet, noisy = (picture(BoardFilm(blur=0.01, noise=noise, seed=1)).astype(float) for noise in (0.0, 4.0))
    assert np.std(noisy - quiet) == pytest.approx(4.0, rel=0.06) and abs(np.mean(noisy - quiet)) < 0.2
    assert not np.array_equal(noisy, picture(BoardFilm(blur=0.01, noise=4.0, seed=2)))


def test_vignetting_darkens_the_corners_of_the_frame_by_its_share():
    plain, dark = picture().astype(float), picture(replace(PLAIN, vignetting=0.4)).astype(float)
    assert dark[0, 0] == pytest.approx(0.6 * plain[0, 0], abs=2.5)
    assert dark[60, 80] == pytest.approx(plain[60, 80], abs=1.0)


def test_light_scales_and_saturates():
    half, bright = picture(replace(PLAIN, light=0.5)), picture(replace(PLAIN, light=1.6))
    assert half.max() == 107 and bright.max() == 255 and (bright == 255).sum() > 500


def test_sixteen_bits_are_the_same_picture_in_finer_steps():
    deep = picture(replace(PLAIN, bits=16))
    assert deep.dtype == np.uint16 and picture().dtype == np.uint8
    assert np.abs(deep / 257.0 - picture()).max() <= 0.5 + 1e-3


def test_blur_spreads_an_edge_and_keeps_the_mean():
    sharp, soft = picture().astype(float), picture(BoardFilm(blur=2.0, noise=0.0)).astype(float)
    assert np.abs(np.diff(soft, axis=1)).max() < 0.6 * np.abs(np.diff(sharp, axis=1)).max()
    assert soft.mean() == pytest.approx(sharp.mean(), abs=1.0)


def test_boards_of_the_project_are_flat_apart_and_as_many_as_asked():
    places = board_places(5)
    assert places.shape == (5, 3) and np.abs(places[:, 2]).max() <= np.pi
    apart = np.linalg.norm(places[:, None, :2] - places[None, :, :2], axis=2) + 9.0 * np.eye(5)
    assert apart.min() > 2.0 * BOARD.reach and np.array_equal(board_places(2), places[:2])


@pytest.mark.parametrize("number", range(6))
def test_photos_of_the_project_look_down_on_the_boards(number):
    at = board_view(CAMERA, BoardPhoto(number, 5, 3, 2.0))
    tilt = np.degrees(np.arccos(at.rotation[2, 2]))
    assert at.name == f"board_{number + 1:02d}" and tilt < 33.0 and (tilt < 6.0) == (number % 4 == 0)
    assert at.contains(at.project(np.array([[0.0, 0.0, 0.0]]))).all(), "the first board is at the origin"


def test_a_photo_of_the_project_depends_on_its_number_and_not_on_others():
    one = render_boards(CAMERA, BoardPhoto(1, 5, 3, 2.0), Window(30, 40, 20, 30))
    assert one.shape == (20, 30) and one.dtype == np.uint8
    assert np.array_equal(one, render_boards(CAMERA, BoardPhoto(1, 5, 3, 2.0), WHOLE)[30:50, 40:70])
    assert not np.array_equal(one, render_boards(CAMERA, BoardPhoto(2, 5, 3, 2.0), Window(30, 40, 20, 30)))
