"""Equal chessboards in random arrangement on a floor, and photographs of them from all sides, with known truth.

Boards lie in the jittered cells of a lattice, each turned by any angle. Photos aim near the middle, are tilted in directions spread
over the circle and turned through the four quadrants, and stand as near as all boards (or `share` of them) allow: what remains
outside the frame is cut. The published set-ups of Kawka 2021 (methods/calibration.md, section 4) stand below as seeded scenes.
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.camera import Camera
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View


@dataclass(frozen=True)
class BoardType:
    """A board: inner corners (columns, rows), side of a square and width of the white margin, m."""

    corners: tuple[int, int]
    square: float
    quiet: float

    @property
    def local(self) -> np.ndarray:
        """(N, 2) m: inner corners row by row, from the middle of the board."""
        col, row = np.meshgrid(np.arange(self.corners[0]), np.arange(self.corners[1]))
        return (np.column_stack([col.ravel(), row.ravel()]) - (np.array(self.corners) - 1) / 2.0) * self.square

    @property
    def reach(self) -> float:
        """m from the middle to the outer corner of the margin."""
        return float(np.hypot(*((np.array(self.corners) + 1) * self.square / 2 + self.quiet)))


@dataclass(frozen=True)
class BoardSetup:
    """A set of photographs of boards. `tilt`: least and largest angle against the vertical, degrees; `turned`: through the four
    quadrants, or all alike; `share` of the boards that a photo has to show whole; `back`: how many times further off than that
    takes; `straight`: boards lie along the axes of the floor, and not at any angle."""

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
    """(K, 3) x, y (m) of the middles of the boards, and their angles (radians)."""
    generator = np.random.default_rng([setup.seed, 1])
    wide = setup.camera.width / setup.camera.height
    columns = max(1, round(np.sqrt(setup.boards * wide)))
    rows = -(-setup.boards // columns)
    cell = np.arange(setup.boards)
    lattice = np.column_stack([cell % columns - (columns - 1) / 2, cell // columns - (rows - 1) / 2])
    jitter = generator.uniform(-0.14, 0.14, (setup.boards, 2))
    angle = generator.uniform(-np.pi, np.pi, setup.boards) * (not setup.straight)
    return np.column_stack([2.5 * setup.board.reach * (lattice + jitter), angle])


def floor_corners(places: np.ndarray, board: BoardType) -> np.ndarray:
    """(K, N, 3) m: inner corners of all boards on the floor, row by row."""
    cos, sin = np.cos(places[:, 2, None]), np.sin(places[:, 2, None])
    u, v = board.local.T
    x, y = places[:, 0, None] + u * cos - v * sin, places[:, 1, None] + u * sin + v * cos
    return np.stack([x, y, np.zeros_like(x)], axis=-1)


def views_of(setup: BoardSetup) -> tuple[View, ...]:
    """Where the photos were taken from, in the system of the floor (m, Z up, floor at 0)."""
    generator = np.random.default_rng([setup.seed, 2])
    corners = floor_corners(places_of(setup), setup.board)
    return tuple(_view(setup, number, corners, generator) for number in range(setup.photos))


def _view(setup: BoardSetup, number: int, corners: np.ndarray, generator: np.random.Generator) -> View:
    tilt = np.radians(generator.uniform(*setup.tilt))
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
        if not (trial.project(corners.reshape(-1, 3)) == trial.project(corners.reshape(-1, 3))).all():
            continue
        inside = trial.contains(trial.project(corners.reshape(-1, 3)), margin).reshape(corners.shape[:2]).all(axis=1)
        if inside.mean() >= share - 1e-9:
            return trial
    raise ValueError(f"the boards of {view.name} do not fit into the frame")


def _published(name: str, size: tuple[int, int], c: float, k_px: tuple[float, float], **rest) -> BoardSetup:
    """A published set-up; radial distortion is given in px^-2 and px^-4 there."""
    camera = Camera(name=name, width=size[0], height=size[1], c=c, x0=rest.pop("x0"), y0=rest.pop("y0"),
                    k1=k_px[0] * c**2, k2=k_px[1] * c**4, source="truth")  # fmt: skip
    return BoardSetup(name, camera, **rest)


_LARGE, _SMALL = BoardType((6, 5), 0.0359, 0.02), BoardType((5, 4), 0.0359, 0.02)

TWELVE_BOARDS = _published(
    "twelve_boards", (5472, 3648), 3619.4, (-3.08e-10, 3.546e-17), x0=0.4, y0=6.2, photos=7, boards=12, board=_LARGE, seed=41
)
"""12 boards of 6 x 7 squares, 7 photographs of a drone's camera, published with sigma0 0.945 px."""
SIX_BOARDS = _published(
    "six_boards", (4912, 3264), 4195.2, (-8.272e-9, 4.298e-16), x0=-4.8, y0=16.6, photos=14, boards=6, board=_LARGE, seed=42,
    tilt=(24.0, 40.0),
)  # fmt: skip
"""6 boards, 14 photographs, 20 mm lens, published with sigma0 0.383 px."""
SIX_BOARDS_LONGER = _published(
    "six_boards_longer", (5184, 3456), 4938.2, (-1.248e-9, 2.816e-16), x0=8.5, y0=21.9, photos=16, boards=6, board=_LARGE, seed=43
)
"""6 boards, 16 photographs, 22 mm lens, published with sigma0 0.375 px."""
FIVE_BOARDS = _published(
    "five_boards", (5472, 3648), 3687.5, (6.237e-11, -3.482e-18), x0=-4.2, y0=-16.4, photos=34, boards=5, board=_SMALL, seed=44
)
"""5 boards of 5 x 6 squares, 34 photographs, published with sigma0 0.467 px."""
PUBLISHED = (TWELVE_BOARDS, SIX_BOARDS, SIX_BOARDS_LONGER, FIVE_BOARDS)
