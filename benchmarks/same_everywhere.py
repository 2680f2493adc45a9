"""Are the products the same bit for bit: sequential and Dask, one worker and four, small tiles and large ones?

Run with `python -m benchmarks.same_everywhere`. Uses the small simulated project.
"""

import hashlib
import tempfile
from pathlib import Path

import numpy as np
import yaml

from benchmarks.measured_run import machine, orthomill, project_root, write_result
from pipeline.store import Store

PROJECT = "volos_small"
VARIANTS = {
    "sequential": ("--sequential",),
    "1 worker": ("--workers", "1"),
    "4 workers": ("--workers", "4"),
}


def digests(run: Path) -> dict[str, str]:
    """Digest of every raster's pixels and of every table's bytes of a run."""
    store = Store(run)
    found = {name: hashlib.sha256(store.read(name, store.spec(name).full).tobytes()).hexdigest() for name in store.names()}
    tables = run / "tables"
    files = [path for path in tables.rglob("*") if path.is_file()]
    return found | {path.relative_to(tables).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def run_variant(folder: Path, words: tuple[str, ...], tile: int | None = None) -> Path:
    """Run the project in its own root; returns the run's folder."""
    root = project_root(folder, PROJECT)
    if tile is not None:
        path = root / "workflows" / f"{PROJECT}.yaml"
        path.write_text(yaml.safe_dump({**yaml.safe_load(path.read_text()), "tile": tile}, sort_keys=False))
    ended = orthomill(root, "run", PROJECT, *words)
    if ended.code != 0:
        raise SystemExit(ended.output)
    return root / "runs" / PROJECT


def difference(first: Path, second: Path, name: str) -> str:
    """How much a raster of two runs differs."""
    one, two = (Store(run).read(name, Store(run).spec(name).full).astype(np.float64) for run in (first, second))
    if one.shape != two.shape:
        return f"shapes {one.shape} and {two.shape}"
    gaps = np.isnan(one) != np.isnan(two)
    return f"largest difference {np.nanmax(np.abs(one - two)):.3g}, {int(gaps.sum())} cells empty in only one"


def main() -> None:
    """Run all variants and write the page."""
    with tempfile.TemporaryDirectory() as scratch:
        runs = {name: run_variant(Path(scratch) / name.replace(" ", "_"), words) for name, words in VARIANTS.items()}
        runs["tile 1024"] = run_variant(Path(scratch) / "tile_1024", ("--workers", "2"), tile=1024)
        reference = digests(runs["sequential"])
        lines = ["# The same products, whoever runs them", "", f"`python -m benchmarks.same_everywhere`; {machine()}.", "",
                 "| against sequential | rasters and tables | equal | differ |", "| --- | --- | --- | --- |"]
        details = []
        for name, run in list(runs.items())[1:]:
            found = digests(run)
            shared = sorted(set(reference) & set(found))
            differ = [what for what in shared if reference[what] != found[what]]
            lines.append(f"| {name} | {len(shared)} | {len(shared) - len(differ)} | {len(differ)} |")
            for what in differ:
                how = "differs" if "." in what else difference(runs["sequential"], run, what)
                details.append(f"- {name}: `{what}` {how}")
        write_result("same_everywhere", "\n".join([*lines, "", *details]) + "\n")


if __name__ == "__main__":
    main()
