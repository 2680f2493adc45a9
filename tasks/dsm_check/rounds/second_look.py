"""The surface under test and the second one, cell by cell: which of them do the photographs fit?

Strategy. Both were checked alike, so that both tell the height of a cell, each with its standard error. Where the heights agree,
nothing is to be decided, and the surface under test is answered. Where they contradict each other, or only the second one could be
judged, the photographs decide: the orthoimages of which surface correlate better around the cell. Walls and roofs speak for the
surface under test, for the second one is smooth; an error that is narrower than the window, or too steep for it, speaks against it,
although the window as a whole may still agree. The surface under test has the benefit of the doubt: against a height that it
confirmed, the difference of the correlations must exceed two of its standard errors, or the first look must have seen a part of the
error itself; both are weighed together. Where it failed, any better fit will do; where it hides a place from a photograph (the
bottom of a pit that is an error, or truly the foot of a wall), the fit must be better than that of an accepted match.

Source: difference of correlations by Fisher's transformation (Fisher 1921).
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import binary_opening

from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import Window
from orthomill.tasks.dsm_check.correction_map import CorrectionMap, CorrectionNodes
from orthomill.tasks.dsm_check.nodes import CORRELATION, OUTCOME
from orthomill.tasks.dsm_check.tile import JointNodes, NodeWindow

_CONTRADICTS = 4.0
"""standard errors of the difference of two heights"""
_CLEARLY = 2.0
"""standard errors by which the second surface must correlate better"""
_UNTRIED = (Outcome.NOT_TRIED, Outcome.OUTSIDE)
_WITNESSES = 2
"""pairs that must have matched a place of the second surface, if as many show it"""
_MATCHES = 0.7
"""correlation of windows that are accepted as a match"""
_IN_PLAN = 0.25
"""cells"""
_HIGHEST = 0.999
"""correlation beyond which noise decides which is higher"""


class Look(NamedTuple):
    """One surface as it was checked: heights (rows, cols) m, what all pairs say of them, and the nodes of every pair."""

    heights: np.ndarray
    says: JointNodes
    nodes: tuple[np.ndarray, ...]


class BothLooks(NamedTuple):
    """What two looks together say of the surface under test: corrections, and cells (bool) that are disputed, and where the looks
    contradict each other and neither is clearly the better one."""

    found: CorrectionMap
    disputed: np.ndarray
    undecided: np.ndarray


def better_of(
    given: Look, second: Look, wide: Window, pairs: tuple[NodeWindow, ...], grid: CorrectionNodes, sure: float
) -> BothLooks:
    """What both looks together say of the surface under test in the cells `wide`; right from the third row and column on, or from
    the border of the surface. sure: standard errors by which a correction is significant."""
    mine, other = given.says.found, second.says.found
    # What the second look says of the same height, against the surface under test: that is known to a quarter of a cell in plan.
    dh = (other.dh + (second.heights - given.heights)).astype(np.float32)
    sigma = np.hypot(other.sigma, _IN_PLAN * _steps(given.heights)).astype(np.float32)
    gain = _gain(given.nodes, second.nodes, wide, pairs, grid) / _CLEARLY
    with np.errstate(invalid="ignore"):
        contradicts = np.abs(dh - mine.dh) > _CONTRADICTS * np.hypot(mine.sigma, other.sigma)
        # Of an error that is narrower than its window the first look sees a part.
        part = (np.sign(dh) == np.sign(mine.dh)) & (np.abs(dh) > np.abs(mine.dh))
        against = np.hypot(np.maximum(gain, 0.0), np.where(part, mine.dh / (sure * mine.sigma), 0.0))
        known = np.isfinite(dh) & _seen_well(second.says.clean, wide, pairs, grid)
        instead = known & np.where(np.isnan(mine.dh), gain > 0.0, contradicts & (against > 1.0))
    # Beside walls both windows see roof and ground: of single cells nothing can be told.
    instead = binary_opening(instead, np.ones((3, 3)))
    found = CorrectionMap(np.where(instead, dh, mine.dh), np.where(instead, sigma, mine.sigma))
    return BothLooks(found, np.where(instead, second.says.disputed, given.says.disputed), known & contradicts & ~instead)


def _seen_well(nodes: tuple[np.ndarray, ...], wide: Window, pairs: tuple[NodeWindow, ...], grid: CorrectionNodes) -> np.ndarray:
    """(wide.shape) bool: cells whose own node was matched in two pairs, or in the only one that shows it."""
    # Behind a wall no window is matched, and what the nodes beyond it say would be extended to its foot.
    matched, shown = np.zeros(wide.shape, np.uint8), np.zeros(wide.shape, np.uint8)
    for pair, one in zip(pairs, nodes, strict=True):
        outcome, cells = np.nan_to_num(one[..., OUTCOME]), pair.given.scaled(grid.step)
        both = cells.overlap(wide)
        for total, counts in ((matched, outcome == Outcome.CONVERGED), (shown, ~np.isin(outcome, _UNTRIED))):
            total[both.within(wide).slices] += np.repeat(np.repeat(counts, grid.step, 0), grid.step, 1)[both.within(cells).slices]
    return np.asarray((matched > 0) & (matched >= np.minimum(shown, _WITNESSES)))


def _steps(heights: np.ndarray) -> np.ndarray:
    """(rows, cols) m: the greatest step from a cell to one of its four neighbours; 0 where none is known."""
    padded = np.pad(heights.astype(np.float64), 1, mode="edge")
    centre = padded[1:-1, 1:-1]
    sides = padded[1:-1, 2:], padded[1:-1, :-2], padded[2:, 1:-1], padded[:-2, 1:-1]
    return np.fmax.reduce([np.zeros_like(centre), *(np.abs(side - centre) for side in sides)])


def _gain(
    given: tuple[np.ndarray, ...],
    second: tuple[np.ndarray, ...],
    wide: Window,
    pairs: tuple[NodeWindow, ...],
    grid: CorrectionNodes,
) -> np.ndarray:
    """(wide.shape): by how many standard errors the second surface correlates better, the mean of all pairs; NaN where none tried
    both."""
    total, number = np.zeros(wide.shape), np.zeros(wide.shape)
    # Resampling by the orthoimages and the smoothing of the matching leave about a quarter of the pixels independent.
    pixels = (grid.window * grid.pixels_per_cell) ** 2 / 4
    for pair, one, other in zip(pairs, given, second, strict=True):
        better = (_fit(other, np.nan) - _fit(one, _MATCHES)) * np.sqrt(max(pixels - 3, 1) / 2)
        cells = pair.given.scaled(grid.step)
        both = cells.overlap(wide)
        values = np.repeat(np.repeat(better, grid.step, 0), grid.step, 1)[both.within(cells).slices]
        known, inside = np.isfinite(values), both.within(wide).slices
        total[inside] += np.where(known, values, 0.0)
        number[inside] += known
    return np.where(number > 0, total / np.maximum(number, 1), np.nan)


def _fit(nodes: np.ndarray, hidden: float) -> np.ndarray:
    """Fisher's transform (rows, cols) of the correlation at nodes, 0 where they do not correlate, that of `hidden` where the
    surface hides them; NaN where they were not tried."""
    outcome = np.nan_to_num(nodes[..., OUTCOME])
    correlation = np.clip(np.nan_to_num(nodes[..., CORRELATION]), 0.0, _HIGHEST)
    correlation = np.where(outcome == Outcome.OCCLUDED, hidden, correlation)
    return np.where(np.isin(outcome, _UNTRIED), np.nan, np.arctanh(correlation))
