"""What it costs to keep a project in an object store instead of a folder: processor time of the command and its workers.

python -m benchmarks store_cost [ROUNDS [PROJECT]]

One machine, two workers, real programs as stores: SeaweedFS for S3, Azurite for Azure (`azurite` on the PATH: npm install -g
azurite), fake-gcs-server for Google, those of them that are installed (docs/scale.md). A run in the folder and one in each store,
in turn, from nothing each time; a run before all of them compiles the kernels. The time of the programs that are the stores is not
counted.
"""

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import median
from typing import NamedTuple
from unittest.mock import patch

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import MeasuredRun, orthomill, project_root
from benchmarks.trust.kept_results import kept
from orthomill.pipeline.storage.depots.bucket import bucket_of
from orthomill.pipeline.storage.depots.folder import Folder
from tests.support.stores.cloud_emulators import AZURITE, FAKE_GCS, azure, google
from tests.support.stores.seaweed import WEED, seaweed

HERE = "a folder"
"""what the others are compared with"""


class Kept(NamedTuple):
    """A run, and how many of its rasters, tables and products are those of the first run in a folder, byte for byte."""

    run: MeasuredRun
    same: int


@contextmanager
def _amazon(folder: Path) -> Iterator[dict[str, str]]:
    with seaweed(folder) as server:
        yield server.environment


STORES: dict[str, tuple[str, object, Callable]] = {
    "SeaweedFS": ("s3", WEED, _amazon),
    "Azurite": ("az", AZURITE, azure),
    "fake-gcs-server": ("gs", FAKE_GCS, google),
}
"""scheme, the program if it is there, and what starts it"""


def main(words: list[str]) -> None:
    """Makes ROUNDS (3) of runs, and writes the page."""
    rounds = int(words[0]) if words else 3
    project = words[1] if words[1:] else "volos_small"
    with tempfile.TemporaryDirectory() as scratch, ExitStack() as stack:
        folder = Path(scratch)
        first = _run(folder / "first", project)
        expected = kept(Folder(folder / "first/runs" / project))
        schemes = {}
        for name, (scheme, program, start) in STORES.items():
            if program:
                (folder / scheme).mkdir()
                stack.enter_context(patch.dict(os.environ, stack.enter_context(start(folder / scheme))))
                schemes[name] = scheme
        found: dict[str, list[Kept]] = {place: [] for place in (HERE, *schemes)}
        for number in range(rounds):
            for place, runs in found.items():
                runs.append(_kept_at(folder / f"{place} {number}", project, schemes.get(place), number, expected))
    write_page("store_cost", words, page(project, found, len(expected), first))


def _run(root: Path, project: str, *words: str) -> MeasuredRun:
    found = orthomill(project_root(root, project), "run", project, "--workers", "2", *words)
    if found.code:
        raise SystemExit(found.output)
    return found


def _kept_at(root: Path, project: str, scheme: str | None, number: int, expected: dict[str, str]) -> Kept:
    """A run in a folder of its own, or below a prefix of its own, which is removed then."""
    address = f"{scheme}://trial/round{number}"
    run = _run(root, project, *(("--store", address) if scheme else ()))
    depot = bucket_of(f"{address}/{project}") if scheme else Folder(root / "runs" / project)
    digests = kept(depot)
    if scheme:
        depot.clear("")
    shutil.rmtree(root)
    return Kept(run, sum(digests.get(name) == digest for name, digest in expected.items()) if len(digests) == len(expected) else 0)


def page(project: str, found: dict[str, list[Kept]], results: int, first: MeasuredRun) -> str:
    """The page."""
    lines = [
        "# An object store instead of a folder",
        "",
        f"Project `{project}` from nothing with two workers on one machine, {len(found[HERE])} runs in each place in turn. "
        "Processor time of the command and its workers, not of the program that is the store; *ratio*: to the run in a folder of "
        "the same round.",
        "",
        "| kept in | CPU-s, median | of each run | ratio, median | least and most | the same bytes |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for place, runs in found.items():
        seconds = [one.run.cpu_seconds for one in runs]
        ratios = [own / here.run.cpu_seconds for own, here in zip(seconds, found[HERE], strict=True)]
        each = ", ".join(f"{one:.1f}" for one in seconds)
        lines.append(
            f"| {place} | {median(seconds):.1f} | {each} | {median(ratios):.2f} | {min(ratios):.2f} to {max(ratios):.2f} | "
            f"{min(one.same for one in runs)} of {results} |"
        )
    lines += ["", f"The run before all of them, which compiled what was not compiled yet, took {first.cpu_seconds:.0f} CPU-s."]
    if left_out := [name for name in STORES if name not in found]:
        lines += ["", f"Not measured, since they are not installed there: {', '.join(left_out)}."]
    return "\n".join(lines)
