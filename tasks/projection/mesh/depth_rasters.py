"""Depth and triangle of every pixel of a photograph and of an output, block by block of the mesh, and which blocks they show.

Blocks pass one after the other: a job holds two of them and its own rasters, however large the mesh is.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import Window
from orthomill.schemas.solid.census import MeshCensus, MeshTriangles, MeshVertices
from orthomill.schemas.solid.frames import AnyFrame
from orthomill.tasks.geometry.view import View, block_view
from orthomill.tasks.projection.lines.sections import AnySection, cut
from orthomill.tasks.visibility.mesh_blocks import CELL, BlockBox, MeshBlocks, PhotoDepth, ShownSurfaces, TileSurface
from orthomill.tasks.visibility.output_frame import ORIGIN, moved, scan_frame, shown_points, window_pixels
from orthomill.tasks.visibility.scanline import NOTHING, add_triangles, central_projection, empty_raster
from orthomill.tasks.visibility.triangle_blocks import PER_BLOCK, as_blocks, block_areas, block_bounds, block_count


class BlocksOfMesh(NamedTuple):
    """The mesh as a raster of blocks, and their boxes."""

    corners: np.ndarray
    boxes: MeshBlocks


def cut_into_blocks(vertices: MeshVertices, triangles: MeshTriangles) -> BlocksOfMesh:
    """The mended mesh, block by block."""
    points = np.column_stack([vertices.x, vertices.y, vertices.z]).astype(np.float32)
    raster = as_blocks(points[np.column_stack([triangles.a, triangles.b, triangles.c])])
    boxes = tuple(BlockBox(low=tuple(low), high=tuple(high)) for low, high in block_bounds(raster).tolist())
    return BlocksOfMesh(raster, MeshBlocks(boxes=boxes, areas=tuple(block_areas(raster).tolist())))


class PhotoRasters(NamedTuple):
    """Rasters of a photograph without its distortion, at its ideal window, and what they show."""

    nearness: np.ndarray
    triangle: np.ndarray
    seen: PhotoDepth


def photograph_depth(
    blocks: Iterator[np.ndarray], block: Block, census: MeshCensus, numbers: tuple[int, ...], name: str, window: Window
) -> PhotoRasters:
    """Depth and triangle of the photograph `name`; `window` as from `ideal_window`, `blocks` those of `numbers`."""
    view = moved(block_view(block, name), np.array(census.origin))
    projection, raster = central_projection(view, ORIGIN), empty_raster(window)
    front = np.zeros(block_count(census.triangles) * PER_BLOCK, np.bool_)
    every = np.arange(3 * PER_BLOCK, dtype=np.int32).reshape(-1, 3)
    for number, part in zip(numbers, blocks, strict=True):
        own = np.arange(number * PER_BLOCK, (number + 1) * PER_BLOCK, dtype=np.int32)
        add_triangles(raster, projection, part.reshape(-1, 3), every, own)
        front[own] = _faces(part.reshape(-1, 3, 3).astype(np.float64), view)
    return PhotoRasters(raster.nearness, raster.triangle, _seen_blocks(raster.triangle, front))


def _faces(corners: np.ndarray, view: View) -> np.ndarray:
    """bool (T,): triangles that turn their front to the view."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.einsum("ni,ni->n", normal, view.centre - corners[:, 0]) > 0


def _seen_blocks(triangle: np.ndarray, front: np.ndarray) -> PhotoDepth:
    down, across = -(-triangle.shape[0] // CELL), -(-triangle.shape[1] // CELL)
    marks = np.zeros((down * across, len(front) // PER_BLOCK), np.bool_)
    fronts, backs = _mark(triangle, front, across, marks)
    cells = tuple(tuple(map(int, np.flatnonzero(row))) for row in marks)
    return PhotoDepth(pixels=triangle.size, fronts=int(fronts), backs=int(backs), cells=cells, cells_across=across)


@njit()
def _mark(triangle, front, across, marks):
    """Marks the blocks (cells, blocks) that each square shows; returns the numbers of pixels of fronts and of backs."""
    fronts = backs = 0
    for r in range(triangle.shape[0]):
        for c in range(triangle.shape[1]):
            number = triangle[r, c]
            if number >= 0:
                marks[r // CELL * across + c // CELL, number // PER_BLOCK] = True
                if front[number]:
                    fronts += 1
                else:
                    backs += 1
    return fronts, backs


def shown_surfaces(surfaces: Iterator[TileSurface]) -> ShownSurfaces:
    """Those of all tiles, in their order."""
    return ShownSurfaces(tiles=tuple(surfaces))


class OutputRasters(NamedTuple):
    """Depth and triangle of a tile of an output, and what it shows."""

    nearness: np.ndarray
    triangle: np.ndarray
    surface: TileSurface


def depth_picture(nearness: np.ndarray, central: bool, near: tuple[float, float] | None = None) -> np.ndarray:
    """uint8 (rows, cols, 4): depth as grey, 255 at the nearest place and 0 at the farthest; transparent without surface (M4 of
    sources/blending.md).

    `near`: lowest and highest nearness of the whole raster, of which this may be a tile; `central`: nearness is an inverse depth.
    """
    shown = np.isfinite(nearness) & ((nearness > 0) | (not central))
    out = np.zeros((*nearness.shape, 4), np.uint8)
    if not shown.any():
        return out
    low, high = near or (nearness[shown].min(), nearness[shown].max())
    depth, far, close = (nearness[shown].astype(np.float64), float(low), float(high))
    if central:
        depth, far, close = -1.0 / depth, -1.0 / far, -1.0 / close
    grey = np.rint(255.0 * (depth - far) / max(close - far, 1e-12))
    out[shown, :3] = np.clip(grey, 0, 255)[:, None].astype(np.uint8)
    out[shown, 3] = 255
    return out


def output_depth(
    blocks: Iterator[np.ndarray], census: MeshCensus, numbers: tuple[int, ...], frame: AnyFrame, section: AnySection, window: Window
) -> OutputRasters:
    """Depth and triangle of the pixels `window` of a frame after the section; `blocks` are those of `numbers`."""
    origin = np.array(census.origin)
    parts = zip(numbers, blocks, strict=True)
    raster = scan_frame(frame, window, (_after(section, number, part, origin) for number, part in parts), origin)
    shown = raster.triangle.ravel() != NOTHING
    # In products and pictures what has no surface has no depth.
    nearness = np.where(raster.triangle == NOTHING, np.float32(np.nan), raster.nearness)
    if not shown.any():
        return OutputRasters(nearness, raster.triangle, TileSurface(covered=0))
    points = shown_points(frame, window_pixels(window)[shown], raster.nearness.ravel()[shown], origin)
    low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    seen = np.unique(raster.triangle.ravel()[shown] // PER_BLOCK)
    near = float(np.nanmin(nearness)), float(np.nanmax(nearness))
    surface = TileSurface(covered=int(shown.sum()), blocks=tuple(map(int, seen)), low=tuple(low), high=tuple(high), near=near)
    return OutputRasters(nearness, raster.triangle, surface)


def _after(section: AnySection, number: int, block: np.ndarray, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What the section leaves of a block, and the numbers of its triangles."""
    corners = block.reshape(-1, 3, 3)
    known = np.isfinite(corners[:, 0, 0])
    own = np.arange(number * PER_BLOCK, (number + 1) * PER_BLOCK, dtype=np.int32)
    return cut(section, corners[known], own[known], origin)
