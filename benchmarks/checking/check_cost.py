"""What a check costs: processor time of every pass for each megapixel of orthoimage pair, and how little later rounds look at.

    python -m benchmarks check_cost runs/check-model ...

Strategy. The records of a finished check (`orthomill check SURFACE --sequential`) hold the processor time of every job. The pixels
of a pass are those of its orthoimages that both photographs of a pair show, each pair once. A later round makes orthoimages of
the small tiles around what the round before changed; its pixels are compared with those of the first pass.
"""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import run_folders
from orthomill.pipeline.records.records import Records
from orthomill.pipeline.storage.store import Store

KIND = "dsm_check"


@dataclass(frozen=True)
class Pass:
    """One pass: megapixels that both photographs of a pair show, processor time in all (s), and of orthoimages and of nodes."""

    name: str
    pixels: float
    seconds: float
    orthoimages: float
    nodes: float
    jobs: int


def pass_of(item: str) -> str:
    """The pass to which a job belongs, by the name of its item."""
    if item.startswith("rounds/"):
        return f"round {item.split('/')[1].split('-')[0]}"
    if item.startswith(("level-", "placing-")):
        return "-".join(item.split("-")[:2]).replace("-", " ")
    if item.startswith("second"):
        return "second surface"
    return "placing, pairs, report" if item.startswith(("place", "pairs", "report", "surface", "no-")) else "first round"


def passes(folder: Path) -> list[Pass]:
    """The passes of a finished check, in the order in which they began."""
    store, seconds, parts, jobs = Store(folder), Counter[str](), Counter[tuple[str, str]](), Counter[str]()
    records = sorted(Records(folder).of_stage(KIND), key=lambda record: record.started)
    for record in records:
        name = pass_of(record.item)
        seconds[name] += record.cpu_seconds
        jobs[name] += 1
        for part in ("ortho", "nodes"):
            parts[name, part] += record.cpu_seconds * (f"{part}-" in record.item)
    pixels = _pixels(store)
    order = dict.fromkeys(pass_of(record.item) for record in records)
    return [Pass(n, pixels[n] / 1e6, seconds[n], parts[n, "ortho"], parts[n, "nodes"], jobs[n]) for n in order]


def _pixels(store: Store) -> Counter[str]:
    """Pixels that both orthoimages of a pair show, by pass."""
    pixels: Counter[str] = Counter()
    for name in store.names():
        if name.startswith(f"{KIND}/") and "/ortho/" in name and name.endswith("/left"):
            left, right = (store.read(one, store.spec(one).full) for one in (name, name.removesuffix("left") + "right"))
            prefix = name.removeprefix(f"{KIND}/").split("ortho/")[0].strip("/")
            pixels[pass_of(f"{prefix}-" if prefix else "ortho-")] += int(((left > 0) & (right > 0)).sum())
    return pixels


def table(folder: Path) -> list[str]:
    """The lines of one check."""
    found = passes(folder)
    first = next(one for one in found if one.name == "first round")
    rows = [_row(one, first) for one in found]
    whole = sum(one.seconds for one in found)
    pixels = sum(one.pixels for one in found)
    return [
        f"## {folder.name}",
        "",
        "| pass | jobs | Mpx of orthoimage pair | of the first round (%) | CPU-s | orthoimages | nodes | CPU-s per Mpx |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
        *rows,
        f"| all | {sum(one.jobs for one in found)} | {pixels:.2f} | | {whole:.1f} | | | {whole / pixels:.2f} |",
        "",
    ]


def _row(one: Pass, first: Pass) -> str:
    share, each = (f"{100 * one.pixels / first.pixels:.1f}", f"{one.seconds / one.pixels:.2f}") if one.pixels else ("", "")
    parts = f"{one.seconds:.1f} | {one.orthoimages:.1f} | {one.nodes:.1f}"
    return f"| {one.name} | {one.jobs} | {one.pixels:.2f} | {share} | {parts} | {each} |"


def main(words: list[str]) -> None:
    """Measure finished checks and keep the page."""
    lines = [
        "# What a check costs",
        "",
        "To reach: 2 CPU-s per Mpx of orthoimage pair for one pass.",
        "",
        *(line for folder in run_folders(words) for line in table(folder)),
    ]
    write_page("check_cost", words, "\n".join(lines))
