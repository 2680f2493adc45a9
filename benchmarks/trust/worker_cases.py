"""Workers of a cluster that join, are killed, leave, are small or of another version: does every run end, and how?

python -m benchmarks worker_cases [RUNS [MINUTES]]

Each run has a scheduler, workers and a command of its own, all of them processes; what happens to the workers happens at a moment
by lot after the first tile is there, or all the time. The project is that of the engine's tests, whose first stage takes half a
second a tile (three where workers leave). Where no worker may do the jobs the command must end with a sentence. A run that has not
ended after five minutes hangs.
"""

import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path

from benchmarks.instrument.result_page import write_page
from benchmarks.trust.cluster_nodes import Cluster, cluster
from benchmarks.trust.kept_results import kept
from benchmarks.trust.session_on_cluster import run_session
from orthomill.pipeline.engine.graph import PROCESS_BYTES
from orthomill.pipeline.storage.depots.folder import Folder
from orthomill.schemas.job import Job
from tests.support.engine import toy_stages
from tests.support.engine.toy_stages import SmoothStage, SourceStage, SumStage, run_in, session_in

ROOT = Path(__file__).parents[2]
PATIENCE = 90.0
"""seconds without anybody at work after which a run is given up; 600 for a user's"""
HANGS = 300.0
"""seconds after which a run is taken to hang"""
AT_ONCE = 5
"""runs side by side"""
LATEST = 4.0
"""seconds after the first tile before which something happens"""
NOTICE = 2.0
"""seconds between the notice that a machine is taken away and its end"""
ELSEWHERE = 3.0
"""seconds until a machine that was taken away is replaced"""
HALF = "1GiB"
NEEDED = 1400 * 2**20
"""bytes that a job of the first stage is said to need where there is not enough memory for all: more than half of a worker's"""
OTHER = "import orthomill.pipeline.engine.workers.worker_terms as terms\nterms.__version__ = '0.0.1'\n"


Ended = Callable[[], bool]
"""whether the command has ended"""


@dataclass(frozen=True)
class Case:
    """What happens to the workers: the words that each has at the beginning, what happens then, whether the run can be whole."""

    name: str
    workers: tuple[tuple[str, ...], ...]
    happens: Callable[[Cluster, random.Random, Ended], bool] = lambda cluster, chance, ended: True
    whole: bool = True
    demanding: bool = False
    """whether the jobs need more than half of a worker's memory"""
    always: bool = False
    """whether it begins before the first tile is there"""
    pause: float = 0.5
    """seconds that a tile takes"""


@dataclass(frozen=True)
class Ending:
    """How a run ended: its command's code (None: it hung), what it said last, seconds, results that are not those of a run alone,
    and whether what was to happen to the workers did while the run lasted."""

    code: int | None
    said: str
    seconds: float
    differing: int
    happened: bool

    def as_expected(self, whole: bool) -> bool:
        """Whole and the same, or ended with a sentence."""
        if whole:
            return self.code == 0 and not self.differing
        return bool(self.code) and self.said.endswith(".") and "Traceback" not in self.said


def _joins(cluster: Cluster, chance: random.Random, ended: Ended) -> bool:
    cluster.join()
    return True


def _killed(cluster: Cluster, chance: random.Random, ended: Ended) -> bool:
    return chance.choice(cluster.nodes).kill_worker()


def _walltime(cluster: Cluster, chance: random.Random, ended: Ended) -> bool:
    """The batch system starts others for those whose time is over."""
    until = time.monotonic() + HANGS
    while not ended() and time.monotonic() < until:
        time.sleep(ELSEWHERE)
        for node in cluster.nodes:
            node.replace()
    return any(node.revived for node in cluster.nodes)


def _preempted(cluster: Cluster, chance: random.Random, ended: Ended) -> bool:
    """A notice, the end, and another machine a little later."""
    node = chance.choice(cluster.nodes)
    node.warn()
    time.sleep(NOTICE)
    node.end()
    time.sleep(ELSEWHERE)
    cluster.join()
    return True


def _cases(other: Path) -> tuple[Case, ...]:
    """`other`: a file that makes a worker one of another version."""
    plain, half, version = (), ("--memory-limit", HALF), ("--preload", str(other))
    walltime = ("--lifetime", "25 seconds", "--lifetime-stagger", "5 seconds")
    return (
        Case("a second worker joins", (plain,), _joins),
        Case("one of two workers is killed with -9; its nanny starts another", (plain, plain), _killed),
        Case("the only worker is killed with -9 and started again", (plain,), _killed),
        Case("workers leave after 20 to 30 s (`--lifetime`), others come", (walltime, walltime), _walltime, always=True, pause=3.0),
        Case("one of two is taken away 2 s after a notice, another comes 3 s later", (plain, plain), _preempted),
        Case("one of two has half the memory, too little for some jobs", (plain, half), demanding=True),
        Case("all have half the memory, too little for some jobs", (half, half), whole=False, demanding=True),
        Case("one of two has another version", (plain, version)),
        Case("all have another version", (version, version), whole=False),
    )


def run_at(root: str, address: str, workers: int, demanding: bool, pause: float) -> None:
    """The command, in a process of its own: what `orthomill run --scheduler` does once so many workers are there."""
    source = (DemandingStage if demanding else SourceStage)(rows=500, cols=500, pause=pause)
    session = session_in(Path(root), source, SmoothStage(), SumStage())
    run_session(session, address, workers, toy_stages.MEMORY, PATIENCE)


class DemandingStage(SourceStage):
    """Makes the same numbers, and needs most of a worker's memory for it."""

    def plan(self, view):
        """Raises NotYet."""
        for thing in super().plan(view):
            yield replace(thing, scratch=NEEDED - PROCESS_BYTES) if isinstance(thing, Job) and thing.item == "tile" else thing


def main(words: list[str]) -> None:
    """Makes RUNS runs (54), of which none begins after so many MINUTES, and writes the page."""
    runs, minutes = int(words[0]) if words else 54, float(words[1]) if words[1:] else inf
    until = time.monotonic() + 60.0 * minutes
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / "other.py").write_text(OTHER)
        run_in(folder / "alone", SourceStage(rows=500, cols=500), SmoothStage(), SumStage())
        expected = kept(Folder(folder / "alone/runs/toy"))
        cases = _cases(folder / "other.py")

        def ended(number: int) -> tuple[Case, Ending] | None:
            case = cases[number % len(cases)]
            return (case, run_case(folder / f"run{number}", number, case, expected)) if time.monotonic() < until else None

        with ThreadPoolExecutor(AT_ONCE) as pool:
            endings = [one for one in pool.map(ended, range(runs)) if one]
    write_page("worker_cases", words, page(cases, endings, len(expected)))


def run_case(folder: Path, number: int, case: Case, expected: dict[str, str]) -> Ending:
    """One run, with what happens to its workers."""
    folder.mkdir()
    with cluster(folder) as office, (folder / "said").open("wb") as said:
        for words in case.workers:
            office.join(*words)
        begun = time.monotonic()
        told = f"{str(folder)!r}, {office.address!r}, {len(case.workers)}, {case.demanding}, {case.pause}"
        command = f"from benchmarks.trust.worker_cases import run_at; run_at({told})"
        process = subprocess.Popen([sys.executable, "-c", command], cwd=ROOT, stdout=said, stderr=said)
        happened = _happens(process, folder, case, office, random.Random(number))
        code = _code(process, HANGS - (time.monotonic() - begun))
        seconds = time.monotonic() - begun
    last = ((folder / "said").read_text().strip().splitlines() or [""])[-1]
    found = kept(Folder(folder / "runs/toy")) if code == 0 else {}
    differing = sum(found.get(name) != digest for name, digest in expected.items()) + len(set(found) - set(expected))
    return Ending(code, last, seconds, differing, happened)


def _happens(process: subprocess.Popen, folder: Path, case: Case, cluster: Cluster, chance: random.Random) -> bool:
    """Wait for the first tile and a moment by lot, and let it happen; whether the run still lasted."""
    tiles = folder / "runs/toy/rasters.zarr/source/numbers/c"
    until = time.monotonic() + HANGS
    if not case.always:
        while not tiles.exists() and process.poll() is None and time.monotonic() < until:
            time.sleep(0.05)
        with suppress(subprocess.TimeoutExpired):
            process.wait(chance.uniform(0.0, LATEST))
    if process.poll() is not None:
        return False
    return case.happens(cluster, chance, lambda: process.poll() is not None)


def _code(process: subprocess.Popen, seconds: float) -> int | None:
    try:
        return process.wait(max(seconds, 1.0))
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        return None


def page(cases: tuple[Case, ...], endings: list[tuple[Case, Ending]], results: int) -> str:
    """The page."""
    good, hung = sum(ending.as_expected(case.whole) for case, ending in endings), sum(ending.code is None for _, ending in endings)
    lines = [
        "# Workers that come and go",
        "",
        f"{len(endings)} runs of {results} rasters, tables and products, each on a cluster of its own; what happens to its workers "
        f"happens within {LATEST:g} s after the first tile. *Whole*: the command ended well, and every raster, table and product "
        "is that of a run without workers, byte for byte. Where no worker may do all jobs the command is to end with a sentence.",
        "",
        f"**{good} of {len(endings)} ended as they must, {hung} hung.**",
        "",
        "| what happens | runs | happened in time | whole | ended with a sentence | hung | longest, s |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    sentences = []
    for case in cases:
        mine = [ending for one, ending in endings if one is case]
        told = [ending for ending in mine if ending.as_expected(whole=False)]
        figures = (
            len(mine),
            sum(ending.happened for ending in mine) if case.whole else "-",
            sum(ending.as_expected(whole=True) for ending in mine),
            len(told),
            sum(ending.code is None for ending in mine),
            f"{max((ending.seconds for ending in mine), default=0.0):.0f}",
        )
        lines.append(f"| {case.name} | {' | '.join(map(str, figures))} |")
        sentences += [f'- {case.name}: "{ending.said}"' for ending in told[:1]]
    return "\n".join([*lines, "", "What was said:", "", *sentences]) if sentences else "\n".join(lines)
