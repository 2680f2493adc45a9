"""All ways to heights on the same ground: `python -m benchmarks compare` writes docs/compare.md and pictures.

Parts of finished runs are densified anew by every method, with the orientation, tie points, pairs and range of heights of the run.
The simulated town and a rendered mountain have a truth; on the real shore the heights on which two or more pairs of the default
agree stand for it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.compare.compared_ground import Known, Scene, shore, town
from benchmarks.compare.method_figures import draw
from benchmarks.compare.mountain_scene import mountain
from benchmarks.compare.replayed_crop import Replay
from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import ROOT, run_folders
from orthomill.schemas.surface import HEIGHT, MEASURED, PROVENANCE, RELATIVE_PRECISION
from orthomill.tasks.densification.stage import DensificationStage
from orthomill.tasks.evaluation.classes import PlaceClass

_RIM = 40
"""cells along the border of a part that are not judged: methods that look around lack their surroundings there"""
_DEM = "coarse_dem.tif"
_GUIDE = {"kind": "file", "path": _DEM}
_LEAST = {"smoothing": 0.6, "max_shift": 2.0}


_PUBLISHED = {"window": 25, "photographs": 2, "threshold": {"kind": "t_test"}}
"""of vertical line locus: the smallest published window, its pair of photographs and its threshold"""


def _growing(window: Any, **shape: Any) -> dict[str, Any]:
    return {"kind": "region_growing", "growing": {"matching": {"window": window, **_LEAST, **shape}}}


METHODS: dict[str, dict[str, Any]] = {
    "object space (default)": {"kind": "object_space"},
    "object space, coarse model as guide": {"kind": "object_space", "guide": _GUIDE},
    "vertical line locus": {"kind": "vertical_line_locus"},
    "vertical line locus, 25 px, 2 photographs, t test": {"kind": "vertical_line_locus", **_PUBLISHED},
    "guided densification": {"kind": "guided"},
    "guided, coarse model as guide": {"kind": "guided", "guide": _GUIDE},
    "guided, whole line at the first level": {"kind": "guided", "guide": {"kind": "levels"}},
    "pyramid": {"kind": "pyramid"},
    "pyramid, one coarse level, coarse model as guide": {"kind": "pyramid", "pyramid": {"levels": 1}, "guide": _GUIDE},
    "cascade": {"kind": "cascade"},
    "region growing, 21 px": _growing(21),
    "region growing, statistical window": _growing({"kind": "statistical"}),
    "region growing, entropy window": _growing({"kind": "entropy"}),
    "region growing, Foerstner window": _growing({"kind": "foerstner"}),
    "region growing, combined window": _growing({"kind": "combined"}),
    "region growing, ellipse along": _growing(21, shape={"kind": "ellipse", "major_axis": "along"}),
    "region growing, ellipse across": _growing(21, shape={"kind": "ellipse", "major_axis": "across"}),
}
"""what it is called, and its settings; every one runs as the stage runs it"""


@dataclass(frozen=True, eq=False)
class MethodResult:
    """What a method made of a scene: rows of the table, and what the figure shows."""

    row: str
    panel: tuple[str, np.ndarray, np.ndarray, float, float]


def judged(method: str, settings: dict[str, Any], scene: Scene) -> MethodResult:
    """A method on a scene."""
    replay = Replay(scene.crop, files={_DEM: scene.model})
    replay.run(DensificationStage.model_validate({"kind": "densification", "matching": settings}))
    inner = slice(_RIM, -_RIM), slice(_RIM, -_RIM)
    heights, sigma, code = (replay.rasters[name][inner] for name in (HEIGHT, RELATIVE_PRECISION, PROVENANCE))
    known = Known(*(values[inner] for values in (scene.known.height, scene.known.classes, scene.known.seen)))
    measured = np.isin(code, MEASURED) & np.isfinite(known.height)
    departure = np.where(measured, heights - known.height, np.nan)
    open_ground = measured & (known.classes == PlaceClass.CLEAR_GROUND)
    # The datum of the block is common to all methods, and none of them can change it.
    departure = departure - np.nanmedian(departure[open_ground]) if open_ground.any() else departure
    seconds = sum(replay.seconds.values())
    row = " | ".join([method, *_figures(departure, sigma, known, measured, scene.gross), f"{seconds:.1f}"])
    cell = scene.crop.surface.grid.cell
    return MethodResult(f"| {row} |", (scene.name, heights, departure, cell, scene.gross))


def _figures(departure: np.ndarray, sigma: np.ndarray, known: Known, measured: np.ndarray, gross: float) -> list[str]:
    wanted = known.seen & np.isfinite(known.height)
    found = [f"{100 * (measured & wanted).sum() / max(wanted.sum(), 1):.1f}"]
    clear, roof = (known.classes == PlaceClass.CLEAR_GROUND), np.isin(known.classes, _ROOFS)
    found.append(_robust(departure[clear & measured]))
    for place in (clear, known.classes == PlaceClass.BUILDING_MARGIN, roof):
        found.append(_share(np.abs(departure[place & measured]) > gross))
    ratio = np.abs(departure[clear & measured] / sigma[clear & measured])
    return [*found, _share(ratio < 2), _share(ratio > 4)]


_ROOFS = (PlaceClass.ROOF_INTERIOR, PlaceClass.ROOF_EDGE)


def _robust(values: np.ndarray) -> str:
    return f"{1.4826 * np.median(np.abs(values - np.median(values))):.3f}" if len(values) > 50 else "-"


def _share(hits: np.ndarray) -> str:
    return f"{100 * hits.mean():.2f}" if len(hits) > 50 else "-"


def page(scenes: tuple[Scene, ...], pictures: Path, progress: Callable[[str], object] = print) -> str:
    """The page; writes its pictures."""
    rows: dict[str, list[str]] = {scene.name: [] for scene in scenes}
    figures = []
    for method, settings in METHODS.items():
        found = [judged(method, settings, scene) for scene in scenes]
        for scene, result in zip(scenes, found, strict=True):
            rows[scene.name].append(result.row)
            progress(f"{scene.name} {result.row}")
        name = method.replace(" (default)", "").replace(",", "").replace(" ", "_")
        draw(pictures / f"{name}.png", method, [result.panel for result in found])
        figures += [f"![{method}](pictures/compare/{name}.png)", ""]
    lines = [_HEAD]
    for scene in scenes:
        lines += [f"## {scene.name.capitalize()}", "", _columns(scene.gross), "| --- " * 9 + "|", *rows[scene.name], ""]
    return "\n".join([*lines, "## Figures", "", _CAPTION, "", *figures])


def _columns(gross: float) -> str:
    beyond = f"beyond {gross:g} m"
    named = ("measured, %", "NMAD open, m", f"{beyond} open, %", f"{beyond} beside buildings, %", f"{beyond} roofs, %")
    return "| " + " | ".join(["method", *named, "within 2 sigma, %", "beyond 4 sigma, %", "CPU-s"]) + " |"


_HEAD = """# The methods side by side

Every way to heights that `densification: matching` knows, as the stage runs it with its defaults, on the same ground: parts of
finished runs of two projects, and a mountain that is rendered.

*Measured*: cells with a measured height, of those that two photographs see. *Open*: bare ground more than three cells from
buildings and trees. *Beside buildings*: ground within three cells of one. Sigma is the standard error among neighbours, on open
ground. CPU time is that of all jobs, the surface included, in one process; compiled kernels are read from the cache in it.

The simulated town and the rendered mountain (three photographs of bare slopes of 28 to 41 degrees) have a truth. The real shore
has none: there the heights on which two or more pairs of the default method agree stand for it, and only these cells are
counted, so that the row of the default says how well it repeats itself, and those of the others how far they are from it. A
*coarse model* has posts 30 m apart and 2 m of noise, on the shore both reduced to the
size of the block; it is searched only as far from it as tie points lie (`python -m benchmarks guide_model` tells what that saves).

Shares of a part are not those of a project. The town's part is a square of 220 m in its centre, densified by itself and judged
without a rim of 40 cells. What the default measures of the whole project `volos` stands in `benchmarks/results/volos.md` ("measured
heights, of cells truly seen twice").

Windows that know no walls have wide standard errors beside them, and most of these methods are too careful on open ground.
"""
_CAPTION = """Above: the heights of a method, shaded, estimates included. Below: measured heights minus what is known; dark
where nothing was measured, or nothing is known."""


def main(words: list[str]) -> None:
    """Write the page from the finished runs of volos and brighton."""
    volos, brighton = run_folders(words, "volos", "brighton")
    docs = ROOT / "docs"
    with mountain() as rendered:
        text = page((town(volos), shore(brighton), rendered), docs / "pictures" / "compare")
    write_page("compare", words, text, docs / "compare.md")
