"""Photographs and a mesh of other programs, textured as a user would, with every photograph left out in turn.

`python -m benchmarks foreign_meshes FOLDER ...`: each folder holds `images/*.jpg`, the orientation of another program as
`cameras.json` (photograph -> K, R_world_to_camera, t) and `mesh.ply`. A project of four stages with all defaults and the facade as
its output is run to its end in `.cache/foreign_meshes/NAME`, and `benchmarks/results/foreign_meshes.md` holds what the photographs
that were left out tell: blended from all others, beside what programs that take one photograph for each place would give.
Photographs and meshes are not part of this repository. What is done is not done again: to measure anew remove
`.cache/foreign_meshes`.
"""

import json
import statistics
from collections.abc import Iterator
from pathlib import Path

import yaml

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import ROOT, orthomill, project_root, summary

SCRATCH = ROOT / ".cache" / "foreign_meshes"
WANTED_GRADIENT = 0.9
"""gradient energy of a blend that is as sharp as the photographs"""
TOO_ROUGH = 1.25
"""gradient energy that is no longer sharpness"""


def make_project(folder: Path, data: Path, name: str) -> None:
    """The workflow that a user would write."""
    if (folder / "workflows" / f"{name}.yaml").is_file():
        return
    c = next(iter(json.loads((data / "cameras.json").read_text()).values()))["K"][1][1]
    workflow = {
        "project": name,
        "crs": "EPSG:3857",
        "photographs": {"kind": "folder", "path": "data/images", "pattern": "*.jpg"},
        "cameras": {"kind": "given", "c": c},
        "positions": {"kind": "none"},
        "stages": [
            {"kind": "photos"},
            {"kind": "calibration"},
            {"kind": "orientation", "exterior": {"kind": "matrices", "path": "data/cameras.json"}},
            {
                "kind": "projection",
                "surface": {"kind": "mesh", "path": "data/mesh.ply"},
                "outputs": [{"kind": "plane", "name": "front"}],
            },
        ],
    }
    root = project_root(folder)
    (root / "data").symlink_to(data)
    (root / "workflows" / f"{name}.yaml").write_text(yaml.safe_dump(workflow, sort_keys=False))


def chapter(data: Path) -> Iterator[str]:
    """Runs one folder to the end; yields the lines of its chapter."""
    name, folder = data.name, SCRATCH / data.name
    make_project(folder, data, name)
    run = orthomill(folder, "run", name, "--workers", "2")
    if run.code != 0:
        raise SystemExit(run.output)
    found = {key: entry["value"] for key, entry in summary(folder, name).items()}
    tables = sorted((folder / "runs" / name / "tables" / "projection").glob("left_out_*.json"))
    compared = [one for one in (json.loads(path.read_text()) for path in tables) if one["blended"]]
    yield f"## {name}"
    yield ""
    cpu, peak = found["run.projection.cpu_seconds"], found["run.projection.peak_memory"]
    coloured, three = found["projection.front_coloured"], found["projection.front_seen_by_three_or_more"]
    yield (
        f"{found['projection.triangles']} triangles, {len(compared)} photographs; {cpu:.0f} CPU-s of the stage, largest worker "
        f"{peak:.0f} MiB. {coloured:.1f} % of the surface in the front has a colour; three photographs or more see {three:.0f} %."
    )
    yield ""
    yield "| left out | covered % | PSNR, dB: blended | nearest | SSIM: blended | nearest | gradient energy %: blended | nearest |"
    yield "| --- | --- | --- | --- | --- | --- | --- | --- |"
    for one in compared:
        yield _row(one["photo"], 100 * one["covered"], one["blended"], one["nearest"])
    both = [{key: statistics.median(one[kind][key] for one in compared) for key in ("psnr", "ssim", "gradient")} for kind in KINDS]
    yield _row("median", 100 * statistics.median(one["covered"] for one in compared), *both)
    yield ""
    yield _judgement(compared, *both)
    yield ""


KINDS = ("blended", "nearest")


def _row(name: str, covered: float, blended: dict[str, float], nearest: dict[str, float]) -> str:
    values = [f"{one['psnr']:.2f}" for one in (blended, nearest)] + [f"{one['ssim']:.4f}" for one in (blended, nearest)]
    values += [f"{100 * one['gradient']:.0f}" for one in (blended, nearest)]
    return f"| {name} | {covered:.0f} | {' | '.join(values)} |"


def _judgement(compared: list[dict], blended: dict[str, float], nearest: dict[str, float]) -> str:
    """Whether what was wanted is reached, from the figures."""
    ahead = [sum(one["blended"][key] > one["nearest"][key] for one in compared) for key in ("psnr", "ssim")]
    sharp = "reached" if blended["gradient"] >= WANTED_GRADIENT else "missed"
    if blended["gradient"] > TOO_ROUGH:
        sharp = "more than the photographs themselves, which are less sharp than the others or edges are wrong"
    first = all(blended[key] > nearest[key] for key in ("psnr", "ssim"))
    return (
        f"Gradient energy of {100 * WANTED_GRADIENT:.0f} % or more: {sharp} ({100 * blended['gradient']:.1f} %). PSNR and SSIM "
        f"ahead of the nearest photograph: {'reached' if first else 'missed'} (medians); in {ahead[0]} and {ahead[1]} of "
        f"{len(compared)} photographs."
    )


def main(words: list[str]) -> None:
    """Measure all folders and write the page."""
    lines = [
        "# Meshes and photographs of other programs",
        "",
        "Every photograph made again from all others, blended, and from the nearest of them alone, in the same run; all settings "
        "are defaults.",
        "",
    ]
    for folder in map(Path, words or [ROOT / "../shared/data/sceaux_castle"]):
        lines += chapter(folder.resolve())
        write_page("foreign_meshes", words, "\n".join(lines))
