"""The files in which the records of one stage are kept: logs to which processes append, and what was folded from them."""

import json
import os
import re
import secrets
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from orthomill.pipeline.records.record_lines import STATUSES, Place, RecordLine, line_of, read_lines
from orthomill.pipeline.storage.file_names import file_name
from orthomill.pipeline.storage.sealed_json import unsealed
from orthomill.pipeline.storage.whole_files import replacing
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


def append(folder: Path, wave: int, line: bytes) -> None:
    """Append a line to the log of this process. Raises StoreError."""
    path = folder / f"{wave:08d}-{os.getpid()}-{_PROCESS}{LOG}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # Unbuffered, in one call: what a killed process has not written whole is the last line of its file, and no line.
        with path.open("ab", buffering=0) as stream:
            before = stream.tell()
            try:
                if stream.write(line) != len(line):
                    raise OSError(28, "No space left on device")
            except OSError:
                stream.truncate(before)
                raise
    except OSError as error:
        raise StoreError(
            f"{path} cannot be written: {error.strerror}; make room on the disk or make the folder writable, then run again."
        ) from error


class StageFiles:
    """The lines of a stage that count, by place, with those of waves before `least` left out."""

    def __init__(self, folder: Path, least: int = 0) -> None:
        self.folder = folder
        self.lines: dict[Place, RecordLine] = {}
        self.damaged: set[Path] = set()
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

    def _read_on(self) -> None:
        for path, size in self._counting():
            if size < self._read.get(path.name, 0):  # another file of this name
                self.lines.clear()
                self._read.clear()
                return self._read_on()
            if size > self._read.get(path.name, 0):
                self._take(path)

    def _counting(self) -> list[tuple[Path, int]]:
        """The files whose lines count, with their sizes: what was folded holds all that was written before."""
        if not self.folder.is_dir():
            return []
        found = [(Path(entry.path), entry.stat().st_size) for entry in os.scandir(self.folder)]
        waves = [(path, size, wave_of(path.name)) for path, size in found]
        folded = max((wave for path, _, wave in waves if path.suffix == FOLDED), default=0)
        return sorted(
            (path, size)
            for path, size, wave in waves
            if wave >= self._least
            and (
                (path.suffix == LOG and wave > folded)
                or (path.suffix == FOLDED and wave == folded)
                or (path.suffix == OF_ONE_JOB and not folded)
            )
        )

    def _take(self, path: Path) -> None:
        if path.suffix == OF_ONE_JOB:
            content = path.read_bytes()
            self._read[path.name] = len(content)
            self._keep(path, _of_one_job(path, content))
            return
        with path.open("rb") as stream:
            stream.seek(self._read.get(path.name, 0))
            content = stream.read()
        whole = content.rfind(b"\n") + 1
        self._read[path.name] = self._read.get(path.name, 0) + whole
        for found in read_lines(content[:whole], wave_of(path.name)):
            self._keep(path, found)
        # The end of a log may be on its way; what was folded ends with a line.
        if path.suffix == FOLDED and whole < len(content):
            self.damaged.add(path)

    def _keep(self, path: Path, found: tuple[Place, RecordLine] | None) -> None:
        if found is None:
            self.damaged.add(path)
            return
        place, line = found
        if place not in self.lines or self.lines[place][:3] <= line[:3]:
            self.lines[place] = line

    def fold(self) -> None:
        """Keep the lines that count in one file. Nobody else may write. Raises StoreError."""
        self.refresh()
        files = [path for path in self.folder.iterdir() if path.suffix in (LOG, FOLDED, OF_ONE_JOB)]
        if not files or (not self.damaged and [path.suffix for path in files] == [FOLDED]):
            return
        target = self.folder / f"{max(max(wave_of(path.name) for path in files), 1):08d}{FOLDED}"
        try:
            with replacing(target) as stream:
                stream.writelines(self._folded())
                # Before the logs go: after a power cut the file would be there, and empty.
                stream.flush()
                os.fsync(stream.fileno())
            for path in files:
                if path != target:
                    path.unlink()
        except OSError as error:
            raise StoreError(f"{target} cannot be written: {error.strerror}; make room on the disk, then run again.") from error

    def _folded(self) -> Iterator[bytes]:
        for place, line in sorted(self.lines.items(), key=lambda item: item[0]):
            if line.text:
                yield line_of(place, STATUSES[line.rank], line.started, line.text)


def _of_one_job(path: Path, content: bytes) -> tuple[Place, RecordLine] | None:
    """The record of an earlier version, a sealed JSON file under the name of its job."""
    text = unsealed(content)
    try:
        value = json.loads(text or b"")
        place = value["item"], value["row"], value["col"]
        if path.name != f"{file_name(place[0])}.{place[1]}.{place[2]}{OF_ONE_JOB}":
            return None
        # In one line, whatever the spaces of the file.
        return place, RecordLine(0, STATUSES.index(value["status"]), value.get("started", 0.0), json.dumps(value).encode())
    except (ValueError, KeyError, TypeError, AttributeError):  # no JSON, or another value than a record
        return None
