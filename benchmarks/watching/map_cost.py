"""What the map of tiles costs a run: a finished run is told to it again, job by job, while a page asks ten times a second.

    python -m benchmarks map_cost PROJECT     (a project with a finished run, or the path of its workflow)

Processor time of the process of the scheduler, beside that of the jobs: a worker that waits for it waits that long at most.
"""

import gzip
import json
import time
from pathlib import Path

from benchmarks.watching.recorded_run import WORKERS, Replayed
from orthomill.pipeline.engine.runner import Finished
from orthomill.pipeline.engine.running import session_of
from orthomill.pipeline.forecast.known_costs import expectations
from orthomill.pipeline.records.records import Records
from orthomill.pipeline.watching.cost_model import CostModel
from orthomill.pipeline.watching.live_map import LiveMap
from orthomill.pipeline.workflow.workflow_file import load_workflow, resolve_workflow
from orthomill.tasks.catalogue import STAGES

TENTH = 10
"""of the pictures every tenth is drawn and counted as ten"""
ASKED = 0.1
"""seconds of work of all workers between two answers"""


def main(words: list[str]) -> None:
    """Print both times and their ratio."""
    session = session_of(load_workflow(resolve_workflow(words[0], Path.cwd()), STAGES))
    session.__class__ = Replayed
    kept = [record for stage in session.stages for record in Records(session.folder).of_stage(stage.kind)]
    records = {record.key: record for record in kept if record.status == "done"}
    known = -1
    while len(session.graph.jobs) > known:
        known = len(session.graph.jobs)
        list(session.planner.advance())
        for key in session.graph.jobs.keys() & records.keys():
            session.done.add(key)
    work, due, answers = 0.0, 0.0, 0
    model = CostModel(tuple(stage.kind for stage in session.stages), WORKERS, expectations(session.folder, 0.0, 512))
    begun = time.process_time()
    shown = LiveMap(session, model, 2**30)
    for planned in session.graph.jobs.values():
        model.planned(planned)
        shown.planned(planned)
    asked = {"tiles": 0, "changes": 0}
    for key in sorted(records.keys() & session.graph.jobs.keys(), key=lambda key: records[key].started):
        shown.board.started(key, records[key].worker)
        model.finished(Finished(key, "done"), records[key])
        shown.finished(Finished(key, "done"), records[key])
        work += records[key].cpu_seconds
        while work / WORKERS > due:
            answer = shown.changes(asked["tiles"], asked["changes"])
            gzip.compress(json.dumps(answer).encode(), 1)
            asked, due, answers = answer, due + ASKED, answers + 1
    page = len(shown.kept_page())
    cost = time.process_time() - begun
    print(f"{len(records)} jobs of {work:.0f} s, {answers} answers, kept page of {page / 1e3:.0f} kB")
    print(f"the map: {cost:.2f} s, {100 * cost / work:.2f} % of the jobs' processor time")
    begun, ground = time.process_time(), on_the_ground(shown)
    for tile in ground[::TENTH]:
        shown.picture(tile)
    seen = TENTH * (time.process_time() - begun)
    print(f"{len(ground)} pictures of tiles on the ground, if a page scrolls past all: {seen:.1f} s, {100 * seen / work:.2f} %")


def on_the_ground(shown: LiveMap) -> list[int]:
    """The tiles whose pictures a page asks for."""
    whole = shown.changes(0, 0)
    return [tile for tile, panel in enumerate(whole["places"][::3]) if whole["panels"][panel][2]]
