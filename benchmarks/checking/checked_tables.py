"""Tables 4.20 to 4.22 of the published check, as `orthomill check` makes them on a rendered block.

    python -m benchmarks checked_tables runs/volos [ROWS COLS]

Strategy. The real pair, its 18343 points and the two commercial surfaces are not public. Surfaces with errors of their printed
size, as those of `published_checks`, are the true one of a simulated run with the published deformation (steeper, so that it rises
as much over the smaller part), like the commercial grid and like the commercial triangulation; they are checked against the
photographs with their true orientation. Points, surveyed to 0.35 m, are compared with the surface as it was given and with what the
check corrects it by, everywhere where it judged. For 4.21 the first of these runs is repeated with elliptic windows.

The town has roofs and trees, where no check and no point agree to decimetres: open ground is listed by itself.

Source: Skarlatos (sources/surface_check.md#table-4-20, #table-4-21, #table-4-22).
"""

import tempfile
from pathlib import Path

import numpy as np
import rasterio
import yaml
from scipy.stats import norm

from benchmarks.checking.planted_rounds import Ground, checked, ground_of
from benchmarks.checking.published_checks import COUNTED, LIMITS, MANUAL, PUBLISHED, SOUTH, WEST, rough
from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import orthomill, run_folders
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.truth import TRUTH_BLOCK

SIDES = 400, 500
POINTS = 18343
DEFORMED, GRID, TRIANGLES = PUBLISHED
SHAPES = {
    "square": {"kind": "square"},
    "ellipse along": {"kind": "ellipse", "major_axis": "along"},
    "ellipse across": {"kind": "ellipse", "major_axis": "across"},
}
PRINTED = {"square": (-0.248, 0.579, 76.46), "ellipse along": (-0.249, 0.576, 76.64), "ellipse across": (-0.249, 0.572, 76.91)}
"""table 4.21: mean and standard deviation (m), share within 0.75 m by the normal law (%)"""
_WITHIN, _TRIMMED = 0.75, 0.95


def surfaces(ground: Ground) -> dict[str, np.ndarray]:
    """The heights (rows, cols) m of the surfaces that are checked."""
    rows, cols = ground.heights.shape
    y, x = np.indices((rows, cols)) * ground.grid.cell
    at = WEST + x, SOUTH + y
    base = rough(0.3, 20.0, 0.0, 1)(*at)
    deformed = 5.0 * (x / (cols * ground.grid.cell) - 0.5) + 5.0 * (y / (rows * ground.grid.cell) - 0.5)
    return {
        DEFORMED: ground.heights + base + deformed,
        GRID: ground.heights + rough(0.75, 20.0, 0.004, 2)(*at),
        TRIANGLES: ground.heights + rough(0.7, 10.0, 0.003, 3)(*at),
    }


def differences(ground: Ground, given: np.ndarray, bands: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """(3, N) at random points that the check judged: given and corrected minus surveyed heights (m), and whether on open ground."""
    random = np.random.default_rng(5)
    row, col = random.integers(0, given.shape[0], POINTS), random.integers(0, given.shape[1], POINTS)
    surveyed = ground.heights[row, col] + random.normal(0, MANUAL, POINTS)
    corrected = (given + bands["dh"])[row, col]
    judged = np.isfinite(corrected)
    level = ground.classes()["open ground"][row, col]
    both = np.stack([given[row, col] - surveyed, corrected - surveyed])
    return {"all": both[:, judged], "open ground": both[:, judged & level]}


def figures(off: np.ndarray, trimmed: bool) -> str:
    """Mean, standard deviation, RMS and mean absolute difference, as cells."""
    if trimmed:
        off = off[np.abs(off - off.mean()) <= np.quantile(np.abs(off - off.mean()), _TRIMMED)]
    return " | ".join(f"{value:.2f}" for value in (off.mean(), off.std(), np.sqrt((off**2).mean()), np.abs(off).mean()))


def shaped(root: Path, name: str, shape: dict[str, str]) -> dict[str, np.ndarray]:
    """The bands of the check of a finished run, repeated with other windows."""
    workflow = yaml.safe_load((root / "runs" / name / "workflow.yaml").read_text())
    workflow["project"] = f"{name}-{shape.get('major_axis', 'square')}"
    (check,) = (stage for stage in workflow["stages"] if stage["kind"] == "dsm_check")
    check["matching"]["least_squares"]["shape"] = shape
    (root / "workflows").mkdir(exist_ok=True)
    (root / "workflows" / f"{workflow['project']}.yaml").write_text(yaml.safe_dump(workflow))
    run = orthomill(root, "run", workflow["project"], "--sequential")
    assert not run.code, run.output
    with rasterio.open(root / "runs" / workflow["project"] / "products" / "dsm_check.tif") as product:
        return {text.split(" ")[0]: product.read(k + 1).astype(np.float64) for k, text in enumerate(product.descriptions)}


def page(folder: Path, sides: tuple[int, int]) -> str:
    """Check, repeat, compare; the page as text."""
    ground = ground_of(folder, sides)
    about = (__doc__ or "").split("Strategy. ")[1].split("\n\nSource")[0].replace("\n\n", " ").replace("\n", " ")
    lines = ["# The published tables of a check, by the check itself", "", about, "", "## Table 4.20", ""]
    lines += [
        "| surface | state | points | mean | std | RMS | mean abs | printed: mean | std | RMS | mean abs |",
        "| --- " * 11 + "|",
    ]
    with tempfile.TemporaryDirectory() as place:
        root, block = Path(place), Path(place) / "cameras.json"
        block.write_text(Store(folder).table(TRUTH_BLOCK).model_dump_json())
        found = {}
        for number, (name, heights) in enumerate(surfaces(ground).items()):
            bands, _ = checked(ground, heights, folder, root, f"surface{number}", block)
            found[name] = differences(ground, heights, bands)
            for where, off in found[name].items():
                for state, printed in enumerate(PUBLISHED[name]):
                    words = f"{name}, {where}", ("given", "corrected, trimmed")[state], str(off.shape[1])
                    cells = *words, figures(off[state], bool(state)), " | ".join(f"{value:.2f}" for value in printed)
                    lines.append(f"| {' | '.join(cells)} |")
        lines += ["", "## Table 4.21", "", "Of the deformed surface, corrected, open ground, trimmed."]
        lines += [
            "",
            "| window | mean | std | within 0.75 m by the normal law (%) | printed: mean | std | within |",
            "| --- " * 7 + "|",
        ]
        deformed = surfaces(ground)[DEFORMED]
        for name, shape in SHAPES.items():
            off = differences(ground, deformed, shaped(root, "surface0", shape))["open ground"][1]
            off = off[np.abs(off - off.mean()) <= np.quantile(np.abs(off - off.mean()), _TRIMMED)]
            within = 100 * np.diff(norm.cdf([-_WITHIN, _WITHIN], off.mean(), off.std()))[0]
            mean, std, share = PRINTED[name]
            lines.append(f"| {name} | {off.mean():.3f} | {off.std():.3f} | {within:.2f} | {mean:.3f} | {std:.3f} | {share:.2f} |")
    lines += ["", "## Table 4.22", "", "What the check finds in the commercial triangulation, below a limit (m), in %."]
    lines += ["", "| limit | all | open ground | printed |", "| --- " * 4 + "|"]
    by = {where: np.abs(off[0] - off[1]) for where, off in found[TRIANGLES].items()}
    for limit, printed in zip(LIMITS, COUNTED[0], strict=True):
        shares = " | ".join(f"{100 * (off < limit).mean():.2f}" for off in by.values())
        lines.append(f"| {limit} | {shares} | {printed:.2f} |")
    return "\n".join([*lines, ""])


def main(words: list[str]) -> None:
    """Measure on a run, in a part of it of ROWS x COLS cells."""
    (folder,) = run_folders(words[:1], "volos")
    write_page("checked_tables", words, page(folder, (int(words[1]), int(words[2])) if len(words) > 2 else SIDES))
