"""What each stage takes for a megapixel of photographs, of finished runs; and how the forecast from the others would have been.

`python -m benchmarks forecast_rates RUN...` prints the rates that `pipeline/forecast/rates.json` holds.
"""

from pathlib import Path

from benchmarks.measured_run import run_folders
from orthomill.pipeline.records.records import Record, Records
from orthomill.pipeline.storage.store import Store


def megapixels(run: Path) -> float:
    """Of the photographs in a run's store."""
    store = Store(run)
    full = [name for name in store.names() if name.startswith("photos/") and name.endswith("/0")]
    return sum(store.spec(name).shape[0] * store.spec(name).shape[1] for name in full) / 1e6


def rates(run: Path) -> dict[str, tuple[float, float, float, float]]:
    """(jobs, MB, CPU-s) per megapixel and the largest worker in MiB, by stage."""
    pixels = megapixels(run)
    stages = sorted(folder.name for folder in (run / "jobs").iterdir() if folder.is_dir())
    return {stage: _rate([r for r in Records(run).of_stage(stage) if r.status == "done"], pixels) for stage in stages}


def _rate(records: list[Record], pixels: float) -> tuple[float, float, float, float]:
    megabytes = sum(kept.size for record in records for kept in record.files.values()) / 1e6
    seconds, peak = sum(record.cpu_seconds for record in records), max((record.peak_bytes for record in records), default=0)
    return len(records) / pixels, megabytes / pixels, seconds / pixels, peak / 2**20


def main(words: list[str]) -> None:
    """Print the rates of all runs, stage by stage."""
    found = {run.name: rates(run) for run in run_folders(words)}
    for stage in sorted({stage for of_run in found.values() for stage in of_run}):
        for name, of_run in found.items():
            if stage in of_run:
                jobs, megabytes, seconds, peak = of_run[stage]
                print(f'{stage:14} "{name}": [{jobs:.1f}, {megabytes:.2f}, {seconds:.2f}, {peak:.0f}]')
