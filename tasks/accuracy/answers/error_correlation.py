"""How the errors of neighbouring heights are correlated, estimated from the surface itself.

Windows of ground that is one smooth sheet are freed from a quadratic surface; what remains is noise of the matching (and the
ground's own unevenness, which makes answers a little less sure than they are, never surer). The mean of its products by distance
is the correlation. The quadratic surface takes away what is long: the correlation is nowhere taken as less than the one that was
measured against the truth on the simulated town of volos, which is assumed where a block shows no such ground. Far apart errors
are correlated as well, for the same photographs and lenses made all of them: of that no window of the surface knows, and what was
measured over simulated flights is assumed on every block.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.tasks.accuracy.answers.datum_lattice import DatumLattice

DISTANCES = (0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0, 48.0)
"""cells"""
ASSUMED = (1.0, 0.97, 0.89, 0.80, 0.69, 0.46, 0.27, 0.08, 0.06, 0.06, 0.04, 0.0)
"""of the errors of the open ground of volos, 3.9 million measured cells against the truth"""
COMMON = 0.03
"""share of the variance of a measured height that all heights of a surface have in common, the datum apart: of 20 simulated flights
and towns the mean is 0.036, and 0.027 without the one whose heights are 2 m off (benchmarks: `common_errors`)"""
SIDES = (96, 48)
"""cells along a window: the larger ones first, and the smaller where the ground is too hilly for those"""
LEAST = 4
"""windows from which a correlation is estimated"""
_ROUGH = 1.25
"""stated standard errors up to which the residuals of a smooth window spread: beyond, the ground's own relief is most of them"""


@dataclass(frozen=True)
class ErrorCorrelation:
    """Correlation of the errors of two heights: of matching by their distance, in cells, beyond the last one that of all heights;
    of the datum by their places."""

    distances: tuple[float, ...] = DISTANCES
    values: tuple[float, ...] = ASSUMED
    windows: int = 0
    """windows that it was estimated from; 0: assumed"""
    common: float = COMMON
    """correlation of all heights of the surface, however far apart"""
    datum: DatumLattice | None = None
    """None: one error, common to the block"""

    @property
    def cells(self) -> float:
        """How many cells count as one observation, what all have in common apart: the sum of the correlation over the plane."""
        return float(kernel_of(self).sum())


def kernel_of(correlation: ErrorCorrelation) -> np.ndarray:
    """The correlation (2 r + 1, 2 r + 1) around a cell beyond what all heights have in common, r the last distance."""
    reach = int(np.ceil(correlation.distances[-1]))
    steps = np.arange(-reach, reach + 1)
    away = np.hypot(*np.meshgrid(steps, steps))
    return np.maximum(np.interp(away, correlation.distances, correlation.values, right=0.0) - correlation.common, 0.0)


def window_products(height: np.ndarray, sigma: np.ndarray, measured: np.ndarray) -> np.ndarray | None:
    """Mean products of normalised residuals by DISTANCES, from one window (n, n) m; None where it is no smooth ground.

    measured: bool, heights that photographs measured.
    """
    known = measured & np.isfinite(height) & np.isfinite(sigma) & (sigma > 0)
    if known.mean() < 0.95:
        return None
    rows, cols = np.indices(height.shape) / (height.shape[0] / 2) - 1.0
    design = np.stack([np.ones_like(rows), rows, cols, rows * rows, rows * cols, cols * cols], axis=-1)
    # Coordinates are of the order of one, so normal equations are as good as a decomposition of all cells, and many times cheaper.
    rows_of, heights = design[known], height[known].astype(np.float64)
    found = np.linalg.solve(rows_of.T @ rows_of, rows_of.T @ heights)
    residual = np.where(known, (height - design @ found) / np.where(known, sigma, 1.0), 0.0)
    spread = 1.4826 * np.median(np.abs(residual[known]))
    if not 0 < spread < _ROUGH or (np.abs(residual[known]) > 6 * spread).mean() > 0.002:
        return None
    return _by_distance(residual, known)


def _by_distance(residual: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Mean products of a window (n, n) with itself at DISTANCES: by FFT over all pairs of cells, then over rings."""
    size = [2 * n for n in residual.shape]
    spectra = (np.fft.rfft2(values, size) for values in (residual, known.astype(np.float64)))
    sums, counts = (np.fft.irfft2(np.abs(spectrum) ** 2, size) for spectrum in spectra)
    reach = int(DISTANCES[-1])
    steps = np.arange(-reach, reach + 1)
    away = np.hypot(*np.meshgrid(steps, steps))
    sums, counts = (part[np.ix_(steps, steps)] for part in (sums, counts))
    out = []
    for distance in DISTANCES:
        ring = np.abs(away - distance) < 0.5
        out.append(sums[ring].sum() / max(counts[ring].sum(), 1.0))
    return np.array(out)


def correlation_from(products: list[np.ndarray], side: int) -> ErrorCorrelation:
    """The correlation of a block from the products of windows of `side` cells; the assumed one from fewer than LEAST."""
    if len(products) < LEAST:
        return ErrorCorrelation()
    middle = np.median([one / one[0] for one in products], axis=0)
    # Never rising; far off, and from a third of a window on, its quadratic surface has taken away what there was.
    values = np.minimum.accumulate(np.clip(middle, 0.0, 1.0))
    values[np.array(DISTANCES) > side / 3] = 0.0
    # What was taken away would make answers too sure: nowhere less than where the truth is known.
    values = np.maximum(values, ASSUMED)
    return ErrorCorrelation(DISTANCES, tuple(map(float, values)), len(products))
