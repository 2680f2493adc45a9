"""Which photographs colour the surface, where their masks lie, and which of them are left out to prove the block."""

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import PurePosixPath
from typing import Annotated, Literal

from pydantic import Field

from orthomill.schemas.errors import WorkflowError, some_of
from orthomill.schemas.job import PhotoPixels, Raster
from orthomill.schemas.photo import Photos
from orthomill.schemas.raster import Window
from orthomill.schemas.settings import Settings, setting


class NoMasks(Settings):
    """All pixels of the photographs may be used."""

    kind: Literal["none"]


class MaskFolder(Settings):
    """Images of the size and name of the photographs; black is not used: sky, people, the rim of a scan, a moving platform."""

    kind: Literal["folder"]
    path: str = setting(..., "Folder with the masks; a photograph without one is used whole.")


class BorderMasks(Settings):
    """Black borders of the photographs, found: beside an undistorted, scanned or rotated picture."""

    kind: Literal["borders"] = "borders"


@dataclass(frozen=True)
class PhotographMask:
    """Where the mask of a photograph is: an image `file`, or a `raster`."""

    file: str = ""
    raster: str = ""

    def region(self, window: Window) -> PhotoPixels | Raster:
        """What a job reads of it."""
        return PhotoPixels(self.file, window) if self.file else Raster(self.raster, window)


class NoLeaveOneOut(Settings):
    """No photograph is made again from the others."""

    kind: Literal["none"]


class LeaveOneOut(Settings):
    """Every photograph is made again from the others and compared."""

    kind: Literal["photographs"] = "photographs"
    most: int = setting(30, "Photographs beyond which only so many, spread evenly over the block, are left out.", ge=1, le=1000)
    pixels: int = setting(500_000, "Most pixels of a picture: the level of the photograph's pyramid follows.", "px", ge=10_000)


Masks = Annotated[NoMasks | MaskFolder | BorderMasks, Field(discriminator="kind")]
LeavingOut = Annotated[NoLeaveOneOut | LeaveOneOut, Field(discriminator="kind")]


def taking_part(names: Sequence[str], without: Sequence[str]) -> tuple[str, ...]:
    """Those of the oriented photographs whose name matches none of the shell patterns `without`. Raises WorkflowError for a pattern
    that matches nothing, and where no photograph is left."""
    idle = [pattern for pattern in without if not any(fnmatchcase(name, pattern) for name in names)]
    if idle:
        raise WorkflowError(
            f"projection.without names {some_of(idle)}, but no oriented photograph is called so; there are {some_of(names)}."
        )
    left = tuple(name for name in names if not any(fnmatchcase(name, pattern) for pattern in without))
    if not left:
        raise WorkflowError(f"projection.without leaves none of the {len(names)} oriented photographs; the surface needs some.")
    return left


def masks_of(files: Sequence[str], photos: Photos, names: Sequence[str]) -> dict[str, PhotographMask]:
    """photograph -> its mask among `files`. Raises WorkflowError for masks of photographs that are rotated by their EXIF flag."""
    found = {PurePosixPath(file).stem: file for file in files}
    masks = {name: found[name] for name in names if name in found}
    rotated = [name for name in masks if photos[name].exif_orientation != 1]
    if rotated:
        raise WorkflowError(
            f"The masks of {some_of(rotated)} cannot be used: these photographs are rotated by an EXIF flag. Rotate the files "
            "themselves, or leave the photographs out (`without`)."
        )
    return {name: PhotographMask(file=file) for name, file in masks.items()}


def left_out_names(names: Sequence[str], most: int) -> tuple[str, ...]:
    """At most `most` photographs, spread evenly."""
    step = max(len(names) / most, 1.0)
    return tuple(names[int(k * step)] for k in range(min(len(names), most)))
