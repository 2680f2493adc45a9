"""What a photograph sees of a surface whose heights are not all worth the same: estimates hide less than measurements.

An estimated height may be metres too high. A photograph that it seems to hide a place from is therefore not lost: it is set back
behind those that see the place freely, and serves where none does. A measured surface hides for certain what lies deeper behind it
than the standard errors of both explain, for noise alone puts half of all heights behind others. A place whose height was guessed
may as well lie above whatever seems to hide it.

The depth in a photograph breaks where places beside each other are seen and hidden: on the edge of what hides, and where its shadow
ends.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.geometry.view import FIELD_MARGIN, View, empty_row, frame_row
from orthomill.tasks.visibility.height_model import HeightModel, Targets, centre_of, march_row
from orthomill.tasks.visibility.sight import PlaceSight

_HIDDEN, _SEEN, _BEHIND = (np.uint8(code) for code in (PlaceSight.HIDDEN, PlaceSight.SEEN, PlaceSight.BEHIND_ESTIMATE))
_NEIGHBOURS = np.ones((3, 3), np.uint8)


class _PlaceRows(NamedTuple):
    """`HeightPlaces` for the kernel: places x (C,), y (R,) m and in cells of the whole model; heights, slopes and what these may be
    higher, (R, C)."""

    x: np.ndarray
    y: np.ndarray
    cols: np.ndarray
    rows: np.ndarray
    z: np.ndarray
    slope: np.ndarray
    above: np.ndarray
    tolerance: float


@njit()
def _look(n, widest, centre, surface, certain, places, out):
    """Fills the codes `out` (R, C) without regard to breaks; surface, certain: terrains of all heights and of those that hide for
    certain."""
    line, higher = empty_row(places.x.size), np.empty(places.x.size, np.float32)
    for i in range(places.y.size):
        z, row, slope, codes = places.z[i], places.rows[i], places.slope[i], out[i]
        frame_row(n, places.x, places.y[i], z, widest, line)
        for j in range(places.x.size):
            inside = line.border[j] >= 0.0
            codes[j] = PlaceSight.HIDDEN if inside else PlaceSight.NOWHERE if np.isnan(z[j]) else PlaceSight.OUTSIDE
        march_row(surface, centre, row, places.cols, z, slope, places.tolerance, _HIDDEN, _SEEN, codes)
        # Only what something hides is asked again: a few per cent of the ground.
        for j in range(places.x.size):
            higher[j] = z[j] + places.above[i, j]
            if codes[j] == _HIDDEN and np.isinf(places.above[i, j]):
                codes[j] = _BEHIND
        march_row(certain, centre, row, places.cols, higher, slope, places.tolerance, _HIDDEN, _BEHIND, codes)


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
        out = np.empty(self.targets.z.shape, np.uint8)
        centre = centre_of(self.surface, view)
        _look(view.numbers, FIELD_MARGIN * view.field, centre, self.surface.terrain, self.certain.terrain, self._places, out)
        hidden = (out == PlaceSight.HIDDEN) | (out == PlaceSight.BEHIND_ESTIMATE)
        if hidden.any():
            beside = cv2.dilate(hidden.astype(np.uint8), _NEIGHBOURS) > 0
            out[beside & (out == PlaceSight.SEEN)] = PlaceSight.AT_BREAK
        return out

    @cached_property
    def _places(self) -> _PlaceRows:
        grid, targets = self.surface.grid, self.targets
        cols, rows = np.asarray(targets.cols, np.float64), np.asarray(targets.rows, np.float64)
        x, y = grid.west + (cols + 0.5) * grid.cell, grid.north - (rows + 0.5) * grid.cell
        z, slope, above = (np.ascontiguousarray(values, np.float32) for values in (targets.z, targets.slope, self.above))
        return _PlaceRows(x=x, y=y, cols=cols, rows=rows, z=z, slope=slope, above=above, tolerance=float(self.tolerance))
