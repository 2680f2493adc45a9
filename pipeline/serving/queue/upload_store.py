"""Uploads that are not tasks yet: what was acknowledged is there under its name, what was not is under another."""

import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import BinaryIO

from orthomill.pipeline.serving.queue.task_folder import UUID, TaskFolder
from orthomill.pipeline.serving.queue.task_state import TaskState
from orthomill.pipeline.serving.queue.upload_names import belongs_beside, checked_name, is_archive, is_image, unused_sentence
from orthomill.pipeline.storage.whole_files import replacing
from orthomill.schemas.errors import ResourceError, StoreError, WorkflowError
from orthomill.schemas.memory import GIB, MIB

FEWEST = 2
"""photographs of a task"""


@dataclass(frozen=True)
class UploadLimits:
    """What one upload may hold."""

    file_bytes: int = 4 * GIB
    task_bytes: int = 500 * GIB
    files: int = 100_000
    reserve: int = 2 * GIB
    """bytes of the disk that are left free"""


@dataclass
class UploadStore:
    """Uploads below a folder, each in the form of the task that it becomes."""

    home: Path
    limits: UploadLimits = field(default_factory=UploadLimits)
    _sizes: dict[str, dict[str, int]] = field(default_factory=dict)
    """uuid -> bytes by name of what is there or being received"""
    _lock: Lock = field(default_factory=Lock)

    def __post_init__(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        for path in self.folder.iterdir():
            if UUID.fullmatch(path.name):
                for part in path.glob("images/.*.part"):
                    part.unlink()
                self._sizes[path.name] = {file.name: file.stat().st_size for file in path.glob("images/*")}

    @property
    def folder(self) -> Path:
        """Folder of the uploads."""
        return self.home / "uploads"

    def begin(self, state: TaskState) -> None:
        """Make room for an upload. Raises StoreError."""
        upload = TaskFolder(self.folder / state.uuid)
        self.enough_disk(0)
        try:
            upload.images.mkdir(parents=True)
        except OSError as error:
            raise StoreError(f"The upload cannot begin: {error.strerror}.") from error
        upload.keep(state)
        with self._lock:
            self._sizes[state.uuid] = {}

    def find(self, uuid: str) -> tuple[TaskFolder, TaskState] | None:
        """An upload that has begun, and what it is to become."""
        if not UUID.fullmatch(uuid):
            return None
        upload = TaskFolder(self.folder / uuid)
        state = upload.state()
        return (upload, state) if state is not None else None

    def bytes_of(self, owner: str) -> int:
        """What the uploads of an owner hold."""
        with self._lock:
            sizes = {uuid: sum(files.values()) for uuid, files in self._sizes.items()}
        owners = ((uuid, self.find(uuid)) for uuid in sizes)
        return sum(sizes[uuid] for uuid, found in owners if found and found[1].owner == owner)

    def size_of(self, uuid: str) -> int:
        """What an upload holds."""
        with self._lock:
            return sum(list(self._sizes.get(uuid, {}).values()))

    def enough_disk(self, wanted: int) -> None:
        """Raises ResourceError where the disk has no room for so many bytes."""
        free = shutil.disk_usage(self.folder).free
        if free - wanted < self.limits.reserve:
            raise ResourceError(
                f"The disk of this node is full ({free / GIB:.1f} GiB free, {self.limits.reserve / GIB:.1f} are kept); remove "
                "tasks that are no longer needed, or ask whoever runs it."
            )

    @contextmanager
    def receiving(self, uuid: str, sent_name: str | None, quota: int | None = None) -> Iterator["Receipt"]:
        """A file that is being received; it has its name when the context ends without an error. `quota`: bytes that the upload may
        hold together. Raises WorkflowError for names and sizes, ResourceError for the disk."""
        name = checked_name(sent_name)
        upload = TaskFolder(self.folder / uuid)
        with self._lock:
            sizes = self._sizes.setdefault(uuid, {})
            if name not in sizes and len(sizes) >= self.limits.files:
                raise WorkflowError(f"A task has at most {self.limits.files} files.")
            earlier = sizes.get(name)
        most = self.limits.task_bytes if quota is None else min(self.limits.task_bytes, quota)
        try:
            with replacing(upload.images / name) as stream:
                receipt = Receipt(stream, name, sizes, most, self)
                yield receipt
                receipt.check()
                stream.flush()
                # Now and not at the commit, where gigabytes would keep the client waiting for longer than it does.
                os.fsync(stream.fileno())
        except BaseException as error:
            with self._lock:
                if earlier is None:
                    sizes.pop(name, None)
                else:
                    sizes[name] = earlier
            if not isinstance(error, OSError):
                raise
            raise _not_kept(name, error) from error

    def sort(self, upload: TaskFolder) -> tuple[int, list[str]]:
        """Put aside what is no photograph and no list; the number of photographs (an archive counts as many), and sentences about
        what is not used. Raises WorkflowError for too few photographs."""
        photographs, archives, unused = 0, 0, []
        for path in sorted(upload.images.iterdir()):
            if path.name.startswith("."):
                path.unlink()
            elif is_image(path.name):
                photographs += 1
            elif is_archive(path.name):
                archives += 1
            elif not belongs_beside(path.name):
                upload.unused.mkdir(exist_ok=True)
                path.rename(upload.unused / path.name)
                unused.append(unused_sentence(path.name))
        if photographs < FEWEST and not archives:
            raise WorkflowError(
                f"{photographs} photographs were uploaded; a task needs at least {FEWEST}, as JPEG, TIFF or PNG, that overlap."
            )
        return photographs, unused

    def forget(self, uuid: str) -> None:
        """The upload has become a task, or was removed."""
        with self._lock:
            self._sizes.pop(uuid, None)

    def tidy(self, days: float) -> None:
        """Remove uploads that nobody has continued for so many days."""
        oldest = time.time() - days * 86_400
        for path in list(self.folder.iterdir()):
            newest = max((one.stat().st_mtime for one in (path, path / "images") if one.exists()), default=0.0)
            if newest < oldest:
                TaskFolder(path).remove()
                self.forget(path.name)


def _not_kept(name: str, error: OSError) -> ResourceError:
    return ResourceError(
        f"{name} cannot be kept: {os.strerror(error.errno or 0)}. What was uploaded before is kept; send it again when "
        "there is room."
    )


@dataclass
class Receipt:
    """A file that is being received, and the sizes of all files of its upload."""

    stream: BinaryIO
    name: str
    sizes: dict[str, int]
    most: int
    store: UploadStore
    size: int = 0
    _checked: int = 0

    def write(self, block: bytes) -> None:
        """Take a block. Raises WorkflowError beyond the limits, ResourceError where the disk is nearly full."""
        self.size += len(block)
        self.sizes[self.name] = self.size
        if self.size > self.store.limits.file_bytes:
            raise WorkflowError(f"{self.name} has more than the {self.store.limits.file_bytes / MIB:.0f} MiB that this node takes.")
        # Adding up and asking for the disk takes longer than a block: now and then is enough.
        if self.size >= self._checked:
            self._checked = self.size + 16 * MIB
            self.check()
        try:
            self.stream.write(block)
        except OSError as error:
            raise _not_kept(self.name, error) from error

    def check(self) -> None:
        """Raises WorkflowError where the upload is too large by now, ResourceError where the disk is nearly full."""
        self.store.enough_disk(0)
        if sum(list(self.sizes.values())) > self.most:
            raise WorkflowError(f"With {self.name} the upload exceeds the {self.most / 1e6:.1f} MB that are left for it.")
