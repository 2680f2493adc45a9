"""Volumes of random polygons on a simulated town, against the standard errors that `orthomill measure` states for them.

The error of a height is known in every cell (surface minus truth), and a volume is linear in heights: its error is the volume of
that difference. Polygons are stars of eight corners, of five sizes; those of the first rows have no estimated cell.
"""

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.instrument.result_page import write_page
from orthomill.pipeline.cli.lookups.measured_surface import RunSurface
from orthomill.schemas.accuracy.surface_answers import SurfaceCut
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.accuracy.answers.error_correlation import ErrorCorrelation
from orthomill.tasks.accuracy.answers.linear_answer import SurfacePart, error_of
from orthomill.tasks.accuracy.answers.measuring import correlation_words, surface_correlation
from orthomill.tasks.accuracy.answers.polygon_volumes import inside_share, volume_weights

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


@dataclass(frozen=True)
class Town:
    """A simulated town in memory: its surface, and the surface minus the truth (rows, cols) m."""

    grid: MapGrid
    whole: SurfaceCut
    wrong: np.ndarray

    def read(self, window: Window) -> SurfaceCut:
        """A window of the surface."""
        w = window.slices
        return SurfaceCut(self.whole.height[w], self.whole.relative[w], self.whole.datum[w], self.whole.measured[w])


def town_of(run: str) -> Town:
    """What a finished run has."""
    surface = RunSurface(Path(run))
    full = Window(0, 0, surface.grid.rows, surface.grid.cols)
    return Town(surface.grid, surface.read(full), surface.store.read(DIFFERENCE, full))


class Found(NamedTuple):
    """The error of a mean height, m, and that of a volume in standard errors."""

    height: float
    ratio: float


@dataclass(frozen=True)
class Kind:
    """Which polygons, against what, and whether the one datum of the block is taken out of errors and promises."""

    name: str
    only_measured: bool = True
    border: bool = False
    datum_known: bool = False


def sampled(town: Town, area: float, kind: Kind, correlation: ErrorCorrelation) -> list[Found]:
    """Errors of volumes under COUNT polygons, above a level or above the plane through their border."""
    only_measured, border = kind.only_measured, kind.border
    datum = float(np.nanmedian(np.where(town.whole.measured, town.wrong, np.nan))) if kind.datum_known else 0.0
    rng, grid, found = np.random.default_rng(39), town.grid, []
    radius = math.sqrt(area / math.pi) / grid.cell
    side = 2 * math.ceil(1.2 * radius) + 3
    for tried in range(TRIES):
        if tried > TRIES // 8 and len(found) < COUNT // 40:
            break
        row, col = rng.integers(0, grid.rows - side), rng.integers(0, grid.cols - side)
        ring = star(rng, radius) + side / 2
        window = Window(int(row), int(col), side, side)
        cut, wrong = town.read(window), town.wrong[window.slices]
        # The middle half first, which spares most of the work on places that do not serve.
        middle = slice(side // 4, side - side // 4)
        if not np.isfinite(wrong[middle, middle]).all() or (only_measured and not cut.measured[middle, middle].mean() > 0.98):
            continue
        share = inside_share(ring, window.shape)
        inside = share > 0
        if not inside.any() or not np.isfinite(wrong[inside]).all() or (only_measured and not cut.measured[inside].all()):
            continue
        weights = volume_weights(share * grid.cell**2, border)
        error = error_of(weights, SurfacePart(cut.height, cut.relative, cut.datum, cut.measured), correlation)
        volume = float((weights * np.where(inside, wrong - datum, 0.0)).sum())
        sigma = math.hypot(error.measured, error.estimated) if kind.datum_known else error.sigma
        found.append(Found(volume / float(share.sum() * grid.cell**2), abs(volume) / sigma))
        if len(found) == COUNT:
            break
    return found


def row_of(name: str, area: float, found: list[Found]) -> str:
    """A line of the table."""
    if len(found) < COUNT // 4:
        return f"| {name} | {area:g} | {len(found)} | too few such places | | | |"
    ratios = np.array([one.ratio for one in found])
    rms = 1000 * math.sqrt(float(np.mean([one.height**2 for one in found])))
    one, two = (100 * (ratios <= k).mean() for k in (1, 2))
    return f"| {name} | {area:g} | {len(found)} | {rms:.0f} | {math.sqrt((ratios**2).mean()):.2f} | {one:.0f} | {two:.0f} |"


_KINDS = (
    Kind("measured, above a level"),
    Kind("measured, above a level, the block's datum known", datum_known=True),
    Kind("measured, above the border's plane", border=True),
    Kind("anywhere, above a level", only_measured=False),
)
_AS_EVERYBODY = Kind("measured, above the border's plane, cells as if independent", border=True)


def main(words: list[str]) -> None:
    """The page."""
    lines = ["# Volumes against their standard errors", ""]
    most = max((float(word) for word in words if word.isdigit()), default=AREAS[-1])
    for run in [word for word in words if not word.isdigit()] or ["runs/volos"]:
        town = town_of(run)
        known = surface_correlation(town)
        lines += [f"## {Path(run).name}", "", correlation_words(known), ""]
        lines += ["| polygons | area m2 | number | rms mean height error mm | rms error / sigma | within 1 (%) | within 2 (%) |"]
        lines += ["| --- | --- | --- | --- | --- | --- | --- |"]
        for kind in _KINDS:
            lines += [row_of(kind.name, area, sampled(town, area, kind, known)) for area in AREAS if area <= most]
        lines += [row_of(_AS_EVERYBODY.name, 1000.0, sampled(town, 1000.0, _AS_EVERYBODY, _ALONE)), ""]
    lines += [
        "Errors of a volume divided by the standard error that is stated for it; of normal errors 68 and 95 % lie within 1 and 2.",
        "Above a level the datum of the one block counts in every row: one draw of it, not many; it is taken out of errors (median",
        "of measured cells) and promises where it is known. Anywhere: estimates, walls and trees too.",
    ]
    write_page("volume_errors", words, "\n".join(lines))


if __name__ == "__main__":
    main(sys.argv[1:])
