"""The photographs of a folder, and what else lies there and is left out.

Memory cards hold folders named by the camera (`DCIM/100MEDIA`, `101MEDIA`), which are looked into when the workflow says so. Links
to photographs are followed and links to folders below the first are not, so that no loop is endless and nothing is found twice.
What a person may take for a photograph and is not read is counted by kind: no flight loses half of its photographs without a word.
"""

import fnmatch
import os
import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath

from orthomill.pipeline.storage.file_names import shown
from orthomill.pipeline.storage.photographs.file_kinds import (
    DEVELOPED_SUFFIXES,
    RAW_SUFFIXES,
    SPEECH,
    Kind,
    is_link_text,
    kind_of_file,
)
from orthomill.schemas.errors import WorkflowError, some_of
from orthomill.schemas.project import MaskFiles, PhotoFiles, PhotoFolder
from orthomill.schemas.survey_files.photograph_masks import is_named_mask, masked_photograph

_CARD = re.compile(r"DCIM|\d{3}[A-Z0-9_]{5}", re.IGNORECASE)
"""Folders of a memory card (JEITA CP-3461, DCF 2.0, 3.2): DCIM, and in it 100MEDIA, 101_0002, 100CANON."""
_DEEPEST, _MOST_ENTRIES = 8, 200_000
"""levels of folders, and entries in all of them: more is a disk and no flight"""


@dataclass(frozen=True)
class Listing:
    """Photographs as paths relative to the project's root, sorted; what was left out by kind, and the folders that were not looked
    into, as paths below the folder."""

    files: tuple[str, ...]
    left_out: dict[Kind, tuple[str, ...]]
    closed: tuple[str, ...]


@dataclass
class _Search:
    """One look through a folder and those below it that `folders` opens; what was found so far."""

    top: Path
    folders: str
    found: list[Path] = field(default_factory=list)
    left: dict[Kind, list[str]] = field(default_factory=lambda: defaultdict(list))
    closed: list[str] = field(default_factory=list)
    entries: int = 0

    def look(self, folder: Path, depth: int = 0) -> None:
        for entry in self._entries(folder):
            path = Path(entry.path)
            if not entry.is_dir():
                self._file(path, entry.is_file())
            elif not entry.name.startswith("."):
                self._folder(path, entry.is_symlink(), depth)

    def _entries(self, folder: Path) -> list[os.DirEntry[str]]:
        try:
            with os.scandir(folder) as entries:
                found = sorted(entries, key=lambda entry: entry.name)
        except OSError:
            if folder == self.top:
                raise
            self.left[Kind.UNREADABLE].append(self._name(folder))
            return []
        self.entries += len(found)
        if self.entries > _MOST_ENTRIES and folder != self.top:
            raise WorkflowError(
                f"{shown(self.top)} holds more than {_MOST_ENTRIES} files in folders below; give that of one flight."
            )
        return found

    def _folder(self, path: Path, is_link: bool, depth: int) -> None:
        of_card = _CARD.fullmatch(path.name) is not None
        opened = self.folders == "all" or (self.folders == "card" and of_card)
        if is_link and (opened or of_card):
            self.left[Kind.LINKED_FOLDER].append(self._name(path))
        elif opened and depth < _DEEPEST:
            self.look(path, depth + 1)
        elif not is_link:
            self.closed.append(self._name(path))

    def _file(self, path: Path, exists: bool) -> None:
        kind = kind_of_file(path.name)
        if kind is Kind.PHOTOGRAPH and exists and not is_link_text(path):
            self.found.append(path)
        elif kind is Kind.PHOTOGRAPH:
            self.left[Kind.BROKEN_LINK].append(self._name(path))
        elif kind is not Kind.OTHER:
            self.left[kind].append(self._name(path))

    def _name(self, path: Path) -> str:
        return path.relative_to(self.top).as_posix()


def list_folder(root: Path, source: PhotoFolder) -> Listing:
    """The photographs of a folder, whose path is relative to `root`. Raises WorkflowError when it cannot be read."""
    search = _Search(root / source.path, source.folders)
    try:
        search.look(search.top)
    except OSError as error:
        raise WorkflowError(f"The folder {source.path} cannot be read ({error.strerror}); correct its path.") from error
    names = {path: _readable(path, search.top) for path in search.found}
    beside = _raw_beside(search.found)
    search.left[Kind.RAW_BESIDE] += sorted(names[path] for path in beside)
    masks = _masks_beside(search.found)
    if source.masks is None:
        search.left[Kind.MASK] += sorted(names[path] for path in masks)
    files = sorted((PurePosixPath(source.path) / names[path]).as_posix() for path in search.found if path not in beside | masks)
    return Listing(tuple(files), {kind: tuple(left) for kind, left in search.left.items() if left}, tuple(search.closed))


def with_those_below(root: Path, source: PhotoFolder, listing: Listing) -> Listing:
    """The listing with the photographs of the folders that were not looked into among what was left out."""
    below: list[str] = []
    for folder in listing.closed:
        try:
            inside = list_folder(root, PhotoFolder(kind="folder", path=f"{source.path}/{folder}", folders="all"))
        except WorkflowError:  # a disk, or nothing that one may read: nobody expects photographs of this flight there
            continue
        below += [PurePosixPath(file).relative_to(source.path).as_posix() for file in inside.files]
    return replace(listing, left_out={**listing.left_out, **({Kind.BELOW: tuple(below)} if below else {})})


def _raw_beside(found: list[Path]) -> set[Path]:
    """Raw files with a developed photograph of the same name beside them: cameras write both of one exposure."""
    developed = {path.with_suffix("") for path in found if path.suffix.lower() in DEVELOPED_SUFFIXES}
    return {path for path in found if path.suffix.lower() in RAW_SUFFIXES and path.with_suffix("") in developed}


def _masks_beside(found: list[Path]) -> set[Path]:
    """Files that are named as masks of others in their folder."""
    named = {path for path in found if is_named_mask(path.name)}
    photographs = {(path.parent, path.stem.lower()) for path in found if path not in named}
    return {path for path in named if (path.parent, masked_photograph(path.name)) in photographs}


def _readable(path: Path, top: Path) -> str:
    """The name of a file below `top`. Raises WorkflowError when it is not text: no table could hold it."""
    name = path.relative_to(top).as_posix()
    try:
        name.encode()
    except UnicodeEncodeError:
        raise WorkflowError(
            f"The photograph {shown(path)} has a name that is not UTF-8 text; rename it with letters that this system can show."
        ) from None
    return name


def image_files(root: Path, source: PhotoFiles | MaskFiles) -> tuple[str, ...]:
    """The image files of a folder or a list, relative to `root`, sorted by name. Raises WorkflowError when there are none."""
    if source.kind == "list":
        return tuple(sorted(source.paths))
    if source.kind == "masks":
        return _mask_files(root, source)
    listing = list_folder(root, source)
    chosen = tuple(path for path in listing.files if fnmatch.fnmatchcase(PurePosixPath(path).name, source.pattern))
    if not chosen:
        raise WorkflowError(_no_images(source, listing, root))
    return chosen


def _mask_files(root: Path, source: MaskFiles) -> tuple[str, ...]:
    """The masks of a folder: those beside photographs or, where none are named so, all of its images."""
    listing = list_folder(root, PhotoFolder(kind="folder", path=source.path, folders="all"))
    masks = tuple((PurePosixPath(source.path) / name).as_posix() for name in listing.left_out.get(Kind.MASK, ()))
    if not (masks or listing.files):
        raise WorkflowError(f"The folder {source.path} contains no masks (JPEG, TIFF or PNG images); correct photographs > masks.")
    return masks or listing.files


def _no_images(source: PhotoFolder, listing: Listing, root: Path) -> str:
    if listing.files:
        return (
            f"None of the {len(listing.files)} images in {source.path} matches the pattern '{source.pattern}'; the pattern '*' "
            "matches all."
        )
    lines = left_out_lines(with_those_below(root, source, listing))
    advice = f"The folder {source.path} contains no JPEG, TIFF or PNG images; put the photographs there or correct the path."
    return " ".join((advice, *lines))


def left_out_lines(listing: Listing) -> Iterator[str]:
    """One sentence for each kind of what was left out."""
    for kind, (one, several, advice) in SPEECH.items():
        if names := listing.left_out.get(kind):
            yield f"Left out: {len(names)} {one if len(names) == 1 else several} ({some_of(names, 3)}); {advice}."
