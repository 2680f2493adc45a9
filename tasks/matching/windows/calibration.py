"""The limit of a window sizing at which a wanted share of the points gets a window.

Strategy: the *last limit* of a point is the highest at which one of its windows would still be accepted; it is infinite where
another rule of the method accepts a window anyway, and -infinity where no limit does. A limit gives windows to the points whose
last limit is above it, so the limit sought is a quantile. Limits depend on texture and contrast, so that a share is often easier to
state than a limit (sources/measured.md#calibrated-limits).
"""

import math
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.errors import WorkflowError
from orthomill.tasks.matching.windows.measures import entropy, gradient_weights, statistics
from orthomill.tasks.matching.windows.sizes import GreyLevels, crossings, growth_of, nearest_pixels, stalled
from orthomill.tasks.matching.windows.window_settings import (
    CombinedWindow,
    EntropyWindow,
    FixedWindow,
    FoerstnerWindow,
    LimitedWindow,
    StatisticalWindow,
    WindowSizing,
)

LIMITS = {StatisticalWindow: "min_deviation", EntropyWindow: "min_entropy", FoerstnerWindow: "min_weight"}
"""The limit of each method that is calibrated."""
_BATCH = 16384


@dataclass(frozen=True)
class LimitCalibration:
    """A sizing with its limits set, and the share of the points that gets a window from it.

    The share is smaller than wanted where the points lack texture even for a limit of zero, and larger where other rules of the
    method accept more windows.
    """

    sizing: WindowSizing
    share: float


def last_limits(image: GreyLevels, points: np.ndarray, sizing: WindowSizing) -> np.ndarray:
    """(N, limits) last limit of points (N, 2) (col, row) px: one column, two for a combined window (its Foerstner first).

    Raises WorkflowError for a fixed window, which has no limit.
    """
    sizing = _with_limit(sizing)
    if isinstance(sizing, CombinedWindow):
        return np.hstack([last_limits(image, points, sizing.foerstner), last_limits(image, points, sizing.entropy)])
    pixels = nearest_pixels(points, image.levels.shape)
    batches = [_last(image, pixels[start : start + _BATCH], sizing) for start in range(0, len(pixels), _BATCH)]
    return np.concatenate(batches)[:, None] if batches else np.empty((0, 1))


def _with_limit(sizing: WindowSizing) -> LimitedWindow | CombinedWindow:
    if isinstance(sizing, FixedWindow):
        raise WorkflowError("A fixed window has no limit to calibrate; choose another method.")
    return sizing


def _last(image: GreyLevels, pixels: np.ndarray, sizing: LimitedWindow) -> np.ndarray:
    growth = growth_of(image, pixels, sizing)
    if isinstance(sizing, FoerstnerWindow):
        weight, roundness = gradient_weights(image.levels, growth)
        return _highest(np.where(roundness > sizing.min_roundness, weight, -np.inf))
    if isinstance(sizing, EntropyWindow):
        values = entropy(image.levels, growth)
        return _highest(np.where(stalled(values, sizing), np.inf, values))
    mean, deviation, spread = statistics(image.levels, growth)
    anyway = crossings(mean, spread) | (spread > mean + sizing.min_excess)
    return _highest(np.where(anyway, np.inf, deviation))


def _highest(values: np.ndarray) -> np.ndarray:
    """(N,) highest of the sizes that may be chosen, NaN ignored."""
    # The first column is the size before the smallest, which no rule may choose.
    return np.fmax.reduce(values[:, 1:], axis=1, initial=-np.inf)


def calibrated(sizing: WindowSizing, last: np.ndarray, share: float) -> LimitCalibration:
    """The sizing whose limits give a window to `share` (0 to 1) of the points with these `last_limits` (N, limits)."""
    sizing = _with_limit(sizing)
    if not 0.0 < share <= 1.0:
        raise WorkflowError(f"{100 * share:g} per cent of the points cannot be given a window; say more than 0 and at most 100.")
    if not len(last):
        raise WorkflowError("There are no points to calibrate the limit of the window on.")
    # At least the share asked for: rounding down could leave a single point without its window.
    wanted = min(math.ceil(share * len(last)), len(last))
    limits = _limits(last, wanted)
    if isinstance(sizing, CombinedWindow):
        parts: tuple[LimitedWindow, ...] = _limited(sizing.foerstner, limits[0]), _limited(sizing.entropy, limits[1])
        sizing = sizing.model_copy(update={"foerstner": parts[0], "entropy": parts[1]})
    else:
        sizing = _limited(sizing, limits[0])
        parts = (sizing,)
    return LimitCalibration(sizing, float((last > [_limit(part) for part in parts]).all(axis=1).mean()))


def _limits(last: np.ndarray, wanted: int) -> np.ndarray:
    """Limits that `wanted` of the points exceed. With two limits, points go in the order of their worse rank in both."""
    # Stable: the choice among equal limits must not depend on the sorting algorithm.
    order = np.argsort(-last, axis=0, kind="stable")
    rank = np.empty_like(order)
    np.put_along_axis(rank, order, np.arange(len(last))[:, None], axis=0)
    worst = np.sort(rank.max(axis=1))[wanted - 1]
    # Windows are accepted above the limit, not at it: the next smaller number keeps the last wanted point.
    return np.nextafter(last[order[worst], np.arange(last.shape[1])], -np.inf)


def _limit(sizing: LimitedWindow) -> float:
    return float(getattr(sizing, LIMITS[type(sizing)]))


def _limited(sizing: LimitedWindow, limit: float) -> LimitedWindow:
    """The sizing with its limit set, kept within what the method can measure."""
    highest = {EntropyWindow: 6.0, StatisticalWindow: 255.0}.get(type(sizing), 1e12)
    return sizing.model_copy(update={LIMITS[type(sizing)]: float(min(max(limit, 0.0), highest))})
