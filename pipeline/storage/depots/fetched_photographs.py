"""Photographs that lie in an object store: brought to this machine once, with the lists and masks beside them.

What is there already, with the bytes and the time of the object, is not fetched again; a file is there whole or not at all.
"""

import os
import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from orthomill.pipeline.storage.depots.bucket import Bucket, bucket_of
from orthomill.pipeline.storage.photographs.file_kinds import FOREIGN_SUFFIXES, LIST_SUFFIXES, PHOTOGRAPH_SUFFIXES
from orthomill.schemas.errors import ResourceError, StoreError, WorkflowError
from orthomill.schemas.memory import GIB

_WANTED = PHOTOGRAPH_SUFFIXES | LIST_SUFFIXES | FOREIGN_SUFFIXES
_AT_ONCE = 8
"""objects that are fetched at the same time"""


class Fetched(NamedTuple):
    """How many files of a place are here now, how many of them came just now, and how many objects were left where they are."""

    files: int
    new: int
    left: int


class _Object(NamedTuple):
    name: str
    size: int
    changed: float


def fetched_photographs(address: str, folder: Path, say: Callable[[str], None] = lambda line: None) -> Fetched:
    """Bring the photographs below an address, such as s3://bucket/flight, and what lies beside them, into a folder, in the folders
    that they are in. Raises WorkflowError, ResourceError, StoreError."""
    bucket = bucket_of(address.rstrip("/"))
    objects = [_Object(*found) for found in bucket.objects()]
    wanted = [found for found in objects if _wanted(found.name)]
    if not wanted:
        raise WorkflowError(f"{address} holds no photographs, among {len(objects)} objects; name the prefix that they lie below.")
    missing = [found for found in wanted if not _there(folder / found.name, found)]
    _check_room(folder, missing)
    try:
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            for number, _ in enumerate(pool.map(lambda found: _fetch(bucket, found, folder), missing), 1):
                if number % 100 == 0:
                    say(f"{number} of {len(missing)} files fetched from {address}")
    except FileNotFoundError as error:
        raise StoreError(f"An object of {address} was removed while it was fetched; run again.") from error
    return Fetched(len(wanted), len(missing), len(objects) - len(wanted))


def _wanted(name: str) -> bool:
    path = PurePosixPath(name)
    odd = "\\" in name or any(part in ("", "..") or part.startswith(".") for part in name.split("/"))
    return not odd and path.suffix.lower() in _WANTED


def _there(path: Path, found: _Object) -> bool:
    try:
        state = path.stat()
    except OSError:
        return False
    return state.st_size == found.size and abs(state.st_mtime - found.changed) < 1.0


def _check_room(folder: Path, missing: list[_Object]) -> None:
    needed = sum(found.size for found in missing)
    here = next(place for place in (folder, *folder.parents) if place.exists())
    free = shutil.disk_usage(here).free
    if needed > free:
        raise ResourceError(
            f"The photographs have {needed / GIB:.1f} GB and the disk of {here} has {free / GIB:.1f} GB free; make room, or begin "
            "the project on a larger disk."
        )


def _fetch(bucket: Bucket, found: _Object, folder: Path) -> None:
    path = folder / found.name
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.part")
    try:
        bucket.fetch(found.name, part)
        os.utime(part, (found.changed, found.changed))
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
