"""What is known of a run apart from its results: when, where, how long, what was skipped, what failed.

Plain frozen values that the engine fills, keeps in `jobs/run.json`, and that the summary and the report print.
"""

from dataclasses import dataclass, field
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.project import Tolerances

DASHBOARD = "jobs/dashboard.txt"
"""Holds the address of the dashboard while a run on Dask is in progress."""
TILES = "jobs/tiles.txt"
"""Holds the address of the map of tiles while one is served."""
TIME_FORMAT = "%Y-%m-%dT%H:%M:%S%z"


FACTS = "jobs/run.json"
StageTitle = tuple[str, str]
"""(kind, title) of a stage, in the order of the workflow."""


@dataclass(frozen=True)
class StageRun:
    """The state of one stage. `jobs` are all jobs planned; those neither done, skipped nor failed are still waiting."""

    kind: str
    jobs: int = 0
    done: int = 0
    """finished in this run"""
    skipped: int = 0
    """unchanged since an earlier run"""
    failed: int = 0
    seconds: float = 0.0
    """working time of its jobs added up, s, whichever run did them"""
    peak_bytes: int | None = None
    """largest memory of a worker while one of its jobs ran, whichever run did it"""
    cpu_seconds: float = 0.0
    """processor time of its jobs added up, s, whichever run did them"""
    written: int = 0
    """bytes that its jobs left on the disk, whichever run did them"""
    reported: bool = True
    """whether its report, where there is one, describes its present results and not those of an earlier run"""

    @property
    def waiting(self) -> int:
        """Planned jobs that have not ended."""
        # At least 0: facts of a run that was killed while it planned may count a job as done before it is counted as planned.
        return max(self.jobs - self.done - self.skipped - self.failed, 0)

    @property
    def complete(self) -> bool:
        """Whether all its jobs are done, in this run or before."""
        return self.jobs > 0 and self.done + self.skipped >= self.jobs and self.failed == 0


@dataclass(frozen=True)
class Failure:
    """A job that failed: its key as text (`stage/item/row/col`), and one sentence."""

    stage: str
    key: str
    sentence: str


@dataclass(frozen=True)
class RunFacts:
    """One run of one project. Times are ISO 8601 text; `finished` is None while it runs or when it was interrupted."""

    project: str
    crs: str
    version: str
    started: str
    finished: str | None = None
    seconds: float = 0.0
    """wall clock of this run, s"""
    earlier: tuple[float, ...] = ()
    """wall clock of each earlier run whose results still hold, from its first to its last job among them, s"""
    pixels: int = 0
    """of all photographs, 0 where they were not known when the run began"""
    tile: int = 0
    """side of a tile, px"""
    peak_bytes: int | None = None
    scheduler: str = ""
    """one phrase, e.g. "2 processes on this machine"."""
    machine: tuple[tuple[str, str], ...] = ()
    """(what, value) rows: processor, cores, memory, operating system, versions of libraries"""
    stages: tuple[StageRun, ...] = ()
    failures: tuple[Failure, ...] = ()
    tolerances: Tolerances = field(default_factory=Tolerances)
    """what the survey allows"""
    workflow: str = ""
    """the workflow as run, every default filled in (YAML text)"""
    written_by: str = ""
    """digest of the code that wrote summary and report"""

    def stage(self, kind: str) -> StageRun:
        """The facts of a stage; an empty record when it has not been planned."""
        return next((stage for stage in self.stages if stage.kind == kind), StageRun(kind))

    @property
    def complete(self) -> bool:
        """Finished, and every job of every stage done or unchanged."""
        return self.finished is not None and not self.failures and bool(self.stages) and all(s.complete for s in self.stages)

    @property
    def worked(self) -> bool:
        """Whether this run did anything: jobs that are neither done nor failed now were blocked or found unchanged."""
        return any(stage.done or stage.failed for stage in self.stages)

    @property
    def runs(self) -> int:
        """How many runs made the results."""
        return len(self.earlier) + any(stage.done for stage in self.stages)

    @property
    def whole_seconds(self) -> float:
        """Wall clock of all runs that made the results, s."""
        return sum(self.earlier) + self.seconds

    def describes(self, later: "RunFacts") -> bool:
        """Whether these facts of a complete run still hold after a later one that had nothing to do."""
        return self.complete and self.workflow == later.workflow and all(self.stage(stage.kind).jobs for stage in later.stages)


_FACTS = TypeAdapter(RunFacts)


def write_facts(folder: Path, facts: RunFacts) -> None:
    """Store what summary and report are made from, apart from the results. Raises StoreError when the disk refuses."""
    write_whole(folder / FACTS, _FACTS.dump_json(facts, indent=1))


def read_facts(folder: Path) -> RunFacts | None:
    """The facts that the last run left; None when there are none, or none that this version can read."""
    try:
        return _FACTS.validate_json((folder / FACTS).read_bytes())
    except (FileNotFoundError, ValidationError):
        return None
