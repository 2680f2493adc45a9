"""Places that look like water and that nobody outlined: named, and left as they are.

Strategy. On water every photograph shows waves, glare and what is mirrored, each its own: the heights that fit best are spread over
all that were looked for, below the shore as well as above it. In woods heights stand alone as well, but they lie between the crowns
and the ground below, and that ground rises and falls, while all of a shore is at one level. So a place is named where all of this
holds: the heights inside fill most of the range that was looked for; a good share of them lie below the ground around, and
another above it; and that ground, in directions around the middle of the place, is at one level, compared with how far apart
the heights inside are. Some directions may fail: where photographs are few, heights beside water are wrong. The level that is
stated is that of the nearest ground that agrees. What touches the edge of what two photographs see has a border that nobody knows.

This is circumstance, not measurement. Nothing is levelled before somebody who knows the place takes the outline over (water.py).
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict
from scipy import ndimage

from orthomill.schemas.maps.coded_areas import CodedAreas
from orthomill.schemas.maps.wanted_area import WantedArea
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.densification.speckle_blocks import BlockBand

_LEAST = 48
"""blocks of the smallest place: heights enough to tell how they are spread"""
_GROWTH = 3
"""blocks that an outline may grow by where nothing is measured"""
_SHORE, _NEAREST = 12, 8
"""blocks around a place among which its shore is sought, and how many of them in a direction tell its level"""
_DIRECTIONS, _MEASURED_DIRECTIONS = 16, 10
"""around the middle of a place, and in how many of them its shore must be measured"""
_FEWEST = 2
"""measured blocks in a direction"""
_LOW = 25
"""% of the measured ground of a direction below its level"""
_EVEN, _AGREEING = 0.03, 0.75
"""of the spread of the heights inside, how far a direction may be from the level of all; share of them that must be no farther"""
_FILLED = 0.55
"""share of the range that was looked for between whose ends the heights inside lie (docs/methods.md has what was measured)"""
_BOTH_SIDES = 0.1
"""share of the heights inside that must lie below the level of the shore, and above it"""
_UNSEEN = 0.02
"""share of the border beyond which nobody knows it"""
_SPREAD = 1, 99
"""% of the heights inside between which their spread is taken"""
CANDIDATES = "products/water_candidates.gpkg"
"""their outlines"""
MOST = 1000
"""places that are named, the largest first"""


class WaterPlace(BaseModel):
    """A place that looks like water."""

    model_config = ConfigDict(frozen=True)

    area: float
    """m2"""
    level: float
    """m, the median of the directions of its shore that agree with each other"""
    scatter: float
    """m, root mean square difference of these from it"""
    spread: float
    """m, of the heights inside"""
    below: float
    """share of these that lie below the level"""


class WaterPlaces(BaseModel):
    """All of a surface, the largest first."""

    model_config = ConfigDict(frozen=True)

    places: tuple[WaterPlace, ...] = ()


class FoundPlaces(NamedTuple):
    """The places, the attributes of their outlines, and (rows, cols) uint16 which blocks belong to each, counted from 1."""

    places: WaterPlaces
    areas: CodedAreas
    numbers: np.ndarray


NO_PLACES = WaterPlaces()


def water_places(
    blocks: np.ndarray, grid: MapGrid, wanted: WantedArea, looked_for: float, outlined: WantedArea | None = None
) -> FoundPlaces:
    """The places on a raster of blocks (rows, cols, 3), see `BlockBand`, of the `grid`.

    wanted: where a surface is wanted at all; looked_for: m, from the lowest to the highest height that may be measured; outlined:
    what is known to be water.
    """
    whole_window = Window(0, 0, *grid.shape)
    inside = wanted.cells(grid, whole_window)
    seen = inside & (blocks[..., BlockBand.SEEN] == 1)
    ground = np.where(inside, blocks[..., BlockBand.MEASURED], np.nan)
    speckle = np.where(inside, blocks[..., BlockBand.SPECKLE], np.nan)
    if outlined is not None:
        speckle[ndimage.binary_dilation(outlined.cells(grid, whole_window), iterations=_GROWTH)] = np.nan
    whole = ndimage.binary_opening(np.isfinite(speckle), np.ones((3, 3)))
    named = _named(whole, speckle, ground, seen, grid.cell)
    found = sorted((each for each in named if each[0].spread >= _FILLED * looked_for), key=lambda each: -each[0].area)[:MOST]
    numbers = np.zeros(seen.shape, np.uint16)
    for number, (_, box, part) in enumerate(found, start=1):
        numbers[box][part] = number
    places = tuple(place for place, _, _ in found)
    areas = CodedAreas(attributes={number: _attributes(place) for number, place in enumerate(places, start=1)})
    return FoundPlaces(WaterPlaces(places=places), areas, numbers)


_Box = tuple[slice, ...]


def _named(
    whole: np.ndarray, speckle: np.ndarray, ground: np.ndarray, seen: np.ndarray, cell: float
) -> Iterator[tuple[WaterPlace, _Box, np.ndarray]]:
    """What looks like water of the connected parts of `whole` (rows, cols) bool: each with its box and the blocks in it."""
    labels, count = ndimage.label(whole)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    for number, tight in enumerate(ndimage.find_objects(labels), start=1):
        if sizes[number] < _LEAST:
            continue
        box = tuple(slice(max(side.start - _SHORE - 1, 0), side.stop + _SHORE + 1) for side in tight)
        part = labels[box] == number
        part = ndimage.binary_fill_holes(part)
        place = _looks_like_water(part, speckle[box], ground[box], seen[box])
        if place is not None:
            grown = _to_the_shore(part, ground[box], seen[box])
            yield place.model_copy(update={"area": float(grown.sum() * cell**2)}), box, grown


def _to_the_shore(part: np.ndarray, ground: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """The part (rows, cols) bool with what is not measured between it and its shore."""
    open_blocks = part | (np.isnan(ground) & seen)
    return ndimage.binary_fill_holes(ndimage.binary_dilation(part, iterations=_GROWTH, mask=open_blocks))


def _looks_like_water(part: np.ndarray, speckle: np.ndarray, ground: np.ndarray, seen: np.ndarray) -> WaterPlace | None:
    """The part (rows, cols) bool as a place without its area, or none; speckle, ground (rows, cols) m, seen (rows, cols) bool."""
    if _cut(part, seen):
        return None
    core = ndimage.binary_erosion(part) & np.isfinite(speckle)
    heights = speckle[core if core.any() else part & np.isfinite(speckle)]
    spread = float(np.diff(np.percentile(heights, _SPREAD))[0])
    around, even = _levels(part, ground), _EVEN * spread
    if len(around) < _MEASURED_DIRECTIONS:
        return None
    level = float(np.median(around))
    below, above = np.mean(heights < level - even), np.mean(heights > level + even)
    if np.mean(np.abs(around - level) <= even) < _AGREEING or min(below, above) < _BOTH_SIDES:
        return None
    nearest = _levels(part, ground, _NEAREST)
    nearest = nearest[np.abs(nearest - level) <= even]
    if len(nearest):
        level = float(np.median(nearest))
    scatter = float(np.sqrt(np.mean((nearest - level) ** 2))) if len(nearest) else even
    return WaterPlace(area=0.0, level=level, scatter=scatter, spread=spread, below=float(below))


def _cut(part: np.ndarray, seen: np.ndarray) -> bool:
    """Whether the part (rows, cols) bool reaches what is not `seen`, or the edge of the raster, which its box keeps clear of."""
    edge = part[0].any() or part[-1].any() or part[:, 0].any() or part[:, -1].any()
    around = ndimage.binary_dilation(part, np.ones((3, 3)), iterations=2) & ~part
    return bool(edge or (around & ~seen).sum() > _UNSEEN * around.sum())


def _levels(part: np.ndarray, ground: np.ndarray, most: int | None = None) -> np.ndarray:
    """(directions,) m: the level of the measured ground (rows, cols), or of its nearest `most` blocks, in directions around the
    middle of the part."""
    away = ndimage.distance_transform_edt(~part)
    row, col = (np.nonzero(part)[axis].mean() for axis in (0, 1))
    rows, cols = np.nonzero((away > 0) & (away <= _SHORE) & np.isfinite(ground))
    order = np.argsort(away[rows, cols], kind="stable")
    rows, cols = rows[order], cols[order]
    turns = np.arctan2(rows - row, cols - col) / (2 * np.pi) + 0.5
    direction = np.minimum((turns * _DIRECTIONS).astype(int), _DIRECTIONS - 1)
    each = [ground[rows, cols][direction == one][:most] for one in range(_DIRECTIONS)]
    return np.array([np.percentile(one, _LOW) for one in each if len(one) >= _FEWEST])


def _attributes(place: WaterPlace) -> dict[str, str]:
    return {
        "what": "looks like water, not outlined",
        "level_m": f"{place.level:.2f}",
        "shore_scatter_m": f"{place.scatter:.2f}",
        "spread_inside_m": f"{place.spread:.1f}",
        "below_level": f"{place.below:.2f}",
    }
