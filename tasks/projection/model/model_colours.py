"""A block of the mesh with its colours: a texture that every photograph contributes to that sees a texel, and colours of vertices.

Each texel is a point of the surface. It is seen, weighted, rejected and blended exactly as a pixel of an orthoimage is, so that a
texture shows no seam where two blocks or two charts meet: both take the same colours at the same place. Texels pass in groups, so
that memory follows the group and the photographs' parts about the block, whatever the mesh is.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.job import Columns, FileBytes
from orthomill.schemas.orientation import Block
from orthomill.schemas.solid.census import MeshCensus
from orthomill.tasks.colouring.balance.photo_radiometry import Radiometry
from orthomill.tasks.colouring.blending.colour_rules import ColourRules
from orthomill.tasks.colouring.blending.painting import rgba
from orthomill.tasks.colouring.blending.surface_colours import ShownPhotographs, tile_colours
from orthomill.tasks.colouring.sight.facing import MeshFacing
from orthomill.tasks.colouring.sight.sight_rasters import TilePoints, point_sights
from orthomill.tasks.colouring.widening.hidden_edges import NO_ZONE, ChosenWidth
from orthomill.tasks.geometry.photograph_part import PhotoPart
from orthomill.tasks.projection.model.glb import ModelPart, as_glb, as_jpeg
from orthomill.tasks.projection.model.unwrapping import Unwrapped, unwrapped
from orthomill.tasks.visibility.mesh_sight import SightTolerance
from orthomill.tasks.visibility.scanline import NOTHING, NearestTriangles
from orthomill.tasks.visibility.sight import PlaceSight
from orthomill.tasks.visibility.triangle_blocks import PER_BLOCK, TrianglesAtHand

TOGETHER = 2**16
"""texels that are coloured at a time"""
UNSEEN = 128
"""grey level of what no photograph sees, and of texels between the charts"""


@dataclass(frozen=True)
class PhotographSet:
    """Photographs that may take part, and parts of them: see `PhotographsAtHand`."""

    names: tuple[str, ...]
    parts: tuple[PhotoPart, ...]
    zones: tuple[PhotoPart, ...] = ()


@dataclass(frozen=True)
class TexturedBlock:
    """The block `number`; blocks at hand; parts of the photographs' ideal pictures (`seen`) and of their levels (`coloured`); the
    side of the texture and m of a texel; what the file says of its coordinates."""

    number: int
    blocks: tuple[int, ...]
    seen: PhotographSet
    coloured: PhotographSet
    side: int
    texel: float
    extras: dict[str, Any]


@dataclass(frozen=True)
class ColouredCorners(Columns):
    """Corners of triangles, three after each other for each, m relative to the mesh's origin; colours, `known` 0 where none."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    """float32"""
    red: np.ndarray
    green: np.ndarray
    blue: np.ndarray
    known: np.ndarray
    """uint8"""

    @property
    def corners(self) -> np.ndarray:
        """(T, 3, 3) float32"""
        return np.column_stack([self.x, self.y, self.z]).reshape(-1, 3, 3)

    @property
    def colours(self) -> np.ndarray:
        """(T, 3, 4) uint8: red, green, blue, known"""
        return np.column_stack([self.red, self.green, self.blue, self.known]).reshape(-1, 3, 4)

    @staticmethod
    def of(corners: np.ndarray, colours: np.ndarray) -> "ColouredCorners":
        """From corners (T, 3, 3) and colours (T, 3, 4)."""
        return ColouredCorners(*corners.reshape(-1, 3).astype(np.float32).T, *colours.reshape(-1, 4).astype(np.uint8).T)


class TileFacts(BaseModel):
    """A texture: texels of triangles, those that no, one, two or more photographs see, and the side of a texel, m."""

    model_config = ConfigDict(frozen=True)

    triangles: int
    texels: int
    seen: tuple[int, int, int, int]
    texel: float
    side: int


class ColouredBlock(NamedTuple):
    """A block as GLB, its corners with their colours, and what its texture is worth."""

    tile: FileBytes
    corners: ColouredCorners
    facts: TileFacts


@dataclass(frozen=True, eq=False)
class _Painter:
    """All that colours points of a block."""

    at_hand: TrianglesAtHand
    rasters: list[NearestTriangles]
    masks: tuple[np.ndarray, ...]
    shown: ShownPhotographs
    tile: TexturedBlock
    tolerance: SightTolerance
    rules: ColourRules
    widening: ChosenWidth

    def painted(self, points: np.ndarray, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Colours (N, 4) uint8 (the fourth 255 where known) and number of photographs (N,) that see points (N, 3) of the triangles
        `own` (N,) of the block."""
        out, seen = np.full((len(points), 4), UNSEEN, np.uint8), np.zeros(len(points), np.uint8)
        out[:, 3] = 0
        for start in range(0, len(points), TOGETHER):
            part = slice(start, start + TOGETHER)
            out[part], seen[part] = self._group(points[part], own[part] + self.tile.number * PER_BLOCK)
        return out, seen

    def _group(self, points: np.ndarray, triangle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        corners = self.at_hand.corners_of(triangle)
        surface = TilePoints(np.arange(len(points)), points, triangle, corners, np.zeros_like(points))
        codes = point_sights(
            surface,
            self.rasters,
            block=self.shown.block,
            origin=self.shown.origin,
            facing=self.shown.facing,
            at_hand=self.at_hand,
            photographs=self.tile.seen,
            tolerance=self.tolerance,
            masks=self.masks,
        )
        found = tile_colours(surface, codes[None], self.shown, self.rules).blended(self.rules, self.widening.at_breaks)
        out = np.full((len(points), 4), UNSEEN, np.uint8)
        known = found.used[0] > 0
        out[known, :3] = rgba(found)[0][known, :3]
        out[:, 3] = np.where(known, 255, 0)
        return out, (codes >= PlaceSight.AT_BREAK).sum(axis=1).astype(np.uint8)


def coloured_block(
    *,
    blocks: tuple[np.ndarray, ...],
    nearness: tuple[np.ndarray, ...],
    drawn: tuple[np.ndarray, ...],
    photos: tuple[np.ndarray, ...],
    block: Block,
    census: MeshCensus,
    facing: MeshFacing,
    radiometry: Radiometry,
    tile: TexturedBlock,
    tolerance: SightTolerance,
    rules: ColourRules,
    masks: tuple[np.ndarray, ...] = (),
    widening: ChosenWidth = NO_ZONE,
) -> ColouredBlock:
    """One block of the mesh in colour. nearness, drawn: rasters of the parts of `tile.seen`; photos: pixels of `tile.coloured`."""
    at_hand, origin = TrianglesAtHand.of(tile.blocks, blocks), np.array(census.origin)
    rasters = [NearestTriangles(part.window, *pair) for part, *pair in zip(tile.seen.parts, nearness, drawn, strict=True)]
    shown = ShownPhotographs(
        at_hand=tile.coloured, photos=photos, zones=(), block=block, origin=origin, radiometry=radiometry, facing=facing.sign
    )
    painter = _Painter(
        at_hand=at_hand, rasters=rasters, masks=masks, shown=shown, tile=tile, tolerance=tolerance, rules=rules, widening=widening
    )
    corners = at_hand.corners_of(np.arange(PER_BLOCK) + tile.number * PER_BLOCK)
    corners = corners[np.isfinite(corners[:, 0, 0])]
    laid = unwrapped(corners, tile.side, tile.texel)
    texture, counts = _texture(laid, corners, painter)
    part = _part(laid, corners, as_jpeg(texture), facing.sign < 0)
    facts = TileFacts(triangles=len(corners), texels=sum(counts), seen=counts, texel=laid.texel, side=laid.side)
    return ColouredBlock(FileBytes.of(as_glb([part], tile.extras)), _corner_colours(corners, painter), facts)


def _texture(laid: Unwrapped, corners: np.ndarray, painter: _Painter) -> tuple[np.ndarray, tuple[int, int, int, int]]:
    """The texture (side, side, 3), and texels that 0, 1, 2, more photographs see."""
    drawn = laid.raster().triangle
    row, col = np.nonzero(drawn != NOTHING)
    own = drawn[row, col]
    points = points_of_places(np.column_stack([col, row]), laid.places[own], corners[own])
    colours, seen = painter.painted(points, own)
    texture = np.full((laid.side, laid.side, 3), UNSEEN, np.uint8)
    texture[row, col] = colours[:, :3]
    none, one, two, more = np.bincount(np.minimum(seen, 3), minlength=4).tolist()
    return with_margins(texture, drawn != NOTHING), (none, one, two, more)


def points_of_places(places: np.ndarray, flat: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Points (N, 3) at places (N, 2) of a texture, from the places (N, 3, 2) of the corners (N, 3, 3) of their triangles."""
    a, first, second = flat[:, 0], flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    inner = places - a
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    v = (inner[:, 0] * second[:, 1] - inner[:, 1] * second[:, 0]) / area
    w = (first[:, 0] * inner[:, 1] - first[:, 1] * inner[:, 0]) / area
    share = np.stack([1.0 - v - w, v, w], axis=1)
    return np.einsum("nk,nki->ni", share, corners)


def with_margins(texture: np.ndarray, known: np.ndarray, width: float = 3.0) -> np.ndarray:
    """The texture with the nearest known texel's colour up to `width` texels around the `known` (rows, cols)."""
    if not known.any():
        return texture
    distance, labels = cv2.distanceTransformWithLabels(
        (~known).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    at = np.zeros(int(labels.max()) + 1, np.int64)
    at[labels[known]] = np.flatnonzero(known)
    near = (distance > 0) & (distance <= width)
    out = texture.copy()
    out[near] = texture.reshape(-1, texture.shape[2])[at[labels[near]]]
    return out


def _part(laid: Unwrapped, corners: np.ndarray, texture: bytes, turned: bool) -> ModelPart:
    """The block with vertices that are shared within a chart."""
    rows = np.concatenate(
        [corners.reshape(-1, 3), np.repeat(laid.charts, 3)[:, None], laid.places.reshape(-1, 2).astype(np.float32)], axis=1
    )
    # The place follows from corner and chart; it comes along so that it need not be looked up.
    unique, numbers = np.unique(rows, axis=0, return_inverse=True)
    triangles = numbers.reshape(-1, 3)
    places = (unique[:, 4:] + 0.5) / laid.side
    return ModelPart(unique[:, :3], triangles[:, ::-1] if turned else triangles, places, texture)


def _corner_colours(corners: np.ndarray, painter: _Painter) -> ColouredCorners:
    """Each place once, by the first of its triangles that is seen by any photograph."""
    places, first, numbers = np.unique(corners.reshape(-1, 3), axis=0, return_index=True, return_inverse=True)
    colours, _ = painter.painted(places, (first // 3).astype(np.int32))
    return ColouredCorners.of(corners, colours[numbers.reshape(-1, 3)])


def merged(parts: Iterator[ColouredCorners]) -> tuple[np.ndarray, np.ndarray]:
    """Corners (T, 3, 3) and colours (T, 3, 4) of several sets."""
    every = list(parts)
    return np.concatenate([one.corners for one in every]), np.concatenate([one.colours for one in every])
