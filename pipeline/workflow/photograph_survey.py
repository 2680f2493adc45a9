"""What a folder of photographs contains, by its names and the headers of its files: no pixels are read.

A folder outside of the project gets a link `photographs/<name>` inside it. Workflows name nothing outside of the project: what a
person names on the command line is the one thing that is linked in, and it is only read.
"""

import os
import statistics
from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from orthomill.pipeline.storage.file_names import shown
from orthomill.pipeline.storage.image_files import header_or_fault
from orthomill.pipeline.storage.photographs.file_kinds import Kind
from orthomill.pipeline.storage.photographs.folder_listing import (
    Listing,
    image_files,
    left_out_lines,
    list_folder,
    with_those_below,
)
from orthomill.pipeline.workflow.camera_tags import camera_name, focal_mm, longitude_latitude
from orthomill.pipeline.workflow.lying_beside import NOTHING, Beside, look_beside
from orthomill.schemas.errors import PhotoError, StoreError, WorkflowError, first_of
from orthomill.schemas.maps.map_scale import utm_zone
from orthomill.schemas.photo import Header
from orthomill.schemas.project import MaskFiles, PhotoFolder
from orthomill.schemas.survey_files.photograph_masks import masked_photograph

LINKS = "photographs"
"""folder of the project that holds links to folders of photographs outside of it"""


@dataclass(frozen=True)
class Survey:
    """What the headers of a folder of photographs contain, and what lies beside them."""

    source: PhotoFolder
    headers: tuple[Header, ...]
    beside: Beside = NOTHING
    left_out: tuple[str, ...] = ()
    """a sentence for each kind of file that is no photograph which can be read"""
    linked: Path | None = None
    """the folder outside of the project that its folder of photographs is a link to"""

    @property
    def folder(self) -> str:
        """The folder of photographs, as the workflow names it."""
        return self.source.path

    @cached_property
    def cameras(self) -> Counter[str]:
        """Number of photographs by the camera they name."""
        return Counter(name for header in self.headers if (name := camera_name(header)))

    @cached_property
    def focal_lengths(self) -> Counter[float]:
        """Number of photographs by focal length in mm."""
        return Counter(length for header in self.headers if (length := focal_mm(header.tags)))

    @cached_property
    def places(self) -> tuple[tuple[float, float], ...]:
        """Longitude and latitude in degrees of the photographs that have them."""
        return tuple(place for header in self.headers if (place := longitude_latitude(header.tags)))

    @property
    def utm(self) -> str | None:
        """The UTM zone of the middle of the photographs, if any of them has a position."""
        if not self.places:
            return utm_zone(*self.beside.site) if self.beside.site else None
        # The median ignores single photographs taken before the receiver had a fix, or elsewhere.
        longitudes, latitudes = zip(*self.places, strict=True)
        return utm_zone(statistics.median(longitudes), statistics.median(latitudes))

    @property
    def placeless(self) -> bool:
        """Whether nothing is known of the place of the photographs: any system in metres will do."""
        return not (self.places or self.beside.positions or self.beside.control)

    @property
    def without_focal(self) -> int:
        """Number of photographs without a focal length."""
        return len(self.headers) - self.focal_lengths.total()


def survey_photographs(photos: Path, root: Path) -> Survey:
    """Read the headers of all photographs of a folder; one outside of `root` is linked into it. Raises WorkflowError, or PhotoError
    where no file is a photograph that can be used."""
    folder, linked = _inside(photos, root)
    return replace(survey_folder(folder, root), linked=linked)


def survey_folder(folder: str, root: Path) -> Survey:
    """Read the headers of all photographs of a folder, which may lie outside of the root. Raises WorkflowError, or PhotoError where
    no file is a photograph that can be used. Others are among the headers, with what is wrong with them."""
    source = _with_masks(_source(folder, root), root)
    files = image_files(root, source)
    headers = [header_or_fault(root / file).model_copy(update={"path": file}) for file in files]
    sound = [header for header in headers if not header.unusable]
    if len(sound) < 2:
        faults = [f"{header.path} {header.unusable}." for header in headers if header.unusable]
        if not sound:
            raise PhotoError(first_of(faults))
        only = f"{sound[0].path} is the only photograph in {shown(Path(folder))} that can be used"
        advice = "heights come from overlap, so at least two photographs of the same ground are needed."
        raise WorkflowError(first_of([f"{only}; {advice}", *faults]))
    # The same way as `_inside`: a link inside of the project is no way out of it.
    top = Path(os.path.abspath(root))
    names = tuple(Path(header.path).stem for header in sound)
    beside = look_beside(top / folder, top, {(h.width, h.height) for h in sound}, names)
    left_out = left_out_lines(with_those_below(root, source, list_folder(root, source)))
    return Survey(source, tuple(headers), beside, tuple(left_out))


def _source(folder: str, root: Path) -> PhotoFolder:
    """The folder, and which of those below it belong to it: those of a memory card, or all where nothing else holds photographs."""
    card = PhotoFolder(kind="folder", path=folder, folders="card")
    found = list_folder(root, card)
    if not found.files:
        whole = card.model_copy(update={"folders": "all"})
        return whole if _files(root, whole, found) else card
    return card if any("/" in _below(file, folder) for file in found.files) else card.model_copy(update={"folders": "none"})


def _with_masks(source: PhotoFolder, root: Path) -> PhotoFolder:
    """With the masks beside the photographs, or those of a folder `masks` in theirs or beside it, if any is named like one."""
    listing = list_folder(root, source)
    if Kind.MASK in listing.left_out:
        return source.model_copy(update={"masks": source.path})
    names = {masked_photograph(file) for file in listing.files}
    for folder in (f"{source.path}/masks", f"{Path(source.path).parent.as_posix()}/masks"):
        if (root / folder).is_dir() and names & {masked_photograph(file) for file in _masks_in(root, folder)}:
            return source.model_copy(update={"masks": Path(folder).as_posix()})
    return source


def _masks_in(root: Path, folder: str) -> tuple[str, ...]:
    try:
        return image_files(root, MaskFiles(path=folder))
    except WorkflowError:  # no masks in it
        return ()


def _files(root: Path, source: PhotoFolder, found: Listing) -> bool:
    return bool(found.closed) and bool(list_folder(root, source).files)


def _below(file: str, folder: str) -> str:
    return Path(file).relative_to(folder).as_posix()


def _inside(photos: Path, root: Path) -> tuple[str, Path | None]:
    """The folder relative to the root, and where it is linked to if it lies outside; links are not followed, so that a link inside
    the project is accepted."""
    # normpath and not resolve: resolving would follow the link and lead out of the project again.
    top = Path(os.path.abspath(root))
    folder = Path(os.path.normpath(top / photos))
    if not folder.is_dir():
        raise WorkflowError(f"The folder of photographs {photos} does not exist; give an existing one with --photos.")
    if folder.is_relative_to(top):
        return folder.relative_to(top).as_posix(), None
    return _linked(folder, top).relative_to(top).as_posix(), folder


def _linked(folder: Path, top: Path) -> Path:
    """A link to a folder, in the project; the one that is there already if it leads to it."""
    name, number = folder.name or "disk", 1
    link = top / LINKS / name
    while os.path.lexists(link):
        if link.is_symlink() and link.resolve() == folder.resolve():
            return link
        number += 1
        link = top / LINKS / f"{name}_{number}"
    try:
        link.parent.mkdir(exist_ok=True)
        link.symlink_to(folder, target_is_directory=True)
    except OSError as error:
        raise StoreError(
            f"{shown(link)} cannot be made, a link to {folder} ({error.strerror}); copy the photographs into the project's folder."
        ) from error
    return link
