"""What all tiles rest on: the block, the mesh, the photographs that take part, and the parts of these that show a surface."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orthomill.schemas.orientation import Block
from orthomill.schemas.photo import Photos
from orthomill.schemas.raster import Window
from orthomill.schemas.solid.census import MeshCensus
from orthomill.schemas.solid.frames import AnyFrame, ViewFrame
from orthomill.tasks.colouring.sampling.photo_levels import photo_source
from orthomill.tasks.colouring.sight.output_tile import ideal_part, photo_part
from orthomill.tasks.geometry.photograph_part import PhotoPart
from orthomill.tasks.geometry.view import View, block_view
from orthomill.tasks.visibility.mesh_blocks import MeshBlocks, TileSurface
from orthomill.tasks.visibility.output_frame import ideal_window

Place = np.ndarray
"""(3,) m, in the system of the block"""


@dataclass(frozen=True, eq=False)
class ProjectionBasis:
    """The block and its photographs `names`, the mesh and its blocks, the side of tiles (px)."""

    block: Block
    photos: Photos
    names: tuple[str, ...]
    census: MeshCensus
    blocks: MeshBlocks
    tile: int
    crs: str

    @cached_property
    def origin(self) -> np.ndarray:
        """(3,) m"""
        return np.array(self.census.origin)

    @cached_property
    def views(self) -> dict[str, View]:
        """The photographs that take part."""
        return {name: block_view(self.block, name) for name in self.names}

    @cached_property
    def ideal(self) -> dict[str, Window]:
        """Their windows without distortion."""
        return {name: ideal_window(view.camera) for name, view in self.views.items()}

    def middle_of(self, surface: TileSurface) -> Place:
        """The middle of a surface."""
        return np.asarray(0.5 * np.add(surface.low, surface.high) + self.origin)

    def middle_of_all(self, surfaces: Iterable[TileSurface]) -> Place:
        """The middle of what several tiles show; the mesh's where they show nothing."""
        shown = [surface for surface in surfaces if surface.covered]
        if not shown:
            return np.asarray(self.census.middle)
        low = np.min([surface.low for surface in shown], axis=0)
        return np.asarray(0.5 * (low + np.max([surface.high for surface in shown], axis=0)) + self.origin)

    def photo_parts(self, names: Sequence[str], surface: TileSurface, middle: Place, wanted: float) -> tuple[PhotoPart, ...]:
        """The parts of photographs that show a surface, at the level whose pixels are about `wanted` m large at `middle`."""
        found = []
        for name in names:
            view = self.views[name]
            source = photo_source(view, self.photos[name], _pixel_at(middle, view.centre, view.camera.c), wanted)
            found.append(photo_part(source, surface, self.origin))
        return tuple(part for part in found if part is not None)

    def ideal_parts(self, names: Sequence[str], surface: TileSurface) -> tuple[PhotoPart, ...]:
        """The parts of their pictures without distortion that show a surface."""
        found = (ideal_part(self.views[name], surface, self.ideal[name], self.origin) for name in names)
        return tuple(part for part in found if part is not None)


def frame_pixel(frame: AnyFrame, middle: Place) -> float:
    """Side of a pixel of an output on a surface with this middle, m."""
    return _pixel_at(middle, frame.centre, frame.camera.c) if isinstance(frame, ViewFrame) else frame.pixel


def _pixel_at(place: np.ndarray, centre: Sequence[float] | np.ndarray, c: float) -> float:
    return float(np.linalg.norm(place - centre)) / c
