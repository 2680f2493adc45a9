"""A height model with known ground: rolling land with a knoll, a house, a row of trees that were estimated, and noise."""

import numpy as np

from orthomill.schemas.raster import MapGrid
from orthomill.schemas.surface import Provenance

SIDE = 300
HOUSE = slice(140, 160), slice(60, 84)
TREES = slice(200, 212), slice(100, 180)
KNOLL = 100, 220
SIGMA = 0.05


def hilly_grid(cell: float = 1.0) -> MapGrid:
    """As many cells as the models have."""
    return MapGrid(west=1000.0, north=5000.0, cell=cell, rows=SIDE, cols=SIDE)


def bare_land(cell: float = 1.0) -> np.ndarray:
    """float64 (rows, cols) m: waves of 3 m over 150 cells, and a knoll of 8 m."""
    row, col = np.mgrid[:SIDE, :SIDE] * cell
    wave = 1.5 * np.sin(2 * np.pi * col / 150) * np.cos(2 * np.pi * row / 170)
    away = ((row - KNOLL[0] * cell) ** 2 + (col - KNOLL[1] * cell) ** 2) / (2 * 14.0**2)
    return 100.0 + wave + 8.0 * np.exp(-away)


def model(cell: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """float32 heights (rows, cols) m and uint8 codes of Provenance."""
    noise = np.random.default_rng(7).normal(0.0, SIGMA, (SIDE, SIDE))
    z = bare_land(cell) + noise
    codes = np.full(z.shape, Provenance.AGREED, np.uint8)
    z[HOUSE] = 108.0 + noise[HOUSE]
    z[TREES] += 5.0 + 20 * noise[TREES]
    codes[TREES] = Provenance.INCOHERENT
    # What lies beside walls was seen by no two photographs.
    rim = np.zeros(z.shape, bool)
    rim[HOUSE[0].start - 3 : HOUSE[0].stop + 3, HOUSE[1].start - 3 : HOUSE[1].stop + 3] = True
    rim[HOUSE[0].start + 1 : HOUSE[0].stop - 1, HOUSE[1].start + 1 : HOUSE[1].stop - 1] = False
    codes[rim] = Provenance.INTERPOLATED
    return z.astype(np.float32), codes
