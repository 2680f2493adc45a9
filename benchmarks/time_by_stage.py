"""Where the time goes: processor time of every stage, for each megapixel of the photographs, and beside another program.

`python -m benchmarks time_by_stage [WORD...]`: a WORD is the folder of a finished run, which is read, or a flight that is run now,
by all defaults: a shipped project, or a folder of the shared data (ORTHOMILL_DATA), for which `orthomill init` writes the workflow.
Without words these are `volos`, `brighton` and `rtk_yard`. pyOrthomosaic (flight_peer.py) gets the photographs of a flight right
after ours. Processor time and not wall-clock time: it is the same on an idle and on a busy machine, and adds up over workers; of
whole commands it is that of all their processes, with all that they do before and after a job.
"""

import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

import orthomill as library
from benchmarks.flight_peer import PACKAGE, Delivery, own_delivery, peer_delivery, peer_environment, run_peer
from benchmarks.instrument.result_page import ROOT, write_page
from benchmarks.measured_run import MeasuredRun, orthomill, project_root, run_project
from orthomill.pipeline.engine.run_facts import RunFacts, StageRun, read_facts

FLIGHTS = ("volos", "brighton", "rtk_yard")
DATA = Path(os.environ.get("ORTHOMILL_DATA", ROOT.parent / "shared" / "data"))
TRUTH = ("simulation", "evaluation")
"""stages that exist for simulated photographs only"""
SURFACE = "densification"
"""the last stage of 'photographs to surface'"""
_SIDE_BY_SIDE = (
    "| program | CPU-s | CPU-s per Mpx | wall clock (s) | largest process (MiB) | surface (m2) | measured | its cell (m) "
    "| orthoimage (m2) | its pixel (m) |"
)


@dataclass(frozen=True)
class CommandRun:
    """A whole command on the photographs of a flight, and what it delivered."""

    program: str
    run: MeasuredRun
    delivery: Delivery

    def row(self, pixels: float) -> str:
        """A line of the table side by side; pixels: millions."""
        run, made = self.run, self.delivery
        cost = f"{run.cpu_seconds:.1f} | {run.cpu_seconds / pixels:.2f} | {run.seconds:.0f} | {run.peak_bytes / 2**20:.0f}"
        surface = f"{made.surface:.0f} | {100 * made.measured / max(made.surface, 1e-9):.0f} % | {made.surface_cell:.4f}"
        return f"| {self.program} | {cost} | {surface} | {made.ortho:.0f} | {made.ortho_cell:.4f} |"


def megapixels(run: Path) -> float:
    """All pixels of the photographs of a run, in millions."""
    return sum(photo.width * photo.height for photo in library.open(run).photographs.photos) / 1e6


def to_surface(facts: RunFacts) -> tuple[StageRun, ...]:
    """The stages from the photographs to the surface, in order."""
    kinds = [stage.kind for stage in facts.stages]
    last = kinds.index(SURFACE) + 1 if SURFACE in kinds else len(kinds)
    return tuple(stage for stage in facts.stages[:last] if stage.kind not in TRUTH)


def table(name: str, facts: RunFacts, pixels: float) -> list[str]:
    """The lines of one run; pixels: millions."""
    all_stages = tuple(stage for stage in facts.stages if stage.kind not in TRUTH)
    whole = sum(stage.cpu_seconds for stage in all_stages)
    return [
        f"## {name}: {pixels:.1f} Mpx",
        "",
        "| stage | CPU-s | share | CPU-s per Mpx | largest worker (MiB) |",
        "| --- | --- | --- | --- | --- |",
        *(_row(stage.kind.replace("_", " "), (stage,), whole, pixels) for stage in facts.stages),
        _row("**photographs to surface**", to_surface(facts), whole, pixels),
        _row("**photographs to products**", all_stages, whole, pixels),
        "",
    ]


def _row(name: str, stages: tuple[StageRun, ...], whole: float, pixels: float) -> str:
    seconds = sum(stage.cpu_seconds for stage in stages)
    # Truth is made and judged on no client's block, so that it has no share in what a block costs.
    share = "" if stages[0].kind in TRUTH else f"{100 * seconds / max(whole, 1e-9):.0f} %"
    peak = max(stage.peak_bytes or 0 for stage in stages)
    return f"| {name} | {seconds:.1f} | {share} | {seconds / pixels:.2f} | {peak / 2**20:.0f} |"


def side_by_side(runs: tuple[CommandRun, ...], pixels: float) -> list[str]:
    """What whole commands took on the same photographs, and what each delivered; pixels: millions."""
    return [
        "Whole commands:",
        "",
        _SIDE_BY_SIDE,
        "| --- " * (_SIDE_BY_SIDE.count("|") - 1) + "|",
        *(run.row(pixels) for run in runs),
        "",
        *(f"- products of {run.program}: {', '.join(run.delivery.products)}" for run in runs),
        "",
    ]


def of_run(run: Path) -> list[str]:
    """The lines of a finished run. Raises SystemExit for a folder without one."""
    facts = read_facts(run)
    if facts is None or not facts.stages:
        raise SystemExit(f"{run} is not the folder of a run; give folders like runs/volos.")
    return table(facts.project, facts, megapixels(run))


def photographs_of(flight: str) -> Path | None:
    """The folder of the photographs of a flight; None for one that is simulated. Raises SystemExit for what is no flight."""
    folders = (ROOT / "workflows" / "photographs" / flight, DATA / flight)
    found = next((folder for folder in folders if folder.is_dir()), None)
    if found is None and not _shipped(flight):
        raise SystemExit(f"{flight} is neither a finished run nor a shipped project nor a folder of {DATA} (ORTHOMILL_DATA).")
    return found


def _shipped(flight: str) -> bool:
    return (ROOT / "workflows" / f"{flight}.yaml").is_file()


def run_flight(flight: str, root: Path) -> MeasuredRun:
    """Run a flight in a root of its own."""
    if _shipped(flight):
        return run_project(project_root(root, flight), flight)
    (root / "workflows").mkdir(parents=True)
    begun = orthomill(root, "init", flight, "--photos", str(photographs_of(flight)))
    if begun.code != 0:
        raise SystemExit(begun.output)
    return run_project(root, flight)


def of_flight(flight: str, root: Path, peer: Path) -> list[str]:
    """The lines of a flight that is run now in `root`, and beside it by the program of the environment `peer`."""
    photographs, own = photographs_of(flight), run_flight(flight, root)
    run = root / "runs" / flight
    lines = of_run(run)
    if photographs is None:
        return lines
    other = run_peer(peer, photographs, root / "peer")
    runs = CommandRun("orthomill", own, own_delivery(run / "products")), CommandRun(PACKAGE, other, peer_delivery(root / "peer"))
    return lines + side_by_side(runs, megapixels(run))


def page(words: tuple[str, ...]) -> str:
    """The tables of finished runs and flights. Raises SystemExit for a word that is neither."""
    flights = tuple(word for word in words if not (Path(word) / "jobs").is_dir())
    for flight in flights:
        photographs_of(flight)
    lines = ["# Where the time goes", "", "Kernels compiled before.", ""]
    with tempfile.TemporaryDirectory() as scratch:
        peer = peer_environment(Path(scratch) / "environment") if any(map(photographs_of, flights)) else Path()
        for word in words:
            lines += of_flight(word, Path(scratch) / word, peer) if word in flights else of_run(Path(word))
    return "\n".join(lines)


def main(words: list[str]) -> None:
    """Write the page of the runs and flights that are named."""
    write_page("time_by_stage", words, page(tuple(words) or FLIGHTS))
