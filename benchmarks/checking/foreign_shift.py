"""The shift that a check finds of a surface from elsewhere, beside the one that it was given.

    python -m benchmarks foreign_shift runs/volos [ROWS COLS]

Strategy. The true surface of a simulated run is checked against the run's photographs and their true orientation, so that no datum
of a block stands between both: as it is, smoothed as surfaces of other programs are (Gauss, 4 cells), and in cells four times as
wide. The part that is looked at is cut into twelve, whose ground and matching have nothing in common: each is displaced by another
random amount, and what `orthomill check` says of the shift is compared with it, in its own standard errors.
"""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

from benchmarks.checking.planted_rounds import Ground, checked, ground_of
from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import run_folders, summary
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.truth import TRUTH_BLOCK

SIDES = 800, 900
"""cells of the part that is checked, in the middle of the surface"""
PARTS = 4, 3
"""into which it is cut"""
FARTHEST = (3.0, 3.0, 2.0)
"""m: east, north, up; parts are displaced by less"""
Surface = Callable[[np.ndarray], np.ndarray]
SURFACES: dict[str, Surface] = {
    "as it is": lambda heights: heights,
    "smoothed, 4 cells": lambda heights: gaussian_filter(heights, 4.0),
    "means of 4 x 4 cells": lambda heights: _means(heights, 4),
}


def _means(heights: np.ndarray, side: int) -> np.ndarray:
    rows, cols = (length // side for length in heights.shape)
    return np.asarray(heights[: rows * side, : cols * side].reshape(rows, side, cols, side).mean(axis=(1, 3)))


@dataclass(frozen=True)
class Told:
    """Errors of the shift that a check found (m): east, north, up; and their standard errors as it states them."""

    surface: str
    planted: tuple[float, float, float]
    errors: tuple[float, ...]
    sigmas: tuple[float, ...]

    @property
    def ratios(self) -> np.ndarray:
        """(3,) errors in their own standard errors."""
        return np.abs(np.array(self.errors)) / np.array(self.sigmas)


def parts_of(ground: Ground) -> list[Ground]:
    """The ground cut into PARTS of rows and columns."""
    rows, cols = (side // count for side, count in zip(ground.heights.shape, PARTS, strict=True))
    found = []
    for row, col in product(range(PARTS[0]), range(PARTS[1])):
        cells = np.s_[row * rows : (row + 1) * rows, col * cols : (col + 1) * cols]
        west, north = ground.grid.west + col * cols * ground.grid.cell, ground.grid.north - row * rows * ground.grid.cell
        grid = ground.grid.model_copy(update={"west": west, "north": north, "rows": rows, "cols": cols})
        found.append(replace(ground, grid=grid, heights=ground.heights[cells], material=ground.material[cells]))
    return found


def shifts() -> list[tuple[float, float, float]]:
    """By how much each part is displaced (m)."""
    drawn = np.random.default_rng(11).uniform(-1, 1, (PARTS[0] * PARTS[1], 3)) * FARTHEST
    return [(float(east), float(north), float(up)) for east, north, up in drawn.round(2)]


def told(ground: Ground, folder: Path, block: Path, surface: str, planted: tuple[float, float, float]) -> Told:
    """One surface, displaced and checked; NaN in plan where only the height is told."""
    heights = SURFACES[surface](ground.heights)
    grid = ground.grid.model_copy(
        update={
            "cell": ground.grid.cell * (ground.grid.rows // heights.shape[0]),
            "west": ground.grid.west + planted[0],
            "north": ground.grid.north + planted[1],
            "rows": heights.shape[0],
            "cols": heights.shape[1],
        }
    )
    with tempfile.TemporaryDirectory() as place:
        checked(replace(ground, grid=grid), heights + planted[2], folder, Path(place), "shifted", block)
        says = summary(Path(place), "shifted")
    found = [_number(says, f"shift_{axis}") for axis in ("east", "north", "up")]
    plan = _number(says, "shift_plan_sigma")
    errors = tuple(f - p for f, p in zip(found, planted, strict=True))
    return Told(surface, planted, errors, (plan, plan, _number(says, "shift_up_sigma")))


def _number(says: dict, figure: str) -> float:
    value = says[f"dsm_check.{figure}"]["value"]
    return float("nan") if value is None else float(value)


def page(folder: Path, sides: tuple[int, int]) -> str:
    """Displace, check, compare; the page as text."""
    ground = ground_of(folder, sides)
    with tempfile.TemporaryDirectory() as place:
        block = Path(place) / "cameras.json"
        block.write_text(Store(folder).table(TRUTH_BLOCK).model_dump_json())
        tries = [(surface, part, planted) for surface in SURFACES for part, planted in zip(parts_of(ground), shifts(), strict=True)]
        found = [told(part, folder, block, surface, planted) for surface, part, planted in tries]
    ratios = np.array([one.ratios for one in found])
    lines = ["# Shift of a surface from elsewhere", "", _head(ground, int(np.isnan(ratios[:, 0]).sum())), ""]
    lines += ["| surface | within 1 (%) | within 2 | within 3 | largest |", "| --- | --- | --- | --- | --- |"]
    lines.append(_shares("all", ratios))
    lines += [_shares(name, ratios[[one.surface == name for one in found]]) for name in SURFACES]
    lines += [_shares(name, ratios[:, axis]) for axis, name in enumerate(("east", "north", "up"))]
    lines += ["", "| surface | planted: east, north, up (m) | error (m) | stated standard error (m) | ratio |"]
    return "\n".join([*lines, "| --- | --- | --- | --- | --- |", *map(_row, found), ""])


def _shares(name: str, ratios: np.ndarray) -> str:
    told = ratios[np.isfinite(ratios)]
    shares = " | ".join(f"{100 * (told <= k).mean():.0f}" for k in (1, 2, 3))
    return f"| {name} | {shares} | {told.max():.1f} |"


def _head(ground: Ground, untold: int) -> str:
    rows, cols = (side // count for side, count in zip(ground.heights.shape, PARTS, strict=True))
    return (
        f"Parts of {rows} x {cols} cells of {ground.grid.cell:g} m, true orientation. Shares of errors within 1, 2, 3 stated "
        f"standard errors (68, 95, 99.7 due); {untold} parts tell the height alone."
    )


def _row(one: Told) -> str:
    planted = ", ".join(f"{value:+g}" for value in one.planted)
    errors = _lengths(one.errors)
    sigmas = ", ".join(f"{value:.3f}" for value in one.sigmas)
    return f"| {one.surface} | {planted} | {errors} | {sigmas} | {', '.join(f'{value:.1f}' for value in one.ratios)} |"


def _lengths(values: tuple[float, ...]) -> str:
    return ", ".join(f"{value:+.3f}" for value in values)


def main(words: list[str]) -> None:
    """Measure on a run, in a part of it of ROWS x COLS cells."""
    (folder,) = run_folders(words[:1], "volos")
    write_page("foreign_shift", words, page(folder, (int(words[1]), int(words[2])) if len(words) > 2 else SIDES))
