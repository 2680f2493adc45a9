"""A closed wood of known crowns below a low flight: their height and outline, the ground in gaps, and what codes say.

`python -m benchmarks closed_wood` simulates and measures the flight in a folder of its own; `python -m benchmarks closed_wood RUN`
tells of a finished run of it. The wood lies in the middle of the block, so that several photographs see every crown; crowns sway in
the wind from photograph to photograph, have gaps, and leaves at many depths, as the trees of every simulated scene.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy import ndimage

import orthomill as library
from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import named_or_new_run
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import HEIGHT, ORTHO, PROVENANCE, RELATIVE_PRECISION, SURFACE, Provenance
from orthomill.schemas.truth import TRUTH_GRID, TRUTH_ORTHO, TRUTH_SURFACE, TRUTH_VISIBILITY
from orthomill.tasks.simulation.flight import scene_settings
from orthomill.tasks.simulation.plan.simulation_jobs import flight_of
from orthomill.tasks.simulation.scene.crowns import stamp_crowns, stand_at_rest
from orthomill.tasks.simulation.scene.layout import Scene
from orthomill.tasks.simulation.scene.scene import bare_ground
from orthomill.tasks.simulation.scene.settlement import scene_of, wood_centre
from orthomill.tasks.simulation.stage import SimulationStage

PROJECT = "closed_wood"
FLIGHT: dict[str, Any] = {
    "kind": "simulation",
    "scene": {"kind": "town", "wood": 24.0},
    "frame_mm": 60.0,
    "c_mm": 45.0,
    "pixel_um": 75.0,
    "scale": 1000.0,
    "base_m": 9.0,
    "side_overlap": 0.7,
    "strips": 3,
    "photos_per_strip": 5,
    "scene_cell": 0.1,
    "buildings": 1,
    "board_photos": 0,
    "gnss_sigma": 0.02,
    "control": 0,
    "check": 0,
}
"""45 m above the plain, trees up to 12 m: pixels of 0.075 m on the ground, overlaps of 85 and 70 %"""
_STAGES = ("photos", "calibration", "tie_points", "orientation", "epipolar", "densification", "terrain", "texture", "evaluation")
WORKFLOW = {
    "project": PROJECT,
    "crs": "EPSG:2100",
    "photographs": {"kind": "simulated"},
    "cameras": {
        "kind": "given",
        "c": 600.0,
        "x0": 1.46,
        "y0": -1.08,
        "k1": -0.0155,
        "k2": 0.0042,
        "p1": 0.00018,
        "p2": -0.00013,
        "pixel_um": 75.0,
    },
    "positions": {"kind": "simulated"},
    "tile": 512,
    "stages": [FLIGHT, *({"kind": kind} for kind in _STAGES)],
}
CANOPY = 2.0
"""m above the ground from which on a cell is canopy"""
NEAR = 0.5
"""m: a height this near to the truth is right"""
LEAF = 5
"""cells over which the contrast of the orthoimage is judged"""
FEWEST = 50
"""cells of a crown, and of a code, below which neither is judged"""


@dataclass(frozen=True, eq=False)
class WoodCells:
    """The cells around the wood, each (rows, cols): heights, their standard errors and codes; the true envelope of the crowns and
    the ground below, m; number of the tree, 0 beside crowns; whether two photographs truly see the surface."""

    height: np.ndarray
    sigma: np.ndarray
    code: np.ndarray
    envelope: np.ndarray
    ground: np.ndarray
    tree: np.ndarray
    seen: np.ndarray


def wood_cells(run: Path) -> WoodCells:
    """Of a finished run, without the mean error of its datum: the median difference of agreed open ground."""
    project = library.open(run)
    grid, truth = project.table(SURFACE).grid, project.table(TRUTH_GRID)
    scene = _scene()
    window = _around(scene, grid)
    x, y = grid.centres(window)
    height, sigma, code = (project.raster(name).values[window.slices] for name in (HEIGHT, RELATIVE_PRECISION, PROVENANCE))
    col, row = truth.pixel(*np.meshgrid(x, y))
    at = np.rint(row).astype(int), np.rint(col).astype(int)
    envelope, visible = (project.raster(name).values[at] for name in (TRUTH_SURFACE, TRUTH_VISIBILITY))
    tree = np.zeros(window.shape, np.int32)
    ground = bare_ground(scene, x, y)
    stamp_crowns(ground.copy(), np.zeros(window.shape, np.uint16), tree, (x, y), stand_at_rest(scene), scene.settings.seed)
    open_ground = (tree == 0) & (code == Provenance.AGREED)
    height = height - np.median((height - envelope)[open_ground])
    return WoodCells(height, sigma, code, envelope, ground, tree, np.bitwise_count(visible.astype(np.uint32)) >= 2)


def _scene() -> Scene:
    asked = SimulationStage.model_validate(FLIGHT)
    return scene_of(scene_settings(flight_of(asked), asked.buildings, FLIGHT["scene"]["wood"]))


def _around(scene: Scene, grid: MapGrid) -> Window:
    """The square around the wood, a few metres larger."""
    x, y = wood_centre(scene.settings)
    half = scene.settings.wood + 4.0
    col, row = grid.pixel(np.array(x - half), np.array(y + half))
    side = round(2 * half / grid.cell)
    return Window(int(row), int(col), side, side).clipped(grid.shape)


def crown_rows(cells: WoodCells) -> Iterator[str]:
    """Crowns by their 95th percentile, the canopy by its outline, and the ground between crowns."""
    tops = []
    for number in np.unique(cells.tree[cells.tree > 0]):
        crown = (cells.tree == number) & np.isfinite(cells.height)
        if crown.sum() >= FEWEST:
            tops.append(np.percentile(cells.height[crown], 95) - np.percentile(cells.envelope[crown], 95))
    top = np.array(tops)
    known = np.isfinite(cells.height)
    canopy, found = cells.tree > 0, cells.height > cells.ground + CANOPY
    gap = known & cells.seen & (cells.tree == 0)
    away = (cells.height - cells.envelope)[canopy & known]
    yield "| what | to reach | measured |"
    yield "| --- | --- | --- |"
    yield f"| crowns judged | - | {len(top)} |"
    yield f"| 95th percentile within {NEAR} m of the true one | 90 % | {100 * (np.abs(top) < NEAR).mean():.0f} % |"
    yield f"| the same, median | - | {np.median(top):+.2f} m |"
    overlap = (canopy & found & known).sum() / ((canopy | found) & known).sum()
    yield f"| outline of the canopy, intersection over union | 0.8 | {overlap:.2f} |"
    between = _share(np.abs(cells.height - cells.ground)[gap])
    yield f"| ground between crowns that two photographs see, within {NEAR} m | - | {between} |"
    yield f"| heights in crowns, median below the envelope | - | {-np.median(away):.2f} m |"
    yield f"| the same, NMAD | - | {1.4826 * np.median(np.abs(away - np.median(away))):.2f} m |"


def _share(away: np.ndarray) -> str:
    return f"{100 * (away < NEAR).mean():.0f} %" if away.size else "-"


def code_rows(cells: WoodCells) -> Iterator[str]:
    """In crowns, by code: share, errors from the nearer one of envelope and ground, and what is stated."""
    yield "| code, in crowns | share | median error | stated | within 1 / within 2 / beyond 4 of it |"
    yield "| --- | --- | --- | --- | --- |"
    crowns = (cells.tree > 0) & np.isfinite(cells.height)
    away = np.fmin(np.abs(cells.height - cells.envelope), np.abs(cells.height - cells.ground))
    for code in Provenance:
        here = crowns & (cells.code == code)
        if here.sum() < FEWEST:
            continue
        ratio = away[here] / cells.sigma[here]
        shares = " / ".join(f"{100 * share:.1f}" for share in ((ratio < 1).mean(), (ratio < 2).mean(), (ratio > 4).mean()))
        words = code.name.lower().replace("_", " ")
        share = f"{100 * here.sum() / crowns.sum():.1f} %"
        yield f"| {words} | {share} | {np.median(away[here]):.2f} m | {np.median(cells.sigma[here]):.2f} m | {shares} % |"


def terrain_rows(run: Path) -> Iterator[str]:
    """The bare ground by code, from the evaluation of the run; nothing where it has none."""
    path = run / "summary.json"
    figures = json.loads(path.read_text()) if path.exists() else {}
    yield "| terrain | RMSE | within 1 / 2 / 3 of its standard errors, datum in it |"
    yield "| --- | --- | --- |"
    for code in ("measured", "under_buildings", "under_wood", "guessed"):
        head = f"evaluation.terrain_{code}_"
        if f"{head}rmse" in figures:
            shares = " / ".join(f"{figures[f'{head}within_{k}_sigma']['value']:.1f}" for k in (1, 2, 3))
            yield f"| {code.replace('_', ' ')} | {figures[f'{head}rmse']['value']:.2f} m | {shares} % |"


def orthoimage_rows(run: Path) -> Iterator[str]:
    """How much of the true contrast between leaves the orthoimage shows, inside of crowns and on the open ground around."""
    project, cells = library.open(run), wood_cells(run)
    grid = project.table(SURFACE).grid
    x, y = grid.centres(_around(_scene(), grid))
    own, true = (_grey(project.raster(name), x, y) for name in (ORTHO, TRUTH_ORTHO))
    crowns = ndimage.binary_erosion(cells.tree > 0, iterations=LEAF)
    ground = ndimage.binary_erosion(cells.tree == 0, iterations=LEAF)
    yield "| orthoimage | contrast within 0.5 m, of the true one |"
    yield "| --- | --- |"
    for name, here in (("crowns", crowns), ("open ground", ground)):
        contrast = [np.std((grey - ndimage.uniform_filter(grey, LEAF))[here & cells.seen]) for grey in (own, true)]
        yield f"| {name} | {100 * contrast[0] / contrast[1]:.0f} % |"


def _grey(picture: xr.DataArray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """float64 (rows, cols): the mean of the bands at the pixels nearest to places, m."""
    colours = picture.sel(x=x, y=y, method="nearest").values
    return np.asarray(colours[..., :3].mean(axis=2, dtype=np.float64))


def page(run: Path) -> str:
    """The page of results."""
    cells = wood_cells(run)
    lines = ["# A closed wood", "", (__doc__ or "").split("\n\n")[1].replace("\n", " ").strip(), ""]
    return "\n".join([*lines, *crown_rows(cells), "", *code_rows(cells), "", *terrain_rows(run), "", *orthoimage_rows(run), ""])


def main(words: list[str]) -> None:
    """Write the page: of the finished run that is named, or of a new one."""
    with named_or_new_run(words, WORKFLOW) as run:
        write_page(PROJECT, words, page(run))
