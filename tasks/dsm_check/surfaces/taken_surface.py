"""The surface from a file as it is checked: brought to the heights of the photographs, and its holes filled where that was asked
for.

Checked in the height system of the photographs, it is given back in its own: only differences are of interest here, and a shift of
forty metres would hide all others.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.schemas.maps.wanted_area import WantedArea
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import MEASURED, Provenance
from orthomill.tasks.dsm_check.tile import take_surface


@dataclass(frozen=True)
class InsideArea:
    """The cells of a window that lie in the area that is asked for."""

    wanted: WantedArea
    grid: MapGrid
    window: Window

    def cut(self, heights: np.ndarray) -> np.ndarray:
        """Heights (window.shape) float32 m, NaN outside."""
        return np.where(self.wanted.cells(self.grid, self.window), heights, np.float32(np.nan)).astype(np.float32)


class TakenSurface(NamedTuple):
    """Heights (rows, cols) float32 m, NaN without any; uint8 1 where the photographs filled a hole."""

    input: np.ndarray
    filled: np.ndarray


def raised(heights: np.ndarray, up: float, inside: InsideArea) -> np.ndarray:
    """Heights of a file (rows, cols) float32 m, raised by `up`; NaN where it has none, and outside of the area."""
    return inside.cut(take_surface(heights + np.float32(up)))


def take_file(
    heights: np.ndarray, up: float, inside: InsideArea, matched: np.ndarray | None = None, provenance: np.ndarray | None = None
) -> TakenSurface:
    """Heights (rows, cols) m of a file, raised by `up`; its holes take `matched` heights of the project that were measured."""
    own = raised(heights, up, inside)
    if matched is None or provenance is None:
        return TakenSurface(own, np.zeros(own.shape, np.uint8))
    filled = np.isnan(own) & np.isfinite(matched) & np.isin(provenance, MEASURED)
    return TakenSurface(np.where(filled, matched, own).astype(np.float32), filled.astype(np.uint8))


class PaintedSurface(NamedTuple):
    """Heights and standard errors (rows, cols) float32 m, NaN where there are none, and uint8 codes of `Provenance`."""

    height: np.ndarray
    precision: np.ndarray
    code: np.ndarray


def painted_surface(corrected: np.ndarray, back: float, sigma: float) -> PaintedSurface:
    """The corrected surface (rows, cols) m without what was added to give it `back`; `sigma` m: of its heights.

    What somebody else has measured counts as measured: the check tells where it is wrong.
    """
    known = np.isfinite(corrected)
    code = np.where(known, np.uint8(Provenance.AGREED), np.uint8(Provenance.EMPTY))
    precision = np.where(known, np.float32(sigma), np.float32(np.nan))
    return PaintedSurface((corrected - np.float32(back)).astype(np.float32), precision, code)
