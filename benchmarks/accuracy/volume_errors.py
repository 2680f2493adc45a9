"""Volumes of random polygons on a simulated town, against the standard errors that `orthomill measure` states for them.

The error of a height is known in every cell (surface minus truth), and a volume is linear in heights: its error is the volume of
that difference. Polygons are stars of eight corners, of five sizes; those of the first rows have no estimated cell.
"""

import math
import sys
from pathlib import Path

import numpy as np

from benchmarks.instrument.result_page import write_page
from orthomill.pipeline.cli.lookups.measured_surface import RunSurface
from orthomill.schemas.accuracy.surface_answers import SurfaceCut
from orthomill.schemas.raster import Window
from orthomill.tasks.accuracy.answers.error_correlation import ErrorCorrelation
from orthomill.tasks.accuracy.answers.linear_answer import SurfacePart
from orthomill.tasks.accuracy.answers.measuring import correlation_words, surface_correlation
from orthomill.tasks.accuracy.answers.polygon_volumes import VolumeAnswer, inside_share, volume_of

AREAS = (10.0, 100.0, 1000.0, 10_000.0, 100_000.0)
"""m2, of the circle about a star"""
COUNT = 200
TRIES = 4000
DIFFERENCE = "evaluation/dh_before_check"
_ALONE = ErrorCorrelation((0.0, 1.0), (1.0, 0.0))


def star(rng: np.random.Generator, radius: float) -> np.ndarray:
    """Eight corners (8, 2) around the origin, cells."""
    angles = np.sort(rng.uniform(0, 2 * math.pi, 8))
    reach = radius * rng.uniform(0.6, 1.2, 8)
    return np.column_stack([reach * np.cos(angles), reach * np.sin(angles)])


def sampled(
    surface: RunSurface, area: float, only_measured: bool, base: float | None, correlation: ErrorCorrelation
) -> list[VolumeAnswer]:
    """Volumes of the error under COUNT polygons."""
    rng, grid, found = np.random.default_rng(39), surface.grid, []
    radius = math.sqrt(area / math.pi) / grid.cell
    side = 2 * math.ceil(1.2 * radius) + 3
    for _ in range(TRIES):
        row, col = rng.integers(0, grid.rows - side), rng.integers(0, grid.cols - side)
        ring = star(rng, radius) + side / 2
        window = Window(int(row), int(col), side, side)
        share = inside_share(ring, window.shape)
        cut = surface.read(window)
        inside = share > 0
        wrong = surface.store.read(DIFFERENCE, window)
        if not np.isfinite(wrong[inside]).all() or not inside.any() or (only_measured and not cut.measured[inside].all()):
            continue
        found.append(volume_of(_errors(cut, wrong), share, grid.cell, base, correlation))
        if len(found) == COUNT:
            break
    return found


def _errors(cut: SurfaceCut, wrong: np.ndarray) -> SurfacePart:
    return SurfacePart(wrong, cut.relative, cut.datum, cut.measured)


def row_of(name: str, area: float, found: list[VolumeAnswer]) -> str:
    """A line of the table."""
    if len(found) < COUNT // 4:
        return f"| {name} | {area:g} | {len(found)} | too few such places | | | |"
    ratios = np.array([abs(one.volume) / one.error.sigma for one in found])
    rms = 1000 * math.sqrt(float(np.mean([(one.volume / one.area) ** 2 for one in found])))
    one, two = (100 * (ratios <= k).mean() for k in (1, 2))
    return f"| {name} | {area:g} | {len(found)} | {rms:.0f} | {math.sqrt((ratios**2).mean()):.2f} | {one:.0f} | {two:.0f} |"


_KINDS: tuple[tuple[str, bool, float | None], ...] = (
    ("measured, above a level", True, 0.0),
    ("measured, above the border's plane", True, None),
    ("anywhere, above a level", False, 0.0),
)


def main(words: list[str]) -> None:
    """The page."""
    lines = ["# Volumes against their standard errors", ""]
    for run in words or ["runs/volos"]:
        surface = RunSurface(Path(run))
        known = surface_correlation(surface)
        lines += [f"## {Path(run).name}", "", correlation_words(known), ""]
        lines += ["| polygons | area m2 | number | rms mean height error mm | rms error / sigma | within 1 (%) | within 2 (%) |"]
        lines += ["| --- | --- | --- | --- | --- | --- | --- |"]
        for name, only, base in _KINDS:
            lines += [row_of(name, area, sampled(surface, area, only, base, known)) for area in AREAS]
        alone = sampled(surface, 1000.0, True, None, _ALONE)
        lines += [row_of("measured, above the border's plane, cells as if independent", 1000.0, alone), ""]
    lines += [
        "Errors of a volume divided by the standard error that is stated for it; of normal errors 68 and 95 % lie within 1 and 2.",
        "Above a level the datum of the one block counts in every row: one draw of it, not many. Anywhere: estimates, walls",
        "and trees too.",
    ]
    write_page("volume_errors", words, "\n".join(lines))


if __name__ == "__main__":
    main(sys.argv[1:])
