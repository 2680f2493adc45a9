"""A tile of an output, or of a photograph that is made again, in colour: from every photograph that sees its pixels."""

from dataclasses import dataclass, replace
from typing import NamedTuple, NotRequired, TypedDict, Unpack

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.orientation import Block
from orthomill.schemas.solid.census import MeshCensus
from orthomill.tasks.colouring.balance.photo_radiometry import Radiometry
from orthomill.tasks.colouring.balance.shared_ground import Samples, sample_rows, seen_twice
from orthomill.tasks.colouring.blending.blending import Blend, blend
from orthomill.tasks.colouring.blending.colour_rules import ColourRules
from orthomill.tasks.colouring.blending.colour_sums import ColourSums, ColourTally
from orthomill.tasks.colouring.blending.painting import rgba
from orthomill.tasks.colouring.blending.rejection import Rejection
from orthomill.tasks.colouring.blending.surface_colours import ShownPhotographs, TileColours, tile_colours
from orthomill.tasks.colouring.sampling.photograph_colours import PhotoPixelsAt
from orthomill.tasks.colouring.sampling.surface_sampling import of_tile, sample_points
from orthomill.tasks.colouring.sight.facing import MeshFacing
from orthomill.tasks.colouring.sight.output_tile import OutputTile
from orthomill.tasks.colouring.sight.sight_rasters import TilePoints, tile_points
from orthomill.tasks.colouring.widening.hidden_edges import NO_ZONE, ChosenWidth
from orthomill.tasks.geometry.view import block_view
from orthomill.tasks.visibility.output_frame import moved
from orthomill.tasks.visibility.sight import PlaceSight
from orthomill.tasks.visibility.triangle_blocks import TrianglesAtHand

NO_SURFACE = 255
"""in the coverage"""
_NEAREST = Blend(Rejection("none"), best=1)
"""What programs with one photograph per face do"""


class ProjectionTile(BaseModel):
    """Sums over the pixels of a tile of an output."""

    model_config = ConfigDict(frozen=True)

    pixels: int
    surface: int
    """pixels with surface"""
    colours: ColourSums
    """of the pixels with surface"""
    coloured: int
    backs: int
    """pixels that show a back of the surface"""
    zone: int
    """values next to the limit of what is hidden"""
    sights: dict[str, tuple[int, ...]]
    """photograph -> pixels by code of PlaceSight"""


class ColouredTile(NamedTuple):
    """`ortho` uint8 (rows, cols, 4); `coverage` uint8 (rows, cols): photographs that see the surface, 255 without surface;
    `rejected` uint8 (rows, cols)."""

    ortho: np.ndarray
    coverage: np.ndarray
    rejected: np.ndarray
    statistics: ProjectionTile


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
        shown = ShownPhotographs(
            at_hand=tile,
            photos=reads["photos"],
            zones=zones,
            block=reads["block"],
            origin=origin,
            radiometry=reads["radiometry"],
            facing=facing,
        )
        return TileAtHand(surface, sight, shown)

    def colours(self, rules: ColourRules) -> TileColours:
        """Of all points in every photograph."""
        return tile_colours(self.surface, self.sight, self.shown, rules)


def colour_tile(rules: ColourRules, widening: ChosenWidth = NO_ZONE, **reads: Unpack[TileReads]) -> ColouredTile:
    """One tile of an output: colours, the photographs that see each pixel, and rejected colours."""
    hand, triangle, sight = TileAtHand.of(reads), reads["triangle"], reads["sight"]
    found = hand.colours(rules)
    blended = found.blended(rules, widening.zone)
    seen = (sight >= PlaceSight.AT_BREAK).sum(axis=2).astype(np.uint8)
    known = triangle >= 0
    coverage = np.where(known, np.minimum(seen, NO_SURFACE - 1), NO_SURFACE).astype(np.uint8)
    tally = ColourTally(np.zeros(len(found.colours)))
    tally.add(blended)
    statistics = ProjectionTile(
        pixels=triangle.size,
        surface=int(known.sum()),
        colours=tally.sums([part.name for part in reads["tile"].parts], coverage[known]),
        coloured=int((blended.used > 0).sum()),
        backs=int(hand.surface.backs(hand.shown.facing).sum()),
        zone=int(found.near(widening.zone).sum()),
        sights={name: _sight_counts(sight[..., k]) for k, name in enumerate(reads["tile"].names)},
    )
    return ColouredTile(rgba(blended), coverage, blended.rejected, statistics)


def _sight_counts(codes: np.ndarray) -> tuple[int, ...]:
    """Pixels by code of PlaceSight."""
    return tuple(np.bincount(codes.ravel(), minlength=len(PlaceSight)).tolist())


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
        seen = of_tile(surface, sight[..., tile.names.index(part.name)]) == PlaceSight.SEEN
        # No soft border: a sample there is as good as any, and vignetting is seen best there.
        found = sample_points(view, PhotoPixelsAt.of(pixels, part.window, part.level), surface, seen, facing.sign, 0.0)
        columns.append(sample_rows(number[found.at], block.names.index(part.name), found.colour, found.weight, found.r2))
    return seen_twice(columns)


class LeftOutTile(NamedTuple):
    """A tile of a photograph, from the others: blended, and from the nearest one only; uint8 (rows, cols, 4)."""

    blended: np.ndarray
    nearest: np.ndarray


def left_out_tile(rules: ColourRules, widening: ChosenWidth = NO_ZONE, **reads: Unpack[TileReads]) -> LeftOutTile:
    """What the photograph of `frame` shows, from the others: as `colour_tile`, and as programs with one photograph per face do."""
    found = TileAtHand.of(reads).colours(rules)
    whole = found.blended(rules, widening.at_breaks)
    return LeftOutTile(rgba(whole), rgba(blend(found.colours, found.weights, _NEAREST)))
