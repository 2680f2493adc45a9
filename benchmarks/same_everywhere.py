"""Are the products the same bit for bit: sequential and Dask, one worker and four, small tiles and large ones?

Uses the small simulated project. `python -m benchmarks same_everywhere RUN OTHER` compares two folders of runs instead, for
example of the same project before and after a change of the code.
"""

import hashlib
import tempfile
from collections import Counter
from itertools import chain
from pathlib import Path

import numpy as np
import yaml

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import ROOT, orthomill, project_root, run_folders
from orthomill.pipeline.storage.store import Store

PROJECT = "volos_small"
OWN_TILE = yaml.safe_load((ROOT / "workflows" / f"{PROJECT}.yaml").read_text())["tile"]
TILES = (2 * OWN_TILE, 4 * OWN_TILE)
VARIANTS = {"sequential": ("--sequential",), "1 worker": ("--workers", "1"), "4 workers": ("--workers", "4")}


def digests(run: Path) -> dict[str, str]:
    """Digest of every raster's pixels, and of the bytes of every table and product of a run."""
    store = Store(run)
    found = {name: hashlib.sha256(store.read(name, store.spec(name).full).tobytes()).hexdigest() for name in store.names()}
    for place, folder in ((run / "tables", "."), (run, "products")):
        files = [path for path in (place / folder).rglob("*") if path.is_file()]
        found |= {path.relative_to(place).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
    return found


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
    """How much a raster of two runs differs, in one line."""
    one, two = (Store(run).read(name, Store(run).spec(name).full).astype(np.float64) for run in (first, second))
    if one.shape != two.shape:
        return f"shapes {one.shape} and {two.shape}"
    off, gaps = np.abs(one - two), np.isnan(one) != np.isnan(two)
    share, alone = np.nanmean(off > 0), int(gaps.sum())
    return f"largest difference {np.nanmax(off):.3g}, {share:.3%} of the values differ, {alone} are empty in only one"


def compared(reference: Path, run: Path, name: str) -> tuple[str, list[str]]:
    """The line of the table for a run, and lines that tell what differs: each raster, and how many tables (products) of each stage.

    Per-tile tables stand for other tiles when the tile size differs, so only those that both runs have are compared.
    """
    expected, found = digests(reference), digests(run)
    shared = sorted(set(expected) & set(found))
    differ = [what for what in shared if expected[what] != found[what]]
    rasters = [what for what in differ if "." not in what]
    tables = Counter(what.split("/")[0] for what in differ if "." in what)
    details = [f"- {name}: raster `{what}`: {difference(reference, run, what)}" for what in rasters]
    details += [f"- {name}: {count} tables of `{stage}`" for stage, count in tables.items()]
    return f"| {name} | {len(shared)} | {len(shared) - len(differ)} | {len(differ)} |", details


def print_comparison(reference: Path, run: Path) -> None:
    """Rasters and tables of two runs: how many both have, how many are equal, and what differs."""
    line, details = compared(reference, run, run.as_posix())
    print("| run | rasters and tables of both | equal | differ |", line, *details, sep="\n")


def main(words: list[str]) -> None:
    """Compare two runs that are named, or run all variants and write the page."""
    if words:
        print_comparison(*run_folders(words))
        return
    with tempfile.TemporaryDirectory() as scratch:
        runs = {name: run_variant(Path(scratch) / name.replace(" ", "_"), words) for name, words in VARIANTS.items()}
        for tile in TILES:
            runs[f"tile {tile}"] = run_variant(Path(scratch) / f"tile_{tile}", ("--workers", "2"), tile)
        reference = runs.pop("sequential")
        rows, details = zip(*(compared(reference, run, name) for name, run in runs.items()), strict=True)
    write_page(
        "same_everywhere",
        words,
        "\n".join(
            [
                "# The same products, whoever runs them",
                "",
                f"Project `{PROJECT}`, whose own tile is {OWN_TILE} px.",
                "",
                "What differs is listed below. Tables of single tiles stand for other ground when tiles are larger, and the",
                "working orthoimages of `dsm_check` cover whole tiles, so their extent follows the tile.",
                "",
                "| against sequential | rasters and tables | equal | differ |",
                "| --- | --- | --- | --- |",
                *rows,
                "",
                *chain(*details),
            ]
        )
        + "\n",
    )
