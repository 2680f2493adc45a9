"""Windows of which a share of the points is to get one: the limit of the sizing is found in the left image of each pair.

Strategy. Limits depend on texture and contrast, so that a share is easier to state than a limit (sources/matching.md). The left
image is read in strips; points of a regular grid tell the highest limit at which each would still have a window. One table for a
pair: its blocks share the limits, however they are cut.

Source: Skarlatos (sources/matching.md#size-map).
"""

from collections.abc import Iterator

import numpy as np
from pydantic import BaseModel, ConfigDict
from scipy.ndimage import minimum_filter

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.job import Table
from orthomill.schemas.raster import Window
from orthomill.tasks.densification.settings.pair_strategy_settings import PairStrategy
from orthomill.tasks.matching.least_squares.matching import prepare
from orthomill.tasks.matching.windows.calibration import LIMITS, calibrated, last_limits
from orthomill.tasks.matching.windows.sizes import grey_levels
from orthomill.tasks.matching.windows.window_settings import ChosenWindow, CombinedWindow

_STRIP = 2_000_000
"""pixels of a strip"""
_SAMPLES = 200
"""points of the grid along the shorter side of an image: they fix a share to a fraction of a per cent"""
_SMOOTHED = 8
"""px around a window that smoothing reads"""


class AssignedWindow(BaseModel):
    """The window of a step of a strategy with its limit set, and the share of the points that gets one, %."""

    model_config = ConfigDict(frozen=True)

    step: str
    window: ChosenWindow
    share: float


class AssignedWindows(BaseModel):
    """The windows of a pair."""

    model_config = ConfigDict(frozen=True)

    windows: tuple[AssignedWindow, ...]

    def of(self, strategy: PairStrategy) -> PairStrategy:
        """The strategy with these windows."""
        return strategy.with_matchings(
            {found.step: strategy.matchings[found.step].model_copy(update={"window": found.window}) for found in self.windows}
        )


def limits_in_words(window: ChosenWindow) -> str:
    """The limits that a share of the points can find."""
    if isinstance(window, CombinedWindow):
        return f"{limits_in_words(window.foerstner)}, {limits_in_words(window.entropy)}"
    limit = LIMITS[type(window)]
    return f"{limit} {getattr(window, limit):.4g}"


def windows_table(pair: str) -> Table[AssignedWindows]:
    """The windows that were assigned to the points of a pair."""
    return Table(f"densification/windows/{pair}.json", AssignedWindows)


def strips_of(pair: EpipolarPair, strategy: PairStrategy) -> tuple[Window, ...]:
    """The parts of the left image that are read, each with the halo of the largest window."""
    height = max(2 * _halo(strategy), _STRIP // pair.left_cols)
    whole = Window(0, 0, pair.rows, pair.left_cols)
    cores = (Window(row, 0, min(height, pair.rows - row), pair.left_cols) for row in range(0, pair.rows, height))
    return tuple(core.grown(_halo(strategy)).clipped((whole.height, whole.width)) for core in cores)


def assigned_windows(pair: EpipolarPair, strategy: PairStrategy, left: Iterator[np.ndarray]) -> AssignedWindows:
    """The windows of the steps of a strategy that choose theirs; left: `strips_of` its image, uint8, 0 without data.

    Raises GeometryError for an image that has no room for the largest window.
    """
    sized = strategy.sized
    last: dict[str, list[np.ndarray]] = {step: [] for step in sized}
    spacing, halo = max(1, min(pair.rows, pair.left_cols) // _SAMPLES), _halo(strategy)
    for window, pixels in zip(strips_of(pair, strategy), left, strict=True):
        top, bottom = window.row + halo * (window.row > 0), window.row + window.height - halo
        rows = np.arange(-(-max(top, halo) // spacing) * spacing, max(bottom, 0), spacing) - window.row
        cols = np.arange(halo, pair.left_cols - halo, spacing)
        points = np.column_stack([np.tile(cols, len(rows)), np.repeat(rows, len(cols))]).astype(np.float64)
        for step, matching in sized.items():
            # Where the largest window leaves the image or its data, no limit could give a point its window.
            room = minimum_filter(pixels > 0, 2 * matching.half + 1, mode="constant")
            own = points[room[points[:, 1].astype(int), points[:, 0].astype(int)]] if len(points) else points
            image = grey_levels(prepare(pixels, matching).grey)
            last[step].append(last_limits(image, own, matching.window))  # type: ignore[arg-type]
    found = {step: np.concatenate(parts) for step, parts in last.items()}
    if not all(len(limits) for limits in found.values()):
        raise GeometryError(
            f"The left image of the pair {pair.name} holds no window of the largest size; choose a smaller one (largest)."
        )
    assert strategy.assigned is not None, "nobody asks otherwise"
    windows = []
    for step, matching in sized.items():
        limited = calibrated(matching.window, found[step], strategy.assigned / 100)  # type: ignore[arg-type]
        windows.append(AssignedWindow(step=step, window=limited.sizing, share=round(100 * limited.share, 2)))
    return AssignedWindows(windows=tuple(windows))


def _halo(strategy: PairStrategy) -> int:
    return max(matching.half for matching in strategy.sized.values()) + _SMOOTHED
