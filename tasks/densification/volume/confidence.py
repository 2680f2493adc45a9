"""Which heights of the finest level count as measured, and calmer ones where they stand alone far and wide.

Strategy. A height counts as measured where those around go along with it, it beats its rivals as clearly as is usual here, none of
them lies far away, and two photographs or more see all of its surroundings. Where only the rivals are too far away (grass, in which
the next heights fit nearly as well), a pair that matched there decides among them. The others are estimates. In a wood or on
water, where every leaf and wave has a height of its own that no neighbour shares, estimates are calmed: medians of squares, medians
of those, interpolated; a rough guess would hide ground from photographs that no other rough guess reveals. How far they depart from
the terrain of the tie points is believed as far as their scatter supports it, and upwards only: crowns stand out from it.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar, NamedTuple

import numpy as np
from scipy import ndimage

from orthomill.schemas.raster import Window
from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.densification.volume.quality import SPREAD_UNIT, SURROUNDINGS, Band, Judgement, box_sums, judgement
from orthomill.tasks.densification.volume.terrain import at_cells, places_around
from orthomill.tasks.imagery.resampling import between
from orthomill.tasks.matching.volume.winners import COHERENCE_HALF


class ConfidenceLimits(Settings):
    """When a height of the volume counts as measured."""

    renamed: ClassVar = {"standing": "distinctiveness", "spread": "rival_spread"}  # 0.2
    coherence: float = setting(0.7, "Share of the cells around that must go along with it.", ge=0.0, le=1.0)
    distinctiveness: float = setting(
        0.7, "How clearly it beats its rivals, as a share of what is usual in its surroundings, at least.", ge=0.0, le=2.5
    )
    rival_spread: float = setting(
        1.6, "How far from it heights may lie, on average, that fit nearly as well.", "heights", ge=0.0, le=15.0
    )

    def coherent(self, judged: np.ndarray) -> np.ndarray:
        """(rows, cols) bool from a judgement (rows, cols, 4): the surroundings go along, and its rivals are beaten."""
        return (judged[..., Judgement.COHERENCE] >= 100 * self.coherence) & (
            judged[..., Judgement.DISTINCTIVENESS] >= 100 * self.distinctiveness
        )

    def sharp(self, judged: np.ndarray) -> np.ndarray:
        """(rows, cols) bool from a judgement (rows, cols, 4): its rivals are near."""
        return judged[..., Judgement.SPREAD] <= SPREAD_UNIT * self.rival_spread


class Confidence(IntEnum):
    """Whether a height of the volume counts as measured; uint8."""

    HIGH = 0
    LOW = 1
    CALMED = 2
    BLURRED = 3
    """high but for rivals that fit nearly as well: measured where a pair decides among them"""


class JudgedVolume(NamedTuple):
    """A tile: `height` (rows, cols) float32 m, `judgement` (rows, cols, 4) uint8 and `confidence`, uint8 codes of
    Confidence."""

    height: np.ndarray
    judgement: np.ndarray
    confidence: np.ndarray


SQUARE = 8
"""cells along the side of the squares whose medians make a calmed surface"""
_PATCH = 2
"""squares on every side whose medians count"""
_SUPPORT = 4.0
"""standard errors of a median by which it must depart from the terrain to be believed in part"""
_OF_MEDIAN = 1.4826 * 1.2533
"""standard error of the median of one normal value, from the median of absolute deviations"""
_FAR = 18
"""cells on every side whose mean coherence says whether a height stands alone far and wide"""
_COMPANY = 50
"""%, the mean coherence below which it does"""


@dataclass(frozen=True)
class JudgedTile:
    """A tile of the finest level, the cells around it that influence it, in whole squares, and the places of the terrain around."""

    window: Window
    around: Window
    places: Window

    @classmethod
    def of(cls, window: Window, shape: tuple[int, int], terrain_shape: tuple[int, int]) -> "JudgedTile":
        """shape: of the finest level; terrain_shape: of the raster of the terrain."""
        squares = window.reduced(SQUARE).grown(max(_PATCH + 1, SURROUNDINGS // SQUARE + 1))
        around = squares.scaled(SQUARE).clipped(shape)
        return cls(window, around, places_around(around, 1, terrain_shape))


def judged(
    tile: JudgedTile, settings: ConfidenceLimits, height: np.ndarray, quality: np.ndarray, terrain: np.ndarray
) -> JudgedVolume:
    """height (rows, cols) m, NaN for none, and quality (rows, cols, 5) of the cells `tile.around`; terrain (rows, cols) m of
    `tile.places`."""
    inner = tile.window.within(tile.around).slices
    known, judgements = np.isfinite(height), judgement(quality)
    enclosed = _enclosed(known)
    coherent, sharp = settings.coherent(judgements) & enclosed, settings.sharp(judgements)
    alone = known & ~(coherent & sharp) & _alone(quality, known)
    confidence = np.select(
        [coherent & sharp, alone, coherent],
        [np.uint8(Confidence.HIGH), np.uint8(Confidence.CALMED), np.uint8(Confidence.BLURRED)],
        np.uint8(Confidence.LOW),
    )
    calmer = _bordered(height, enclosed)
    # Most tiles of open ground have nothing to calm, and medians cost more than all the rest.
    if alone[inner].any():
        calmer = np.where(alone, _calm(height, at_cells(terrain, tile.places, tile.around, 1)), calmer)
    return JudgedVolume(calmer[inner], judgements[inner], confidence[inner])


def _enclosed(known: np.ndarray) -> np.ndarray:
    """(rows, cols) bool: cells all around which, as far as coherence looks, two photographs or more see."""
    return box_sums(known, COHERENCE_HALF) == (2 * COHERENCE_HALF + 1) ** 2


def _bordered(height: np.ndarray, enclosed: np.ndarray) -> np.ndarray:
    """The heights (rows, cols); along the border, on both sides, those of the nearest cell that is enclosed, where one is near."""
    # Inside the border, left alone, they run to the ends of their ranges and hide ground from photographs as if they were walls;
    # beyond it, the terrain that drew it is known to a few cells only.
    if not enclosed.any():
        return height
    distance, nearest = ndimage.distance_transform_edt(~enclosed, return_indices=True)
    return np.where(~enclosed & (distance <= 2 * COHERENCE_HALF), height[tuple(nearest)], height)


def _alone(quality: np.ndarray, known: np.ndarray) -> np.ndarray:
    """(rows, cols) bool: where the mean coherence of the surroundings is too low."""
    total = box_sums(np.where(known, quality[..., Band.COHERENCE], 0), _FAR)
    return total < _COMPANY * box_sums(known, _FAR)


def _calm(height: np.ndarray, terrain: np.ndarray) -> np.ndarray:
    """The heights (rows, cols) without what is narrower than a patch of squares; the first cell begins a square."""
    patches = _patches(_of_squares(height))
    middle = _median(patches)
    scatter = _median(np.abs(patches - middle[..., None])) * np.float32(_OF_MEDIAN / (2 * _PATCH + 1))
    places = [np.clip((np.arange(size) + 0.5) / SQUARE - 0.5, 0, -(-size // SQUARE) - 1) for size in height.shape]
    # Crowns rise above the tie points; what lies below them all around is chance, however much it agrees with itself.
    departure, doubtful = np.maximum(between(middle, *places) - terrain, 0), _SUPPORT * between(scatter, *places)
    believed = 1 - np.minimum(doubtful / np.maximum(departure, np.float32(1e-6)), 1) ** 2
    return np.where(np.isfinite(height), terrain + believed * departure, np.nan).astype(np.float32)


def _of_squares(height: np.ndarray) -> np.ndarray:
    """Median height of every square; the last ones may be smaller."""
    rows, cols = (-(-size // SQUARE) for size in height.shape)
    spare = [(0, n * SQUARE - size) for n, size in zip((rows, cols), height.shape, strict=True)]
    whole = np.pad(height, spare, constant_values=np.nan)
    return _median(whole.reshape(rows, SQUARE, cols, SQUARE).swapaxes(1, 2).reshape(rows, cols, -1))


def _patches(squares: np.ndarray) -> np.ndarray:
    """The squares around each (rows, cols, squares)."""
    side = 2 * _PATCH + 1
    spare = np.pad(squares, _PATCH, constant_values=np.nan)
    return np.lib.stride_tricks.sliding_window_view(spare, (side, side)).reshape(*squares.shape, -1)


def _median(values: np.ndarray) -> np.ndarray:
    """Medians of the last axis without NaN; the lower one of two, NaN without any."""
    ordered, count = np.sort(values, axis=-1), np.isfinite(values).sum(axis=-1)
    return np.take_along_axis(ordered, np.maximum(count - 1, 0)[..., None] // 2, axis=-1)[..., 0]
