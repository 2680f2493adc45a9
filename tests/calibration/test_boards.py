"""Corners of rendered chessboards with known places, several in one picture."""

import numpy as np
import pytest

from schemas.camera import Camera
from tasks.calibration.boards import board_grid, find_boards, photo_corners
from tasks.geometry.rotation import rotation_matrix
from tasks.geometry.view import View

CORNERS, SQUARE = (7, 5), 0.1
CAMERA = Camera(name="t", width=640, height=520, c=520, x0=4.0, y0=-3.0, k1=-0.06)
VIEW = View("v", CAMERA, rotation_matrix(0.25, -0.2, 0.4), np.array([-0.58, -0.75, 2.9]))
PLACES = ((-0.75, 0.1, 0.3), (0.75, 0.15, 2.0))


def rendered() -> np.ndarray:
    """Two boards on grey ground, 3 x 3 rays per pixel, grey noise of sigma 2."""
    total = np.zeros((CAMERA.height, CAMERA.width))
    for dx, dy in np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)]) / 3:
        col, row = np.meshgrid(np.arange(CAMERA.width) + dx, np.arange(CAMERA.height) + dy)
        total += painted(VIEW.at_height(np.column_stack([col.ravel(), row.ravel()]), 0.0)).reshape(total.shape)
    noise = np.random.default_rng(0).normal(0, 2, total.shape)
    return np.clip(total / 9 + noise, 0, 255).astype(np.uint8)


def painted(ground: np.ndarray) -> np.ndarray:
    values = np.full(len(ground), 130.0)
    for x, y, angle in PLACES:
        cos, sin = np.cos(angle), np.sin(angle)
        u = (cos * (ground[:, 0] - x) + sin * (ground[:, 1] - y)) / SQUARE + (CORNERS[0] + 1) / 2
        v = (cos * (ground[:, 1] - y) - sin * (ground[:, 0] - x)) / SQUARE + (CORNERS[1] + 1) / 2
        values[(u > -1) & (u < CORNERS[0] + 2) & (v > -1) & (v < CORNERS[1] + 2)] = 220
        on_board = (u >= 0) & (u < CORNERS[0] + 1) & (v >= 0) & (v < CORNERS[1] + 1)
        values[on_board & ((np.floor(u) + np.floor(v)) % 2 == 0)] = 30
    return values


def true_corners() -> np.ndarray:
    boards = []
    for x, y, angle in PLACES:
        u, v = (SQUARE * (board_grid(CORNERS) - (np.array(CORNERS) - 1) / 2)).T
        ground = np.column_stack([x + np.cos(angle) * u - np.sin(angle) * v, y + np.sin(angle) * u + np.cos(angle) * v, 0 * u])
        boards.append(VIEW.project(ground))
    return np.array(boards)


@pytest.fixture(scope="module")
def picture() -> np.ndarray:
    return rendered()


def test_both_boards_are_found_to_a_tenth_of_a_pixel(picture):
    boards = find_boards(picture, CORNERS)
    truth = true_corners()
    assert len(boards) == 2
    distance = np.linalg.norm(np.concatenate(boards)[:, None] - truth.reshape(1, -1, 2), axis=2).min(axis=1)
    assert np.sqrt((distance**2).mean()) < 0.1 and distance.max() < 0.3


def test_rows_and_columns_of_the_table_are_those_of_a_board(picture):
    corners = photo_corners(np.repeat(picture[:, :, None], 3, axis=2), CORNERS)
    assert len(corners) == 70 and set(corners.board) == {0, 1}
    first = corners.take(corners.board == 0)
    along = first.take(first.row == 2)
    line = np.column_stack([along.x, along.y])
    assert np.linalg.matrix_rank(line - line.mean(axis=0), tol=1.0) == 1, "corners of one row lie on a line"


def test_no_board_gives_an_empty_table():
    assert len(photo_corners(np.full((200, 300, 1), 120, dtype=np.uint8), CORNERS)) == 0
