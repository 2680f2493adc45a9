"""Standard errors of heights among their neighbours, by what the surface does around them.

placeholder
"""

import numpy as np
from scipy import ndimage

from orthomill.schemas.surface import Provenance
from orthomill.tasks.densification.completion import VolumeWindow
from orthomill.tasks.densification.fusion import FusedCells


def relative_precision(cells: FusedCells, volume: VolumeWindow, cell: float) -> np.ndarray:
    """Standard errors (rows, cols) float32, m, of all cells with a height."""
    known = np.isfinite(cells.height)
    filled = np.where(known, cells.height, 0.0)
    n = np.maximum(ndimage.uniform_filter(known.astype(np.float64), 5), 1e-6)
    mean = ndimage.uniform_filter(filled, 5) / n
    spread = np.sqrt(np.maximum(ndimage.uniform_filter(filled * filled, 5) / n - mean * mean, 0.0))
    sigma = np.where(cells.provenance == Provenance.VOLUME, 0.5 * cell + 0.5 * spread, cells.precision)
    sigma = np.where(cells.provenance == Provenance.INCOHERENT, 3.0 * cell + spread, sigma)
    return np.where(known, sigma, np.nan).astype(np.float32)
