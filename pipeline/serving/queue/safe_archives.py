"""Photographs out of a zip archive that strangers have sent: nothing outside of one folder, nothing without bounds.

The directory of an archive is judged before it is read, each entry before it is opened, and bytes are counted while they come: what
an archive says of itself is believed for refusing only. Folders become parts of names, for cameras number their files in each anew.
"""

import shutil
import stat
import struct
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path

from orthomill.pipeline.serving.queue.upload_names import NamesTaken, belongs_beside, is_image
from orthomill.pipeline.storage.whole_files import replacing
from orthomill.schemas.errors import ResourceError, WorkflowError
from orthomill.schemas.memory import GIB, MIB

_BLOCK = MIB
_END, _END64, _LOCATOR = b"PK\x05\x06", b"PK\x06\x06", b"PK\x06\x07"
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""What photographs are packed with; other methods may take any amount of memory."""
_NOISE = frozenset({"__macosx", ".ds_store", "thumbs.db", "desktop.ini"})


@dataclass(frozen=True)
class ArchiveLimits:
    """What an archive may hold."""

    files: int = 100_000
    file_bytes: int = 4 * GIB
    bytes: int = 500 * GIB
    ratio: float = 50.0
    """bytes out of each byte of the archive: photographs are compressed already"""
    reserve: int = 2 * GIB
    """bytes of the disk that are left free"""


def unpacked(archive: Path, target: Path, limits: ArchiveLimits) -> tuple[int, list[str]]:
    """Put the photographs and lists of an archive into a folder; the number of photographs, and sentences about what was left out.
    Raises WorkflowError for an archive that is none, or that holds what no honest one does, ResourceError for a full disk."""
    _judge_directory(archive, limits)
    try:
        with zipfile.ZipFile(archive) as opened:
            chosen, left_out = _chosen(archive.name, opened, limits)
            allowance = min(limits.bytes, int(limits.ratio * archive.stat().st_size) + 16 * _BLOCK)
            target.mkdir(parents=True, exist_ok=True)
            for name, entry in chosen.items():
                allowance -= _unpack(opened, entry, target / name, min(limits.file_bytes, allowance), limits.reserve)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, ValueError, struct.error) as error:
        raise WorkflowError(f"{archive.name} is damaged or no zip archive ({error}); pack it again.") from error
    except OSError as error:
        raise ResourceError(f"{archive.name} cannot be unpacked: {error.strerror}.") from error
    told = [f"{archive.name}: {left_out} files are neither photographs nor lists, and were left out."] if left_out else []
    return sum(is_image(name) for name in chosen), told


def _judge_directory(archive: Path, limits: ArchiveLimits) -> None:
    """The directory at the end of the archive: Python reads all of it into memory, whatever it holds."""
    with open(archive, "rb") as stream:
        size = stream.seek(0, 2)
        stream.seek(max(size - 2**17, 0))
        tail = stream.read()
    place = tail.rfind(_END)
    if place < 0 or len(tail) - place < 22:
        raise WorkflowError(f"{archive.name} is no zip archive, or its end is missing; send it again.")
    count, length = struct.unpack_from("<HI", tail, place + 10)
    place64 = tail.rfind(_END64)
    if place64 >= 0 and len(tail) - place64 >= 56 and tail.find(_LOCATOR, place64) >= 0:
        count, length = struct.unpack_from("<QQ", tail, place64 + 32)
    # 46 bytes and a name; comments and extra fields of honest archives are short.
    if count > limits.files or length > 400 * limits.files:
        raise WorkflowError(f"{archive.name} says that it holds {count} files; a task has at most {limits.files}.")


def _chosen(archive: str, opened: zipfile.ZipFile, limits: ArchiveLimits) -> tuple[dict[str, zipfile.ZipInfo], int]:
    """Entries by the names that they get, and how many are not taken."""
    chosen: dict[str, zipfile.ZipInfo] = {}
    left_out, names = 0, NamesTaken(archive)
    entries = [entry for entry in opened.infolist() if not entry.is_dir()]
    if len(entries) > limits.files:
        raise WorkflowError(f"{archive} holds {len(entries)} files; a task has at most {limits.files}.")
    for entry in entries:
        parts = entry.filename.replace("\\", "/").split("/")
        shown = ascii(entry.filename[:80])
        if ".." in parts or parts[0] == "" or ":" in parts[0]:
            raise WorkflowError(f"{archive} holds {shown}, a path that leads out of it; pack it again.")
        kind = stat.S_IFMT(entry.external_attr >> 16)
        if kind not in (0, stat.S_IFREG):
            raise WorkflowError(f"{archive} holds {shown}, which is a link or a device; pack the photographs themselves.")
        if _NOISE & {part.lower() for part in parts} or parts[-1].startswith("."):
            continue
        if not (is_image(parts[-1]) or belongs_beside(parts[-1])):
            left_out += 1
            continue
        if entry.flag_bits & 1 or entry.compress_type not in _METHODS:
            raise WorkflowError(f"{archive} holds {shown} with a password or in an unusual packing; pack it as a plain zip.")
        chosen[names.take(parts)] = entry
    return chosen, left_out


def _unpack(opened: zipfile.ZipFile, entry: zipfile.ZipInfo, target: Path, most: int, reserve: int) -> int:
    """Bytes of one file. Raises WorkflowError beyond the most that it may have."""
    size = 0
    with opened.open(entry) as source, replacing(target) as stream:
        while block := source.read(_BLOCK):
            size += len(block)
            if size > most:
                raise WorkflowError(
                    f"{Path(opened.filename or '').name} holds far more than photographs are compressed to, or more than this "
                    f"node takes: {entry.filename[:80]!a} goes beyond."
                )
            if shutil.disk_usage(target.parent).free < reserve:
                raise ResourceError("The disk of this node is full; remove tasks that are no longer needed, and restart this one.")
            stream.write(block)
    return size
