"""How well the remaining time is estimated: recorded runs are replayed, and every estimate is compared with what came.

    python -m benchmarks remaining_time                      the runs recorded in benchmarks/watching/recordings
    python -m benchmarks remaining_time LOG ...              every estimate of other recorded runs
    python -m benchmarks remaining_time --release            writes pipeline/forecast/costs.json from the recorded runs

A first run expects what the other blocks took, never its own; a second one what the first one of the same project took. Logs whose
name ends in `_cold` are of runs that compiled all their kernels. Replayed on the clock of an idle machine, the same on any machine.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.watching.recorded_run import WORKERS, Ended, Event, LaidOut, Planned, RunLog, read_log
from orthomill.pipeline.forecast import known_costs
from orthomill.pipeline.forecast.known_costs import Expectations, Family, FunctionCost, RunCosts, expected_from, measured_at_release
from orthomill.pipeline.watching.cost_model import CostModel, Remaining

RUNS = Path(__file__).parent / "recordings"
FROM, STEP, LAST = 60.0, 5.0, 10.0
"""seconds after the beginning and between estimates; in the last seconds a single job decides, and nobody plans by them"""
WITHIN = 30.0
"""per cent that are wanted"""
COLD = "_cold"
RELEASED = ("volos", "brighton", "caliterra", "buddha")
"""the runs that the package ships"""
SECOND = {"volos": "volos_cold", "volos_second": "volos", "brighton": "brighton_before", "ochota": "ochota_cold"}
"""(run, the run before it whose costs it knows)"""


@dataclass(frozen=True)
class Estimate:
    """At `time`, `left` s were left; `said` was estimated."""

    time: float
    left: float
    said: Remaining

    @property
    def off(self) -> float:
        """Per cent."""
        return 100 * (self.said.seconds - self.left) / self.left


def estimates(log: RunLog, expectations: Expectations, cold: bool = False) -> Iterator[Estimate]:
    """What a run told every STEP seconds."""
    now, due = 0.0, STEP
    model = CostModel(stages_of(log), WORKERS, expectations, cold, clock=lambda: now)
    last = {event.family[0]: number for number, event in enumerate(log.events) if isinstance(event, Planned)}
    for number, event in enumerate(log.events):
        if isinstance(event, Ended):
            while event.time > due:
                now = due
                if (said := model.remaining()) is not None:
                    yield Estimate(due, log.whole - due, said)
                due += STEP
            now = event.time
        tell(model, event, closes=number in last.values())


def stages_of(log: RunLog) -> tuple[str, ...]:
    """All stages of a run, in the order in which they were planned."""
    return tuple(dict.fromkeys(event.family[0] for event in log.events if isinstance(event, Planned)))


def tell(model: CostModel, event: Event, closes: bool = False) -> None:
    """Tell a model what happened."""
    if isinstance(event, LaidOut):
        model.laid_out(event.stage, event.megapixels)
    elif isinstance(event, Ended):
        model.took(event.family, event.seconds, event.worker, event.effort)
    else:
        for job in range(event.jobs):
            model.count(event.family, event.effort / event.jobs, closes=closes and job + 1 == event.jobs)


def costs_of(log: RunLog) -> RunCosts:
    """What a run would have left in its folder, with nothing known before."""
    stages: dict[str, dict[str, FunctionCost]] = {}
    ended = [event for event in log.events if isinstance(event, Ended)]
    for stage, function in sorted({event.family for event in ended}):
        own = [event for event in ended if event.family == (stage, function)]
        seconds, effort = sum(event.seconds for event in own), sum(event.effort for event in own)
        stages.setdefault(stage, {})[function] = FunctionCost(len(own), round(seconds, 3), round(effort, 3))
    grids = {event.stage: event.megapixels for event in log.events if isinstance(event, LaidOut)}
    return RunCosts(log.megapixels, 512, stages, grids)


def compiling(cold: RunCosts, warm: RunCosts) -> dict[Family, float]:
    """Seconds that a worker compiles, by function: what a run without cached kernels took more than one with them."""
    found = {}
    for stage, functions in cold.stages.items():
        for name, cost in functions.items():
            usual = warm.stages.get(stage, {}).get(name)
            # Functions of one or two jobs are compiled by as many workers. What is below a second is the noise of the machine.
            if (
                usual
                and (more := (cost.seconds - usual.seconds) / min(WORKERS, cost.jobs)) > 1.0
                and cost.seconds > 1.5 * usual.seconds
            ):
                found[stage, name] = round(more, 1)
    return found


def released() -> dict[str, object]:
    """What the package ships."""
    costs = {path.name.removesuffix(".json.gz"): costs_of(read_log(path)) for path in sorted(RUNS.glob("*.json.gz"))}
    # Of blocks that are not recorded and functions that no cold run had, what was measured for an earlier release stays.
    runs, compiled = measured_at_release()[0] | costs, dict(measured_at_release()[1])
    for name, cold in costs.items():
        if name.endswith(COLD) and (warm := costs.get(name.removesuffix(COLD))):
            compiled |= compiling(cold, warm)
    stages: dict[str, dict[str, float]] = {}
    for (stage, name), seconds in sorted(compiled.items()):
        stages.setdefault(stage, {})[name] = seconds
    return {"compiling": stages, "runs": {name: asdict(runs[name]) for name in RELEASED}}


def first_and_second(logs: Mapping[str, RunLog]) -> Iterator[tuple[str, RunLog, Expectations]]:
    """(what is judged, its log, what it may expect)."""
    shipped, compiled = measured_at_release()
    for name, log in logs.items():
        block = name.split("_")[0]
        others = [run for other, run in shipped.items() if other != block]
        yield f"{name}, first", log, expected_from(None, others, compiled, log.megapixels, 512, here=False)
        if block in shipped:
            yield f"{name}, as released", log, expected_from(None, shipped.values(), compiled, log.megapixels, 512, here=False)
        if SECOND.get(name) in logs:
            before = kept_by(logs[SECOND[name]], others, compiled)
            yield f"{name}, after {SECOND[name]}", log, expected_from(before, others, compiled, log.megapixels, 512, here=True)


def kept_by(log: RunLog, others: list[RunCosts], compiled: Mapping[Family, float]) -> RunCosts:
    """What a run leaves for the next one."""
    model = CostModel(stages_of(log), WORKERS, expected_from(None, others, compiled, log.megapixels, 512, here=False))
    for event in log.events:
        tell(model, event)
    return RunCosts(log.megapixels, 512, model.costs(), model.grids)


def summary_line(name: str, log: RunLog, found: list[Estimate]) -> str:
    """One row of the table."""
    judged = [one for one in found if one.time >= FROM and one.left >= LAST]
    within = sum(abs(one.off) <= WITHIN for one in judged) / len(judged)
    covered = sum(one.said.range[0] <= one.left <= one.said.range[1] for one in judged) / len(judged)
    at = next(one.off for one in judged)
    worst = f"{min(one.off for one in judged):+.0f} to {max(one.off for one in judged):+.0f}"
    return f"| {name} | {log.whole:.0f} | {at:+.0f} | {worst} | {100 * within:.0f} | {100 * covered:.0f} |"


def main(words: list[str]) -> None:
    """Print the table, or every estimate."""
    if words == ["--release"]:
        path = Path(known_costs.__file__).parent / "costs.json"
        path.write_text(json.dumps(released(), indent=1) + "\n")
        return
    logs = {path.name.removesuffix(".json.gz"): read_log(path) for path in map(Path, words or sorted(RUNS.glob("*.json.gz")))}
    if not words:
        print("| run | whole (s) | at 60 s (%) | from then on (%) | within 30 % | said error covers (%) |")
        print("| --- | --- | --- | --- | --- | --- |")
    for name, log, known in first_and_second(logs):
        found = list(estimates(log, known, cold=f"{COLD}," in name))
        if words:
            print(f"{name}\n{'after s':>8} {'left s':>8} {'said s':>8} {'+-':>6} {'off %':>6}")
            for one in found:
                print(f"{one.time:8.0f} {one.left:8.0f} {one.said.seconds:8.0f} {one.said.error:6.0f} {one.off:6.0f}")
        elif log.whole > FROM + LAST:
            print(summary_line(name, log, found))
