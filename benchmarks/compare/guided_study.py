"""Guided densification beside its published tables: `python -m benchmarks guided runs/volos`.

A part of the simulated town, whose pixel of 64 um and flight are those of the published rough model, with the published choices (no
halving, whole pixels of column, one pixel of parallax as standard error), against the truth; on open ground alone; and against the
measured heights of the default, for the published reference is the surface of another matcher and has none where matching is
hard. Then the search: every level guided, or a single level along the whole line, by the points of the last level.

Source: Karfis 2009, sections 7.2 and 8.3 (sources/epipolar.md#results), checks 20 and 22 to 24.
"""

from typing import Any

import numpy as np
from scipy.ndimage import map_coordinates

from benchmarks.compare.compared_ground import Scene, town
from benchmarks.compare.replayed_crop import Replay
from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import run_folders
from orthomill.schemas.epipolar import PAIRS
from orthomill.schemas.surface import HEIGHT, MEASURED, PROVENANCE
from orthomill.tasks.densification.stage import DensificationStage
from orthomill.tasks.densification.surface_grid import ground_pixel
from orthomill.tasks.evaluation.classes import PlaceClass

_THRESHOLDS = (20000.0, 10000.0, 5000.0, 2000.0, 1000.0, 500.0, 200.0)
_WHOLE = {"template": 21, "sub_pixel": False}
_PUBLISHED: dict[str, Any] = {
    "kind": "guided",
    "reduction": 0,
    "thresholds": _THRESHOLDS,
    "points": _WHOLE,
    "parallax_sigma": 1.0,
    "pixels": {"correlation": {"template": 9, "sub_pixel": False}},
}
_BLIND = {**_PUBLISHED, "guide": {"kind": "levels"}, "thresholds": _THRESHOLDS[-1:]}
_BANDS = {"Volos rough": (1.90, 10.7, 79.9, 95.5, 98.9, 99.7, 0.0), "Volos dense": (0.71, 56.1, 82.9, 87.2, 90.8, 93.4, 1.3)}
_POINTS = (1007, 1489, 2249, 4414, 4414, 7412, 14325)
"""of the seven published levels of Kea; the fifth has the threshold of the fourth"""


def bands(error: np.ndarray, sigma: float) -> str:
    """RMS, mean, standard deviation, and shares within 1, 3, 4, 5, 6 sigma and beyond 10, as cells of a table."""
    ratio = np.abs(error) / sigma
    shares = [100 * (ratio < limit).mean() for limit in (1, 3, 4, 5, 6)] + [100 * (ratio > 10).mean()]
    numbers = [np.sqrt(np.mean(error**2)), error.mean(), error.std()]
    return " | ".join([*(f"{value:.2f}" for value in numbers), *(f"{share:.1f}" for share in shares)])


def run(scene: Scene, settings: dict[str, Any]) -> Replay:
    """A part densified with settings."""
    return Replay(scene.crop).run(DensificationStage.model_validate({"kind": "densification", "matching": settings}))


def cloud_errors(replay: Replay, scene: Scene, level: int, known: np.ndarray | None = None) -> np.ndarray:
    """Heights of the points of a level minus those that are known (rows, cols), m, by default the truth; points where nothing is
    known are left out."""
    known = scene.known.height if known is None else known
    prefix = f"densification/guided/{level}/cloud/"
    tables = [table for path, table in replay.tables.items() if path.startswith(prefix) and path.endswith("parquet")]
    x, y, z = (np.concatenate([getattr(table, name) for table in tables]) for name in "xyz")
    col, row = scene.crop.surface.grid.pixel(x, y)
    heights = map_coordinates(known, [row, col], order=1, mode="constant", cval=np.nan)
    return (z - heights)[np.isfinite(heights)]


def references(scene: Scene) -> dict[str, np.ndarray]:
    """Heights (rows, cols) m with which the points are compared, by what they are; NaN where there is none."""
    other = run(scene, {"kind": "object_space"}).rasters
    open_ground = scene.known.classes == PlaceClass.CLEAR_GROUND
    return {
        "against the truth": scene.known.height,
        "of open ground alone": np.where(open_ground, scene.known.height, np.nan),
        "against the default's measured heights": np.where(np.isin(other[PROVENANCE], MEASURED), other[HEIGHT], np.nan),
    }


def page(scene: Scene) -> str:
    """The whole study."""
    guided, blind = run(scene, _PUBLISHED), run(scene, _BLIND)
    pairs = guided.tables[PAIRS.path].pairs
    sigma = float(np.median([ground_pixel(pair) / pair.base_height for pair in pairs]))
    measured = np.isin(guided.rasters[PROVENANCE], MEASURED)
    lines = ["# Guided densification beside its published figures", "", ""]
    lines += [(__doc__ or "").split("\n\n")[1].replace("\n", " "), "", "## Points by level", ""]
    lines += ["| level | threshold | points without spikes | places compared per point | published (Kea) |", "| --- " * 5 + "|"]
    for row, published in zip(_levels(guided), _POINTS, strict=True):
        lines.append(f"| {row[0]} | {row[1]:g} | {row[5]} | {row[6]} | {published} |")
    lines += ["", f"## Differences, sigma of a height {sigma:.2f} m (published 0.77 m at 0.44 m pixels)", ""]
    lines += ["| | RMS, m | mean | SD | < 1 sigma, % | < 3 | < 4 | < 5 | < 6 | > 10 |", "| --- " * 10 + "|"]
    for name, known in references(scene).items():
        off = guided.rasters[HEIGHT] - known
        last = cloud_errors(guided, scene, len(_THRESHOLDS), known)
        lines.append(f"| points of the last level, {name} | {bands(last, sigma)} |")
        lines.append(f"| every pixel, as surface, {name} | {bands(off[measured & np.isfinite(off)], sigma)} |")
    for name, (rms, *shares) in _BANDS.items():
        lines.append(f"| published, {name} against MATCH-T | {rms:.2f} | - | - | " + " | ".join(f"{s:.1f}" for s in shares) + " |")
    lines += ["", "## With a guide and along the whole line", ""]
    lines += ["| | interest points | matched | places compared per point | beyond 3 m, % | CPU-s of points |", "| --- " * 6 + "|"]
    for name, replay in (("seven levels", guided), ("one level, whole line", blind)):
        last = _levels(replay)[-1]
        error = cloud_errors(replay, scene, last[0])
        seconds = sum(value for item, value in replay.seconds.items() if item.startswith("points"))
        beyond = 100 * (np.abs(error) > 3).mean()
        lines.append(f"| {name} | {last[3]} | {last[4]} | {last[6]} | {beyond:.2f} | {seconds:.1f} |")
    return "\n".join([*lines, ""])


def _levels(replay: Replay) -> tuple[tuple[Any, ...], ...]:
    """Rows of the report's table of levels."""
    rows: tuple[tuple[Any, ...], ...] = replay.tables["densification/report.json"].grids[0].rows
    return rows


def main(words: list[str]) -> None:
    """Measure on a finished run."""
    write_page("guided", words, page(town(*run_folders(words, "volos"))))
