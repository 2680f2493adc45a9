"""Vertical pairs over level ground: the parallax of every height is known in closed form."""

import numpy as np
from village_pair import normal_case

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import Surface
from orthomill.tasks.densification.surface_tile import PairPiece, SurfaceTile
from orthomill.tasks.geometry.epipolar_window import box_corners, node_window, nodes_shape

SIZE = 220
STEP = 4
GRID = MapGrid(west=20.0, north=-20.0, cell=2.0, rows=32, cols=36)
"""well inside the ground that the pair sees, 0 to 110 m east and south"""


def level_pair(name: str = "a-b", **changes) -> EpipolarPair:
    """A pair with axes along the map: base 582 m, c 1597 px, flying height 1040 m."""
    return normal_case(SIZE).model_copy(update={"name": name, **changes})


def parallax_of(pair: EpipolarPair, z: np.ndarray | float) -> np.ndarray | float:
    """p = B c / (H - z), px."""
    return pair.base * pair.c / (pair.left_centre[2] - z)


def level_nodes(pair: EpipolarPair, z: float, window: Window, sigma: float = 0.1) -> np.ndarray:
    """Nodes (rows, cols, 3) of the plane of height `z` m: parallax, standard error, correlation."""
    values = np.array([parallax_of(pair, z), sigma, 0.9], np.float32)
    return np.broadcast_to(values, (*window.shape, 3)).copy()


def piece_of(pair: EpipolarPair, surface: Surface, work: Window) -> PairPiece:
    corners = box_corners(surface.grid, work.grown(1), surface.height_low, surface.height_high)
    return PairPiece(pair, node_window(pair, STEP, corners), STEP)


def surface_tile(*pairs: EpipolarPair, window: Window | None = None, work: Window | None = None) -> SurfaceTile:
    """A tile of GRID over the pairs; without windows the whole grid."""
    surface = Surface(grid=GRID, height_low=-30.0, height_high=60.0)
    whole = Window(0, 0, *GRID.shape)
    window, work = window or whole, work or whole
    return SurfaceTile(surface, window, work, tuple(piece_of(pair, surface, work) for pair in pairs))


def all_nodes(pair: EpipolarPair) -> Window:
    return Window(0, 0, *nodes_shape(pair, STEP))
