"""One function executes a job, whoever calls it: read the regions, call the pure function, write its results, record it."""

import os
import resource
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from orthomill.pipeline.engine.freed_memory import give_back
from orthomill.pipeline.engine.one_thread import opencv_on_one_thread
from orthomill.pipeline.export.exports import export
from orthomill.pipeline.records.numbered_names import Key
from orthomill.pipeline.records.records import NOT_DONE, Fingerprint, Record, Records
from orthomill.pipeline.storage.array_metadata import StoredArray
from orthomill.pipeline.storage.depots.depot import Depot, KeptFile
from orthomill.pipeline.storage.depots.folder import Folder
from orthomill.pipeline.storage.depots.kept_files import keep
from orthomill.pipeline.storage.depots.side_by_side import side_by_side
from orthomill.pipeline.storage.image_files import header_or_fault, picture_fault, read_pixels
from orthomill.pipeline.storage.map_files import read_map, read_map_grid
from orthomill.pipeline.storage.mesh_files import read_mesh
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.errors import OrthomillError, StoreError
from orthomill.schemas.job import (
    AreaFile,
    CloudFile,
    Export,
    FileRegion,
    HeightFile,
    HeightHeader,
    Job,
    MapFile,
    MapHeader,
    MeshFile,
    PhotoHeader,
    PhotoPicture,
    PhotoPixels,
    Raster,
    Reading,
    Region,
    Stream,
    Table,
)
from orthomill.schemas.photo import Soundness
from orthomill.schemas.survey_files.text_encoding import LARGEST, decoded

_NO_MEMORY = ("bad_alloc", "Insufficient memory", "Cannot allocate memory", "Unable to allocate")


@dataclass(frozen=True)
class JobOrder:
    """All that a worker needs to know of a job."""

    job: Job | Export
    root: Path
    folder: Path
    fingerprint: Fingerprint
    reason: str
    run: str = ""
    """identifier of the run that asks for it"""
    wave: int = 1
    """number of this run"""
    kept: str = ""
    """address of the object store that holds the results; empty for those in `folder`"""
    inputs: tuple[tuple[str, str], ...] = ()
    """(path below `root`, name in the object store) of the user's files that it reads"""

    @property
    def depot(self) -> Depot:
        """Where the results are kept. Raises OrthomillError."""
        if not self.kept:
            return Folder(self.folder)
        # What reaches object stores is loaded only where there is one.
        from orthomill.pipeline.storage.depots.bucket import bucket_of

        return bucket_of(self.kept)


class Started(NamedTuple):
    """When a job began: time of day, and processor time of this process, s."""

    wall: float
    processor: float


class Left(NamedTuple):
    """What a job left on the disk: birth marks by raster, and its files by path in the run's folder."""

    births: dict[str, str]
    files: dict[str, KeptFile]


class JobFailed(Exception):
    """A job could not be done; carries the sentence for the user."""

    def __init__(self, key: Key, sentence: str) -> None:
        super().__init__(key, sentence)
        self.key, self.sentence = key, sentence


def execute(work: JobOrder, *dependencies: object) -> Key:
    """Do one job and record it; returns its key. Raises JobFailed.

    `dependencies` are the results of the jobs before it: keys, never data.
    """
    records = _records(work.depot, work.wave, work.run)
    store = Store(work.depot, _arrays(work.depot, work.run) if work.run else None)
    # When a worker dies, Dask repeats all jobs whose results, the keys, it held; their data are on disk and remain valid. What
    # others have recorded is read only where there is something: each of them has a file, and there may be a thousand.
    before = records.afresh(work.job.key) if _has_left_something(work.job, store) else records.known(work.job.key)
    if _is_done(work, before):
        return work.job.key
    started = Started(time.time(), time.process_time())
    # The record goes first: a process killed while it writes must not leave a record that says the result is valid.
    if before or work.reason != NOT_DONE:
        records.remove(work.job.key)
    try:
        left = _perform(work, store)
    except Exception as error:  # whatever a method raises ends this job only, and the run goes on with the others
        sentence = _sentence(error)
        told = traceback.format_exc()
        with suppress(OrthomillError, OSError):  # that of the job counts
            before = records.afresh(work.job.key)
        _put(records, _record(work, "failed", started, attempt=_attempt(work, before), error=sentence, traceback=told))
        raise JobFailed(work.job.key, sentence) from None
    _put(records, _record(work, "done", started, attempt=_attempt(work, before), births=left.births, files=left.files))
    give_back()
    return work.job.key


@lru_cache(maxsize=1)
def _records(depot: Depot, wave: int, run: str) -> Records:
    """The records of a run, kept from job to job: of the logs of other workers only what is new need be read."""
    return Records(depot, wave)


@lru_cache(maxsize=1)
def _arrays(depot: Depot, run: str) -> dict[str, StoredArray]:
    """What is known of the rasters of a run, kept from job to job: they are created before their jobs are handed out."""
    return {}


def _has_left_something(job: Job | Export, store: Store) -> bool:
    """Whether there is anything under the name of its first result, of this run or of one before; not where that has no content."""
    if isinstance(job, Export):
        return store.depot.state(job.path) is not None
    try:
        return any(store.is_there(output) for output in islice(job.writes.values(), 1))
    except StoreError:  # what is wrong there is told when the job writes
        return True


def _sentence(error: Exception) -> str:
    if isinstance(error, OrthomillError):
        return str(error)
    # Each library has its own error for it; C++ has std::bad_alloc, which some of them pass on as text.
    if isinstance(error, MemoryError) or any(word in str(error) for word in _NO_MEMORY):
        return (
            "The system refused more memory; run fewer workers, close other programs, or raise the limit of this shell (ulimit -v)."
        )
    return f"unexpected {type(error).__name__}: {error}"


def _is_done(work: JobOrder, record: Record | None) -> bool:
    if record is None or not work.run:
        return False
    return (record.status, record.run, record.fingerprint) == ("done", work.run, work.fingerprint)


def _attempt(work: JobOrder, before: Record | None) -> int:
    """Which attempt of this run it is; a worker that died has left no record of its own."""
    return before.attempt + 1 if before and work.run and (before.status, before.run) == ("failed", work.run) else 1


def _put(records: Records, record: Record) -> None:
    try:
        records.put(record)
    except StoreError as error:
        raise JobFailed(record.key, str(error)) from None


def _perform(work: JobOrder, store: Store) -> Left:
    if isinstance(work.job, Export):
        return Left({}, keep(store.depot, export(work.job, store, store.depot)))
    job = work.job
    inputs = {name: _input(store, work, reading) for name, reading in job.reads.items()}
    with opencv_on_one_thread():  # until all is written: a result may be computed while it is
        values = results_by_name(job.function(**inputs, **job.params), job)
        if set(values) != set(job.writes):
            raise StoreError(f"{job.key} must return {sorted(job.writes)} but returned {sorted(values)}.")
        for name, region in job.writes.items():
            _write(store, region, values[name])
    births = {region.name: store.birth(region.name) for region in job.writes.values() if isinstance(region, Raster)}
    files = (name for region in job.writes.values() for name in store.files(region))
    return Left(births, keep(store.depot, files, store.written))


def _input(store: Store, work: JobOrder, reading: Reading) -> Any:
    def read(region: Region) -> Any:
        return _read(store, work, region)

    def together(regions: tuple[Region, ...]) -> tuple[Any, ...]:
        # All values of a tuple are held at the end, so that several on their way at a time take no more memory; of a stream they
        # would.
        if all(isinstance(region, (Raster, Table)) for region in regions):
            return tuple(side_by_side(store.depot, read, regions))
        return tuple(map(read, regions))

    return read_all(reading, read, together)


def results_by_name(result: Any, job: Job) -> dict[str, Any]:
    """What a function returned, under the names of the writes; job_signature.py describes the three forms."""
    if isinstance(result, tuple) and hasattr(result, "_asdict"):
        return {name: value for name, value in result._asdict().items() if value is not None}
    return result if isinstance(result, dict) else {next(iter(job.writes)): result}


def read_all(reading: Reading, read: Callable[[Region], Any], together: Callable[[tuple[Region, ...]], Any] | None = None) -> Any:
    """The value of one argument: `read` gives that of a region, `together` those of a tuple, one after the other where it is
    missing."""
    if isinstance(reading, Stream):
        # A generator reads nothing before it is asked, and what it cannot read then ends the job as any other error does.
        return (read_all(entry, read, together) for entry in reading.regions)
    if isinstance(reading, tuple):
        return together(reading) if together else tuple(map(read, reading))
    return read(reading)


def _read(store: Store, work: JobOrder, region: Region) -> Any:
    if isinstance(region, Raster):
        return store.read(region.name, region.window)
    if isinstance(region, Table):
        return store.table(region)
    return read_file(_root_of(region.path, work) if work.kept else work.root, region)


def _root_of(path: str, work: JobOrder) -> Path:
    """A folder of this machine below which a file has its path: it is fetched from the object store unless it is there already."""
    from orthomill.pipeline.storage.depots.scratch import fetched

    run = f"runs/{work.folder.name}/"
    return fetched(work.kept, dict(work.inputs).get(path) or path.removeprefix(run), path)


def read_file(root: Path, region: FileRegion) -> Any:
    """What a region of a file outside the store holds. Raises OrthomillError."""
    if isinstance(region, PhotoPixels):
        return read_pixels(root / region.path, region.window)
    if isinstance(region, PhotoHeader):
        header = header_or_fault(root / region.path)
        # The path relative to the root: tables made from it must not depend on where the project is stored.
        return header.model_copy(update={"path": region.path})
    if isinstance(region, PhotoPicture):
        return Soundness(path=region.path, fault=picture_fault(root / region.path))
    if isinstance(region, MapHeader):
        return read_map_grid(root / region.path, region.crs)
    if isinstance(region, MapFile):
        return read_map(root / region.path, region)
    if isinstance(region, MeshFile):
        return read_mesh(root / region.path)
    if isinstance(region, CloudFile):
        # Read where it is asked for, as outlines are: laspy and pyproj take time to load.
        from orthomill.pipeline.storage.cloud_files import read_cloud

        return read_cloud(root / region.path, region.crs)
    if isinstance(region, AreaFile):
        # Read where it is asked for: few workflows have one, and sqlite and pyproj take time to load.
        from orthomill.pipeline.storage.features.outline_files import read_wanted_area

        return read_wanted_area(root / region.path, region.crs)
    if isinstance(region, HeightHeader | HeightFile):
        return _read_heights(root / region.path, region)
    return _read_text(root / region.path)


def _read_heights(path: Path, region: HeightHeader | HeightFile) -> Any:
    # As clouds are: a surface may be one.
    from orthomill.pipeline.storage.height_files import read_height_grid, read_heights

    return read_heights(path, region) if isinstance(region, HeightFile) else read_height_grid(path, region)


def _read_text(path: Path) -> str:
    if path.stat().st_size > LARGEST:
        raise StoreError(
            f"{path} has {path.stat().st_size / 1e6:.0f} MB, more than any list of photographs or points; give another."
        )
    return decoded(path.read_bytes(), str(path))


def _write(store: Store, region: Raster | Table, value: Any) -> None:
    if isinstance(region, Raster):
        store.write(region.name, region.window, value)
    else:
        store.write_table(region, value)


def _record(work: JobOrder, status: str, started: Started, **more: Any) -> Record:
    stage, item, row, col = work.job.key
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024  # Linux counts in KiB
    return Record(
        stage=stage,
        item=item,
        row=row,
        col=col,
        status=status,
        fingerprint=work.fingerprint,
        reason=work.reason,
        run=work.run,
        started=started.wall,
        seconds=time.time() - started.wall,
        cpu_seconds=time.process_time() - started.processor,
        worker=str(os.getpid()),
        peak_bytes=peak,
        **more,
    )
