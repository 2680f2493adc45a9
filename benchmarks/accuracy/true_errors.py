"""The errors of a surface of a simulated town, from its truth."""

import numpy as np
from scipy.ndimage import binary_dilation

from orthomill.pipeline.storage.store import Store
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.truth import TRUTH_GRID, TRUTH_GROUND, TRUTH_MATERIAL, TRUTH_SURFACE, Material
from orthomill.tasks.evaluation.grids import codes_on, heights_on, placement


def errors_of(store: Store, grid: MapGrid, height: np.ndarray) -> np.ndarray:
    """The errors (rows, cols) m of heights; below crowns those from the ground where it is closer: leaves are full of holes, and
    what photographs show through them is no error."""
    place = placement(grid, Window(0, 0, *grid.shape), store.table(TRUTH_GRID))
    surface, ground = (height - heights_on(store.read(name, place.source_window), place) for name in (TRUTH_SURFACE, TRUTH_GROUND))
    tree = binary_dilation(codes_on(store.read(TRUTH_MATERIAL, place.source_window), place) == Material.TREE, iterations=2)
    return np.where(tree & (np.abs(ground) < np.abs(surface)), ground, surface)
