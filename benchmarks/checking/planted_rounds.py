"""Planted bumps against the whole check: second surface, rounds and several pairs, as `orthomill check` runs it.

    python -m benchmarks planted_rounds runs/volos [ROWS COLS]

Strategy. The true surface of a simulated run, whose error is known in every cell, is checked against the run's photographs and
adjusted cameras: as it is, with bumps of +-0.5 to +-25 m and 3 to 60 cells of radius, and with an error of just the detectable
size all over, up and down in turn. A bump is detectable where it is as wide as the report of the check asks for, the untouched
surface was judged, and every height of its core (above three quarters of its height) is off by more than the map of detectable
errors says; it is found when half of the core is called wrong (codes 2 and 3 of the product) with the right sign. What the check
says of the untouched surface gives false alarms (the same codes), standard errors, and the share that was judged by class of the
ground. A run of which the block is oriented and its pairs are chosen will do; a part of ROWS x COLS cells in its middle is looked
at (1100 x 1400).
"""

import os
import re
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio
from rasterio.transform import from_origin
from scipy.ndimage import binary_dilation, gaussian_filter, median_filter

from benchmarks.deformation import Bump, shape_of
from benchmarks.instrument.result_page import RESULTS, write_page
from benchmarks.measured_run import orthomill, run_folders, summary
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.epipolar import PAIRS
from orthomill.schemas.observations import GROUND_POINTS
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import CheckCode
from orthomill.schemas.truth import OPEN_MATERIALS, TRUTH_GRID, TRUTH_MATERIAL, TRUTH_SURFACE, Material
from orthomill.tasks.densification.surface_grid import GridWish, surface_of
from orthomill.tasks.imagery.resampling import between

HEIGHTS, RADII = (0.5, 1.0, 2.0, 5.0, 10.0, 25.0), {60: 1, 40: 1, 25: 2, 15: 3, 9: 4, 6: 4, 3: 4}
"""m; cells, and how many bumps of each height and sign"""
SIDES = 1100, 1400
"""cells of the part that is checked, in the middle of the surface"""
SIGNIFICANT = 5
"""standard errors"""
CORE, ROOM = 0.75, 14
"""share of a bump's height; cells between bumps"""
SQUARE = 100
"""cells from an error of just the detectable size to the next, which has the other sign"""


@dataclass(frozen=True, eq=False)
class Ground:
    """The true surface (rows, cols) m of a part of a simulated run, with its materials, on the cells of the run's surface."""

    grid: MapGrid
    crs: str
    heights: np.ndarray
    material: np.ndarray

    def classes(self) -> dict[str, np.ndarray]:
        """Cells (bool) by class."""
        roof = self.material == Material.ROOF
        margin = binary_dilation(roof, np.ones((7, 7))) & ~roof
        tree = self.material == Material.TREE
        return {"open ground": np.isin(self.material, OPEN_MATERIALS) & ~margin, "roofs": roof, "margins": margin, "crowns": tree}


def ground_of(folder: Path, sides: tuple[int, int] = SIDES) -> Ground:
    """The middle of a simulated run, `sides` cells of it."""
    store = Store(folder)
    block, pairs, points = (store.table(table) for table in (BLOCK, PAIRS, GROUND_POINTS))
    whole, truth = surface_of(block, pairs, points, GridWish()).grid, store.table(TRUTH_GRID)
    rows, cols = (min(side, size) for side, size in zip(sides, whole.shape, strict=True))
    first = (whole.rows - rows) // 2, (whole.cols - cols) // 2
    west, north = whole.west + first[1] * whole.cell, whole.north - first[0] * whole.cell
    grid = MapGrid(west=west, north=north, cell=whole.cell, rows=rows, cols=cols)
    x, y = grid.centres(Window(0, 0, rows, cols))
    col, row = truth.pixel(x, y)
    heights = store.read(TRUTH_SURFACE, store.spec(TRUTH_SURFACE).full)
    material = store.read(TRUTH_MATERIAL, store.spec(TRUTH_MATERIAL).full)
    near = np.ix_(np.rint(row).astype(int), np.rint(col).astype(int))
    return Ground(grid, store.spec(TRUTH_SURFACE).crs or "", between(heights, row, col), material[near])


def planted(grid: MapGrid, seed: int = 7) -> list[Bump]:
    """Bumps at random places that do not touch, the largest first."""
    random, bumps = np.random.default_rng(seed), list[Bump]()
    for radius, count in RADII.items():
        for height in [sign * h for _ in range(count) for h in HEIGHTS for sign in (1, -1)]:
            for _ in range(400):
                row, col = (random.uniform(radius + ROOM, side - radius - ROOM) for side in grid.shape)
                place = Bump(grid.west + col * grid.cell, grid.north - row * grid.cell, radius * grid.cell, height)
                if all(_apart(place, other, ROOM * grid.cell) for other in bumps):
                    bumps.append(place)
                    break
    return bumps


def _apart(one: Bump, other: Bump, room: float) -> bool:
    return bool(np.hypot(one.x - other.x, one.y - other.y) > 1.15 * (one.radius + other.radius) + room)


def checked(
    ground: Ground, heights: np.ndarray, project: Path, root: Path, name: str, block: Path | None = None
) -> tuple[dict[str, np.ndarray], float]:
    """What `orthomill check` says of heights (rows, cols) m: the bands of its product, and its CPU time (s). block: another
    orientation than that of the project."""
    (root / "runs").mkdir(exist_ok=True)
    if not (root / "runs" / project.name).exists():
        (root / "runs" / project.name).symlink_to(project.resolve())
    place = from_origin(ground.grid.west, ground.grid.north, ground.grid.cell, ground.grid.cell)
    rows, cols = heights.shape
    with rasterio.open(root / f"{name}.tif", "w", "GTiff", cols, rows, 1, ground.crs, place, "float32", nodata=np.nan) as target:
        target.write(heights.astype(np.float32), 1)
    oriented = ("--block", str(block)) if block else ()
    before = sum(os.times()[2:4])
    run = orthomill(root, "check", f"{name}.tif", "--project", project.name, "--name", name, "--sequential", *oriented)
    assert not run.code, run.output
    with rasterio.open(root / "runs" / name / "products" / "dsm_check.tif") as product:
        bands = {text.split(" ")[0]: product.read(k + 1).astype(np.float64) for k, text in enumerate(product.descriptions)}
    return bands, sum(os.times()[2:4]) - before


@dataclass(frozen=True)
class Found:
    """One bump: radius (cells) and height (m); whether it is off by more than the map says, and was found; whether most of it could
    not be judged; the share of its amplitude that the corrections tell."""

    radius: int
    height: float
    detectable: bool
    found: bool
    unjudged: bool
    share: float


def found(bump: Bump, ground: Ground, untouched: dict[str, np.ndarray], answer: dict[str, np.ndarray]) -> Found:
    """What became of a bump."""
    x, y = np.meshgrid(*ground.grid.centres(Window(0, 0, *ground.grid.shape)))
    near = np.s_[slice(*_range(bump.y, bump.radius, y[:, 0])), slice(*_range(bump.x, bump.radius, x[0]))]
    shape = shape_of(bump, x[near], y[near])
    core, dh = shape > CORE, answer["dh"][near] - np.nan_to_num(untouched["dh"][near])
    limit = untouched["detectable"][near][core]
    known = np.isfinite(dh) & (shape > 0)
    with np.errstate(invalid="ignore"):
        clearly = CORE * abs(bump.height) > limit
        right = wrong(answer)[near][core] & (-np.sign(bump.height) * answer["test"][near][core] > 0)
    share = -float((dh * shape)[known].sum() / max((shape[known] ** 2).sum(), 1e-9)) / bump.height if known.any() else 0.0
    cells = round(bump.radius / ground.grid.cell)
    unjudged = bool(np.isnan(answer["dh"][near][core]).mean() > 0.5)
    return Found(cells, bump.height, bool(clearly.all()), bool(right.mean() >= 0.5), unjudged, share)


def wrong(answer: dict[str, np.ndarray]) -> np.ndarray:
    """Cells (bool) that the product calls wrong."""
    return np.isin(answer["code"], (CheckCode.WRONG, CheckCode.CORRECTED))


@dataclass(frozen=True, eq=False)
class JustDetectable:
    """An error (rows, cols) m of the size that the map of detectable errors names, up and down in turn; its plateaus (bool)."""

    error: np.ndarray
    plateau: np.ndarray


def just_detectable(untouched: dict[str, np.ndarray]) -> JustDetectable:
    """The error that the check of the untouched surface promises to find in 95 %; plateaus where it is what the map says."""
    limit = untouched["detectable"]
    known = np.isfinite(limit)
    # Smoothed: an error that changes from cell to cell is narrower than any window.
    size = gaussian_filter(median_filter(np.where(known, limit, np.median(limit[known])), 31), 8)
    rows, cols = (np.sin(np.pi * np.arange(side) / SQUARE) for side in limit.shape)
    wave = 2 * np.outer(rows, cols)
    alike = np.abs(np.nan_to_num(limit) / size - 1) < 0.05
    return JustDetectable(size * np.clip(wave, -1, 1), (np.abs(wave) >= 1) & alike)


def power(planted: JustDetectable, answer: dict[str, np.ndarray]) -> list[str]:
    """Rows of the table: of the plateaus, by sign, the share of the cells that are significant and that are called wrong."""
    rows = []
    judged = planted.plateau & np.isfinite(answer["dh"])
    for name, sign in (("too high", 1), ("too low", -1)):
        cells = judged & (sign * planted.error > 0)
        significant = 100 * float((-sign * answer["test"][cells] > SIGNIFICANT).mean())
        rows.append(f"| {name} | {int(cells.sum())} | {significant:.1f} | {100 * float(wrong(answer)[cells].mean()):.1f} |")
    return rows


def _range(middle: float, radius: float, centres: np.ndarray) -> tuple[int, int]:
    inside = np.flatnonzero(np.abs(centres - middle) <= radius)
    return int(inside[0]), int(inside[-1]) + 1


def page(folder: Path, sides: tuple[int, int]) -> str:
    """Plant, check, compare; the page as text."""
    ground = ground_of(folder, sides)
    bumps = planted(ground.grid)
    x, y = np.meshgrid(*ground.grid.centres(Window(0, 0, *ground.grid.shape)))
    error = np.zeros(ground.grid.shape)
    for bump in bumps:
        error += bump.height * shape_of(bump, x, y)
    with tempfile.TemporaryDirectory() as place:
        untouched, seconds = checked(ground, ground.heights, folder, Path(place), "untouched")
        answer, more = checked(ground, ground.heights + error, folder, Path(place), "planted")
        just = just_detectable(untouched)
        powers = power(just, checked(ground, ground.heights + just.error, folder, Path(place), "just")[0])
        wide = summary(Path(place), "untouched")["dsm_check.detectable_width"]["value"] / (2 * ground.grid.cell)
    results = [found(bump, ground, untouched, answer) for bump in bumps]
    return "\n".join(
        [
            "# Planted bumps against the whole check",
            "",
            f"The true surface of {ground.grid.rows} x {ground.grid.cols} cells of {ground.grid.cell:g} m, {len(bumps)} bumps. "
            f"CPU of `orthomill check` with everything before it: {seconds:.0f} s untouched, {more:.0f} s with the bumps.",
            "",
            f"The report promises to see errors of {wide:.3g} cells of radius and more.",
            "",
            _HEAD.format("radius (cells)"),
            "| --- " * 7 + "|",
            *[_row(f"{radius}", [r for r in results if r.radius == radius]) for radius in sorted(RADII)],
            _row("**promised**", [r for r in results if r.radius >= wide]),
            "",
            _HEAD.format("height (m), as wide as promised"),
            "| --- " * 7 + "|",
            *[_row(f"+-{h:g}", [r for r in results if abs(r.height) == h and r.radius >= wide]) for h in HEIGHTS],
            "",
            "Errors of just the size of the map of detectable errors, which it promises to find in 95 %.",
            "",
            "| surface | cells | significant (%) | called wrong (%) |",
            "| --- | --- | --- | --- |",
            *powers,
            "",
            *_untouched(ground, untouched),
        ]
    )


_HEAD = "| {} | bumps | off by more than the map says | found of these | not judged of these | amplitude: median | 5 % below |"


def _row(name: str, results: list[Found]) -> str:
    these = [r for r in results if r.detectable]
    shares = [r.share for r in these] or [np.nan]
    part = f"{100 * np.mean([r.found for r in these]):.1f} %" if these else "-"
    unjudged = sum(r.unjudged and not r.found for r in these)
    median, low = np.percentile(shares, (50, 5))
    return f"| {name} | {len(results)} | {len(these)} | {part} | {unjudged} | {100 * median:.0f} % | {100 * low:.0f} % |"


def _untouched(ground: Ground, answer: dict[str, np.ndarray]) -> list[str]:
    """What the check says of the true surface."""
    known, lines = np.isfinite(answer["dh"]), list[str]()
    for name, cells in (("all", np.ones(known.shape, bool)), *ground.classes().items()):
        ratio = np.abs(answer["test"][cells & known])
        shares = [100 * float((ratio < k).mean()) for k in (1, 2, 3)]
        judged = 100 * known[cells].mean()
        alarms = 100 * float(wrong(answer)[cells & known].mean())
        lines.append(f"| {name} | {judged:.1f} | {shares[0]:.1f} | {shares[1]:.1f} | {shares[2]:.2f} | {alarms:.4f} |")
    return [
        "The untouched surface. Crowns are an envelope through which the photographs see the ground.",
        "",
        "| class | judged (%) | within 1 standard error | 2 | 3 | false alarms (% of the judged) |",
        "| --- | --- | --- | --- | --- | --- |",
        *lines,
    ]


def main(words: list[str]) -> None:
    """Measure on a run, in a part of it of ROWS x COLS cells; every other run than that of volos has a page of its own."""
    (folder,) = run_folders(words[:1], "volos")
    text = page(folder, (int(words[1]), int(words[2])) if len(words) > 2 else SIDES)
    own = "" if folder.name == "volos" else f"_{re.sub('[^a-z0-9]', '_', folder.name)}"
    write_page("planted_rounds", words, text, RESULTS / f"planted_rounds{own}.md")
