"""The shift that a check finds of a surface from elsewhere, beside the one that it was given.

    python -m benchmarks foreign_shift runs/volos [ROWS COLS]

Strategy. The true surface of a simulated run is checked against the run's photographs and adjusted cameras: as it is, smoothed as
surfaces of other programs are (Gauss, 2 and 4 cells), and in wider cells; each at its place and displaced in plan and height by
two amounts. What `orthomill check` says of the shift is compared with what was planted, in its own standard errors. The block has
a datum error of its own, which the surface that nobody touched shows: errors are told from there.
"""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

from benchmarks.checking.planted_rounds import Ground, checked, ground_of
from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import run_folders, summary

SIDES = 560, 680
"""cells of the part that is checked, in the middle of the surface"""
SHIFTS = ((0.0, 0.0, 0.0), (1.3, -0.8, 0.4), (-2.5, -1.7, 3.0))
"""m: east, north, up"""
Surface = Callable[[np.ndarray], np.ndarray]
SURFACES: dict[str, Surface] = {
    "as it is": lambda heights: heights,
    "smoothed, 2 cells": lambda heights: gaussian_filter(heights, 2.0),
    "smoothed, 4 cells": lambda heights: gaussian_filter(heights, 4.0),
    "means of 4 x 4 cells": lambda heights: np.kron(_means(heights, 4), np.ones((4, 4))),
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


def told(ground: Ground, folder: Path, surface: str, planted: tuple[float, float, float]) -> Told:
    """One surface, displaced and checked."""
    heights = SURFACES[surface](ground.heights)
    grid = ground.grid.model_copy(
        update={
            "west": ground.grid.west + planted[0],
            "north": ground.grid.north + planted[1],
            "rows": heights.shape[0],
            "cols": heights.shape[1],
        }
    )
    with tempfile.TemporaryDirectory() as place:
        checked(replace(ground, grid=grid), heights + planted[2], folder, Path(place), "shifted")
        says = summary(Path(place), "shifted")
    found = [says[f"dsm_check.shift_{axis}"]["value"] for axis in ("east", "north", "up")]
    plan = says["dsm_check.shift_plan_sigma"]["value"]
    errors = tuple(f - p for f, p in zip(found, planted, strict=True))
    return Told(surface, planted, errors, (plan, plan, says["dsm_check.shift_up_sigma"]["value"]))


def page(folder: Path, sides: tuple[int, int]) -> str:
    """Displace, check, compare; the page as text."""
    ground = ground_of(folder, sides)
    all_told = [told(ground, folder, surface, planted) for surface in SURFACES for planted in SHIFTS]
    datum = all_told[0].errors
    all_told = [replace(one, errors=tuple(np.subtract(one.errors, datum).tolist())) for one in all_told[1:]]
    ratios = np.concatenate([shift.ratios for shift in all_told])
    one, two, three = (100 * (ratios <= k).mean() for k in (1, 2, 3))
    return "\n".join(
        [
            "# Shift of a surface from elsewhere",
            "",
            f"Cells of {ground.grid.cell:g} m. The block itself lies {_lengths(datum)} m from the truth (east, north, up), by the "
            "true surface at its place; errors are told from there.",
            "",
            f"Within 1 stated standard error: {one:.0f} % (68 due), within 2: {two:.0f} % (95), "
            f"within 3: {three:.0f} %; largest {ratios.max():.1f}.",
            "",
            "| surface | planted: east, north, up (m) | error (m) | stated standard error (m) | ratio |",
            "| --- | --- | --- | --- | --- |",
            *map(_row, all_told),
            "",
        ]
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
