"""The files in which the records of one stage are kept: logs to which processes append, and what was folded from them."""

import json
import os
import re
import secrets
from collections.abc import Iterable, Iterator
from contextlib import suppress

from orthomill.pipeline.records.kept_lines import KeptLines
from orthomill.pipeline.records.record_lines import STATUSES, Place, RecordLine, line_of, read_lines
from orthomill.pipeline.storage.depots.depot import Depot
from orthomill.pipeline.storage.file_names import file_name
from orthomill.pipeline.storage.sealed_json import unsealed
from orthomill.schemas.errors import StoreError

LOG, FOLDED, OF_ONE_JOB = ".log", ".done", ".json"
_NAME = re.compile(r"(\d{8})(-\S+\.log|\.done)")
ATTEMPTS = 5
"""Times that the files of a stage are read when they change meanwhile."""
_PROCESS = secrets.token_hex(4)


def wave_of(name: str) -> int:
    """The number of the run that wrote a file of records; 0 for other files."""
    found = _NAME.fullmatch(name)
    return int(found[1]) if found else 0


class OwnLog:
    """The log of this process for one stage."""

    def __init__(self, depot: Depot, folder: str, wave: int) -> None:
        self._depot = depot
        self._name = f"{folder}/{wave:08d}-{os.getpid()}-{_PROCESS}"
        self._part = 0

    def append(self, line: bytes) -> tuple[str, int]:
        """Append a line; returns the file's name in the folder, and its size now. Raises StoreError."""
        name = f"{self._name}.{self._part}{LOG}" if self._part else f"{self._name}{LOG}"
        try:
            size = self._depot.append(name, line)
        except OSError as error:
            raise StoreError(
                f"{self._depot.address}/{name} cannot be written: {error.strerror}; make room on the disk or make the folder "
                "writable, then run again."
            ) from error
        if self._depot.longest_log and size > self._depot.longest_log:
            self._part += 1
        return name.rpartition("/")[2], size


class StageFiles:
    """The lines of a stage that count, by place, with those of waves before `least` left out."""

    def __init__(self, depot: Depot, folder: str, least: int = 0) -> None:
        self._depot = depot
        self.folder = folder
        self.lines = KeptLines()
        self.damaged: set[str] = set()
        """files in which something cannot be read"""
        self._least = least
        self._read: dict[str, int] = {}
        """bytes that were read of each file"""

    def refresh(self) -> None:
        """Read what was appended since."""
        for _ in range(ATTEMPTS):
            # A run that folds the logs while somebody else looks at its state removes them; what they held is then in the new file.
            with suppress(FileNotFoundError):
                return self._read_on()

    def take_own(self, name: str, size: int, line: bytes) -> None:
        """What this process has just appended to a file, which has so many bytes now. Nobody else writes it, so it need not be
        read."""
        if self._read.get(name, 0) != size - len(line):
            return self.refresh()
        self._read[name] = size
        for found in read_lines(line, wave_of(name)):
            self._keep(name, found)

    def _read_on(self) -> None:
        for name, size in self._counting():
            if size < self._read.get(name, 0):  # another file of this name
                self.lines = KeptLines()
                self._read.clear()
                return self._read_on()
            if size > self._read.get(name, 0):
                self._take(name)

    def _counting(self) -> list[tuple[str, int]]:
        """The files whose lines count, with their sizes: what was folded holds all that was written before."""
        waves = [(name, state.size, wave_of(name)) for name, state in self._depot.entries(self.folder)]
        folded = max((wave for name, _, wave in waves if name.endswith(FOLDED)), default=0)
        return sorted(
            (name, size)
            for name, size, wave in waves
            if wave >= self._least
            and (
                (name.endswith(LOG) and wave > folded)
                or (name.endswith(FOLDED) and wave == folded)
                or (name.endswith(OF_ONE_JOB) and not folded)
            )
        )

    def _take(self, name: str) -> None:
        if name.endswith(OF_ONE_JOB):
            content = self._depot.get(f"{self.folder}/{name}")
            self._read[name] = len(content)
            self._keep(name, _of_one_job(name, content))
            return
        left = b""
        for block in self._blocks(name):
            content = left + block
            whole = content.rfind(b"\n") + 1
            self._read[name] = self._read.get(name, 0) + whole
            for found in read_lines(content[:whole], wave_of(name)):
                self._keep(name, found)
            left = content[whole:]
        # The end of a log may be on its way; what was folded ends with a line.
        if name.endswith(FOLDED) and left:
            self.damaged.add(f"{self.folder}/{name}")

    def _blocks(self, name: str) -> Iterable[bytes]:
        """What was not read yet of a file; a large one in pieces."""
        read, path = self._read.get(name, 0), f"{self.folder}/{name}"
        return (self._depot.get(path, read),) if read else self._depot.blocks(path)

    def _keep(self, name: str, found: tuple[Place, RecordLine] | None) -> None:
        if found is None:
            self.damaged.add(f"{self.folder}/{name}")
            return
        self.lines.keep(*found)

    def fold(self) -> None:
        """Keep the lines that count in one file. Nobody else may write. Raises StoreError."""
        self.refresh()
        files = [name for name, _ in self._depot.entries(self.folder) if name.endswith((LOG, FOLDED, OF_ONE_JOB))]
        if not files or (not self.damaged and len(files) == 1 and files[0].endswith(FOLDED)):
            return
        target = f"{max(max(map(wave_of, files)), 1):08d}{FOLDED}"
        try:
            with self._depot.writing(f"{self.folder}/{target}") as stream:
                stream.writelines(self._folded())
                # Before the logs go: after a power cut the file would be there, and empty.
                stream.flush()
                os.fsync(stream.fileno())
            for name in files:
                if name != target:
                    self._depot.delete(f"{self.folder}/{name}")
        except OSError as error:
            where = f"{self._depot.address}/{self.folder}/{target}"
            raise StoreError(f"{where} cannot be written: {error.strerror}; make room on the disk, then run again.") from error

    def _folded(self) -> Iterator[bytes]:
        # Line by line: together the texts of a million jobs take a gigabyte.
        for place in sorted(self.lines):
            if (line := self.lines[place]).text:
                yield line_of(place, STATUSES[line.rank], line.started, line.text)


def _of_one_job(name: str, content: bytes) -> tuple[Place, RecordLine] | None:
    """The record of an earlier version, a sealed JSON file under the name of its job."""
    text = unsealed(content)
    try:
        value = json.loads(text or b"")
        place = value["item"], value["row"], value["col"]
        if name != f"{file_name(place[0])}.{place[1]}.{place[2]}{OF_ONE_JOB}":
            return None
        # In one line, whatever the spaces of the file.
        return place, RecordLine(0, STATUSES.index(value["status"]), value.get("started", 0.0), json.dumps(value).encode())
    except (ValueError, KeyError, TypeError, AttributeError):  # no JSON, or another value than a record
        return None
