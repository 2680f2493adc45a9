"""A tiny project whose surface is to be checked, with errors that are planted on the truth."""

import numpy as np
from memory_runner import MemoryProject
from tiny_block import EAST, NORTH, block, photograph, photos, surface

from orthomill.schemas.epipolar import PAIRS
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import PHOTOS, photo_raster
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import HEIGHT, PROVENANCE, SURFACE, Provenance, Surface
from orthomill.tasks.epipolar.pair_choice import PairChoice
from orthomill.tasks.epipolar.selection import choose_pairs

GRID = MapGrid(west=EAST - 120, north=NORTH + 96, cell=0.6, rows=320, cols=400)
ESTIMATED = slice(130, 160), slice(190, 230)


def ground():
    return np.meshgrid(*GRID.centres(Window(0, 0, *GRID.shape)))


def error(x, y):
    """A tilt of +-2 m, a bump and a hollow of 3 m."""
    u, v = x - EAST, y - NORTH
    bumps = 3 * np.exp(-((u - 50) ** 2 + (v - 25) ** 2) / 128) - 3 * np.exp(-((u + 50) ** 2 + (v + 25) ** 2) / 128)
    return 2 * u / 120 + bumps


def project(tile=128, planted=error, hole=True):
    made = MemoryProject(tile)
    made.tables = {
        PAIRS.path: choose_pairs(block(), PairChoice(per_place=9), 0.08),
        BLOCK.path: block(),
        PHOTOS.path: photos(),
        SURFACE.path: Surface(grid=GRID, height_low=20, height_high=85),
    }
    x, y = ground()
    heights = (surface(x, y) + planted(x, y)).astype(np.float32)
    if hole:
        heights[40:70, 290:330] = np.nan
    made.put(HEIGHT, heights)
    codes = np.where(np.isfinite(heights), Provenance.AGREED, Provenance.EMPTY).astype(np.uint8)
    codes[ESTIMATED] = Provenance.INCOHERENT
    made.put(PROVENANCE, codes)
    for name in block().names:
        made.put(photo_raster(name), photograph(name))
    return made
