"""A finished run as a log of its jobs on a clock of its own, so that it can be replayed without its data.

    python -m benchmarks recorded_run PROJECT LOG     (a project with a finished run, or the path of its workflow)

The clock shows what an idle machine's would: jobs begin in the order of the records, when their inputs are there and one of WORKERS
is free, and last as long as the processor worked for them. Who else used the machine at that time does not matter.
"""

import gzip
import heapq
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from orthomill.pipeline.engine.foresight import photograph_pixels
from orthomill.pipeline.engine.running import session_of
from orthomill.pipeline.engine.session import Session
from orthomill.pipeline.forecast.known_costs import Family, effort_of, family_of, largest_grids
from orthomill.pipeline.records.numbered_names import Key
from orthomill.pipeline.records.records import Record, Records
from orthomill.pipeline.workflow.workflow_file import load_workflow, resolve_workflow
from orthomill.tasks.catalogue import STAGES

WORKERS = 2
OVERHEAD = 0.01
"""seconds between two jobs of a worker"""


@dataclass(frozen=True)
class Planned:
    """So many jobs of a family have been planned, one after another, with so much effort in all."""

    family: Family
    jobs: int
    effort: float


@dataclass(frozen=True)
class LaidOut:
    """A stage has announced its largest raster so far, of so many megapixels."""

    stage: str
    megapixels: float


@dataclass(frozen=True)
class Ended:
    """A job of a family has ended at `time`, s after the beginning, after so many seconds of processor time."""

    family: Family
    worker: str
    seconds: float
    time: float
    effort: float


Event = Planned | LaidOut | Ended


@dataclass(frozen=True)
class RunLog:
    """A run: pixels of its photographs in millions, and what happened, in that order."""

    megapixels: float
    events: tuple[Event, ...]

    @property
    def whole(self) -> float:
        """Seconds that the run took."""
        return max(event.time for event in self.events if isinstance(event, Ended))


def read_log(path: Path) -> RunLog:
    """A log as `write_log` left it."""
    held = json.loads(gzip.decompress(path.read_bytes()))
    families = [(stage, function) for stage, function in held["families"]]
    return RunLog(held["megapixels"], tuple(_event(families, *row) for row in held["events"]))


def _event(families: list[Family], kind: str, *rest: Any) -> Event:
    if kind == "g":
        return LaidOut(*rest)
    family, *numbers = rest
    if kind == "p":
        return Planned(families[family], *numbers)
    worker, seconds, time, effort = numbers
    return Ended(families[family], str(worker), seconds, time, effort)


def write_log(path: Path, log: RunLog) -> None:
    """Rows: g, stage, megapixels; p, family, jobs, effort; e, family, worker, seconds of processor time, time, effort."""
    families = sorted({event.family for event in log.events if not isinstance(event, LaidOut)})
    workers = sorted({event.worker for event in log.events if isinstance(event, Ended)})
    rows: list[list[object]] = []
    for event in log.events:
        if isinstance(event, LaidOut):
            rows.append(["g", event.stage, event.megapixels])
        elif isinstance(event, Planned):
            rows.append(["p", families.index(event.family), event.jobs, event.effort])
        else:
            what = families.index(event.family), workers.index(event.worker)
            rows.append(["e", *what, event.seconds, event.time, event.effort])
    held = {"megapixels": round(log.megapixels, 2), "families": families, "events": rows}
    # Without the time of day in its header, the same run is the same file.
    path.write_bytes(gzip.compress(json.dumps(held, separators=(",", ":")).encode(), mtime=0))


class Replayed(Session):
    """A session that plans as the recorded run did, when the tables that its stages wait for were done."""

    def is_valid(self, key: Key) -> bool:
        """Whether the job had ended at this time of the replay."""
        return key in self.done


class _Recorder:
    """Walks through the records of a run in the order in which its jobs began."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._free, self._ends = [0.0] * WORKERS, dict[Key, float]()
        self._running: list[tuple[float, int, Record]] = []
        self._grids = dict[str, float]()
        records = [record for stage in session.stages for record in Records(session.folder).of_stage(stage.kind)]
        self._records = sorted((one for one in records if one.status == "done"), key=lambda record: record.started)

    def events(self) -> Iterator[Event]:
        """Everything that happened."""
        yield from self._plan()
        while self._records or self._running:
            record = next((record for record in self._records if record.key in self._session.graph.jobs), None)
            if record is not None:
                self._records.remove(record)
                self._begin(record)
            elif not self._running:
                raise SystemExit(
                    f"{len(self._records)} records are of jobs that this version does not plan: {self._records[0].key}"
                )
            while self._running and (record is None or self._running[0][0] <= min(self._free)):
                yield from self._end()
                record = record or next((one for one in self._records if one.key in self._session.graph.jobs), None)

    def _begin(self, record: Record) -> None:
        before = self._session.graph.jobs[record.key].dependencies
        worker = self._free.index(min(self._free))
        begun = max([self._free[worker], *(self._ends.get(key, 0.0) for key in before)])
        self._free[worker] = self._ends[record.key] = begun + record.cpu_seconds + OVERHEAD
        heapq.heappush(self._running, (self._free[worker], len(self._ends), record))

    def _end(self) -> Iterator[Event]:
        time, _, record = heapq.heappop(self._running)
        family, effort = self._known(record.key)
        yield Ended(family, record.worker, round(record.cpu_seconds, 3), round(time, 2), effort)
        self._session.done.add(record.key)
        yield from self._plan()

    def _plan(self) -> Iterator[Event]:
        new = [planned.key for planned in self._session.planner.advance()]
        for stage, grid in largest_grids(self._session.graph.specs.values()).items():
            if grid > self._grids.get(stage, 0.0):
                self._grids[stage] = grid
                yield LaidOut(stage, round(grid, 3))
        for key in new:
            family, effort = self._known(key)
            yield Planned(family, 1, effort)

    def _known(self, key: Key) -> tuple[Family, float]:
        planned = self._session.graph.jobs[key]
        return family_of(planned), round(effort_of(planned), 2)


def recorded(workflow: Path) -> RunLog:
    """The log of the finished run of a project."""
    session = session_of(load_workflow(workflow, STAGES))
    session.__class__ = Replayed
    found: list[Event] = []
    for event in _Recorder(session).events():
        if isinstance(event, Planned) and found and isinstance(found[-1], Planned) and found[-1].family == event.family:
            found[-1] = Planned(event.family, found[-1].jobs + event.jobs, round(found[-1].effort + event.effort, 2))
        else:
            found.append(event)
    return RunLog(photograph_pixels(session) / 1e6, tuple(found))


def main(words: list[str]) -> None:
    """Record one run."""
    log = recorded(resolve_workflow(words[0], Path.cwd()))
    write_log(Path(words[1]), log)
    print(f"{len(log.events)} events, {log.whole:.0f} s, {log.megapixels:.1f} megapixels")
