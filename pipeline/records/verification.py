"""Checks every file that the jobs of a project left on the disk against its checksum.

What is damaged is marked in the records, so that the next run computes it again, and nothing else. What belongs to no job (the
groups and map axes of the raster store) is written again at once.
"""

import os
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from orthomill.pipeline.records.lock import only_run
from orthomill.pipeline.records.numbered_names import NumberedNames
from orthomill.pipeline.records.records import Record, Records
from orthomill.pipeline.storage.depots.folder import PARTS
from orthomill.pipeline.storage.depots.kept_files import defect_of
from orthomill.pipeline.storage.store import Store


@dataclass(frozen=True)
class Verification:
    """What was examined: `files` of `size` bytes in all; `damaged` ones by path with what is wrong, `mended` ones by path."""

    files: int
    size: int
    damaged: dict[str, str]
    mended: tuple[str, ...]


def verify(folder: Path) -> Verification:
    """Examine the results of a run, and mark the damaged ones. Raises ResourceError while the project is being run."""
    # Under the lock: a run in progress replaces files between the reading of a record and that of its files.
    with only_run(folder):
        return examine(folder)


def examine(folder: Path, since: float = 0.0) -> Verification:
    """Examine the results of jobs that ended after `since` (s since 1970), and mark the damaged ones."""
    store, records = Store(folder), Records(folder)
    last, size = _LastWriters(), 0
    # One after the other, and twice: of a million jobs the records take gigabytes.
    for number, record in _done(records, store):
        last.add(number, record)
        size += sum(kept.size for kept in record.files.values())
    damaged: dict[str, str] = {}
    for number, record in _done(records, store):
        if record.started + record.seconds < since:
            continue
        # Where a later job wrote the same file, an earlier record says nothing about it.
        own = {name: kept for name, kept in record.files.items() if last.is_of(name, number)}
        found = {name: defect for name, kept in own.items() if (defect := defect_of(store.depot, name, kept, thoroughly=True))}
        found |= dict.fromkeys(_broken_rasters(record, store), "damaged")
        if found:
            damaged |= found
            records.put(record.model_copy(update={"status": "damaged"}))
    damaged |= dict.fromkeys(records.unreadable(), "damaged")
    # What cannot be read is left out, and what it may have hidden is done again.
    records.fold()
    return Verification(len(last), size, damaged, tuple(_mended(store)))


def _done(records: Records, store: Store) -> Iterator[tuple[int, Record]]:
    """The records of what was done and counts, each with its number among all."""
    for number, record in enumerate(records.each()):
        if record.status == "done" and not _is_replaced(record, store):
            yield number, _without_gone_parts(record, store)


class _LastWriters:
    """By file, the number of the record of the job that began last of those that wrote it."""

    def __init__(self) -> None:
        self._names, self._writers, self._begun = NumberedNames(), array("i"), array("d")

    def __len__(self) -> int:
        return len(self._names)

    def add(self, number: int, record: Record) -> None:
        """One more record."""
        for name in record.files:
            place = self._names.add(os.fsencode(name))
            if place == len(self._writers):
                self._writers.append(number)
                self._begun.append(record.started)
            elif record.started >= self._begun[place]:
                self._writers[place], self._begun[place] = number, record.started

    def is_of(self, name: str, number: int) -> bool:
        """Whether the file is that of this record."""
        place = self._names.find(os.fsencode(name))
        return place is not None and self._writers[place] == number


def _is_replaced(record: Record, store: Store) -> bool:
    """Whether a raster that the job wrote has been created again since."""
    sound = (name for name in record.births if store.is_sound(name))
    return any(store.birth(name) != record.births[name] for name in sound)


def _without_gone_parts(record: Record, store: Store) -> Record:
    """The record less the parts that have gone: into a file, or the next run misses them."""
    gone = {name for name in record.files if name.startswith(f"{PARTS}/") and store.depot.state(name) is None}
    return record.model_copy(update={"files": {name: kept for name, kept in record.files.items() if name not in gone}})


def _broken_rasters(record: Record, store: Store) -> Iterator[str]:
    for name in record.births:
        if not store.is_sound(name):
            yield f"{store.place(name)}/zarr.json"


def _mended(store: Store) -> Iterator[str]:
    for name in store.names():
        yield from store.mend(store.spec(name))
