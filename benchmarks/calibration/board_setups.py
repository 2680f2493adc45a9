"""Sets of photographs of equal chessboards with known truth, among them the published ones, as seeded scenes.

Boards lie in the jittered cells of a lattice, each rotated by any angle. Photos aim near the centre, are tilted in directions
spread over the circle and turned through the four quadrants, and are as near as all boards (or `share` of them) allow: what remains
outside the frame is cut. The published set-ups are those of Kawka 2021 (sources/calibration.md#data).
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.camera import Camera
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View
from orthomill.tasks.simulation.boards.board_scene import BoardType


@dataclass(frozen=True)
class BoardSetup:
    """A set of photographs of boards.

    `tilt`: least and largest angle from the vertical, degrees; `turned`: about the optical axis through the four quadrants, or all
    alike; `share` of the boards that a photo has to show whole; `back`: how many times farther away than that requires; `straight`:
    boards are parallel to the axes of the floor, not rotated by any angle.
    """

    name: str
    camera: Camera
    photos: int
    boards: int
    board: BoardType
    seed: int
    tilt: tuple[float, float] = (15.0, 38.0)
    turned: bool = True
    share: float = 1.0
    back: float = 1.0
    straight: bool = False


def places_of(setup: BoardSetup) -> np.ndarray:
    """(K, 3) x, y (m) of the centres of the boards, and their angles (radians)."""
    generator = np.random.default_rng([setup.seed, 1])
    wide = setup.camera.width / setup.camera.height
    columns = max(1, round(np.sqrt(setup.boards * wide)))
    rows = -(-setup.boards // columns)
    cell = np.arange(setup.boards)
    lattice = np.column_stack([cell % columns - (columns - 1) / 2, cell // columns - (rows - 1) / 2])
    jitter = generator.uniform(-0.14, 0.14, (setup.boards, 2))
    # Drawn in any case: straight boards then lie at the same places as rotated ones.
    angle = generator.uniform(-np.pi, np.pi, setup.boards) * (not setup.straight)
    # Cells of 2.5 reaches, so that jittered boards hardly ever touch at any angle.
    return np.column_stack([2.5 * setup.board.reach * (lattice + jitter), angle])


def floor_corners(places: np.ndarray, board: BoardType) -> np.ndarray:
    """(K, N, 3) m: inner corners of all boards at `places` (K, 3) x, y (m), angle (radians) on the floor, row by row."""
    cos, sin = np.cos(places[:, 2, None]), np.sin(places[:, 2, None])
    u, v = board.local.T
    x, y = places[:, 0, None] + u * cos - v * sin, places[:, 1, None] + u * sin + v * cos
    return np.stack([x, y, np.zeros_like(x)], axis=-1)


def views_of(setup: BoardSetup) -> tuple[View, ...]:
    """The true views of the photos, in the system of the floor (m, Z up, floor at 0)."""
    generator = np.random.default_rng([setup.seed, 2])
    corners = floor_corners(places_of(setup), setup.board)
    return tuple(_view(setup, number, corners, generator) for number in range(setup.photos))


def _view(setup: BoardSetup, number: int, corners: np.ndarray, generator: np.random.Generator) -> View:
    tilt = np.radians(generator.uniform(*setup.tilt))
    # Steps of 150 degrees: consecutive photos look from nearly opposite sides, so that any few of them are well spread.
    side = 2.0 * np.pi * (number * 5 / 12 + generator.uniform(-0.04, 0.04))
    kappa = np.radians((90.0 * number if setup.turned else 0.0) + generator.uniform(-12.0, 12.0))
    rotation = rotation_matrix(float(tilt * np.sin(side)), float(tilt * np.cos(side)), float(kappa))
    spread = np.ptp(corners.reshape(-1, 3), axis=0)
    aim = corners.reshape(-1, 3).mean(axis=0) + spread * np.append(generator.uniform(-0.06, 0.06, 2), 0.0)
    near = _as_near_as_allowed(View(f"board_{number + 1:02d}", setup.camera, rotation, aim), aim, corners, setup.share)
    return replace(near, centre=aim + setup.back * (near.centre - aim))


def _as_near_as_allowed(view: View, aim: np.ndarray, corners: np.ndarray, share: float) -> View:
    """The view drawn back from `aim` along its axis until `share` of the boards lie in the frame, 1.5 % of its width inside."""
    margin = 0.015 * view.camera.width
    for distance in np.ptp(corners.reshape(-1, 3), axis=0).max() * np.geomspace(0.1, 20.0, 200):
        trial = replace(view, centre=aim + distance * view.rotation[2])
        pixels = trial.project(corners.reshape(-1, 3))
        # NaN: a corner is still behind the camera.
        if np.isnan(pixels).any():
            continue
        inside = trial.contains(pixels, margin).reshape(corners.shape[:2]).all(axis=1)
        if inside.mean() >= share - 1e-9:
            return trial
    raise ValueError(f"the boards of {view.name} do not fit into the frame")


def _camera(name: str, size: tuple[int, int], interior: tuple[float, float, float], k1: float, k2: float) -> Camera:
    """A camera with c, x0, y0 in px and radial distortion in px^-2 and px^-4, as published."""
    c, x0, y0 = interior
    # Inside the program the radius is in units of c.
    return Camera(name=name, width=size[0], height=size[1], c=c, x0=x0, y0=y0, k1=k1 * c**2, k2=k2 * c**4, source="truth")


_LARGE, _SMALL = BoardType((6, 5), 0.0359, 0.02), BoardType((5, 4), 0.0359, 0.02)

TWELVE_BOARDS = BoardSetup(
    name="twelve_boards",
    camera=_camera("twelve_boards", (5472, 3648), (3619.4, 0.4, 6.2), -3.08e-10, 3.546e-17),
    photos=7,
    boards=12,
    board=_LARGE,
    seed=41,
)
"""12 boards of 6 x 7 squares, 7 photographs of a drone's camera, published with sigma0 0.945 px."""
SIX_BOARDS = BoardSetup(
    name="six_boards",
    camera=_camera("six_boards", (4912, 3264), (4195.2, -4.8, 16.6), -8.272e-9, 4.298e-16),
    photos=14,
    boards=6,
    board=_LARGE,
    seed=42,
    tilt=(24.0, 40.0),
)
"""6 boards, 14 photographs, 20 mm lens, published with sigma0 0.383 px."""
SIX_BOARDS_LONGER = BoardSetup(
    name="six_boards_longer",
    camera=_camera("six_boards_longer", (5184, 3456), (4938.2, 8.5, 21.9), -1.248e-9, 2.816e-16),
    photos=16,
    boards=6,
    board=_LARGE,
    seed=43,
)
"""6 boards, 16 photographs, 22 mm lens, published with sigma0 0.375 px."""
FIVE_BOARDS = BoardSetup(
    name="five_boards",
    camera=_camera("five_boards", (5472, 3648), (3687.5, -4.2, -16.4), 6.237e-11, -3.482e-18),
    photos=34,
    boards=5,
    board=_SMALL,
    seed=44,
)
"""5 boards of 5 x 6 squares, 34 photographs, published with sigma0 0.467 px."""
PUBLISHED = (TWELVE_BOARDS, SIX_BOARDS, SIX_BOARDS_LONGER, FIVE_BOARDS)
