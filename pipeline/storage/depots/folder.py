"""Results on a disk that all workers of a run see under one path."""

import os
import shutil
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import BinaryIO

from orthomill.pipeline.storage.depots.depot import FileState, KeptFile
from orthomill.pipeline.storage.whole_files import replacing
from orthomill.schemas.errors import StoreError

_BLOCK = 2**20
"""bytes that are read at a time"""
PRODUCTS = "products"
PARTS = "parts"
"""what large products are made of; gone when they are there"""
_SCRATCH = ".part"
"""how the names of temporary folders end"""


class Folder:
    """The folder of a run."""

    longest_log: int | None = None
    at_once = 1

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        self.address = str(path)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Folder) and self.address == other.address

    def __hash__(self) -> int:
        return hash(self.address)

    def state(self, name: str) -> FileState | None:
        try:
            found = os.stat(f"{self.address}/{name}")
        except (FileNotFoundError, NotADirectoryError):
            return None
        # Within one tick of the clock a file may be written twice; each time it is another one.
        return FileState(found.st_size, found.st_mtime_ns, found.st_ino)

    def size(self, name: str) -> int | None:
        path = self.path / name
        if not path.exists():
            return None
        return path.stat().st_size if path.is_file() else sum(part.stat().st_size for part in path.rglob("*") if part.is_file())

    def get(self, name: str, start: int = 0) -> bytes:
        with open(f"{self.address}/{name}", "rb") as stream:
            if start:
                stream.seek(start)
            return stream.read()

    def blocks(self, name: str) -> Iterator[bytes]:
        return blocks_of(self.path / name)

    def put(self, name: str, content: bytes) -> KeptFile:
        path = f"{self.address}/{name}"
        with replacing(Path(path)) as stream:
            stream.write(content)
        found = os.stat(path)
        return KeptFile(found.st_size, found.st_mtime_ns, zlib.crc32(content))

    def append(self, name: str, line: bytes) -> int:
        path = self.path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        # Unbuffered, in one call: what a killed process has not written whole is the last line of its file, and no line.
        with path.open("ab", buffering=0) as stream:
            before = stream.tell()
            try:
                if stream.write(line) != len(line):
                    raise OSError(28, "No space left on device")
            except OSError:
                stream.truncate(before)
                raise
            return before + len(line)

    @contextmanager
    def writing(self, name: str) -> Iterator[BinaryIO]:
        with replacing(self.path / name) as stream:
            yield stream

    def send(self, path: Path, name: str) -> None:
        with path.open("rb") as source, self.writing(name) as target:
            shutil.copyfileobj(source, target)

    def kept(self, name: str) -> KeptFile:
        path = self.path / name
        status = path.stat()
        return KeptFile(status.st_size, status.st_mtime_ns, checksum_of(path))

    def entries(self, folder: str) -> list[tuple[str, FileState]]:
        if not os.path.isdir(path := f"{self.address}/{folder}"):
            return []
        found = ((entry.name, entry.stat()) for entry in os.scandir(path) if not entry.is_dir())
        return [(name, FileState(status.st_size, status.st_mtime_ns, status.st_ino)) for name, status in found]

    def folders(self, folder: str) -> list[str]:
        path = self.path / folder
        return sorted(entry.name for entry in os.scandir(path) if entry.is_dir()) if path.is_dir() else []

    def names(self, folder: str) -> Iterator[str]:
        found = (path for path in (self.path / folder).rglob("*") if path.is_file())
        yield from sorted(path.relative_to(self.path).as_posix() for path in found)

    def delete(self, name: str) -> None:
        (self.path / name).unlink(missing_ok=True)

    def clear(self, folder: str) -> None:
        try:
            shutil.rmtree(self.path / folder)
        except FileNotFoundError:
            return

    def sweep(self) -> None:
        # zarr ends its temporary names in .partial, `replacing` in .part.
        for path in self.path.rglob("*.part*"):
            # A photograph may be called "part": then it is a folder that ends so.
            if path.suffix in {".partial", _SCRATCH} and path.is_file():
                path.unlink(missing_ok=True)

    def local(self, name: str) -> nullcontext[Path]:
        return nullcontext(self.path / name)

    def source(self, name: str) -> nullcontext[Path | BinaryIO]:
        return nullcontext(self.path / name)

    @contextmanager
    def product(self, name: str) -> Iterator[Path]:
        # Links are followed here, unlike in a workflow: a product must not be written through a link to somewhere else.
        path = (self.path / name).resolve()
        if not path.is_relative_to(self.path.resolve()):
            raise StoreError(f"The export {name} is outside the run's folder {self.path}; name a path inside it.")
        path.parent.mkdir(parents=True, exist_ok=True)
        yield path


def checksum_of(path: Path) -> int:
    """CRC-32 of a file's content. Raises OSError."""
    checksum = 0
    for block in blocks_of(path):
        checksum = zlib.crc32(block, checksum)
    return checksum


def blocks_of(path: Path) -> Iterator[bytes]:
    """A file's content in pieces. Raises OSError."""
    with path.open("rb") as stream:
        while block := stream.read(_BLOCK):
            yield block
