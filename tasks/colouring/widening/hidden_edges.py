"""Where the limits of what is hidden lie in the photographs, and the zone next to them.

The widening of occlusions is the published one (M10): what a photograph does not see of an output is a binary picture; it is opened
by a small window; a Laplace filter finds its edges; these are points of the surface, and are drawn into the photograph and
dilated there by what the mesh and the orientation are worth. Colours from that zone serve only where there are no others. Hidden
specks smaller than a number of pixels are removed before, by their connected components, so that noise makes no holes.

How much mesh and orientation are worth nobody knows beforehand: several widths are drawn, and the stage finds the best one.

Source: Petsa et al. 2007 (sources/blending.md, M10).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.job import Columns
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import Window
from orthomill.schemas.solid.census import MeshCensus
from orthomill.tasks.colouring.sight.output_tile import OutputTile
from orthomill.tasks.colouring.sight.sight_rasters import tile_points
from orthomill.tasks.geometry.view import block_view
from orthomill.tasks.visibility.output_frame import moved
from orthomill.tasks.visibility.sight import PlaceSight
from orthomill.tasks.visibility.triangle_blocks import TrianglesAtHand


@dataclass(frozen=True)
class WideningRules:
    """Side of the window that opens what is hidden (px of the output), area of specks that are removed (px), and by how far the
    edges are dilated (px of the photograph), rising: the narrowest of these zones that holds a pixel is drawn."""

    window: int = 2
    speck: int = 12
    widths: tuple[float, ...] = (3.0,)

    @property
    def rim(self) -> int:
        """Pixels around a tile that decide about its edges."""
        return self.window + self.speck + 2


class TriedWidth(BaseModel):
    """A width (px of the photographs) and the mean difference of what it gives from photographs that took no part, grey levels."""

    model_config = ConfigDict(frozen=True)

    width: float
    difference: float


class ChosenWidth(BaseModel):
    """How many of the zones that were drawn are used: `zone` counts the narrowest one as 1; `width` px of it, 0 for none."""

    model_config = ConfigDict(frozen=True)

    zone: int = 0
    width: float = 0.0
    places: int = 0
    """at which widths were tried"""
    tried: tuple[TriedWidth, ...] = ()

    @property
    def at_breaks(self) -> int:
        """The zones that are used where there is no picture in which to find limits: the pixels next to a break of the depth."""
        return min(self.zone, 1)


NO_ZONE = ChosenWidth()


def fixed_width(width: float) -> ChosenWidth:
    """The width that a workflow states."""
    return ChosenWidth(zone=1, width=width)


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
        pixels = pixels[view.contains(pixels, -rules.widths[-1])]
        found.append(np.column_stack([np.full(len(pixels), number), pixels]))
    rows = np.concatenate(found) if found else np.zeros((0, 3))
    return HiddenEdges(rows[:, 0].astype(np.int16), rows[:, 1].astype(np.float32), rows[:, 2].astype(np.float32))


def limit_zone(edges: Iterator[HiddenEdges], number: int, shape: tuple[int, int], widths: tuple[float, ...]) -> np.ndarray:
    """uint8 (rows, cols) of a photograph of `shape`: k within widths[k - 1] px of an edge, the least such k; 0 beyond (M10, steps
    5 and 6)."""
    drawn = np.ones(shape, np.uint8)
    for part in edges:
        mine = part.photo == number
        col, row = np.floor(part.col[mine] + 0.5).astype(int), np.floor(part.row[mine] + 0.5).astype(int)
        inside = (col >= 0) & (row >= 0) & (col < shape[1]) & (row < shape[0])
        drawn[row[inside], col[inside]] = 0
    zone = np.zeros(shape, np.uint8)
    if drawn.all():
        return zone
    distance = cv2.distanceTransform(drawn, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    for k in range(len(widths), 0, -1):
        zone[distance <= widths[k - 1]] = k
    return zone
