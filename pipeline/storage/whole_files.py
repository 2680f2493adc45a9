"""Files that are written whole: a reader sees the old one or the new one, never a part."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from orthomill.schemas.errors import StoreError

_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL


def write_whole(path: Path, data: bytes | memoryview) -> None:
    """Write a file so that a reader sees the old one or the new one, never a part. Raises StoreError."""
    with whole_file(path) as stream:
        stream.write(data)


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """A file to be written that takes the place of `path` when it is complete. Raises StoreError."""
    try:
        with replacing(path) as stream:
            yield stream
    except OSError as error:
        raise StoreError(
            f"{path} cannot be written: {error.strerror}; make room on the disk or make the folder writable, then run again."
        ) from error


@contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """A file to be written that takes the place of `path` when it is complete. Raises OSError."""
    # In the same folder, since renaming is atomic only within one file system; the suffix is what `Store.sweep` removes.
    temporary = f"{path.parent}/.{secrets.token_hex(8)}.part"
    try:
        handle = os.open(temporary, _NEW, 0o666)
    except FileNotFoundError:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(temporary, _NEW, 0o666)
    try:
        with os.fdopen(handle, "wb") as stream:
            yield stream
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
