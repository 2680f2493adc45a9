"""The colours of a tile of an output: from every photograph that sees a pixel, by the rules that hold for any surface.

The weight of a colour is the area of the surface element in the photograph: c^2 (n d) / w^3 for the unit normal n, the way d to the
projection centre and the depth w along the axis; the element itself is the same for all photographs. It is made soft towards the
border of the photograph, and almost nothing next to the limit of what is hidden (`widening/hidden_edges.py`).

Source: Petsa et al. 2007 (sources/blending.md, M6, M7, M8, M9, M12, M13).
"""

from dataclasses import dataclass, replace
from typing import NamedTuple, NotRequired, TypedDict, Unpack

import numpy as np
from numba import njit
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.job import Table
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import Window
from orthomill.schemas.solid.census import MeshCensus
from orthomill.tasks.colouring.balance.balancing import balanced
from orthomill.tasks.colouring.balance.radiometric_balance import Radiometry, Samples, corrected, seen_twice
from orthomill.tasks.colouring.blending.blending import RESERVE, Blend, Blended, Rejection, blend
from orthomill.tasks.colouring.sampling.photograph_colours import PhotoPixelsAt, colours_at
from orthomill.tasks.colouring.sight.facing import MeshFacing
from orthomill.tasks.colouring.sight.output_tile import OutputTile, PhotographsAtHand
from orthomill.tasks.colouring.sight.sight_rasters import TilePoints, tile_points
from orthomill.tasks.colouring.widening.hidden_edges import NO_ZONE, ChosenWidth
from orthomill.tasks.geometry.view import View, block_view, project_point
from orthomill.tasks.visibility.output_frame import moved
from orthomill.tasks.visibility.sight import PlaceSight
from orthomill.tasks.visibility.triangle_blocks import TrianglesAtHand

PROJECTION_RADIOMETRY = Table("projection/radiometry.json", Radiometry)
ZONE_WORTH = 1.02 * RESERVE
"""Weight next to the limit of what is hidden, of the greatest one there: such a colour hardly shows beside others, but still votes
on gross errors, which two photographs alone could not find"""
_CLEAR = 3
"""colours far from all limits that find the gross errors among themselves: then those next to a limit have no vote"""
_LEAST_WORTH = 1e-12
COARSE, FINE = 1 / 9, 1 / 4
"""Shares of the greatest area: pixels three times as large as the finest ones do not colour, those twice as large do."""
_NEAREST = Blend(Rejection("none"), best=1)
"""What programs with one photograph per face do"""


@dataclass(frozen=True)
class ColourRules:
    """`feather`: width of the soft border, a part of the photograph's shorter side; `blend`: how colours are combined; of
    two that disagree the one at a break of its depth goes if `breaks`."""

    feather: float
    blend: Blend
    breaks: bool
    finest: bool = False
    """photographs with much larger pixels than the finest one fade out"""


class ProjectionTile(BaseModel):
    """Sums over the pixels of a tile of an output."""

    model_config = ConfigDict(frozen=True)

    pixels: int
    surface: int
    """pixels with surface"""
    seen: tuple[int, int, int, int]
    """pixels with surface that no, one, two or more photographs see"""
    coloured: int
    rejected: int
    values: int
    backs: int
    """pixels that show a back of the surface"""
    zone: int
    """values next to the limit of what is hidden"""
    difference_sum: float
    difference_count: int
    shares: dict[str, float]
    """photograph -> its part in the colours, px"""
    sights: dict[str, tuple[int, ...]]
    """photograph -> pixels by code of PlaceSight"""


class ColouredTile(NamedTuple):
    """`ortho` uint8 (rows, cols, 4); `coverage` uint8 (rows, cols): photographs that see the surface, 255 without surface;
    `rejected` uint8 (rows, cols)."""

    ortho: np.ndarray
    coverage: np.ndarray
    rejected: np.ndarray
    statistics: ProjectionTile


NO_SURFACE = 255
"""in the coverage"""


@dataclass(frozen=True, eq=False)
class _Sampled:
    """Pixels (N, 2), colours (N, bands), weights (N,) and squared distances from the middle (N,) of the points at `at` (N,) in one
    photograph."""

    at: np.ndarray
    pixels: np.ndarray
    colour: np.ndarray
    worth: np.ndarray
    r2: np.ndarray


@njit(cache=True)
def _show(n, points, normals, chosen, facing, soft, pixels, worth, r2):
    """Fills where the view `n` shows the `chosen` points, with which weight, and how far from its middle; `soft`: px of border."""
    right, bottom = 0.5 * (n.width - 1.0), 0.5 * (n.height - 1.0)
    corner = right * right + bottom * bottom
    for i in range(chosen.size):
        k = chosen[i]
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        col, row, depth = project_point(n, x, y, z)
        inside = min(min(col, n.width - 1.0 - col), min(row, n.height - 1.0 - row)) + 0.5
        # NaN is not inside.
        border = min(inside / soft, 1.0) if inside > 0.0 else 0.0
        towards = normals[k, 0] * (n.xc - x) + normals[k, 1] * (n.yc - y) + normals[k, 2] * (n.zc - z)
        area = n.c * n.c * facing * towards / (depth * depth * depth)
        pixels[i, 0], pixels[i, 1] = col, row
        worth[i] = max(area * border * border * (3.0 - 2.0 * border), _LEAST_WORTH)
        r2[i] = ((col - right) ** 2 + (row - bottom) ** 2) / corner


def _sample(view: View, part: PhotoPixelsAt, surface: TilePoints, chosen: np.ndarray, facing: float, feather: float) -> _Sampled:
    """What a photograph shows of the `chosen` (N,) points of a tile."""
    at, camera = np.flatnonzero(chosen), view.camera
    pixels, worth, r2 = np.empty((at.size, 2)), np.empty(at.size, np.float32), np.empty(at.size, np.float32)
    soft = max(feather * min(camera.width, camera.height), 1e-9)
    _show(view.numbers, surface.points, surface.normals, at, float(facing), soft, pixels, worth, r2)
    colour, known = colours_at(part, (camera.height, camera.width), pixels)
    return _Sampled(surface.at[at], pixels, colour, worth * known, r2)


def _of_tile(surface: TilePoints, values: np.ndarray) -> np.ndarray:
    """Those of `values` (rows, cols) at the points of a tile."""
    return values.ravel()[surface.at]


def _zone_at(pixels: np.ndarray, zone: np.ndarray, window: Window) -> np.ndarray:
    """uint8 (N,): the zone in which pixels (N, 2) of a photograph lie, whose zones are at hand for `window`."""
    places = np.floor(pixels + 0.5).astype(int) - (window.col, window.row)
    places = np.clip(places, 0, (window.width - 1, window.height - 1))
    return zone[places[:, 1], places[:, 0]]


@dataclass(frozen=True, eq=False)
class TileColours:
    """Colours (photographs, rows, cols, bands), weights, breaks and zones (photographs, rows, cols) of a tile: the number of the
    narrowest zone next to a limit that holds a value, 0 far from all limits. Without zones at hand a break of the depth is one."""

    colours: np.ndarray
    weights: np.ndarray
    breaks: np.ndarray
    zones: np.ndarray

    def near(self, within: int) -> np.ndarray:
        """bool (photographs, rows, cols): values in one of the first `within` zones."""
        return (self.zones > 0) & (self.zones <= within)

    def blended(self, rules: ColourRules, within: int = 0) -> Blended:
        """The colours as one; those in the first `within` zones serve where there are no others."""
        weights = reserved(self.weights, self.near(within)) if within else self.weights
        weights = fading(weights) if rules.finest else weights
        return blend(self.colours, weights, rules.blend, self.breaks if rules.breaks else None)


def reserved(weights: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Weights (photographs, rows, cols) of which those that are `near` a limit do not count: with fewer than three others they keep
    their vote on gross errors, and where there are no others their weight."""
    clear = np.where(near, np.float32(0.0), weights)
    vote = (clear > 0).sum(axis=0) < _CLEAR
    greatest = clear.max(axis=0, initial=0.0)
    worth = np.where(vote, np.float32(ZONE_WORTH) * greatest, np.float32(0.0))
    return np.where(near & (weights > 0) & (greatest > 0), worth, weights)


def fading(weights: np.ndarray) -> np.ndarray:
    """Weights (photographs, rows, cols) of which those below FINE of the greatest fade out towards COARSE.

    They stay just above the share from which a colour is used at all: their vote on gross errors counts, their blur does not.
    """
    share = weights / np.maximum(weights.max(axis=0, initial=0.0), np.float32(_LEAST_WORTH))
    factor = np.clip((share - COARSE) / (FINE - COARSE), 0.0, 1.0)
    least = np.where(share > RESERVE, 1.01 * RESERVE / np.maximum(share, RESERVE), 1.0)
    return (weights * np.maximum(factor, np.minimum(least, 1.0))).astype(np.float32)


@dataclass(frozen=True, eq=False)
class ShownPhotographs:
    """What colours points: `photos`, pixels at `at_hand.parts`; `zones` of the photographs at `at_hand.zones`; the block, and the
    mesh's `origin` (3,) m; `facing`: -1 for a mesh whose triangles face inwards."""

    at_hand: PhotographsAtHand
    photos: tuple[np.ndarray, ...]
    zones: tuple[np.ndarray, ...]
    block: Block
    origin: np.ndarray
    radiometry: Radiometry
    facing: float

    @property
    def views(self) -> list[View]:
        """The photographs of the parts."""
        return [moved(block_view(self.block, part.name), self.origin) for part in self.at_hand.parts]


class TileReads(TypedDict):
    """What every job that colours a tile reads, under the names by which it reads it."""

    triangle: np.ndarray
    """(rows, cols)"""
    sight: np.ndarray
    """(rows, cols, photographs)"""
    blocks: tuple[np.ndarray, ...]
    photos: tuple[np.ndarray, ...]
    zones: NotRequired[tuple[np.ndarray, ...]]
    block: Block
    census: MeshCensus
    facing: MeshFacing
    radiometry: Radiometry
    tile: OutputTile


@dataclass(frozen=True, eq=False)
class TileAtHand:
    """A tile of an output: the points that it shows, how the photographs see them (..., photographs), and what colours them."""

    surface: TilePoints
    sight: np.ndarray
    shown: ShownPhotographs

    @staticmethod
    def of(reads: TileReads, chosen: np.ndarray | None = None) -> "TileAtHand":
        """From what a job reads; only of the `chosen` (rows, cols) bool pixels, if given, in a row (1, N)."""
        tile, sight, origin = reads["tile"], reads["sight"], np.array(reads["census"].origin)
        at_hand = TrianglesAtHand.of(tile.blocks, reads["blocks"])
        surface = tile_points(reads["triangle"], at_hand, tile.frame, tile.window, origin, chosen)
        if chosen is not None:
            sight = sight.reshape(-1, sight.shape[2])[surface.at][None]
            surface = replace(surface, at=np.arange(len(surface.at)))
        zones, facing = reads.get("zones", ()), reads["facing"].sign
        shown = ShownPhotographs(tile, reads["photos"], zones, reads["block"], origin, reads["radiometry"], facing)
        return TileAtHand(surface, sight, shown)

    def colours(self, feather: float) -> TileColours:
        """Of all points in every photograph."""
        return tile_colours(self.surface, self.sight, self.shown, feather)


def tile_colours(surface: TilePoints, sight: np.ndarray, shown: ShownPhotographs, feather: float) -> TileColours:
    """The colours of points in every photograph at hand, in the radiometry of the block; sight (rows, cols, photographs)."""
    photos, parts, radiometry = shown.photos, shown.at_hand.parts, shown.radiometry
    shape = sight.shape[:2]
    bands = max((pixels.shape[2] for pixels in photos), default=1)
    colours = np.zeros((len(parts), shape[0] * shape[1], bands), np.float32)
    weights = np.zeros((len(parts), shape[0] * shape[1]), np.float32)
    breaks, near = np.zeros((len(parts), *shape), bool), np.zeros((len(parts), shape[0] * shape[1]), np.uint8)
    windows = {part.name: (zone, part.window) for zone, part in zip(shown.zones, shown.at_hand.zones, strict=True)}
    for k, (view, pixels, part) in enumerate(zip(shown.views, photos, parts, strict=True)):
        code = sight[..., shown.at_hand.names.index(part.name)]
        breaks[k] = code == PlaceSight.AT_BREAK
        chosen = _of_tile(surface, code) >= PlaceSight.AT_BREAK
        if not chosen.any():
            continue
        sampled = _sample(view, PhotoPixelsAt(pixels, part.window, part.level), surface, chosen, shown.facing, feather)
        if part.name in windows:
            near[k, sampled.at] = _zone_at(sampled.pixels, *windows[part.name])
        # Corrected before blending: rejection compares colours, and a gain of some per cent would look like a gross error.
        colours[k, sampled.at] = corrected(sampled.colour, sampled.r2, radiometry.of(part.name)) * (255.0 / radiometry.white)
        weights[k, sampled.at] = sampled.worth
    flat = len(parts), *shape
    near = near if windows else breaks.astype(np.uint8)
    return TileColours(colours.reshape(*flat, bands), weights.reshape(flat), breaks, near.reshape(flat))


def colour_tile(rules: ColourRules, widening: ChosenWidth = NO_ZONE, **reads: Unpack[TileReads]) -> ColouredTile:
    """One tile of an output: see the module."""
    hand, triangle, sight = TileAtHand.of(reads), reads["triangle"], reads["sight"]
    found = hand.colours(rules.feather)
    blended = found.blended(rules, widening.zone)
    seen = (sight >= PlaceSight.AT_BREAK).sum(axis=2).astype(np.uint8)
    coverage = np.where(triangle >= 0, np.minimum(seen, NO_SURFACE - 1), NO_SURFACE).astype(np.uint8)
    counts = _statistics(triangle, coverage, sight, blended, reads["tile"])
    near = int(found.near(widening.zone).sum())
    counts = counts.model_copy(update={"zone": near, "backs": int(hand.surface.backs(hand.shown.facing).sum())})
    return ColouredTile(rgba(blended), coverage, blended.rejected, counts)


def rgba(blended: Blended) -> np.ndarray:
    """uint8 (rows, cols, 4), transparent black without colour."""
    out = np.zeros((*blended.used.shape, 4), np.uint8)
    out[..., :3] = np.clip(np.floor(blended.colour + 0.5), 0, 255)
    out[..., 3] = 255
    out[blended.used == 0] = 0
    return out


def _statistics(
    triangle: np.ndarray, coverage: np.ndarray, sight: np.ndarray, blended: Blended, tile: OutputTile
) -> ProjectionTile:
    known = triangle >= 0
    none, one, two, more = np.bincount(np.minimum(coverage[known], 3), minlength=4).tolist()
    return ProjectionTile(
        pixels=triangle.size,
        surface=int(known.sum()),
        seen=(none, one, two, more),
        coloured=int((blended.used > 0).sum()),
        rejected=int(blended.rejected.sum(dtype=np.int64)),
        values=int(blended.seen.sum(dtype=np.int64)),
        backs=0,
        zone=0,
        difference_sum=float(np.nansum(blended.difference, dtype=np.float64)),
        difference_count=int(np.isfinite(blended.difference).sum()),
        shares={part.name: float(share) for part, share in zip(tile.parts, blended.share, strict=True)},
        sights={
            name: tuple(np.bincount(sight[..., k].ravel(), minlength=len(PlaceSight)).tolist()) for k, name in enumerate(tile.names)
        },
    )


def sample_surface(
    triangle: np.ndarray,
    sight: np.ndarray,
    blocks: tuple[np.ndarray, ...],
    photos: tuple[np.ndarray, ...],
    block: Block,
    census: MeshCensus,
    facing: MeshFacing,
    tile: OutputTile,
    spacing: int,
    first: int,
) -> Samples:
    """Grey values of every `spacing`-th pixel of a tile in all photographs that see it, for the radiometric balance.

    Points are numbered from `first` on through the whole output; only those that two photographs or more see.
    """
    window, frame = tile.window, tile.frame
    rows, cols = np.arange(window.height) + window.row, np.arange(window.width) + window.col
    chosen = (rows % spacing == 0)[:, None] & (cols % spacing == 0)
    origin = np.array(census.origin)
    surface = tile_points(triangle, TrianglesAtHand.of(tile.blocks, blocks), frame, window, origin, chosen)
    number = (first + rows[:, None] * frame.cols + cols).ravel()
    columns = []
    for pixels, part in zip(photos, tile.parts, strict=True):
        view = moved(block_view(block, part.name), origin)
        seen = _of_tile(surface, sight[..., tile.names.index(part.name)]) == PlaceSight.SEEN
        sampled = _sample(view, PhotoPixelsAt(pixels, part.window, part.level), surface, seen, facing.sign, 0.0)
        known = sampled.worth > 0
        grey = np.broadcast_to(sampled.colour[known], (int(known.sum()), 3))
        columns.append((number[sampled.at[known]], np.full(len(grey), block.names.index(part.name)), sampled.r2[known], *grey.T))
    return seen_twice(columns)


def balance_surface(samples: tuple[Samples, ...], block: Block, deep: bool, method: str, vignetting: bool) -> Radiometry:
    """The radiometry of the photographs from the samples of all tiles of all outputs."""
    return balanced(samples, block.names, deep, method, vignetting)


class LeftOutTile(NamedTuple):
    """A tile of a photograph, from the others: blended, and from the nearest one only; uint8 (rows, cols, 4)."""

    blended: np.ndarray
    nearest: np.ndarray


def left_out_tile(rules: ColourRules, widening: ChosenWidth = NO_ZONE, **reads: Unpack[TileReads]) -> LeftOutTile:
    """What the photograph of `frame` shows, from the others: as `colour_tile`, and as programs with one photograph per face do."""
    found = TileAtHand.of(reads).colours(rules.feather)
    whole = found.blended(rules, widening.at_breaks)
    return LeftOutTile(rgba(whole), rgba(blend(found.colours, found.weights, _NEAREST)))
