"""What a photograph sees of a surface whose heights are not all worth the same: estimates hide less than measurements.

An estimated height may be metres too high. A photograph that it seems to hide a place from is therefore not lost: it is set back
behind those that see the place freely, and serves where none does. A measured surface hides for certain what lies deeper behind it
than the standard errors of both explain, for noise alone puts half of all heights behind others. A place whose height was guessed
may as well lie above whatever seems to hide it.

The depth in a photograph breaks where places beside each other are seen and hidden: on the edge of what hides, and where its shadow
ends.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numba import njit

from orthomill.tasks.geometry.view import View, in_frame
from orthomill.tasks.visibility.height_model import HeightModel, Targets, visible_targets
from orthomill.tasks.visibility.sight import PlaceSight

_NEIGHBOURS = np.ones((3, 3), np.uint8)


@njit(cache=True)
def _fill_codes(known, inside, free, passing, out):
    """Codes of places (rows, cols) without regard to breaks; all bool: with a height, in the frame, free, and free but for
    what may not be there."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            if not inside[i, j]:
                out[i, j] = PlaceSight.OUTSIDE if known[i, j] else PlaceSight.NOWHERE
            elif free[i, j]:
                out[i, j] = PlaceSight.SEEN
            else:
                out[i, j] = PlaceSight.BEHIND_ESTIMATE if passing[i, j] else PlaceSight.HIDDEN


@dataclass(frozen=True, eq=False)
class HeightPlaces:
    """Places on a height model, as a grid.

    `surface`: all heights; `certain`: the same model as low as its measured heights may well be, NaN where they are not measured;
    `targets` (R, C); `above` (R, C) m: how much higher these may well be, infinite where the height is neither measured nor
    estimated; `tolerance` (m) as in `visible_targets`. A place is beside a break if one of its eight neighbours in the grid is
    hidden: the grid should be about as dense as the pixels of the photographs.
    """

    surface: HeightModel
    certain: HeightModel
    targets: Targets
    above: np.ndarray
    tolerance: float

    def sights(self, view: View) -> np.ndarray:
        """uint8 (R, C) codes of PlaceSight."""
        inside, z = self._framed(view), self.targets.z
        shown = replace(self.targets, z=np.where(inside, z, np.float32(np.nan)))
        free = visible_targets(self.surface, view, shown, self.tolerance) > 0
        # Only what something hides is asked again: a few per cent of the ground.
        behind = replace(shown, z=np.where(free, np.float32(np.nan), shown.z + self.above))
        passing = visible_targets(self.certain, view, behind, self.tolerance) > 0
        out = np.empty(z.shape, np.uint8)
        _fill_codes(np.isfinite(z), inside, free, passing | np.isinf(self.above), out)
        hidden = (out == PlaceSight.HIDDEN) | (out == PlaceSight.BEHIND_ESTIMATE)
        if hidden.any():
            out[free & (cv2.dilate(hidden.astype(np.uint8), _NEIGHBOURS) > 0)] = PlaceSight.AT_BREAK
        return out

    def _framed(self, view: View) -> np.ndarray:
        """bool (R, C): places in the frame of a view."""
        grid = self.surface.grid
        x, y = grid.west + (self.targets.cols + 0.5) * grid.cell, grid.north - (self.targets.rows + 0.5) * grid.cell
        return in_frame(view, x, y, self.targets.z)
