"""Which level of a photograph's pyramid colours a surface: the one whose pixels on it are nearest to those that are wanted."""

from orthomill.schemas.photo import Photo
from orthomill.tasks.geometry.photograph_part import PhotoSource, photo_level
from orthomill.tasks.geometry.view import View
from orthomill.tasks.imagery.pyramid import level_shape


def photo_source(view: View, photo: Photo, pixel: float, wanted: float) -> PhotoSource:
    """A photograph whose pixels are `pixel` m large on the surface, at the level where they are about `wanted` m."""
    level = photo_level(wanted, pixel, photo.levels)
    return PhotoSource(view, level, level_shape((photo.height, photo.width), level))
