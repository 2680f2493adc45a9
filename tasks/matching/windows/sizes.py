"""The size of the matching window, chosen point by point from the template image alone.

Strategy: odd squares grow about the point, and the first that the method accepts is the window. Windows of all sizes are measured
at once (measures.py); a method is then one rule on rows of numbers, and so is the search for the limit that gives a window to a
wanted share of the points (calibration.py). Windows that leave the image or touch missing data are never accepted. All methods use
grey levels of 8 bits.

Which to choose: Foerstner's weight is the expected precision of the match and gives the best matches; entropy is closest to an
operator's choice; the statistical rules follow single outlying pixels and are included for comparison.

Source: Skarlatos (sources/matching.md#window-size).
"""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.windows.measures import WindowGrowth, border_rooms, data_rooms, entropy, gradient_weights, statistics
from orthomill.tasks.matching.windows.window_settings import (
    CombinedWindow,
    EntropyWindow,
    FoerstnerWindow,
    SingleWindow,
    StatisticalWindow,
    WindowSizing,
)

_BATCH = 16384
"""points that are measured at a time"""
_SMALL = 6
"""half size up to which all points are measured; larger windows only where none of these was accepted"""


@dataclass(frozen=True)
class GreyLevels:
    """An image of 8-bit grey levels, prepared once for many points."""

    levels: np.ndarray
    """(H, W) int16: 0 to 255, -1 without data"""
    complete: bool
    """no pixel is without data"""


@dataclass(frozen=True)
class WindowSizes:
    """One row per point."""

    half: np.ndarray
    """(N,) uint8: half size of the window, whose side is 2 half + 1; 0 without a window"""
    outcome: np.ndarray
    """(N,) uint8 `Outcome`: NOT_TRIED with a window (matching decides), LOW_TEXTURE, or OUTSIDE where larger windows that might
    have sufficed leave the image or touch missing data"""

    @property
    def assigned(self) -> np.ndarray:
        """(N,) bool"""
        return self.half > 0


def grey_levels(image: np.ndarray, mask: np.ndarray | None = None, limits: tuple[float, float] = (0.0, 255.0)) -> GreyLevels:
    """Grey levels of an image (H, W) of any dtype.

    `limits` become 0 and 255, values beyond them are clipped (16 bits: `grey_range` in imagery/radiometry.py). NaN, infinity and
    False of `mask` (H, W) are no data.
    """
    low, high = limits
    grey = np.asarray(image)
    if grey.dtype == np.uint8 and limits == (0.0, 255.0):
        levels, good = grey.astype(np.int16), np.ones(grey.shape, dtype=bool)
    else:
        good = np.isfinite(grey)
        stretched = (np.where(good, grey, low).astype(np.float32) - np.float32(low)) * np.float32(255.0 / (high - low))
        levels = np.clip(np.rint(stretched), 0, 255).astype(np.int16)
    if mask is not None:
        good = good & np.asarray(mask, dtype=bool)
    # -1 instead of a mask: the kernels read one array, and every measure tests the level that it reads anyway.
    levels[~good] = -1
    return GreyLevels(levels, bool(good.all()))


def window_sizes(image: GreyLevels, points: np.ndarray, sizing: WindowSizing) -> WindowSizes:
    """Windows of points (N, 2) (col, row) px, each centred on the nearest pixel. Never raises on what image or points contain."""
    if isinstance(sizing, CombinedWindow):
        return _larger(window_sizes(image, points, sizing.foerstner), window_sizes(image, points, sizing.entropy))
    pixels = nearest_pixels(points, image.levels.shape)
    half, outcome = np.zeros(len(pixels), np.uint8), np.zeros(len(pixels), np.uint8)
    for start in range(0, len(pixels), _BATCH):
        part = slice(start, start + _BATCH)
        half[part], outcome[part] = _sized(image, pixels[part], sizing)
    return WindowSizes(half, outcome)


def nearest_pixels(points: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """(N, 2) int64 (col, row) nearest to points (N, 2); (-1, -1) outside an image of `shape` and where a point is not finite."""
    points = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    # Halves round up, as in the matching kernels: the window sized is the window matched.
    nearest = np.floor(points + 0.5)
    inside = np.all((nearest >= 0) & (nearest < [shape[1], shape[0]]), axis=1)
    return np.where(inside[:, None], nearest, -1).astype(np.int64)


def growth_of(image: GreyLevels, pixels: np.ndarray, sizing: SingleWindow) -> WindowGrowth:
    """How far the windows of pixels (N, 2) may grow; gradients need one pixel around them."""
    # Central differences at the border of the window reach one pixel beyond it.
    margin = int(isinstance(sizing, FoerstnerWindow))
    last = sizing.halves[-1]
    rooms = border_rooms(image.levels.shape, pixels, last + margin)
    if not image.complete:
        rooms = data_rooms(image.levels, pixels, rooms)
    return WindowGrowth(pixels, np.maximum(rooms - margin, -1), sizing.halves[0], last)


def _sized(image: GreyLevels, pixels: np.ndarray, sizing: SingleWindow) -> tuple[np.ndarray, np.ndarray]:
    growth = growth_of(image, pixels, sizing)
    chosen = _chosen_in_two(image.levels, growth, sizing)
    # Only where all sizes fitted can texture be blamed.
    outcome = np.where(growth.rooms < growth.last, Outcome.OUTSIDE, Outcome.LOW_TEXTURE)
    half = np.where(chosen > 0, growth.first - 1 + chosen, 0)
    return half, np.where(chosen > 0, Outcome.NOT_TRIED, outcome)


def _chosen_in_two(levels: np.ndarray, growth: WindowGrowth, sizing: SingleWindow) -> np.ndarray:
    """As `chosen_size`, but large windows are measured only for points without a small one.

    The statistical rules need all sizes before they choose one.
    """
    if isinstance(sizing, StatisticalWindow) or not growth.first <= _SMALL < growth.last:
        return chosen_size(levels, growth, sizing)
    small = WindowGrowth(growth.pixels, np.minimum(growth.rooms, _SMALL), growth.first, _SMALL)
    chosen = chosen_size(levels, small, sizing)
    others = np.flatnonzero((chosen == 0) & (growth.rooms > _SMALL))
    # The sums start from the centre again: a second pass over few points costs less than full windows for all.
    large = WindowGrowth(growth.pixels[others], growth.rooms[others], growth.first, growth.last)
    chosen[others] = chosen_size(levels, large, sizing)
    return chosen


def chosen_size(levels: np.ndarray, growth: WindowGrowth, sizing: SingleWindow) -> np.ndarray:
    """(N,) column of the measures (see measures.py) whose window is chosen; 0 for none."""
    if isinstance(sizing, StatisticalWindow):
        return statistical_choice(*statistics(levels, growth), sizing)
    if isinstance(sizing, EntropyWindow):
        return entropy_choice(entropy(levels, growth), sizing)
    if isinstance(sizing, FoerstnerWindow):
        return foerstner_choice(*gradient_weights(levels, growth), sizing)
    return (growth.rooms >= growth.last).astype(np.int64)


def crossings(mean: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """(N, sizes) bool: the range reaches the mean here and did not at the size before."""
    crossing = np.zeros(mean.shape, dtype=bool)
    # The published flags of five samples are reproduced by this reading: reached now, not at the size before.
    crossing[:, 1:] = (spread[:, 1:] >= mean[:, 1:]) & (spread[:, :-1] < mean[:, :-1])
    return crossing


def statistical_choice(mean: np.ndarray, deviation: np.ndarray, spread: np.ndarray, sizing: StatisticalWindow) -> np.ndarray:
    """The crossing of range and mean comes first, then the standard deviation, then the excess of the range; (N, sizes) each."""
    chosen = _first(crossings(mean, spread))
    for passes in (deviation > sizing.min_deviation, spread > mean + sizing.min_excess):
        chosen = np.where(chosen > 0, chosen, _first(passes))
    return chosen


def stalled(values: np.ndarray, sizing: EntropyWindow) -> np.ndarray:
    """(N, sizes) bool: the entropy grew by less than the least gain, at a window of some entropy."""
    stalls = np.zeros(values.shape, dtype=bool)
    if sizing.min_gain > 0.0:
        stalls[:, 1:] = (np.diff(values, axis=1) < sizing.min_gain) & (values[:, 1:] > sizing.min_stalled)
    return stalls


def entropy_choice(values: np.ndarray, sizing: EntropyWindow) -> np.ndarray:
    """Enough entropy, or no growth of it to expect. values: (N, sizes) nats."""
    return _first((values > sizing.min_entropy) | stalled(values, sizing))


def foerstner_choice(weight: np.ndarray, roundness: np.ndarray, sizing: FoerstnerWindow) -> np.ndarray:
    """Enough weight and roundness, measures (N, sizes)."""
    return _first((weight > sizing.min_weight) & (roundness > sizing.min_roundness))


def _first(passes: np.ndarray) -> np.ndarray:
    """First column but the leading one that passes; 0 for none. Measures of windows that do not fit are NaN and never pass."""
    allowed = passes[:, 1:]
    return np.where(allowed.any(axis=1), allowed.argmax(axis=1) + 1, 0)


def _larger(one: WindowSizes, other: WindowSizes) -> WindowSizes:
    # The larger window contains the smaller one, and so satisfies both rules.
    both = one.assigned & other.assigned
    return WindowSizes(
        np.where(both, np.maximum(one.half, other.half), 0).astype(np.uint8), np.where(one.assigned, other.outcome, one.outcome)
    )
