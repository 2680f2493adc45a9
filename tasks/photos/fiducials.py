"""The affine transformation from a scan to its fiducial marks, and the detection of gross errors among the marks.

A mark that was measured wrongly, or two that were exchanged, are identified by leaving them out: the others then fit much better.
Five marks are needed to identify one, six to identify two; with four marks the residuals of all have the same size, so that a gross
error is detected but not located.

Source: Karfis 2009, section 1.3 (sources/epipolar.md#option-a).
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from orthomill.schemas.errors import WorkflowError

# Marks are rejected when the others fit this many times better without them. With five marks, leaving one out always lowers the
# standard error a little: redundancy 4 becomes 2.
_CLEARER = 3.0
# px of the scan: up to this standard error all marks are accepted, for a mark is hardly measured better than to a pixel.
_TOLERATED = 1.0
_FEWEST_WITH_REDUNDANCY = 4  # three marks determine the six coefficients without a residual


@dataclass(frozen=True, eq=False)
class MarkFit:
    """`affine` (3, 2): rows for 1, col and row of the scan, columns x and y in mm; `rms_um` standard error of the marks used, and
    `sigma_um` of a coordinate in their middle and at the outermost one, None without redundancy; `wrong`: rejected mark -> its
    distance (px of the scan) from where the others place it."""

    affine: np.ndarray
    marks: int
    rms_um: float | None
    sigma_um: tuple[float, float] | None
    wrong: dict[str, float]

    @property
    def pixel_um(self) -> tuple[float, float]:
        """Size of a pixel along the columns and the rows of the scan."""
        return float(1000.0 * np.linalg.norm(self.affine[1])), float(1000.0 * np.linalg.norm(self.affine[2]))

    @property
    def mirrored(self) -> bool:
        """Whether the scan is a mirror image, as of film scanned from the back."""
        # Rows count downwards, y upwards: the determinant of a scan from the front is negative.
        return bool(np.linalg.det(self.affine[1:]) > 0)


def fit_marks(photo: str, measured: dict[str, np.ndarray], marks: dict[str, np.ndarray]) -> MarkFit:
    """The transformation of one scan; `measured`: mark -> (col, row), `marks`: mark -> (x, y) mm.

    Raises WorkflowError when the marks lie on one line.
    """
    names = list(measured)
    pixels, mm = np.array([measured[name] for name in names]), np.array([marks[name] for name in names])
    # Tolerances of the rank: a pixel in the scan, a micrometre in the calibrated coordinates.
    if any(np.linalg.matrix_rank(at - at.mean(axis=0), tol=least) < 2 for at, least in ((pixels, 1.0), (mm, 1e-3))):
        raise WorkflowError(f"The fiducial marks of {photo} lie on one line; measure at least one mark off this line.")
    used = _agreeing(pixels, mm)
    affine, rms = _affine(pixels[used], mm[used])
    # Residuals go back into the scan, where whoever measured the marks can look for the error.
    off = np.linalg.norm((_design(pixels) @ affine - mm) @ np.linalg.inv(affine[1:]), axis=1)
    sigma = None if rms is None else _precision(pixels[used], rms)
    return MarkFit(affine, int(used.sum()), rms, sigma, {names[i]: float(off[i]) for i in np.flatnonzero(~used)})


def _agreeing(pixels: np.ndarray, mm: np.ndarray) -> np.ndarray:
    """(n,) which marks agree: all, or those that remain without the one or two that spoil the fit of four or more others."""
    every = np.ones(len(pixels), bool)
    affine, rms = _affine(pixels, mm)
    if rms is None or rms <= _TOLERATED * 1000.0 * np.linalg.norm(affine[1:], axis=1).max():
        return every
    # One mark before two: the smaller change that explains the residuals is taken. All subsets are tried, for there are eight marks
    # at most and least squares with a gross error spreads it over its neighbours (the largest residual need not be the wrong mark).
    for count in (1, 2):
        parts = [np.isin(np.arange(len(pixels)), out, invert=True) for out in combinations(range(len(pixels)), count)]
        large_enough = [part for part in parts if part.sum() >= _FEWEST_WITH_REDUNDANCY]
        found = [(_affine(pixels[part], mm[part])[1] or 0.0, part) for part in large_enough]
        best, part = min(found, key=lambda one: one[0], default=(np.inf, every))
        if best * _CLEARER < rms:
            return part
    return every


def _precision(pixels: np.ndarray, rms_um: float) -> tuple[float, float]:
    """Standard errors of a transformed coordinate in the middle of the marks and at the outermost mark, micrometres."""
    # About the centroid the shift is uncorrelated with the four linear coefficients.
    offset = pixels - pixels.mean(axis=0)
    design = _design(offset)
    cofactor = np.linalg.inv(design.T @ design)
    outermost = design[np.linalg.norm(offset, axis=1).argmax()]
    return rms_um * float(np.sqrt(cofactor[0, 0])), rms_um * float(np.sqrt(outermost @ cofactor @ outermost))


def _design(pixels: np.ndarray) -> np.ndarray:
    return np.column_stack([np.ones(len(pixels)), pixels])


def _affine(pixels: np.ndarray, mm: np.ndarray) -> tuple[np.ndarray, float | None]:
    """The coefficients (3, 2), and the standard error of a mark coordinate, micrometres."""
    design = _design(pixels)
    affine = np.linalg.lstsq(design, mm, rcond=None)[0]
    redundancy = 2 * len(pixels) - 6
    square = ((1000.0 * (design @ affine - mm)) ** 2).sum()
    return affine, float(np.sqrt(square / redundancy)) if redundancy else None
