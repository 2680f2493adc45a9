"""How far an orthoimage shows the ground from where it is, from the true orientations of a simulated flight.

A pixel of the orthoimage shows what its photograph shows at the image of the surface there, by the adjusted orientation. So a place
of the ground lies in it where the photograph's adjusted ray through the place's true image meets the surface.
"""

from pathlib import Path

import numpy as np
from scipy.ndimage import map_coordinates

from orthomill.pipeline.storage.store import Store
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.raster import MapGrid
from orthomill.schemas.surface import HEIGHT, ORTHO_SOURCE, SURFACE
from orthomill.schemas.truth import TRUTH_BLOCK, TRUTH_GRID, TRUTH_GROUND
from orthomill.tasks.evaluation.grids import grid_of
from orthomill.tasks.geometry.view import View, block_view

_ROUNDS = 6


def shown_aside(run: Path, flown: Path, places: np.ndarray) -> np.ndarray:
    """(N, 2) m: where the orthoimage of a run shows the open ground at `places` (N, 2), less these; NaN where it does not."""
    store, truth = Store(run), Store(flown)
    ground = np.column_stack([places, _at(_whole(truth, TRUTH_GROUND), truth.table(TRUTH_GRID), places)])
    surface, grid = _whole(store, HEIGHT), store.table(SURFACE).grid
    source, pixels = _whole(store, ORTHO_SOURCE), grid_of(store.spec(ORTHO_SOURCE))
    block, true = store.table(BLOCK), truth.table(TRUTH_BLOCK)
    aside = np.full(places.shape, np.nan)
    for number, name in enumerate(block.names, start=1):
        rays = block_view(true, name).project(ground)
        shown = _met(block_view(block, name), rays, ground[:, :2], surface, grid)
        col, row = pixels.pixel(*shown.T)
        inside = np.isfinite(shown).all(axis=1) & (row > 0) & (col > 0) & (row < pixels.rows - 1) & (col < pixels.cols - 1)
        own = inside.copy()
        own[inside] = source[np.rint(row[inside]).astype(int), np.rint(col[inside]).astype(int)] == number
        aside[own] = shown[own] - places[own]
    return aside


def _met(view: View, rays: np.ndarray, start: np.ndarray, surface: np.ndarray, grid: MapGrid) -> np.ndarray:
    """(N, 2) m: where the rays through pixels (N, 2) meet the surface near `start`."""
    place = start
    for _ in range(_ROUNDS):
        place = view.at_height(rays, _at(surface, grid, place))[:, :2]
    return place


def _at(raster: np.ndarray, grid: MapGrid, places: np.ndarray) -> np.ndarray:
    """(N,) values between the four cells around places (N, 2)."""
    col, row = grid.pixel(*places.T)
    return map_coordinates(raster.astype(np.float64), [row, col], order=1, mode="nearest")


def _whole(store: Store, name: str) -> np.ndarray:
    return store.read(name, store.spec(name).full)
