"""How a surface as a whole is shifted against the photographs, in height and in plan, with standard errors.

Strategy. A surface that is shifted by s in plan and by z in height differs from the photographs by dh = s . grad - z (Nuth & Kaab
2011): blocks of cells with slopes in all directions tell the shift in plan, all of them that in height. Iterated least squares with
Huber weights, with a tilt as two more unknowns. Errors of neighbouring blocks are alike, so that the standard errors come from the
scatter of groups of blocks and not of single ones.
"""

from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict
from scipy.ndimage import binary_dilation

from orthomill.schemas.job import Table
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.dsm_check.areas import CHECKED, EAST, MEAN, NORTH, SIGMA, fitted_trend

_LEAST_BLOCKS = 60
"""blocks of which a shift in plan can be told"""
_GROUP, _FEWEST_OF_GROUP = 64, 8
"""cells, and blocks at least, along a side of a group whose errors may be alike"""
_LEAST_GROUPS = 8
"""groups of which a scatter can be told beside five unknowns"""
_AWAY = (16, 8, 4, 0)
"""cells around steep blocks that do not count either, as many as leave `_ENOUGH` of the blocks: where a surface is smoothed, as
those of other programs are, the foot of a wall is too high and its top too low, and both slope as the wall does"""
_ENOUGH = 0.1
_WHOLE = 0.95
"""share of a block that must have been judged"""
_STEEPEST, _USUAL = 1.0, 4.0
"""slope beyond which a block holds a wall, and no slope of the ground; times the median slope, whichever is less"""


class SurfaceShift(BaseModel):
    """Surface minus photographs (m): how far it lies too far east and north, and too high; None where that cannot be told."""

    model_config = ConfigDict(frozen=True)

    up: float
    up_sigma: float
    east: float | None = None
    north: float | None = None
    plan_sigma: tuple[float, float] | None = None
    blocks: int = 0
    slope: tuple[float, float] = (0.0, 0.0)
    """mean slope to the east and to the north of the blocks that told it"""
    level_sigma: float | None = None
    """m: standard error of `level`, which no doubt about a shift in plan enlarges"""

    @property
    def level(self) -> float:
        """m: how far it lies too high on average if it stays where it is in plan."""
        return self.up - (self.east or 0.0) * self.slope[0] - (self.north or 0.0) * self.slope[1]

    @property
    def certain(self) -> "SurfaceShift":
        """What is beyond doubt: a shift in height alone unless there is one in plan. Where all of a surface slopes or is bent as a
        whole, one in plan is hardly to be told from one in height."""
        if self.in_plan:
            return self
        return SurfaceShift(up=self.level, up_sigma=self.level_sigma or self.up_sigma, blocks=self.blocks)

    def after(self, before: "SurfaceShift") -> "SurfaceShift":
        """The whole shift of a surface that had been moved back by `before` when this was found; as precise as this."""
        whole = self.model_copy(update={"up": before.up + self.up})
        if before.east is None or before.north is None:
            return whole
        east, north = before.east + (self.east or 0.0), before.north + (self.north or 0.0)
        return whole.model_copy(update={"east": east, "north": north, "plan_sigma": self.plan_sigma or before.plan_sigma})

    def settled(self, before: "SurfaceShift") -> bool:
        """Whether a look that began from `before` found nothing beyond its own standard errors: dh = s . grad - z holds for small
        shifts alone, and each look leaves a part of what it saw."""
        if self.east is None or self.north is None or self.plan_sigma is None:
            return before.blocks > 0
        moved = self.east - (before.east or 0.0), self.north - (before.north or 0.0)
        return before.blocks > 0 and bool(np.hypot(*np.divide(moved, self.plan_sigma)) < _SETTLED)

    @property
    def in_plan(self) -> bool:
        """Whether it is shifted in plan beyond doubt."""
        if self.east is None or self.north is None or self.plan_sigma is None:
            return False
        return bool(np.hypot(self.east / self.plan_sigma[0], self.north / self.plan_sigma[1]) > _CERTAIN)


class SurfaceTrend(BaseModel):
    """A plane of corrections over the whole surface: m in its middle, and per row and column of cells."""

    model_config = ConfigDict(frozen=True)

    middle: float
    by_row: float = 0.0
    by_col: float = 0.0
    centre: tuple[float, float] = (0.0, 0.0)
    """row and column of the middle"""

    def at(self, window: Window) -> np.ndarray:
        """Its value (window.shape) float32 m."""
        row = window.row + np.arange(window.height) - self.centre[0]
        col = window.col + np.arange(window.width) - self.centre[1]
        return (self.middle + self.by_row * row[:, None] + self.by_col * col).astype(np.float32)


TREND = Table("dsm_check/trend.json", SurfaceTrend)
"""what the first pass at full resolution asks for all over a surface from a file: the rest of its shift, and a slight tilt"""
_SOUND_TILT = 0.5
"""orthoimage pixels from corner to corner that a sound orientation may leave: no error of the surface"""


def surface_trend(coarse: np.ndarray, grid: MapGrid, size: int, pixel_height: float) -> SurfaceTrend:
    """The trend of a surface from the blocks (rows, cols, 3) of `size` cells; without a tilt where it is more than a slight one,
    for that is an error of the surface. pixel_height: m, of one orthoimage pixel."""
    trend, _ = fitted_trend(coarse, grid, size)
    centre = (grid.rows - 1) / 2, (grid.cols - 1) / 2
    if trend.range > _SOUND_TILT * pixel_height:
        return SurfaceTrend(middle=trend.middle, centre=centre)
    per_cell = grid.cell / 1000
    return SurfaceTrend(middle=trend.middle, by_row=-trend.north * per_cell, by_col=trend.east * per_cell, centre=centre)


_CERTAIN, _SETTLED = 4.0, 0.5
"""standard errors"""
_LEVEL = 0.02
"""slope that every block may have: of a level ground the median is nothing"""
NO_SHIFT = SurfaceShift(up=0.0, up_sigma=0.0)


def shift_after(look: int) -> Table[SurfaceShift]:
    """The shift of a surface, after it was brought to the tie points, as so many looks know it."""
    return Table(f"dsm_check/shift-{look}.json", SurfaceShift)


def moved_grid(grid: MapGrid, shift: SurfaceShift) -> MapGrid:
    """Where a surface that is shifted in plan has what belongs on `grid`."""
    return grid.model_copy(update={"west": grid.west + (shift.east or 0.0), "north": grid.north + (shift.north or 0.0)})


@dataclass(frozen=True, eq=False)
class _Fit:
    values: np.ndarray
    covariance: np.ndarray


def further_shift(coarse: np.ndarray, side: int, before: SurfaceShift) -> SurfaceShift:
    """The whole shift of a surface that was moved back by `before`, and for which blocks (rows, cols, 5) ask for the rest."""
    return surface_shift(coarse, side).after(before)


def surface_shift(coarse: np.ndarray, side: int) -> SurfaceShift:
    """The shift that the blocks (rows, cols, 5) of a check ask for; side: of a block, in cells of the surface."""
    # Blocks that were judged in part lie at borders, where windows reach ground that is not corrected.
    known, steep = coarse[..., CHECKED] > _WHOLE, np.hypot(coarse[..., EAST], coarse[..., NORTH])
    if not known.any():
        return NO_SHIFT
    # The edge of a roof within a block is a slope of which the windows see nothing. A few such blocks would pull the shift to zero.
    known &= ~_near_walls(known, steep, side)
    dh = coarse[known][:, MEAN].astype(np.float64)
    rows, cols = np.nonzero(known)
    precise = _weights(coarse[known][:, SIGMA].astype(np.float64))
    group = max(_FEWEST_OF_GROUP, _GROUP // side)
    groups = np.unique(rows // group * coarse.shape[1] + cols // group, return_inverse=True)[1].ravel()
    slopes = coarse[known][:, [EAST, NORTH]].astype(np.float64)
    # Of slopes that are all alike a shift in plan is nothing, and its standard error nothing as well: neither is known.
    varied = (np.ptp(slopes, axis=0) > 0.0).all()
    if known.sum() < _LEAST_BLOCKS or groups.max(initial=-1) + 1 < _LEAST_GROUPS or not varied:
        alone = _robust(np.ones((len(dh), 1)), dh, precise, groups)
        return SurfaceShift(up=-float(alone.values[0]), up_sigma=float(np.sqrt(alone.covariance[0, 0])), blocks=len(dh))
    place = np.column_stack([2 * cols / coarse.shape[1] - 1, 1 - 2 * rows / coarse.shape[0]])
    # Centred: the constant is then the shift in the middle of the blocks, and does not depend on the other unknowns.
    others = np.column_stack([slopes, place])
    fit = _robust(np.column_stack([np.ones(len(dh)), others - others.mean(axis=0)]), dh, precise, groups)
    up = -(fit.values[0] - fit.values[1:3] @ slopes.mean(axis=0))
    turn = np.concatenate([[1.0], -slopes.mean(axis=0), [0.0, 0.0]])
    sigma = np.sqrt(np.maximum(np.diag(fit.covariance), 1e-18))
    return SurfaceShift(
        up=float(up),
        up_sigma=float(np.sqrt(turn @ fit.covariance @ turn)),
        east=float(fit.values[1]),
        north=float(fit.values[2]),
        plan_sigma=(float(sigma[1]), float(sigma[2])),
        blocks=len(dh),
        slope=(float(slopes[:, 0].mean()), float(slopes[:, 1].mean())),
        level_sigma=float(sigma[0]),
    )


def _near_walls(known: np.ndarray, steep: np.ndarray, side: int) -> np.ndarray:
    """Blocks (bool) with a wall, and those around them as far as enough of the `known` ones are left."""
    walls = steep >= min(_STEEPEST, max(_USUAL * float(np.median(steep[known])), _LEVEL))
    for away in _AWAY:
        near = binary_dilation(walls, iterations=away // side) if away >= side else walls
        if (known & ~near).sum() >= max(_LEAST_BLOCKS, _ENOUGH * known.sum()):
            break
    return np.asarray(near)


def _weights(sigma: np.ndarray) -> np.ndarray:
    """Weights (N,) of blocks: blocks better than most are no better than they, for orientation and camera err as well."""
    return np.minimum(1.0, (np.median(sigma) / np.maximum(sigma, 1e-9)) ** 2)


def _robust(design: np.ndarray, dh: np.ndarray, precise: np.ndarray, groups: np.ndarray) -> _Fit:
    """Huber's estimate of dh (N,) with weights `precise` over design (N, k), and the covariance from the scatter of groups (N,)."""
    values = np.zeros(design.shape[1])
    values[0] = np.median(dh)
    for _ in range(20):
        size = np.abs(dh - design @ values) * np.sqrt(precise)
        limit = 1.5 * max(1.4826 * float(np.median(size)), 1e-6)
        weight = precise * np.minimum(1.0, limit / np.maximum(size, 1e-12))
        values = np.linalg.lstsq(design * np.sqrt(weight)[:, None], dh * np.sqrt(weight), rcond=None)[0]
    # Huber & Ronchetti 2009, 7.6: only observations within the limit say how the estimate follows them.
    inverse = np.linalg.pinv((design * (precise * (size <= limit))[:, None]).T @ design)
    sums = np.zeros((groups.max() + 1, design.shape[1]))
    np.add.at(sums, groups, design * (weight * (dh - design @ values))[:, None])
    count = len(sums)
    # Few groups underestimate their own scatter.
    return _Fit(values, inverse @ (sums.T @ sums) @ inverse * count / max(count - design.shape[1], 1))
