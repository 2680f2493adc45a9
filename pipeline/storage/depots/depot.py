"""What a run's results are kept in, as its writers and readers see it: bytes by name, written whole or not at all.

A name is a path relative to the run, with slashes. There are two depots, a folder and a bucket; nobody else touches results.
"""

from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import BinaryIO, NamedTuple, Protocol


class KeptFile(NamedTuple):
    """A file as it was when its job ended: `size` bytes, `changed` as in its `FileState`, `checksum` CRC-32 of its content."""

    size: int
    changed: int
    checksum: int


class FileState(NamedTuple):
    """What can be seen of a file without reading it: `size` bytes, and when it changed.

    `changed` is ns since 1970 in a folder, in a bucket a number made from what the store calls this version of the object;
    `version` differs whenever the file was written again.
    """

    size: int
    changed: int
    version: str | int


class Depot(Protocol):
    """A place for the results of one run."""

    @property
    def address(self) -> str:
        """For sentences: a path, or the address of a prefix; never holds a key or a password."""

    @property
    def longest_log(self) -> int | None:
        """Bytes after which a log goes on under another name, since every line writes all of it; None where lines are appended."""

    @property
    def at_once(self) -> int:
        """Requests that it answers at a time, where an answer is waited for: 1 for a disk."""

    def __hash__(self) -> int:
        """What was read is kept in memory by depot, name and state."""

    def state(self, name: str) -> FileState | None:
        """None where there is no such file."""

    def size(self, name: str) -> int | None:
        """Bytes of a file, or of all files of a folder; None where there is neither."""

    def get(self, name: str, start: int = 0) -> bytes:
        """A file's content from a byte on. Raises FileNotFoundError, OSError."""

    def blocks(self, name: str) -> Iterator[bytes]:
        """A file's content in pieces. Raises FileNotFoundError, OSError."""

    def put(self, name: str, content: bytes) -> KeptFile:
        """Write a file whole. Raises OSError."""

    def append(self, name: str, line: bytes) -> int:
        """Add a line to a file that this process alone writes; returns the file's size. Raises OSError."""

    def writing(self, name: str) -> AbstractContextManager[BinaryIO]:
        """A stream whose content becomes the file when it ends without an error. Raises OSError."""

    def send(self, path: Path, name: str) -> None:
        """Copy a file of this machine into the depot. Raises OSError."""

    def kept(self, name: str) -> KeptFile:
        """What a file that was just written is like. Raises OSError."""

    def entries(self, folder: str) -> list[tuple[str, FileState]]:
        """Files that lie directly in a folder: (name without the folder, state)."""

    def folders(self, folder: str) -> list[str]:
        """Names of the folders that lie directly in a folder, sorted."""

    def names(self, folder: str) -> Iterator[str]:
        """All files below a folder."""

    def delete(self, name: str) -> None:
        """Remove a file, where there is one."""

    def clear(self, folder: str) -> None:
        """Remove a folder with all that is in it, where there is one. Raises OSError."""

    def sweep(self) -> None:
        """Remove what a killed process was writing. Nothing may be writing now."""

    def local(self, name: str) -> AbstractContextManager[Path]:
        """A path under which other libraries read the file. Raises FileNotFoundError, OSError."""

    def source(self, name: str) -> AbstractContextManager[Path | BinaryIO]:
        """A file for a library that reads paths and streams alike, a table above all. Raises FileNotFoundError, OSError."""

    def product(self, name: str) -> AbstractContextManager[Path]:
        """A path that other libraries write, with what they put beside it; kept when all is there. Raises StoreError, OSError."""
