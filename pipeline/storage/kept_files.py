"""The files that a job left on the disk: what they were like when it ended, and whether they still are.

A file counts as whole while its size and time of change are as recorded, which costs one question to the file system. Where the
time differs (a copy of the project, or damage), and whenever somebody asks for a thorough check, its checksum decides.
"""

import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Literal, NamedTuple

_BLOCK = 2**20
"""bytes that are read at a time"""


class KeptFile(NamedTuple):
    """A file as it was when its job ended: `size` bytes, `changed` ns since 1970, `checksum` CRC-32 of its content."""

    size: int
    changed: int
    checksum: int


Defect = Literal["missing", "damaged"]
KeptFiles = Mapping[str, KeptFile]
"""by path relative to the run's folder"""


def keep(folder: Path, paths: Iterable[Path], checksums: Mapping[Path, int] | None = None) -> dict[str, KeptFile]:
    """What files of the run's folder are like. `checksums` of those of which they are known need not be read. Raises OSError."""
    known = checksums or {}
    return {path.relative_to(folder).as_posix(): _state(path, known.get(path)) for path in paths}


def _state(path: Path, checksum: int | None) -> KeptFile:
    status = path.stat()
    return KeptFile(status.st_size, status.st_mtime_ns, _checksum(path) if checksum is None else checksum)


def _checksum(path: Path) -> int:
    checksum = 0
    with path.open("rb") as stream:
        while block := stream.read(_BLOCK):
            checksum = zlib.crc32(block, checksum)
    return checksum


def defect_of(path: Path, kept: KeptFile, thoroughly: bool) -> Defect | None:
    """What is wrong with a file, None when it is whole; `thoroughly`: its content is read in any case. Raises OSError."""
    try:
        status = path.stat()
        if status.st_size != kept.size:
            return "damaged"
        unchanged = status.st_mtime_ns == kept.changed and not thoroughly
        return None if unchanged or _checksum(path) == kept.checksum else "damaged"
    except (FileNotFoundError, NotADirectoryError):
        return "missing"


def first_defect(folder: Path, files: KeptFiles, thoroughly: bool = False) -> tuple[str, Defect] | None:
    """The first of a job's files that is not whole, and what is wrong with it. Raises OSError."""
    for name, kept in files.items():
        if defect := defect_of(folder / name, kept, thoroughly):
            return name, defect
    return None
