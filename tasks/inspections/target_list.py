"""The signalised targets of one photograph, without a project."""

from orthomill.schemas.inspections.inspection import PhotoFile
from orthomill.schemas.marks import FoundTarget
from orthomill.schemas.raster import Window
from orthomill.tasks.imagery.upright import exif_orientation, upright
from orthomill.tasks.targets.photo_targets import targets_in


def targets_of_photograph(photo: PhotoFile) -> tuple[FoundTarget, ...]:
    """The targets of a photograph in pixels of its upright picture. Raises PhotoError for one that cannot be read."""
    header = photo.header
    pixels = photo.read(Window(0, 0, header.height, header.width))[..., : header.bands]
    return targets_in(upright(pixels, exif_orientation(header.tags)))
