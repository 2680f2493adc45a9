"""What the user's files tell before the first job: jobs that read headers and texts only are done in memory, nothing is written.
Pictures are taken for whole: to look at all of them takes minutes, which are the first of a run.

Their mistakes are told at once and together, not after half an hour in a later stage; their tables let the stages plan further, and
say what they notice. The run does these jobs again, as any other: they take milliseconds, and what is stored has one origin.
"""

from collections.abc import Iterator
from math import prod
from typing import Any

from orthomill.pipeline.engine.execute import read_all, read_file, results_by_name
from orthomill.pipeline.engine.graph import NoWriter
from orthomill.pipeline.engine.planned.planned_jobs import PlannedJob
from orthomill.pipeline.engine.session import Session
from orthomill.pipeline.storage.image_files import header_or_fault
from orthomill.pipeline.storage.photographs.folder_listing import left_out_lines, list_folder, with_those_below
from orthomill.schemas.errors import OrthomillError, WorkflowError, first_of
from orthomill.schemas.job import Job, PhotoHeader, PhotoPicture, Region, Table, TextFile, regions_of
from orthomill.schemas.photo import Soundness
from orthomill.schemas.stage_contract import NotYet, Stage


class Foresight:
    """The results, in memory, of the planned jobs that depend on nothing but headers and texts of the user."""

    def __init__(self, session: Session) -> None:
        self.tables: dict[str, Any] = {}
        """by path; those of valid earlier results are read from the store"""
        self.mistakes: list[str] = []
        """one sentence or more for each job that could not be done"""
        self._session = session
        self._from_files: set[str] = set()
        """tables that depend on nothing but headers and texts, whether they were made now or earlier"""

    def look(self) -> None:
        """Do all such jobs that are planned. Raises WorkflowError with the mistakes that their files hold."""
        graph = self._session.graph
        for planned in map(graph.jobs.at, graph.light):
            if isinstance(planned.job, Job):
                self._attempt(planned, planned.job)
        if self.mistakes:
            raise WorkflowError(first_of(self.mistakes))

    def remarks(self) -> tuple[str, ...]:
        """What is left out of the folder of photographs, and what the stages notice in the files, as sentences."""
        with self._session.planner.expecting(self.tables):
            noticed = tuple(sentence for stage in self._session.stages for sentence in self._remarks_of(stage))
        return *self._left_out(), *noticed

    def _left_out(self) -> tuple[str, ...]:
        source, root = self._session.project.photographs, self._session.root
        # With a pattern, what is left out is the user's own choice. A folder that is gone, with all photographs read, is none of
        # this run's business.
        if source.kind != "folder" or source.pattern != "*" or not (root / source.path).is_dir():
            return ()
        return tuple(left_out_lines(with_those_below(root, source, list_folder(root, source))))

    def _remarks_of(self, stage: Stage) -> Iterator[str]:
        try:
            yield from stage.remarks(self._session.planner)
        except (NotYet, NoWriter):  # depends on a job that reads more than headers and texts
            return

    def _attempt(self, planned: PlannedJob, job: Job) -> None:
        regions = [region for reading in job.reads.values() for region in regions_of(reading)]
        written = {name: region.path for name, region in job.writes.items() if isinstance(region, Table)}
        if not all(map(self._is_known, regions)) or self._from_files.issuperset(written.values()):
            return
        if not self._session.is_valid(planned.key):
            before = len(self.mistakes)
            try:
                inputs = {name: read_all(reading, self._value) for name, reading in job.reads.items()}
                if len(self.mistakes) > before:
                    return
                values = results_by_name(job.function(**inputs, **job.params), job)
            except OrthomillError as error:
                self.mistakes.append(_in_files(str(error), regions))
                return
            except Exception:  # a defect: the run reports it as that of a job, with its traceback in the record
                return
            self.tables.update({path: values[name] for name, path in written.items() if name in values})
        self._from_files.update(written.values())

    def _is_known(self, region: Region) -> bool:
        if isinstance(region, Table):
            return region.path in self._from_files
        return isinstance(region, TextFile | PhotoHeader | PhotoPicture) and not self._session.graph.is_exported(region.path)

    def _value(self, region: Region) -> Any:
        if isinstance(region, Table):
            return self.tables[region.path] if region.path in self.tables else self._session.store.table(region)
        if isinstance(region, PhotoPicture):
            return Soundness(path=region.path)
        assert isinstance(region, TextFile | PhotoHeader)
        try:
            return read_file(self._session.root, region)
        except OrthomillError as error:  # kept, so that the mistakes of all files are told and not only those of the first
            self.mistakes.append(str(error))
            return None


def _in_files(mistake: str, regions: list[Region]) -> str:
    """The sentence of a job, which knows texts only, with the paths of the files that they come from."""
    paths = [region.path for region in regions if isinstance(region, TextFile) and region.path not in mistake]
    return f"{', '.join(paths)}: {mistake}" if paths else mistake


def plan_ahead(session: Session) -> Foresight:
    """Plan as far as the user's files tell, for show: jobs may be planned from tables that no job has written. Raises
    WorkflowError for mistakes in the files."""
    foresight = Foresight(session)
    known = -1
    while len(foresight.tables) > known:
        known = len(foresight.tables)
        with session.planner.expecting(foresight.tables):
            session.plan()
        foresight.look()
    return foresight


def photograph_pixels(session: Session) -> int:
    """Pixels of all photographs: from their headers, or from what simulates them; 0 while they are not known."""
    try:
        files = session.planner.image_files(session.project.photographs)
        return sum(_pixels(session, path) for path in files)
    except (NotYet, NoWriter, OrthomillError):
        return 0


def _pixels(session: Session, path: str) -> int:
    shape = session.graph.exported_shape(path)
    if shape is not None:
        return prod(shape[:2])
    header = header_or_fault(session.root / path)
    return header.width * header.height
