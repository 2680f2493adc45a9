"""The chessboards of the embedded project, photographed by the camera of the flight.

Equal boards lie flat on one plane at different angles; the photos look down at them from different sides, tilted up to 32 degrees
and turned through the four quadrants, so that principal point and distortion separate from the exterior orientation. Every second
photo is a close-up of the first board; the others show all boards or most of them.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.camera import Camera
from orthomill.schemas.raster import Window
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View
from orthomill.tasks.simulation.boards.board_rendering import BoardFilm, photograph_floor
from orthomill.tasks.simulation.boards.board_scene import BoardType
from orthomill.tasks.simulation.rendering import PSF_SIGMA

CORNERS = (9, 6)
"""Inner corners: columns, rows."""
SQUARE = 0.05
"""m"""
QUIET = 0.045
"""m of white paper around the squares"""
BOARD = BoardType(CORNERS, SQUARE, QUIET)
_PLACES = np.array([[0.0, 0.0, 8.0], [-0.67, 0.51, -14.0], [0.68, 0.49, 97.0], [0.65, -0.53, 24.0], [-0.65, -0.51, 170.0]])
"""x, y (m), angle (degrees) of the first five boards."""


@dataclass(frozen=True)
class BoardPhoto:
    """A photo of the boards: its number from 0, the number of boards, the seed of the series and its noise (grey values)."""

    number: int
    boards: int
    seed: int
    noise_sigma: float


def board_view(camera: Camera, photo: BoardPhoto) -> View:
    """The true view of the photo, in the system of the floor (m, Z up, floor at 0)."""
    # A generator per photo: jobs of any order and number draw the same photos. 6 separates this series from others of the seed.
    generator = np.random.default_rng([photo.seed, 6, photo.number])
    close = photo.number % 2 == 1
    height = generator.uniform(0.53, 0.67) if close else generator.uniform(1.18, 1.37)
    aim = generator.uniform(-0.11, 0.11, 2) if close else generator.uniform(-0.15, 0.15, 2)
    # Every fourth photo is nearly vertical: the tilted ones separate c from the distance, these fill the corners of the frame.
    tilt = np.radians(generator.uniform(16.0, 32.0) if photo.number % 4 else generator.uniform(0.0, 4.0))
    side = 2.0 * np.pi * photo.number / 12.0 * 5.0 + generator.uniform(-0.3, 0.3)
    omega, phi = tilt * np.sin(side), tilt * np.cos(side)
    kappa = np.radians(90.0 * (photo.number % 4) + generator.uniform(-12.0, 12.0))
    # Size of the field of view against that of the large camera, so that a small frame sees the boards as well.
    field = 0.5 * (camera.width + camera.height) / camera.c / 1.5
    rotation = rotation_matrix(float(omega), float(phi), float(kappa))
    axis = -rotation[2]
    centre = np.array([*aim, 0.0]) - axis * (height / field / -axis[2])
    return View(f"board_{photo.number + 1:02d}", camera, rotation, centre)


def board_places(count: int) -> np.ndarray:
    """(count, 3) x, y (m) of the centres of the boards, and their angles (radians)."""
    return np.column_stack([_PLACES[:count, :2], np.radians(_PLACES[:count, 2])])


def render_boards(camera: Camera, photo: BoardPhoto, pixels: Window) -> np.ndarray:
    """The window `pixels` of the photo, uint8 (rows, cols)."""
    # A prime factor: photos of different series do not share their noise.
    film = BoardFilm(PSF_SIGMA, photo.noise_sigma, seed=photo.seed * 1013 + photo.number)
    return photograph_floor(board_view(camera, photo), board_places(photo.boards), BOARD, film, pixels)
