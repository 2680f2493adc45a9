"""From files to a block, as a user does it: what 100, 300 and 1000 photographs of one megapixel take, stage by stage.

    python -m benchmarks run_growth [folder=FOLDER] [photographs ...]

The block is rendered (`rolling_land`); `init` and `run --until orientation --workers 2` do the rest, with all defaults. Photographs
and runs stay in FOLDER (default: .cache/growth). An interrupted program goes on where it stopped: photographs that are there are
not rendered again, the run continues, and the processor time of all its attempts is counted. Sizes that are not named stay as they
were measured. Kernels are compiled by a run of twenty photographs that is not counted.
"""

import csv
import shutil
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from benchmarks.instrument.result_page import RESULTS, write_page
from benchmarks.measured_run import ROOT, orthomill, summary
from benchmarks.orientation.foreign_blocks import cpu_of_children
from benchmarks.orientation.growth.rolling_land import Land, stations, write_photograph

SIZES = {100: (10, 10), 300: (15, 20), 1000: (25, 40)}
"""Strips and photographs in each, by the number of photographs."""
WARMING = (4, 5)
STAGES = ("photos", "calibration", "tie_points", "orientation")
RECORD, ATTEMPTS = RESULTS / "run_growth.csv", "attempts.txt"
MOST_CPU, MOST_MEMORY, MOST_GROWTH = 3.0, 1536.0, 1.15
"""CPU seconds a photograph, MiB a worker, growth of the former from the smallest block to the largest, that are wanted at most"""


@dataclass(frozen=True)
class Size:
    """A block of `photos`: how many were `oriented`; CPU seconds of the jobs of each stage and of `all` processes (planning, the
    scheduler and starting Python included); seconds; MiB of the largest worker and of the largest process; image measurements,
    pairs compared, iterations of the block and its sigma0."""

    photos: int
    oriented: int
    photos_cpu: float
    calibration_cpu: float
    tie_points_cpu: float
    orientation_cpu: float
    all_cpu: float
    seconds: float
    worker: float
    process: float
    rays: int
    pairs: int
    iterations: int
    sigma0: float

    @property
    def each(self) -> float:
        """CPU seconds a photograph."""
        return self.all_cpu / self.photos


def rendered(folder: Path, strips: int, per: int) -> Path:
    """The folder of the photographs of a block; those of the largest one serve the smaller ones."""
    land, photographs = Land(folder, *SIZES[1000]), folder / f"photographs_{strips * per}"
    photographs.mkdir(parents=True, exist_ok=True)
    for station in stations(strips, per):
        write_photograph(land, station, photographs)
    return photographs


def run_block(folder: Path, strips: int, per: int) -> Size:
    """The block of so many photographs, from its files on or from where an earlier attempt stopped."""
    photographs, root = rendered(folder, strips, per), folder / f"block_{strips * per}"
    root.mkdir(exist_ok=True)
    if not (root / "workflows" / "block.yaml").exists():
        (root / "photographs").symlink_to(photographs)
        _counted(root, "init", "block", "--photos", "photographs")
    peak = _counted(root, "run", "block", "--until", "orientation", "--workers", "2")
    attempts = [tuple(map(float, line.split())) for line in (root / ATTEMPTS).read_text().splitlines()]
    cpu, seconds = (sum(column) for column in zip(*attempts, strict=True))
    found = {name: entry["value"] for name, entry in summary(root, "block").items()}
    return Size(
        photos=strips * per,
        oriented=found["orientation.photos_oriented"],
        **{f"{kind}_cpu": found[f"run.{kind}.cpu_seconds"] for kind in STAGES},
        all_cpu=cpu,
        seconds=seconds,
        worker=found["run.peak_memory"],
        process=peak / 2**20,
        rays=found["tie_points.observations"],
        pairs=found["tie_points.pairs_compared"],
        iterations=found["orientation.iterations"],
        sigma0=found["orientation.sigma0_px"],
    )


def _counted(root: Path, *words: str) -> int:
    """Runs the command, notes its CPU seconds and its time, and returns the bytes of its largest process."""
    before = cpu_of_children()
    run = orthomill(root, *words)
    with (root / ATTEMPTS).open("a") as file:
        file.write(f"{cpu_of_children() - before:.2f} {run.seconds:.2f}\n")
    if run.code:
        raise SystemExit(run.output[-3000:])
    return run.peak_bytes


def page(sizes: list[Size]) -> str:
    """The page of all blocks."""
    small, large = sizes[0], sizes[-1]
    head = "| photographs | oriented | pairs | measurements | CPU s each | photos | calibration | tie points | orientation | rest |"
    head += " worker MiB | largest process MiB | seconds | iterations | sigma0 px |"
    text = [
        "# Growth with the number of photographs",
        "",
        "Rendered photographs of one megapixel of a rolling land, 75 and 60 % overlap, GNSS by EXIF; `init`, then "
        "`run --until orientation --workers 2` with all defaults, from the files to the block. CPU seconds of all processes by the "
        "number of photographs, in the stages' jobs and in the rest: planning, records, scheduler, starting Python. Kernels "
        "compiled before.",
        "",
        head,
        "|" + " --- |" * (head.count("|") - 1),
        *map(_row, sizes),
        "",
        f"From {small.photos} to {large.photos} photographs: CPU seconds each by a factor of **{large.each / small.each:.2f}** "
        f"({MOST_GROWTH} wanted), at most **{max(size.each for size in sizes):.2f}** ({MOST_CPU:.0f} wanted); largest worker "
        f"**{max(size.worker for size in sizes):.0f} MiB** ({MOST_MEMORY:.0f} wanted).",
    ]
    return "\n".join(text) + "\n"


def _row(size: Size) -> str:
    by_stage = [getattr(size, f"{kind}_cpu") for kind in STAGES]
    shares = " | ".join(f"{cpu / size.photos:.3f}" for cpu in (*by_stage, size.all_cpu - sum(by_stage)))
    return (
        f"| {size.photos} | {size.oriented} | {size.pairs} | {size.rays} | **{size.each:.2f}** | {shares} | {size.worker:.0f} | "
        f"{size.process:.0f} | {size.seconds:.0f} | {size.iterations} | {size.sigma0:.3f} |"
    )


def sizes_before() -> dict[int, Size]:
    """The blocks that were measured before, by their number of photographs."""
    if not RECORD.exists():
        return {}
    with RECORD.open() as file:
        rows = [Size(*(field.type(row[field.name]) for field in fields(Size))) for row in csv.DictReader(file)]
    return {row.photos: row for row in rows}


def keep(sizes: dict[int, Size], words: list[str]) -> None:
    """Writes the record and the page, in order of size."""
    own = [sizes[photos] for photos in sorted(sizes)]
    with RECORD.open("w", newline="") as file:
        table = csv.DictWriter(file, [field.name for field in fields(Size)], lineterminator="\n")
        table.writeheader()
        table.writerows(asdict(size) for size in own)
    write_page("run_growth", words, page(own))


def main(words: list[str]) -> None:
    """Measures the sizes that are named on the command line, or all."""
    given = dict(word.split("=") for word in words if "=" in word)
    folder = Path(given.get("folder", ROOT / ".cache" / "growth")).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    named = [int(word) for word in words if "=" not in word]
    run_block(folder, *WARMING)
    for photos in named or SIZES:
        found = run_block(folder, *SIZES[photos])
        keep(sizes_before() | {photos: found}, words)
        # A finished block is measured anew by the next call, not found unchanged.
        shutil.rmtree(folder / f"block_{photos}")
