"""The graph of jobs, derived from the regions that they state. There is no other description of it anywhere.

The writer of every chunk, table and file is recorded as jobs are added; a job depends on the writers of everything that it reads.
Because a writer must be known before its reader, jobs are in an order in which they can be run one by one.
"""

from array import array
from collections.abc import Iterable
from pathlib import Path

from orthomill.pipeline.engine import fingerprint as fp
from orthomill.pipeline.engine.fingerprint import region_text
from orthomill.pipeline.engine.job_signature import misfit
from orthomill.pipeline.engine.planned.chunk_writers import Chunk, ChunkWriters, chunks_of
from orthomill.pipeline.engine.planned.file_writers import FileWriters
from orthomill.pipeline.engine.planned.planned_jobs import PlannedJob, PlannedJobs
from orthomill.pipeline.export.exports import export as export_file
from orthomill.pipeline.export.file_parts import joins_parts
from orthomill.pipeline.records.numbered_names import Key
from orthomill.pipeline.records.records import Fingerprint
from orthomill.pipeline.storage.depots.product_files import refuse_joined
from orthomill.pipeline.storage.store import aligned
from orthomill.schemas.errors import OrthomillError, ResourceError, WorkflowError
from orthomill.schemas.job import (
    CloudFile,
    Export,
    FileRegion,
    HeightFile,
    Job,
    MapFile,
    MeshFile,
    PhotoHeader,
    PhotoPicture,
    PhotoPixels,
    Raster,
    Reading,
    Region,
    Stream,
    Table,
    TextFile,
    regions_of,
)
from orthomill.schemas.memory import MIB
from orthomill.schemas.raster import RasterSpec, Window, same_ground

PROCESS_BYTES = 600 * MIB
"""Memory of a worker process apart from its job, measured at the end of a run: the interpreter, libraries and compiled kernels (350
MiB), and what the allocator keeps from earlier jobs for the next one."""
EXPORT_BYTES = 200 * MIB
"""Memory of an export apart from the process: GDAL's block cache, a chunk of every raster, and the compressor."""


class GraphError(OrthomillError):
    """The stages plan something that cannot be run; a mistake of a stage, not of the user."""


class NoWriter(Exception):
    """A job reads what no job planned so far writes."""

    def __init__(self, what: str, stage: str) -> None:
        super().__init__(what)
        self.what, self.stage = what, stage


class Graph:
    """All jobs planned so far."""

    def __init__(self, root: Path, run_folder: str) -> None:
        self.root = root
        self.run_folder = run_folder
        self.specs: dict[str, RasterSpec] = {}
        self._spec_texts: dict[str, str] = {}
        self.jobs = PlannedJobs()
        self.exports, self.light = array("i"), array("i")
        """numbers of the exports, and of the jobs that read headers, texts and tables only and write tables only"""
        self._chunks = ChunkWriters()
        self._tables, self._files = FileWriters(), FileWriters()
        self._table_readers: dict[str, tuple[str, ...]] = {}
        self._joined: dict[int, int] = {}
        """writers of the parts of files -> what joins them"""
        self.joining: dict[int, None] = {}
        """numbers of those jobs, in their order"""

    def add_raster(self, spec: RasterSpec) -> None:
        """Announce a raster. Raises GraphError when it was announced differently."""
        known = self.specs.get(spec.name)
        if known is None:
            self.specs[spec.name] = spec
            # Its text is part of the fingerprint of every job that writes it: thousands of tiles, one raster.
            self._spec_texts[spec.name] = repr(spec)
            self._chunks.add_raster(spec)
        elif known is not spec and not known.same(spec):
            raise GraphError(f"The raster {spec.name} is planned twice and differently: {known} and {spec}.")

    def add(self, job: Job | Export) -> PlannedJob | None:
        """Add a job to the graph; None when it is there already. Raises NoWriter, GraphError."""
        if isinstance(job, Job) and (wrong := misfit(job)):
            raise GraphError(wrong)
        before, planned = self._planned_export(job) if isinstance(job, Export) else self._planned_job(job)
        # A stage is planned again from its beginning whenever a table appears, and yields its earlier jobs again.
        known = self.jobs.keys_by_number.find(planned.key)
        if known is not None:
            if self.jobs.fingerprint(known) != planned.fingerprint:
                raise GraphError(f"Two different jobs are called {planned.key}.")
            return None
        self._note(job, len(self.jobs), planned.key)
        self.jobs.append(planned, before)
        return planned

    def _note(self, job: Job | Export, number: int, key: Key) -> None:
        """What a job writes is known from now on, and what kind it is of."""
        self._claim_outputs(job, number, key)
        if isinstance(job, Export):
            self.exports.append(number)
        elif _is_light(job):
            self.light.append(number)
        if isinstance(job, Export) and joins_parts(job):
            self._joined.update((self._exporter(job.stage, path), number) for path in job.files)
            self.joining[number] = None

    def writer_of_table(self, path: str) -> Key | None:
        """The job or export that writes a table; None where there is none yet."""
        number = self.number_of_table(path)
        return None if number is None else self.jobs.keys_by_number[number]

    def number_of_table(self, path: str) -> int | None:
        """The number of the job that writes a table; None where there is none yet."""
        return self._tables.writer(path)

    def joined_by(self, key: Key) -> PlannedJob | None:
        """The job that makes a file of the part that another one writes; None for all that write no part."""
        joiner = self._joined.get(self.jobs.number(key)) if self._joined else None
        return None if joiner is None else self.jobs.at(joiner)

    def is_exported(self, path: str) -> bool:
        """Whether a planned export writes a file, given relative to the project's root."""
        return self._files.writer(path) is not None

    def exported_shape(self, path: str) -> tuple[int, ...] | None:
        """The shape of the first raster of a file that a planned export writes; None where there is no such export."""
        number = self._files.writer(path)
        job = None if number is None else self.jobs.job(number)
        return self.specs[next(iter(job.rasters.values()))].shape if isinstance(job, Export) and job.rasters else None

    def exported_files(self, folder: str) -> tuple[str, ...]:
        """Files that planned exports write in a folder of the run, relative to the project's root, sorted."""
        prefix = f"{self.run_folder}/{folder}/"
        return tuple(sorted(path for path in self._files if path.startswith(prefix)))

    def _planned_job(self, job: Job) -> tuple[list[int], PlannedJob]:
        regions = [region for reading in job.reads.values() for region in regions_of(reading)]
        for region in regions:
            self._check_reader(job, region)
        numbers: dict[int, None] = {}
        sources: list[str] = []
        for region in regions:
            found, external = self._writers(job.stage, region)
            numbers.update(dict.fromkeys(found))
            sources.append(f"{region_text(region)}{external}" if not isinstance(region, Table) else region.path)
        held = sum(map(self._held_bytes, job.reads.values()))
        written = sum(self._spec(job, r.name).bytes_of(r.window) for r in job.writes.values() if isinstance(r, Raster))
        fingerprint = Fingerprint(
            settings=fp.digest(fp.of_value(job.params), *(self._output_text(job, name) for name in sorted(job.writes))),
            code=fp.of_code(job.function),
            # The fingerprints of the writers contain those of their writers: a change anywhere upstream is seen here.
            inputs=fp.digest(*job.reads, *sources, *(self.jobs.fingerprint(one).text for one in numbers)),
        )
        data = sum(map(self._bytes_of, regions)) + written
        return self._planned(job, numbers, fingerprint, PROCESS_BYTES + held + written + job.scratch, written, data)

    def _planned(
        self, job: Job | Export, numbers: Iterable[int], made_of: Fingerprint, memory: int, written: int, data: int
    ) -> tuple[list[int], PlannedJob]:
        before = list(numbers)
        keys = tuple(self.jobs.keys_by_number[number] for number in before)
        return before, PlannedJob(job, keys, made_of, memory, written, data)

    def _held_bytes(self, reading: Reading) -> int:
        """Bytes of one argument that are in memory at the same time."""
        if not isinstance(reading, Stream):
            return sum(map(self._bytes_of, regions_of(reading)))
        sizes = sorted(sum(map(self._bytes_of, regions_of(entry))) for entry in reading.regions)
        # A loop over a stream still holds one region while it reads the next one; of a group the function lets go before.
        return sum(sizes[-1 if reading.in_groups else -2 :])

    def _bytes_of(self, region: Region) -> int:
        if isinstance(region, Raster):
            return self.specs[region.name].bytes_of(region.window)
        if isinstance(region, PhotoPixels):
            # Photographs are counted as 8-bit RGB; a job that reads 16 bits or widens the values says so in `scratch`.
            return 3 * region.window.cells
        if isinstance(region, MapFile):
            return 4 * region.bands * region.window.cells
        if isinstance(region, HeightFile):
            # A point cloud holds some points for every cell while they are sorted.
            return 64 * region.window.cells
        if isinstance(region, MeshFile | CloudFile):
            # The text or the arrays of the file, and the arrays made from them.
            file = self.root / region.path
            return 3 * file.stat().st_size if file.exists() else 0
        return 0

    def _planned_export(self, export: Export) -> tuple[list[int], PlannedJob]:
        numbers: dict[int, None] = {}
        named = [Raster(name, self._part(export, name)) for name in export.rasters.values()]
        regions = [region for region in named if not region.window.empty]
        for region in regions if export.window else ():
            self._check_window(export, region)
        sources: tuple[Region, ...] = (*regions, *export.tables, *export.beside)
        for source in sources:
            numbers.update(dict.fromkeys(self._writers(export.stage, source)[0]))
        numbers.update(dict.fromkeys(self._exporter(export.stage, path) for path in export.files))
        tables = [table.path for table in (*export.tables, *export.beside)]
        part = [repr(export.window), *export.files] if export.window or export.files else []
        fingerprint = Fingerprint(
            settings=fp.digest(export.path, export.format, fp.of_value(export.rasters), *tables, *part),
            code=fp.of_code(export_file),
            inputs=fp.digest(*(self.jobs.fingerprint(one).text for one in numbers)),
        )
        data = sum(map(self._bytes_of, regions))
        return self._planned(export, numbers, fingerprint, PROCESS_BYTES + EXPORT_BYTES, 0, data)

    def _part(self, export: Export, name: str) -> Window:
        """What an export reads of one of its rasters; empty where that has nothing on the ground of its part."""
        spec = self._known(export.stage, name)
        if export.window is None:
            return spec.full
        first = self._known(export.stage, next(iter(export.rasters.values())))
        return export.window if spec.transform == first.transform else same_ground(export.window, first, spec)

    def _output_text(self, job: Job, name: str) -> str:
        output = job.writes[name]
        if not isinstance(output, Raster):
            return f"{name} {output.path}"
        self._spec(job, output.name)
        return f"{name} {region_text(output)} {self._spec_texts[output.name]}"

    def _spec(self, job: Job, name: str) -> RasterSpec:
        if name not in self.specs:
            raise GraphError(f"{job.key} writes the raster {name}, which was not announced.")
        return self.specs[name]

    def _known(self, stage: str, name: str) -> RasterSpec:
        if name not in self.specs:
            raise NoWriter(f"the raster {name}", stage)
        return self.specs[name]

    def check_table_reader(self, stage: str, path: str) -> None:
        """Raises GraphError when a stage may not read a table."""
        _check_allowed(stage, path, self._table_readers.get(path))

    def _check_reader(self, job: Job, region: Region) -> None:
        if isinstance(region, Table):
            self.check_table_reader(job.stage, region.path)
        if isinstance(region, Raster):
            _check_allowed(job.stage, region.name, self._known(job.stage, region.name).readers)
            self._check_window(job, region)

    def _check_window(self, job: Job | Export, region: Raster) -> None:
        spec = self._known(job.stage, region.name)
        if not _lies_in(region.window, spec.shape):
            raise GraphError(f"{job.key} reads {region.window} of {region.name}, which has the shape {spec.shape}.")

    def _writers(self, stage: str, region: Region) -> tuple[list[int], str]:
        """The jobs that write a region, and for a file of the user the digest of its content."""
        if isinstance(region, Raster):
            chunks = chunks_of(self.specs[region.name], region.window)
            return [self._chunk_writer(stage, region.name, chunk) for chunk in chunks], ""
        if isinstance(region, Table):
            if (number := self._tables.writer(region.path)) is None:
                raise NoWriter(f"the table {region.path}", stage)
            return [number], ""
        return self._file_writer(region)

    def _exporter(self, stage: str, path: str) -> int:
        """The export that writes a file of the run's folder."""
        if (number := self._files.writer(f"{self.run_folder}/{path}")) is None:
            raise NoWriter(f"the file {path}", stage)
        return number

    def _file_writer(self, region: FileRegion) -> tuple[list[int], str]:
        # A file in the run's folder that an export writes depends on that export, and is not looked at before it exists.
        if (number := self._files.writer(region.path)) is not None:
            return [number], ""
        refuse_joined(region.path)
        try:
            return [], fp.of_file(self.root / region.path)
        except OSError as error:
            raise WorkflowError(
                f"{region.path} cannot be read ({error.strerror}); put the file there or correct the workflow."
            ) from error

    def _chunk_writer(self, stage: str, name: str, chunk: Chunk) -> int:
        number = self._chunks.writer(name, chunk)
        if number is None:
            raise NoWriter(f"the raster {name} at chunk {chunk}", stage)
        return number

    def _claim_outputs(self, job: Job | Export, number: int, key: Key) -> None:
        if isinstance(job, Export):
            path = f"{self.run_folder}/{job.path}"
            self._check_claim(self._files.claim(path, number), number, key, path)
            return
        for output in job.writes.values():
            if isinstance(output, Table):
                self._check_claim(self._tables.claim(output.path, number), number, key, output.path)
                if output.readers is not None:
                    self._table_readers[output.path] = output.readers
                continue
            spec = self.specs[output.name]
            if not aligned(output.window, spec.shape, spec.chunks):
                raise GraphError(f"{key} writes {output.window} of {output.name}, which cuts its chunks of {spec.chunks[:2]}.")
            for chunk in chunks_of(spec, output.window):
                self._check_claim(self._chunks.claim(output.name, chunk, number), number, key, (output.name, *chunk))

    def _check_claim(self, writer: int, number: int, key: Key, what: object) -> None:
        if writer != number:
            raise GraphError(f"{what} has two writers: {self.jobs.keys_by_number[writer]} and {key}.")


def _lies_in(window: Window, shape: tuple[int, ...]) -> bool:
    """Whether a window holds pixels, all of them inside a raster of `shape`."""
    inside = (
        window.row >= 0 and window.col >= 0 and window.row + window.height <= shape[0] and window.col + window.width <= shape[1]
    )
    return inside and not window.empty


def _is_light(job: Job) -> bool:
    """Whether it reads headers, texts and tables only, and writes tables only."""
    # A job that reads nothing computes, and one that writes rasters does so at length.
    if not job.reads or not all(isinstance(region, Table) for region in job.writes.values()):
        return False
    regions = [region for reading in job.reads.values() for region in regions_of(reading)]
    return bool(regions) and all(isinstance(region, Table | TextFile | PhotoHeader | PhotoPicture) for region in regions)


def _check_allowed(stage: str, name: str, readers: tuple[str, ...] | None) -> None:
    if readers is not None and stage not in readers:
        raise GraphError(f"The stage {stage} may not read {name}; only {', '.join(readers)} may.")


def check_memory(planned: PlannedJob, room: int) -> None:
    """Raises ResourceError when a job needs more than `room` bytes, all that there is for a job that runs alone."""
    if planned.memory > room:
        remedy = f"with --memory or {planned.job.remedy}" if isinstance(planned.job, Job) else "with --memory"
        raise ResourceError(
            f"The job {'/'.join(map(str, planned.key))} needs {planned.memory / MIB:.0f} MiB, of which every worker takes "
            f"{PROCESS_BYTES / MIB:.0f} MiB for itself, but a job that runs alone may use {room / MIB:.0f} MiB; give "
            f"workers more memory {remedy}."
        )
