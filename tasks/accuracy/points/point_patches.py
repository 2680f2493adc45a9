"""Which parts of which photographs show a marked point, for its place in an orthoimage."""

from collections.abc import Iterator
from dataclasses import dataclass

from orthomill.schemas.observations import ControlPoint
from orthomill.schemas.orientation import Block
from orthomill.schemas.photo import Photos
from orthomill.schemas.raster import Window
from orthomill.tasks.accuracy.points.orthoimage_place import level_for, patch_window
from orthomill.tasks.geometry.view import block_view
from orthomill.tasks.imagery.pyramid import level_shape


@dataclass(frozen=True)
class PatchPlace:
    """A patch that is read: photograph, level of its pyramid and window there."""

    photo: str
    level: int
    window: Window


def patches_of(point: ControlPoint, block: Block, photos: Photos, cell: float) -> Iterator[PatchPlace]:
    """The patches about the marks of a point, at the level that fits pixels of `cell` m."""
    for photo in sorted(point.measurements):
        if photo not in block.names:
            continue
        known, seen = photos[photo], block_view(block, photo)
        level = level_for(seen, point.xyz, cell, known.levels)
        shape = level_shape((known.height, known.width), level)
        window = patch_window(seen, point.measurements[photo], point.xyz, cell, level).clipped(shape)
        if not window.empty:
            yield PatchPlace(photo, level, window)
