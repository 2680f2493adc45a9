"""Does the surface check find planted errors? A tilt of +-5 m and twenty bumps of +-3 m on the surface of a finished run.

    python -m benchmarks planted_errors runs/volos

The study of the embedded project calls it on its own run and keeps the page.

Strategy. The surface that the run measured is deformed, checked in one piece by the functions of `dsm_check`, and the result is
compared with the planted errors: sign, position and amplitude of every bump, and the tilt. How much of a bump is recovered depends
on its size relative to the matching window, so several radii are measured, and on its position: bumps are placed once on open
ground that the check of the untouched surface confirms, once anywhere a height was measured. Alarms on the untouched surface are
counted, too; real errors of that surface are among them. Works on arrays: `check` and `recovered` can be used from a notebook.
"""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import median_filter

from benchmarks.deformation import Bump, Deformation, planted, shape_of
from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import run_folders
from orthomill.schemas.epipolar import PAIRS, EpipolarPairs
from orthomill.schemas.orientation import BLOCK, Block
from orthomill.schemas.photo import photo_raster
from orthomill.schemas.raster import Window
from orthomill.schemas.surface import HEIGHT, SURFACE, Surface
from orthomill.tasks.dsm_check.areas import block_size
from orthomill.tasks.dsm_check.coverage import CheckedPair, CheckedPairs, choose_checked_pairs
from orthomill.tasks.dsm_check.nodes import NodeTile, check_nodes
from orthomill.tasks.dsm_check.plan.round_plan import Comparing, correction_nodes
from orthomill.tasks.dsm_check.stage import DsmCheckStage
from orthomill.tasks.dsm_check.tile import CheckedCells, CorrectionRule, NodeWindow, correct_tile
from orthomill.tasks.dsm_check.working_orthoimage import WorkingTile, ortho_tile


@dataclass(frozen=True, eq=False)
class Scene:
    """Input of a check: geometry, and photographs (rows, cols, bands) by name."""

    block: Block
    pairs: EpipolarPairs
    surface: Surface
    photographs: dict[str, np.ndarray]


@dataclass(frozen=True)
class Recovery:
    """One planted bump and the result of the check at its position."""

    planted: float
    found: float
    """m, amplitude of the bump in the result, with the sign of the error (not of the correction)"""
    off: float
    """m, distance of the position found from the position planted"""
    checked: float
    """share of the cells of the bump that could be checked"""

    @property
    def share(self) -> float:
        return self.found / self.planted


def check(scene: Scene, heights: np.ndarray, stage: DsmCheckStage) -> CheckedCells:
    """The checked cells of a surface (rows, cols) m, in one piece."""
    chosen = choose_checked_pairs(scene.pairs, scene.block, scene.surface, 64, stage.pairs, stage.pixels_per_cell)
    nodes = tuple(_nodes(scene, heights, stage, chosen, pair) for pair in chosen.pairs)
    whole = Window(0, 0, *heights.shape)
    windows = tuple(NodeWindow(p.name, *[_nodes_of(p.window, stage.step)] * 2) for p in chosen.pairs)
    how = Comparing(stage.matching, stage.correction, stage.step, stage.radius * stage.step)
    nodes_of_cells, size = correction_nodes(how, chosen.pixels_per_cell), block_size(heights.shape)
    rule = CorrectionRule(stage.apply, stage.significance, nodes_of_cells, size, chosen.pixel_height)
    return correct_tile(whole, windows, rule, heights, nodes)


def _nodes_of(window: Window, step: int) -> Window:
    return Window(window.row // step, window.col // step, -(-window.height // step), -(-window.width // step))


def _nodes(scene: Scene, heights: np.ndarray, stage: DsmCheckStage, chosen: CheckedPairs, pair: CheckedPair) -> np.ndarray:
    block, grid, factor = scene.block, scene.surface.grid, chosen.pixels_per_cell
    given = pair.window.grown(1).clipped(grid.shape)
    images = []
    for name in (pair.left, pair.right):
        photo = scene.photographs[name]
        tile = WorkingTile(block.of(name), block.camera_of(name), grid, pair.window, given, factor, Window(0, 0, *photo.shape[:2]))
        images.append(ortho_tile(tile, heights[given.slices], photo))
    tile = NodeTile(block.of(pair.left), block.of(pair.right), grid, pair.window, pair.window, factor, stage.step)
    return check_nodes(tile, stage.matching, stage.correction, *images, heights[pair.window.slices])


def recovered(deformation: Deformation, dh: np.ndarray) -> list[Recovery]:
    """Recovery of every bump by the corrections (rows, cols) m; the planted tilt is removed first."""
    x, y = np.meshgrid(*deformation.grid.centres(Window(0, 0, *dh.shape)))
    error = -dh - deformation.tilt_at(x, y)
    return [_recovered(bump, x, y, error) for bump in deformation.bumps]


def _recovered(bump: Bump, x: np.ndarray, y: np.ndarray, error: np.ndarray) -> Recovery:
    near = np.hypot(x - bump.x, y - bump.y) < 1.5 * bump.radius
    # the window is wider than the bump: its centre must not be found merely because nothing else was searched
    x, y, error = x[near], y[near], error[near]
    shape, known = shape_of(bump, x, y), np.isfinite(error)
    inside = shape > 0
    # fewer cells do not determine an amplitude; the bump counts as not checked, not as missed
    if known[inside].mean() < 0.2:
        return Recovery(bump.height, 0.0, np.inf, float(known[inside].mean()))
    found = float((error * shape)[known].sum() / (shape**2)[known].sum())
    # squared and of the right sign only: the noise around the bump would pull the centroid to the middle of the window
    weight = np.clip(error[known] * np.sign(bump.height), 0, None) ** 2
    weight /= max(weight.sum(), 1e-12)
    truth = (shape**2)[known] / (shape**2)[known].sum()
    off = np.hypot(((weight - truth) * x[known]).sum(), ((weight - truth) * y[known]).sum())
    return Recovery(bump.height, found, float(off), float(known[inside].mean()))


def tilt_found(deformation: Deformation, dh: np.ndarray) -> float:
    """Share of the planted tilt that the corrections contain (1: all of it), by regression."""
    x, y = np.meshgrid(*deformation.grid.centres(Window(0, 0, *dh.shape)))
    tilt, error = deformation.tilt_at(x, y), -dh - (deformation.at(x, y) - deformation.tilt_at(x, y))
    known = np.isfinite(error)
    error, tilt = error[known] - error[known].mean(), tilt[known] - tilt[known].mean()
    return float((error * tilt).sum() / (tilt**2).sum())


def false_alarms(answer: CheckedCells, significance: float) -> float:
    """Share of the checked cells of an untouched surface that are reported as wrong."""
    known = np.isfinite(answer.dh)
    return float((np.abs(answer.dh) > significance * answer.precision)[known].mean())


def found_of_detectable_size(
    scene: Scene, heights: np.ndarray, untouched: CheckedCells, stage: DsmCheckStage
) -> tuple[float, float]:
    """Shares of the cells where an error of just the detectable size is found: too high, too low. Both should be 95 %."""
    known = np.isfinite(untouched.detectable)
    # Smoothed: an error that changes from cell to cell is narrower than any window.
    size = median_filter(np.where(known, untouched.detectable, np.median(untouched.detectable[known])), 31)
    shares = []
    for sign in (1, -1):
        answer = check(scene, (heights + sign * size).astype(np.float32), stage)
        same = np.isfinite(answer.dh) & (np.abs(answer.detectable / size - 1) < 0.3)
        shares.append(float((-sign * answer.dh > stage.significance * answer.precision)[same].mean()))
    return shares[0], shares[1]


def open_places(answer: CheckedCells, heights: np.ndarray, scene: Scene) -> np.ndarray:
    """Ground points (N, 2) m where a bump is detectable: the untouched surface was checked, agrees, and is not steep."""
    grid = scene.surface.grid
    slope = np.hypot(*np.gradient(heights, grid.cell))
    good = np.isfinite(answer.dh) & (np.abs(answer.dh) < 3 * answer.precision) & (slope < 0.5)
    side = max(8, max(grid.shape) // 80)
    rows, cols = (n // side for n in grid.shape)
    share = good[: rows * side, : cols * side].reshape(rows, side, cols, side).mean(axis=(1, 3))
    row, col = np.nonzero(share > 0.9)
    return np.column_stack([grid.west + (col + 0.5) * side * grid.cell, grid.north - (row + 0.5) * side * grid.cell])


def any_places(heights: np.ndarray, scene: Scene) -> np.ndarray:
    """Ground points (N, 2) m wherever a height was measured, one in some hundred cells."""
    grid, step = scene.surface.grid, max(4, max(heights.shape) // 160)
    x, y = np.meshgrid(*grid.centres(Window(0, 0, *heights.shape)))
    known = np.isfinite(heights)[::step, ::step]
    return np.column_stack([x[::step, ::step][known], y[::step, ::step][known]])


def run(scene: Scene, heights: np.ndarray, radii: tuple[float, ...] = (6, 10, 15, 25, 50)) -> str:
    """Plant, check and compare for each radius (cells) and kind of place; returns the table as text."""
    stage, start = DsmCheckStage(), time.process_time()
    untouched = check(scene, heights, stage)
    seconds = time.process_time() - start
    places = {"open ground, agreeing": open_places(untouched, heights, scene), "anywhere measured": any_places(heights, scene)}
    columns = (
        "places",
        "radius (cells)",
        "bumps",
        "right sign",
        "80 % or more",
        "not judged",
        "share: median",
        "least",
        "offset, median (m)",
        "tilt",
        "NMAD (m)",
    )
    lines = [f"| {' | '.join(columns)} |", "| --- " * len(columns) + "|"]
    for name, where in places.items():
        lines += [
            _row(name, radius, planted(scene.surface.grid, where, radius * scene.surface.grid.cell), scene, heights, stage)
            for radius in radii
        ]
    ratio = np.abs(untouched.dh / untouched.precision)[np.isfinite(untouched.dh)]
    high, low = found_of_detectable_size(scene, heights, untouched, stage)
    return "\n".join(
        [
            *lines,
            "",
            f"Alarms on the untouched surface: {false_alarms(untouched, stage.significance):.3%} of the checked cells. "
            f"{seconds:.0f} s of CPU for one check.",
            "",
            f"Of its corrections {(ratio < 1).mean():.1%} are within 1 of their standard errors (68.3 %), {(ratio < 2).mean():.1%} "
            f"within 2 (95.4 %), {(ratio < 3).mean():.2%} within 3 (99.7 %); surface and check share photographs and noise.",
            "",
            f"Errors of just the smallest detectable size are found in {high:.1%} (too high) and {low:.1%} (too low) of the "
            "cells where the map says 95 %.",
        ]
    )


def _row(name: str, radius: float, deformation: Deformation, scene: Scene, heights: np.ndarray, stage: DsmCheckStage) -> str:
    x, y = np.meshgrid(*scene.surface.grid.centres(Window(0, 0, *heights.shape)))
    # the bounds grow with the deformation, or the check would not look at the tops of the bumps
    low, high = scene.surface.height_low - 10, scene.surface.height_high + 10
    surface = scene.surface.model_copy(update={"height_low": low, "height_high": high})
    wrong = (heights + deformation.at(x, y)).astype(np.float32)
    dh = check(Scene(scene.block, scene.pairs, surface, scene.photographs), wrong, stage).dh
    bumps = recovered(deformation, dh)
    judged = [b for b in bumps if np.isfinite(b.off)]
    shares = [b.share for b in judged] or [np.nan]
    residual = (dh + deformation.at(x, y))[np.isfinite(dh)]
    nmad = 1.4826 * np.median(np.abs(residual - np.median(residual)))
    off = np.median([b.off for b in judged])
    return (
        f"| {name} | {radius:g} | {len(bumps)} | {sum(s > 0 for s in shares)} | {sum(s >= 0.8 for s in shares)} | "
        f"{len(bumps) - len(judged)} | {np.median(shares):.0%} | {min(shares):.0%} | {off:.1f} | "
        f"{tilt_found(deformation, dh):.1%} | {nmad:.3f} |"
    )


def scene_of_run(folder: Path) -> tuple[Scene, np.ndarray]:
    """The scene and the measured surface (rows, cols) of a finished run."""
    from orthomill.pipeline.storage.store import Store

    store = Store(folder)
    block, pairs, surface = (store.table(table) for table in (BLOCK, PAIRS, SURFACE))
    read = {name: store.read(photo_raster(name), store.spec(photo_raster(name)).full) for name in block.names}
    return Scene(block, pairs, surface, read), store.read(HEIGHT, store.spec(HEIGHT).full)


def main(words: list[str]) -> None:
    """Measure on a finished run and keep the page."""
    (folder,) = run_folders(words, "volos")
    lines = [
        "# Does the check find planted errors?",
        "",
        "A tilt of +-5 m and twenty bumps of +-3 m of each radius, planted on the measured surface.",
        "",
        run(*scene_of_run(folder)),
    ]
    write_page("planted_errors", words, "\n".join(lines))
