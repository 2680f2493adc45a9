"""How every photograph sees every pixel of a tile of an output, and where the limits of what is hidden lie in the photographs.

The widening of occlusions is the published one (M10): what a photograph does not see of an output is a binary picture; it is opened
by a small window; a Laplace filter finds its edges; these are points of the surface, and are drawn into the photograph and
dilated there by what the mesh and the orientation are worth. Colours from that zone serve only where there are no others. Hidden
specks smaller than a number of pixels are removed before, by their connected components, so that noise makes no holes.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from orthomill.schemas.job import Columns
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import Window
from orthomill.schemas.solid.census import MeshCensus
from orthomill.schemas.solid.frames import AnyFrame
from orthomill.tasks.geometry.view import block_view
from orthomill.tasks.projection.facing import MeshFacing
from orthomill.tasks.projection.output_tile import OutputTile, PhotographsAtHand
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
    codes = point_sights(surface, rasters, block, origin, facing.sign, at_hand, tile, tolerance, masks)
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


@dataclass(frozen=True)
class WideningRules:
    """Side of the window that opens what is hidden (px of the output), area of specks that are removed (px), and by how far the
    edges are dilated (px of the photograph)."""

    window: int = 2
    speck: int = 12
    dilation: float = 3.0

    @property
    def rim(self) -> int:
        """Pixels around a tile that decide about its edges."""
        return self.window + self.speck + 2


@dataclass(frozen=True)
class HiddenEdges(Columns):
    """Places in photographs where the limits of hidden surface lie."""

    photo: np.ndarray
    """int16: number in the names of the photographs"""
    col: np.ndarray
    row: np.ndarray
    """float32 px"""


def hidden_edges(hidden: np.ndarray, rules: WideningRules) -> np.ndarray:
    """bool (rows, cols): edges of what is hidden, after specks are removed and the rest is opened (M10, steps 2 to 4)."""
    picture = hidden.astype(np.uint8)
    if rules.speck > 0:
        count, labels, stats, _ = cv2.connectedComponentsWithStats(picture, connectivity=8)
        large = np.zeros(count, np.uint8)
        large[1:] = stats[1:, cv2.CC_STAT_AREA] >= rules.speck
        picture = large[labels]
    opened = opened_by(picture, rules.window)
    return cv2.Laplacian(opened, cv2.CV_16S, borderType=cv2.BORDER_REPLICATE) != 0


def opened_by(picture: np.ndarray, side: int) -> np.ndarray:
    """A binary picture after erosion and dilation by a square window of `side` px."""
    if side <= 1:
        return picture
    square, low = np.ones((side, side), np.uint8), (side - 1) // 2
    # An even window has no middle: opposite anchors keep the picture where it was.
    eroded = cv2.erode(picture, square, anchor=(low, low), borderType=cv2.BORDER_REPLICATE)
    return cv2.dilate(eroded, square, anchor=(side - 1 - low, side - 1 - low), borderType=cv2.BORDER_REPLICATE)


def edge_tile(
    triangle: np.ndarray,
    sight: np.ndarray,
    blocks: tuple[np.ndarray, ...],
    block: Block,
    census: MeshCensus,
    tile: OutputTile,
    around: Window,
    rules: WideningRules,
) -> HiddenEdges:
    """The edges of what is hidden from each photograph in a tile; triangle and sight are those of `around`."""
    inner = tile.window.within(around).slices
    at_hand, origin = TrianglesAtHand.of(tile.blocks, blocks), np.array(census.origin)
    found = []
    for number, name in enumerate(tile.names):
        code = sight[..., number]
        hidden = (code == PlaceSight.HIDDEN) | (code == PlaceSight.AWAY)
        if not hidden.any():
            continue
        # The seen side of an edge lies on the break of the depth in the photograph. The hidden side may be seen through the middle
        # of what hides it, where there is no limit; a limit to where there is no surface, or no photograph, is no occlusion.
        edges = hidden_edges(hidden, rules) & (code >= PlaceSight.AT_BREAK)
        surface = tile_points(triangle[inner], at_hand, tile.frame, tile.window, origin, edges[inner])
        view = moved(block_view(block, name), origin)
        pixels = view.project(surface.points)
        pixels = pixels[view.contains(pixels, -rules.dilation)]
        found.append(np.column_stack([np.full(len(pixels), number), pixels]))
    rows = np.concatenate(found) if found else np.zeros((0, 3))
    return HiddenEdges(rows[:, 0].astype(np.int16), rows[:, 1].astype(np.float32), rows[:, 2].astype(np.float32))


def limit_zone(edges: Iterator[HiddenEdges], number: int, shape: tuple[int, int], dilation: float) -> np.ndarray:
    """uint8 (rows, cols) of a photograph of `shape`: 1 within `dilation` px of an edge (M10, steps 5 and 6)."""
    drawn = np.ones(shape, np.uint8)
    for part in edges:
        mine = part.photo == number
        col, row = np.floor(part.col[mine] + 0.5).astype(int), np.floor(part.row[mine] + 0.5).astype(int)
        inside = (col >= 0) & (row >= 0) & (col < shape[1]) & (row < shape[0])
        drawn[row[inside], col[inside]] = 0
    if drawn.all():
        return np.zeros(shape, np.uint8)
    distance = cv2.distanceTransform(drawn, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return (distance <= dilation).astype(np.uint8)
