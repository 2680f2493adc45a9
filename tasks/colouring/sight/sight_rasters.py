"""How every photograph sees every pixel of a tile of an output."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import Window
from orthomill.schemas.solid.census import MeshCensus
from orthomill.schemas.solid.frames import AnyFrame
from orthomill.tasks.colouring.sight.facing import MeshFacing
from orthomill.tasks.colouring.sight.output_tile import OutputTile, PhotographsAtHand
from orthomill.tasks.geometry.view import block_view
from orthomill.tasks.visibility.mesh_sight import MeshPlaces, SightTolerance
from orthomill.tasks.visibility.output_frame import moved, pixel_rays, points_on, window_pixels
from orthomill.tasks.visibility.scanline import NOTHING, NearestTriangles
from orthomill.tasks.visibility.sight import PlaceSight
from orthomill.tasks.visibility.triangle_blocks import TrianglesAtHand


@dataclass(frozen=True, eq=False)
class TilePoints:
    """The points (N, 3) that the pixels `at` (N,), counted rows first, of a tile show, and their triangles (N,) with corners
    (N, 3, 3); m relative to the mesh's origin."""

    at: np.ndarray
    points: np.ndarray
    triangle: np.ndarray
    corners: np.ndarray
    along: np.ndarray
    """unit directions (N, 3) in which the viewer looks"""

    def backs(self, facing: float) -> np.ndarray:
        """bool (N,): points whose back the viewer sees."""
        return facing * np.einsum("ni,ni->n", self.normals, self.along) >= 0

    # Cached: every photograph of a tile asks for them.
    @cached_property
    def normals(self) -> np.ndarray:
        """Unit normals (N, 3)."""
        normal = np.cross(self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0])
        return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)


def tile_points(
    triangle: np.ndarray,
    at_hand: TrianglesAtHand,
    frame: AnyFrame,
    window: Window,
    origin: np.ndarray,
    chosen: np.ndarray | None = None,
) -> TilePoints:
    """The surface of a tile from its triangles (rows, cols); only the `chosen` (rows, cols) bool pixels, if given."""
    shown = triangle != NOTHING if chosen is None else (triangle != NOTHING) & chosen
    at = np.flatnonzero(shown)
    own = triangle.ravel()[at]
    corners = at_hand.corners_of(own)
    rays = pixel_rays(frame, window_pixels(window)[at], origin)
    return TilePoints(at, points_on(rays, corners), own, corners, rays.along)


def sight_tile(
    triangle: np.ndarray,
    blocks: tuple[np.ndarray, ...],
    nearness: Iterable[np.ndarray],
    drawn: Iterable[np.ndarray],
    block: Block,
    census: MeshCensus,
    facing: MeshFacing,
    tile: OutputTile,
    tolerance: SightTolerance,
    masks: Iterable[np.ndarray] = (),
) -> np.ndarray:
    """Codes (rows, cols, photographs) uint8 of PlaceSight of a tile, for the photographs `tile.names`.

    triangle (rows, cols) of the tile; nearness and drawn triangles of the photographs at `tile.parts` (windows of their ideal
    pictures); masks (rows, cols, bands) at the windows `tile.zones`: 0 is not to be used. They are taken one after the other: a
    tile of a coarse picture shows the whole of every photograph.
    """
    origin, at_hand = np.array(census.origin), TrianglesAtHand.of(tile.blocks, blocks)
    surface = tile_points(triangle, at_hand, tile.frame, tile.window, origin)
    rasters = (NearestTriangles(part.window, *pair) for part, *pair in zip(tile.parts, nearness, drawn, strict=True))
    codes = point_sights(
        surface,
        rasters,
        block=block,
        origin=origin,
        facing=facing.sign,
        at_hand=at_hand,
        photographs=tile,
        tolerance=tolerance,
        masks=masks,
    )
    # A back shows nothing: what is painted on the front of it belongs to the other side.
    codes[surface.backs(facing.sign)] = PlaceSight.AWAY
    out = np.full((triangle.size, len(tile.names)), PlaceSight.NOWHERE, np.uint8)
    out[surface.at] = codes
    return out.reshape(*triangle.shape, len(tile.names))


def point_sights(
    surface: TilePoints,
    rasters: Iterable[NearestTriangles],
    block: Block,
    origin: np.ndarray,
    facing: float,
    at_hand: TrianglesAtHand,
    photographs: PhotographsAtHand,
    tolerance: SightTolerance,
    masks: Iterable[np.ndarray],
) -> np.ndarray:
    """Codes (N, photographs) uint8 of PlaceSight of the points of a surface; `rasters` of the parts, masks of the zones, which are
    some of the same photographs in the same order."""
    out = np.full((len(surface.at), len(photographs.names)), PlaceSight.OUTSIDE, np.uint8)
    zones, veils = {part.name: part.window for part in photographs.zones}, iter(masks)
    for part, raster in zip(photographs.parts, rasters, strict=True):
        places = MeshPlaces(surface.points, surface.triangle, {part.name: raster}, at_hand, tolerance, facing)
        view = moved(block_view(block, part.name), origin)
        codes = places.sights(view)
        if part.name in zones:
            codes[_covered(view.project(surface.points), next(veils), zones[part.name])] = PlaceSight.MASKED
        out[:, photographs.names.index(part.name)] = codes
    return out


def _covered(pixels: np.ndarray, mask: np.ndarray, window: Window) -> np.ndarray:
    """bool (N,): places (N, 2) in a photograph whose pixel of the mask at `window` is 0."""
    out = np.zeros(len(pixels), bool)
    places = np.floor(np.nan_to_num(pixels, nan=-1e6) + 0.5).astype(int) - (window.col, window.row)
    inside = ((places >= 0) & (places < (window.width, window.height))).all(axis=1)
    col, row = places[inside].T
    out[inside] = mask[row, col].max(axis=-1) == 0
    return out
