"""Photographs that lie in an object store: brought to this machine once, with the lists and masks beside them.

What is there already, with the bytes and the time of the object, is not fetched again; a file is there whole or not at all.
"""

import os
import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from orthomill.pipeline.storage.depots.bucket import Bucket, exchange_at
from orthomill.pipeline.storage.photographs.file_kinds import FOREIGN_SUFFIXES, LIST_SUFFIXES, PHOTOGRAPH_SUFFIXES
from orthomill.schemas.errors import ResourceError, StoreError, WorkflowError
from orthomill.schemas.memory import GIB, MIB

_WANTED = PHOTOGRAPH_SUFFIXES | LIST_SUFFIXES | FOREIGN_SUFFIXES
_AT_ONCE = 8
"""objects that are fetched at the same time"""


def photograph_or_beside(name: str) -> bool:
    """Whether a file is a photograph by its name, or of a kind that lies beside photographs."""
    return PurePosixPath(name).suffix.lower() in _WANTED


def in_its_folder(name: str) -> str:
    """An object's file has the path of the object."""
    return name


@dataclass(frozen=True)
class FetchRules:
    """What is fetched of a place and how its files are called, both by the name of an object, and how much that may be."""

    wanted: Callable[[str], bool] = photograph_or_beside
    named: Callable[[str], str] = in_its_folder
    files: int | None = None
    file_bytes: int | None = None
    bytes: int | None = None
    reserve: int = 0
    """bytes of the disk that are left free"""


class Fetched(NamedTuple):
    """The files of a place that are here now, how many of them came just now, and how many objects were left where they are."""

    files: tuple[str, ...]
    new: int
    left: int


class _Object(NamedTuple):
    name: str
    size: int
    changed: float


def fetched_photographs(
    address: str, folder: Path, rules: FetchRules = FetchRules(), say: Callable[[str], None] = lambda line: None
) -> Fetched:
    """Bring the photographs below an address, such as s3://bucket/flight, and what lies beside them, into a folder; or the one zip
    archive that the address names. Raises WorkflowError, ResourceError, StoreError."""
    bucket, objects = _objects(address.rstrip("/"), rules)
    wanted = sorted(found for found in objects if _plain(found.name) and rules.wanted(found.name))
    if not wanted:
        raise WorkflowError(f"{address} holds no photographs, among {len(objects)} objects; name the prefix that they lie below.")
    _check_sizes(address, wanted, rules)
    paths = {found: folder / rules.named(found.name) for found in wanted}
    missing = {found: path for found, path in paths.items() if not _there(path, found)}
    _check_room(folder, sum(found.size for found in missing), rules.reserve)
    try:
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            for number, _ in enumerate(pool.map(lambda one: _fetch(bucket, *one), missing.items()), 1):
                if number % 100 == 0:
                    say(f"{number} of {len(missing)} files fetched from {address}")
    except FileNotFoundError as error:
        raise StoreError(f"An object of {address} was removed while it was fetched; run again.") from error
    files = tuple(path.relative_to(folder).as_posix() for path in paths.values())
    return Fetched(files, len(missing), len(objects) - len(wanted))


def _objects(address: str, rules: FetchRules) -> tuple[Bucket, list[_Object]]:
    """The bucket and its objects, of an archive this one."""
    above, _, last = address.rpartition("/")
    if last.lower().endswith(".zip"):
        bucket = exchange_at(above)
        try:
            return bucket, [_Object(*bucket.object(last))]
        except FileNotFoundError:
            raise WorkflowError(f"{address} does not exist; check the address.") from None
    bucket = exchange_at(address)
    objects = [_Object(*found) for found in islice(bucket.objects(), None if rules.files is None else rules.files + 1)]
    if rules.files is not None and len(objects) > rules.files:
        raise WorkflowError(f"{address} holds more than {rules.files} objects, the most that are taken; name a prefix with fewer.")
    return bucket, objects


def _plain(name: str) -> bool:
    """Whether a name stays within the folder and is not hidden."""
    return "\\" not in name and not any(part in ("", "..") or part.startswith(".") for part in name.split("/"))


def _check_sizes(address: str, wanted: list[_Object], rules: FetchRules) -> None:
    largest, together = max(wanted, key=lambda found: found.size), sum(found.size for found in wanted)
    if rules.file_bytes is not None and largest.size > rules.file_bytes:
        raise WorkflowError(f"{largest.name} has {largest.size / MIB:.0f} MiB; one file may have {rules.file_bytes / MIB:.0f}.")
    if rules.bytes is not None and together > rules.bytes:
        raise WorkflowError(f"The files of {address} have {together / MIB:.0f} MiB; {rules.bytes / MIB:.0f} are taken at most.")


def _there(path: Path, found: _Object) -> bool:
    try:
        state = path.stat()
    except OSError:
        return False
    return state.st_size == found.size and abs(state.st_mtime - found.changed) < 1.0


def _check_room(folder: Path, needed: int, reserve: int) -> None:
    here = next(place for place in (folder, *folder.parents) if place.exists())
    free = shutil.disk_usage(here).free
    if needed > free - reserve:
        kept = f", of which {reserve / GIB:.1f} stay free" if reserve else ""
        raise ResourceError(
            f"The photographs have {needed / GIB:.1f} GB and the disk of {here} has {free / GIB:.1f} GB free{kept}; make room, or "
            "begin the project on a larger disk."
        )


def _fetch(bucket: Bucket, found: _Object, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.part")
    try:
        bucket.fetch(found.name, part)
        os.utime(part, (found.changed, found.changed))
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
