"""What a job on a tile of an output has at hand: the tile, blocks of the mesh, parts of photographs. Found while planning.

A box about the surface that a tile shows tells which part of each photograph shows it; the squares of the photograph tell which
blocks of the mesh are drawn there. So a job reads what its tile needs, whatever the sizes of mesh and photographs are.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from orthomill.schemas.raster import Window
from orthomill.schemas.solid.frames import AnyFrame, FlatFrame, ViewFrame
from orthomill.tasks.geometry.photograph_part import PhotoPart, PhotoSource, level_window
from orthomill.tasks.geometry.view import View
from orthomill.tasks.visibility.mesh_blocks import TileSurface
from orthomill.tasks.visibility.output_frame import frame_view, ideal_window, moved, plane_projection


class PhotographsAtHand(Protocol):
    """Which photographs may take part in a job, and which parts of them it holds."""

    @property
    def names(self) -> tuple[str, ...]:
        """All that may take part."""

    @property
    def parts(self) -> tuple[PhotoPart, ...]:
        """Windows of them, in the order of the arrays."""

    @property
    def zones(self) -> tuple[PhotoPart, ...]:
        """Windows of their limit zones, or of masks where those are read."""


@dataclass(frozen=True)
class OutputTile:
    """Pixels `window` of a frame; `blocks`: numbers of the blocks at hand; `names` of the photographs that may take part; `parts`:
    windows of photographs, in the order of the arrays; `zones`: of their limit zones, and of masks where those are read."""

    frame: AnyFrame
    window: Window
    blocks: tuple[int, ...]
    names: tuple[str, ...]
    parts: tuple[PhotoPart, ...] = ()
    zones: tuple[PhotoPart, ...] = ()

    def with_parts(self, parts: tuple[PhotoPart, ...], zones: tuple[PhotoPart, ...] = ()) -> "OutputTile":
        """The tile with windows of photographs."""
        return replace(self, parts=parts, zones=zones)


def blocks_of_photograph(view: View, boxes: np.ndarray, origin: np.ndarray) -> tuple[int, ...]:
    """Blocks, of boxes with corners (blocks, 8, 3), that may be in the picture of a view, or near it without distortion."""
    return _numbers(~_beside(moved(view, origin), boxes, ideal_window(view.camera)))


def blocks_of_window(frame: AnyFrame, window: Window, boxes: np.ndarray, origin: np.ndarray) -> tuple[int, ...]:
    """Blocks, of boxes with corners (blocks, 8, 3), that may be in a window of a frame; too many do no harm."""
    if isinstance(frame, ViewFrame):
        return _numbers(~_beside(frame_view(frame, origin), boxes, ideal_window(frame.camera, window)))
    if not isinstance(frame, FlatFrame):
        return tuple(range(len(boxes)))
    matrix = plane_projection(frame, origin).matrix[:2]
    placed = boxes @ matrix[:, :3].T + matrix[:, 3]
    first, last = (window.col, window.row), (window.col + window.width - 1, window.row + window.height - 1)
    return _numbers(((placed.max(axis=1) >= first) & (placed.min(axis=1) <= last)).all(axis=1))


def _numbers(chosen: np.ndarray) -> tuple[int, ...]:
    return tuple(np.flatnonzero(chosen).tolist())


def _beside(view: View, boxes: np.ndarray, window: Window) -> np.ndarray:
    """bool (N,): boxes (N, 8, 3) that are behind a view or beside a window of its ideal picture."""
    u = (boxes - view.centre) @ view.rotation.T
    depth, n = -u[..., 2], view.numbers
    # A side of the window is a plane through the centre: the box is beside it where all corners are.
    left, right = (window.col - n.col0) / n.c, (window.col + window.width - n.col0) / n.c
    top, bottom = (n.row0 - window.row) / n.c, (n.row0 - window.row - window.height) / n.c
    x, y = u[..., 0], u[..., 1]
    sides = depth <= 0, x < left * depth, x > right * depth, y > top * depth, y < bottom * depth
    return np.asarray(np.any([side.all(axis=1) for side in sides], axis=0))


def photo_part(source: PhotoSource, surface: TileSurface, origin: np.ndarray, margin: int = 4) -> PhotoPart | None:
    """The part of a photograph's level that shows a box about a surface; None where it does not."""
    camera = source.view.camera
    view = moved(source.view, origin)
    window = _shown(view, surface.box.corners, ideal=False)
    if window is None:
        return None
    whole = window.grown(margin * 2**source.level).clipped((camera.height, camera.width))
    part = level_window(whole, source.level, source.shape)
    return None if part.empty or whole.empty else PhotoPart(source.view.name, source.level, part)


def ideal_part(view: View, surface: TileSurface, whole: Window, origin: np.ndarray, margin: int = 3) -> PhotoPart | None:
    """The part of a photograph without distortion, within its ideal window `whole`, that shows a box about a surface."""
    window = _shown(moved(view, origin), surface.box.corners, ideal=True)
    if window is None:
        return None
    inner = window.grown(margin).within(whole).clipped(whole.shape)
    if inner.empty:
        return None
    return PhotoPart(view.name, 0, Window(inner.row + whole.row, inner.col + whole.col, inner.height, inner.width))


def _shown(view: View, corners: np.ndarray, ideal: bool) -> Window | None:
    """Pixels about the image of a box (8, 3): the whole photograph where part of the box is beside the camera; None behind it."""
    u = (corners - view.centre) @ view.rotation.T
    depth = -u[:, 2]
    if (depth <= 0).all():
        return None
    size = float(np.abs(corners[-1] - corners[0]).max())
    camera = view.camera
    if depth.min() <= 0.05 * size:
        return Window(-camera.height, -camera.width, 3 * camera.height, 3 * camera.width)
    n = view.numbers
    x, y = u[:, 0] / depth, u[:, 1] / depth
    if ideal:
        col, row = n.col0 + n.c * x, n.row0 - n.c * y
    else:
        # Points along the edges and inside: distortion bends their images outwards. Not beyond the field, where it folds back.
        field = ideal_window(camera)
        x = np.clip(x, (field.col - n.col0) / n.c, (field.col + field.width - n.col0) / n.c)
        y = np.clip(y, (n.row0 - field.row - field.height) / n.c, (n.row0 - field.row) / n.c)
        xs, ys = np.meshgrid(np.linspace(x.min(), x.max(), 9), np.linspace(y.min(), y.max(), 9))
        rays = np.column_stack([xs.ravel(), ys.ravel(), np.full(xs.size, -1.0)]) @ view.rotation
        col, row = view.project(view.centre + rays).T
    left, top = (int(np.floor(np.clip(values.min(), -1e8, 1e8))) for values in (col, row))
    right, bottom = (int(np.ceil(np.clip(values.max(), -1e8, 1e8))) for values in (col, row))
    return Window(top, left, bottom - top + 1, right - left + 1)


def union_of(numbers: Iterable[Iterable[int]]) -> tuple[int, ...]:
    """All numbers, once, ascending."""
    return tuple(sorted(set().union(*numbers)))
