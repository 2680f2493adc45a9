"""Corners of rendered boards with known places: several in one picture, turned, cut, too large, and none."""

import numpy as np
import pytest

from benchmarks.calibration.board_setups import floor_corners
from orthomill.schemas.camera import Camera
from orthomill.schemas.raster import Window
from orthomill.tasks.calibration.board_tables import Arranged, ArrangedPhoto, Prediction
from orthomill.tasks.calibration.detection.board_detection import COARSE_SIDE, Refusal, _refusal, find_boards, pyramid, regular
from orthomill.tasks.calibration.detection.board_photographs import photo_corners
from orthomill.tasks.calibration.detection.saddles import edge_blur
from orthomill.tasks.calibration.detection.second_search import complete_corners, near_predictions
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View
from orthomill.tasks.simulation.boards.board_rendering import BoardFilm, photograph_floor
from orthomill.tasks.simulation.boards.board_scene import BoardType

BOARD = BoardType((6, 5), 0.04, 0.02)
CAMERA = Camera(name="t", width=900, height=700, c=760, x0=4.0, y0=-3.0, k1=-0.06)
PLACES = np.array([[-0.3, 0.05, 0.3], [0.25, 0.2, 2.0], [0.2, -0.2, -1.3]])


def view(kappa: float = 0.4, distance: float = 1.15) -> View:
    R = rotation_matrix(0.25, -0.2, kappa)
    return View("v", CAMERA, R, distance * R[2])


def picture(camera_at: View, film: BoardFilm | None = None, board: BoardType = BOARD) -> np.ndarray:
    return photograph_floor(camera_at, PLACES, board, film or BoardFilm(0.7, 2.0), Window(0, 0, CAMERA.height, CAMERA.width))


def truth(camera_at: View) -> np.ndarray:
    return np.array([camera_at.project(board) for board in floor_corners(PLACES, BOARD)])


@pytest.mark.parametrize("kappa", [0.4, 1.9, -2.8])
def test_boards_are_found_to_a_few_hundredths_with_their_origin_in_any_rotation(kappa):
    here = view(kappa)
    found = find_boards(pyramid(picture(here), COARSE_SIDE), BOARD.corners, 3)
    assert found.corners.shape == (3, 5, 6, 2) and (found.false, found.larger) == (0, 0)
    miss = [np.linalg.norm(truth(here) - board.reshape(-1, 2), axis=2).max(axis=1).min() for board in found.corners]
    assert max(miss) < 0.2, "every corner, by its own number"
    nearest = np.array(
        [
            board.reshape(-1, 2) - truth(here)[np.linalg.norm(truth(here) - board.reshape(-1, 2), axis=2).mean(axis=1).argmin()]
            for board in found.corners
        ]
    )
    assert np.sqrt((nearest**2).sum(axis=-1).mean()) < 0.05


def test_sixteen_bits_vignetting_and_three_bands_make_no_difference():
    here = view()
    pixels = np.repeat(picture(here, BoardFilm(0.7, 2.0, vignetting=0.4, light=0.4, bits=16))[:, :, None], 3, axis=2)
    outcome = photo_corners(pixels, "p", BOARD.corners, 3)
    assert outcome.search.boards == 3 and len(outcome.corners) == 90
    first = outcome.corners.take(outcome.corners.board == 0)
    distance = np.linalg.norm(truth(here) - first.pixels, axis=2).max(axis=1).min()
    assert distance < 0.3 and max(outcome.overview.shape) <= 1100
    assert outcome.search.blur == pytest.approx(0.75, abs=0.15) and outcome.search.overexposed < 0.01


def test_blur_is_measured_and_overexposure_seen():
    soft = photo_corners(picture(view(), BoardFilm(2.5, 2.0))[:, :, None], "p", BOARD.corners, 3).search
    assert soft.blur == pytest.approx(2.5, abs=0.5)
    bright = photo_corners(picture(view(), BoardFilm(0.7, 2.0, light=1.6))[:, :, None], "p", BOARD.corners, 3).search
    assert bright.overexposed > 0.3
    assert np.isnan(edge_blur(np.zeros((50, 50), np.uint8), np.full((3, 4, 2), -100.0)))


def test_a_board_with_more_corners_than_stated_is_no_board_of_that_kind():
    image = picture(view())
    assert len(find_boards(pyramid(image, COARSE_SIDE), (5, 4), 3).corners) == 0
    whole = truth(view())[0].reshape(5, 6, 2)
    assert _refusal(image, whole) is None
    assert _refusal(image, whole[:4, 1:]) is Refusal.LARGER, "the squares continue beyond a part of a board"
    assert _refusal(image, whole + 17.0) is Refusal.NO_BOARD, "no corners there"


def test_cut_and_missed_boards_are_found_where_they_have_to_be():
    near = view(distance=0.75)
    image, places = picture(near), truth(near)
    inside = near.contains(places.reshape(-1, 2), 6.0).reshape(places.shape[:2])
    cut = int(inside.sum(axis=1).argmin())
    assert 0 < inside[cut].sum() < 30
    shifted = places[cut] + np.array([1.2, -0.9])
    points, good = near_predictions(image, shifted.reshape(5, 6, 2))
    assert good.sum() >= 0.6 * inside[cut].sum() and not good.ravel()[~near.contains(places[cut], 0.0)].any()
    assert np.abs(points[good] - places[cut].reshape(5, 6, 2)[good]).max() < 0.35
    own = ArrangedPhoto(
        photo="p", names=(), certain=True, predictions=(Prediction(board=2, pixels=tuple(map(tuple, shifted.tolist()))),)
    )
    table = complete_corners(image[:, :, None], Arranged(boards=3, photos=(own,)), "p", BOARD.corners)
    assert len(table) == good.sum() and set(table.board) == {2}


def test_nothing_is_found_where_nothing_is():
    plain = np.full((300, 400, 1), 120, dtype=np.uint8)
    assert len(photo_corners(plain, "p", BOARD.corners, 1).corners) == 0
    _, good = near_predictions(plain[:, :, 0], truth(view())[0].reshape(5, 6, 2))
    assert not good.any()


def barrel(strength: float) -> np.ndarray:
    """(6, 8, 2) px: a board of 8 x 6 corners off the centre, its radius shortened to r / (1 + strength r^2)."""
    col, row = np.meshgrid(np.arange(8) - 1.5, np.arange(6) - 2.5)
    grid = np.stack([col, row], axis=-1) / 4.5
    return 400.0 * grid / (1.0 + strength * (grid**2).sum(axis=-1, keepdims=True))


def test_spacings_may_change_steadily_but_not_suddenly():
    step = np.linalg.norm(np.diff(barrel(0.3), axis=1), axis=2)
    assert (step[:, :-1] / step[:, 1:]).max() > 1.4 and regular(barrel(0.3)), "a strong barrel"
    jumped = barrel(0.2)
    jumped[:, 4:, 0] += 40.0
    assert regular(barrel(0.2)) and not regular(jumped), "a row of squares is missing"
