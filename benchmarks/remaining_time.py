"""How well the remaining time is estimated: finished runs are replayed job by job, and every estimate compared with what came.

    python -m benchmarks.remaining_time PROJECT ...     (names of projects with a finished run, or paths of their workflows)

A run counts if one run did all of its jobs. Times of day come from the records, so that a loaded machine is part of what is judged.
"""

import sys
from pathlib import Path

from orthomill.pipeline.engine.runner import Finished
from orthomill.pipeline.engine.running import session_of
from orthomill.pipeline.engine.session import Session
from orthomill.pipeline.records.records import Key, Record, Records
from orthomill.pipeline.watching.cost_model import CostModel, Remaining
from orthomill.pipeline.workflow.workflow_file import load_workflow, resolve_workflow
from orthomill.tasks.catalogue import STAGES

FROM, STEP, WORKERS = 60.0, 10.0, 2
"""seconds after the beginning, and between estimates; workers of the recorded runs"""


class Replayed(Session):
    """A session that plans as the recorded run did, when the tables that its stages wait for were done."""

    def is_valid(self, key: Key) -> bool:
        """Whether the job had ended at this time of the replay."""
        return key in self.done


def estimates(workflow: Path) -> list[tuple[float, float, Remaining]]:
    """(seconds since the beginning, seconds that were then left, what was estimated) every STEP seconds."""
    loaded = load_workflow(workflow, STAGES)
    session = session_of(loaded)
    session.__class__ = Replayed
    model = CostModel({stage.kind: stage.usual_cost for stage in loaded.stages}, WORKERS)
    records = sorted(recorded(session), key=ended)
    begun = min(record.started for record in records)
    announced, found, due = 0, list[tuple[float, float, Remaining]](), STEP
    for record in records:
        session.planner.advance()
        new = list(session.graph.jobs)[announced:]
        announced += len(new)
        for key in new:
            model.planned(session.graph.jobs[key])
        if record.key in session.graph.jobs:
            model.finished(Finished(record.key, "done"), record.seconds)
            session.done.add(record.key)
        now = ended(record) - begun
        if now >= due and (remaining := model.remaining()):
            found.append((now, ended(records[-1]) - begun - now, remaining))
            due += STEP
    return found


def recorded(session: Session) -> list[Record]:
    """The records of all jobs of a project."""
    return [record for stage in session.stages for record in Records(session.folder).of_stage(stage.kind)]


def ended(record: Record) -> float:
    """When a job ended, s since 1970."""
    return record.started + record.seconds


def main() -> None:
    """Print a table for every project."""
    for name in sys.argv[1:]:
        print(f"{name}\n{'after s':>8} {'left s':>8} {'said s':>8} {'+-':>6} {'off %':>6}")
        for now, left, said in estimates(resolve_workflow(name, Path.cwd())):
            off = 100 * (said.seconds - left) / left if left > 0 else 0.0
            worse = " <" if now >= FROM and abs(off) > 30 else ""
            print(f"{now:8.0f} {left:8.0f} {said.seconds:8.0f} {said.error:6.0f} {off:6.0f}{worse}")


if __name__ == "__main__":
    main()
