"""Which heights of the finest level count as measured, and those of coarser levels where they stand alone far and wide.

Strategy. A height counts as measured where those around go along with it, it beats its rivals as clearly as is usual here, none of
them lies far away, and two photographs or more see all of its surroundings. Where only its rivals are too far away (grass, in which
the next heights fit nearly as well) a pair that matched there decides. So it does where they are beaten less clearly than is usual,
or not all of the surroundings are seen twice, but on even ground only: beside a wall both may prefer the surface next door. The
others are estimates. In a wood or on water, where every leaf and wave has a height of its own that no neighbour shares, the surface
is the one that depth maps of single pairs agree on (canopy_heights.py), elsewhere that of the finest level on which the place is
coherent (coherent_levels.py).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from orthomill.schemas.raster import Window, enclosing, windows_in
from orthomill.tasks.densification.canopy.canopy_heights import CanopyTile, canopy_heights
from orthomill.tasks.densification.canopy.depth_map import LEVEL as DEPTH_LEVEL
from orthomill.tasks.densification.settings.guide_settings import ConfidenceLimits
from orthomill.tasks.densification.volume.coherent_levels import LevelWindows, shown_heights
from orthomill.tasks.densification.volume.evened_heights import evened
from orthomill.tasks.densification.volume.quality import (
    LEVEL_UNIT,
    SPREAD_UNIT,
    STRETCH_UNIT,
    SURROUNDINGS,
    Band,
    Judgement,
    box_sums,
    coheres_less,
    judgement,
)
from orthomill.tasks.densification.volume.terrain import at_cells, places_around
from orthomill.tasks.matching.volume.winners import COHERENCE_HALF


class Confidence(IntEnum):
    """Whether a height of the volume counts as measured; uint8."""

    HIGH = 0
    LOW = 1
    CALMED = 2
    BLURRED = 3
    """high but for rivals that are farther away: measured where a pair decides among them"""
    COARSE = 4
    """calmed, and shown by a coarser level"""
    FAINT = 5
    """coherent, but its rivals fit nearly as well, or something around is not seen twice: measured where a pair matched on even
    ground"""


class JudgedVolume(NamedTuple):
    """A tile: `height` (rows, cols) float32 m, `judgement` (rows, cols, 5) uint8 and `confidence`, uint8 codes of
    Confidence."""

    height: np.ndarray
    judgement: np.ndarray
    confidence: np.ndarray


_COMPANY = 50
"""%, the mean coherence below which it does"""
_SPARSE = 70
"""%, the mean coherence below which depth maps of single pairs are asked: in a known wood 95 % of the crowns, 6 % of the rest"""


@dataclass(frozen=True)
class JudgedTile:
    """A tile of the finest level, the cells around it that influence it, the windows of all levels that do, and the places of the
    terrain around the tile."""

    window: Window
    around: Window
    levels: LevelWindows
    places: Window

    @classmethod
    def of(cls, window: Window, shapes: Sequence[tuple[int, int]], terrain_shape: tuple[int, int]) -> "JudgedTile":
        """shapes: of all levels, the finest first; terrain_shape: of the raster of the terrain."""
        around = window.grown(SURROUNDINGS).clipped(shapes[0])
        return cls(window, around, LevelWindows.of(window, shapes), places_around(window, 1, terrain_shape))


@dataclass(frozen=True)
class JudgedSquare:
    """Tiles side by side, which one job judges one after the other, since what it makes is stored in one piece. `around`, `levels`
    and `places`: what all of them read."""

    window: Window
    tiles: tuple[JudgedTile, ...]
    around: Window
    levels: tuple[Window, ...]
    places: Window

    @classmethod
    def of(cls, window: Window, side: int, shapes: Sequence[tuple[int, int]], terrain_shape: tuple[int, int]) -> "JudgedSquare":
        """The tiles of `side` cells in a window that begins at the corner of one; shapes, terrain_shape: see `JudgedTile`."""
        tiles = tuple(JudgedTile.of(one, shapes, terrain_shape) for one in windows_in(window, side))
        levels = tuple(enclosing(reads) for reads in zip(*(tile.levels.read for tile in tiles), strict=True))
        around, places = enclosing(tile.around for tile in tiles), enclosing(tile.places for tile in tiles)
        return cls(window, tiles, around, levels, places)


def judged_square(
    square: JudgedSquare,
    settings: ConfidenceLimits,
    height: np.ndarray,
    quality: np.ndarray,
    terrain: np.ndarray,
    step: float,
    coarser_heights: tuple[np.ndarray, ...] = (),
    coarser_qualities: tuple[np.ndarray, ...] = (),
    canopy: CanopyTile | None = None,
    maps: Iterable[np.ndarray] = (),
) -> JudgedVolume:
    """Every tile as `judged` does it alone; height, quality, terrain and those of the coarser levels: of the windows of all.

    canopy: the depth maps around the square, None without any; maps: of its pieces, read where heights stand alone.
    """
    shape = square.window.shape
    whole = JudgedVolume(np.empty(shape, np.float32), np.empty((*shape, len(Judgement)), np.uint8), np.empty(shape, np.uint8))
    for tile in square.tiles:
        around, places = tile.around.within(square.around).slices, tile.places.within(square.places).slices
        levels = [own.within(read).slices for own, read in zip(tile.levels.read, square.levels, strict=True)][1:]
        coarser = (
            [values[own] for values, own in zip(level, levels, strict=True)] for level in (coarser_heights, coarser_qualities)
        )
        found = judged(tile, settings, height[around], quality[around], terrain[places], step, *map(tuple, coarser))
        for values, made in zip(whole, found, strict=True):
            values[tile.window.within(square.window).slices] = made
    if canopy and canopy.pieces:
        crowns = _sparse(quality, np.isfinite(height))[square.window.within(square.around).slices]
        crowns &= whole.confidence != Confidence.HIGH
        if crowns.any():
            return _with_canopy(whole, crowns, canopy_heights(canopy, maps))
    return whole


def judged(
    tile: JudgedTile,
    settings: ConfidenceLimits,
    height: np.ndarray,
    quality: np.ndarray,
    terrain: np.ndarray,
    step: float,
    coarser_heights: tuple[np.ndarray, ...] = (),
    coarser_qualities: tuple[np.ndarray, ...] = (),
) -> JudgedVolume:
    """height (rows, cols) m, NaN for none, and quality (rows, cols, 5) of the cells `tile.around`; terrain (rows, cols) m of
    `tile.places`; step: between the heights, m; height and quality of the coarser levels: of `tile.levels.read` from the second
    on."""
    inner = tile.window.within(tile.around).slices
    known, judgements = np.isfinite(height), judgement(quality)
    enclosed = _enclosed(known)
    coherent, distinct, near = _coherent(settings, judgements), _distinct(settings, judgements), _near(settings, judgements)
    high = coherent & enclosed & distinct & near
    alone = known & ~high & _alone(quality, known)
    confidence = np.select(
        [high, coherent & enclosed & distinct, alone, known & coherent & _passable(settings, judgements)],
        [np.uint8(code) for code in (Confidence.HIGH, Confidence.BLURRED, Confidence.CALMED, Confidence.FAINT)],
        np.uint8(Confidence.LOW),
    )
    even = evened(np.asarray(height, np.float32), judgements[..., Judgement.STRETCH] / np.float32(STRETCH_UNIT), step, coherent)
    calmer, judgements, confidence = _bordered(even, enclosed)[inner], judgements[inner], confidence[inner]
    if alone[inner].any():
        own, alone = tile.levels.read[0].within(tile.around).slices, alone[inner]
        heights, qualities = (height[own], *coarser_heights), (quality[own], *coarser_qualities)
        ground = at_cells(terrain, tile.places, tile.window, 1)
        shown = shown_heights(tile.levels, heights, [bands[..., Band.COHERENCE] for bands in qualities], ground, step)
        calmer = np.where(alone, shown.height, calmer)
        level = np.minimum(np.rint(LEVEL_UNIT * shown.level), 255).astype(np.uint8)
        judgements[..., Judgement.LEVEL] = np.where(alone, level, np.uint8(0))
        calmed = alone & shown.shown & (confidence != Confidence.BLURRED)
        confidence = np.where(calmed, np.uint8(Confidence.COARSE), confidence)
    return JudgedVolume(calmer, judgements, confidence)


def _with_canopy(found: JudgedVolume, crowns: np.ndarray, canopy: np.ndarray) -> JudgedVolume:
    """What depth maps agree on, heights (rows, cols) m or NaN, in place of those of `crowns` (rows, cols) bool."""
    agreed = crowns & np.isfinite(canopy)
    judgement = np.where(agreed[..., None], np.uint8(0), found.judgement)
    judgement[..., Judgement.LEVEL] += np.where(agreed, np.uint8(DEPTH_LEVEL * LEVEL_UNIT), np.uint8(0))
    confidence = np.where(agreed, np.uint8(Confidence.COARSE), found.confidence)
    return JudgedVolume(np.where(agreed, canopy, found.height), judgement, confidence)


def _coherent(limits: ConfidenceLimits, judged: np.ndarray) -> np.ndarray:
    """(rows, cols) bool from a judgement (rows, cols, 5): the surroundings go along."""
    return judged[..., Judgement.COHERENCE] >= 100 * limits.coherence


def _distinct(limits: ConfidenceLimits, judged: np.ndarray) -> np.ndarray:
    """(rows, cols) bool from a judgement (rows, cols, 5): its rivals are beaten."""
    return judged[..., Judgement.DISTINCTIVENESS] >= 100 * limits.distinctiveness


def _near(limits: ConfidenceLimits, judged: np.ndarray) -> np.ndarray:
    """(rows, cols) bool from a judgement (rows, cols, 5): its rivals are near."""
    return judged[..., Judgement.SPREAD] <= SPREAD_UNIT * limits.rival_spread


def _passable(limits: ConfidenceLimits, judged: np.ndarray) -> np.ndarray:
    """(rows, cols) bool from a judgement (rows, cols, 5): clear enough for a pair to decide on even ground."""
    return judged[..., Judgement.DISTINCTIVENESS] >= 100 * min(limits.with_pair, limits.distinctiveness)


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
    return coheres_less(quality[..., Band.COHERENCE], known, _COMPANY)


def _sparse(quality: np.ndarray, known: np.ndarray) -> np.ndarray:
    """(rows, cols) bool: where too few go along to trust that a height which fits all photographs is a leaf's."""
    return known & coheres_less(quality[..., Band.COHERENCE], known, _SPARSE)
