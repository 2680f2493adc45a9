"""Volumes of random polygons on a simulated town, against the standard errors that `orthomill measure` states for them.

The error of a height is known in every cell (surface minus truth), and a volume is linear in heights: its error is the volume of
that difference. Polygons are stars of eight corners, of five sizes; those of the first rows have no estimated cell. What the
orientations do to heights is known as well, from the true block: one draw of a level, of leans and bends, however many polygons.
Large polygons overlap: as many of them are independent as find room beside each other, and of so few shares scatter.
"""

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.stats import binom

from benchmarks.accuracy.true_errors import errors_of
from benchmarks.instrument.result_page import write_page
from orthomill.pipeline.cli.lookups.measured_surface import RunSurface
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.accuracy.surface_answers import SurfaceCut
from orthomill.schemas.orientation import BLOCK, Block
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.truth import TRUTH_BLOCK
from orthomill.tasks.accuracy.answers.datum_lattice import DatumLattice
from orthomill.tasks.accuracy.answers.error_correlation import ErrorCorrelation
from orthomill.tasks.accuracy.answers.linear_answer import SurfacePart, error_of
from orthomill.tasks.accuracy.answers.measuring import correlation_words, surface_correlation
from orthomill.tasks.accuracy.answers.polygon_volumes import inside_share, volume_weights
from orthomill.tasks.evaluation.orientation_accuracy import datum_heights

AREAS = (10.0, 100.0, 1000.0, 10_000.0, 100_000.0)
"""m2, of the circle about a star"""
COUNT = 200
TRIES = 4000
MODES = 4
NODES = 33
"""places along a side at which it is computed what the orientations do"""
LEVELS = 20.0
"""m between the two levels at which it is"""
LEAST_MEASURED = 0.98
"""share of the cells that photographs measured, where polygons are called measured: of 100 000 m2 a tree or two are not"""
_ALONE = ErrorCorrelation((0.0, 1.0), (1.0, 0.0), common=0.0)


def star(rng: np.random.Generator, radius: float) -> np.ndarray:
    """Eight corners (8, 2) around the origin, cells."""
    angles = np.sort(rng.uniform(0, 2 * math.pi, 8))
    reach = radius * rng.uniform(0.6, 1.2, 8)
    return np.column_stack([reach * np.cos(angles), reach * np.sin(angles)])


@dataclass(frozen=True)
class Town:
    """A simulated town in memory: its surface, and the surface minus the truth (rows, cols) m."""

    grid: MapGrid
    block: Block
    whole: SurfaceCut
    wrong: np.ndarray
    turned: np.ndarray
    """(rows, cols) m: what the orientations do to heights"""

    def read(self, window: Window) -> SurfaceCut:
        """A window of the surface."""
        w = window.slices
        return SurfaceCut(self.whole.height[w], self.whole.relative[w], self.whole.datum[w], self.whole.measured[w])


def town_of(run: str, flown: Path | None = None) -> Town:
    """What a finished run has; flown: the run that rendered its photographs and has the truth, if it is another."""
    surface = RunSurface(Path(run))
    truth = surface.store if flown is None else Store(flown)
    grid, block, true = surface.grid, surface.store.table(BLOCK), truth.table(TRUTH_BLOCK)
    cut = surface.read(Window(0, 0, grid.rows, grid.cols))
    return Town(grid, block, cut, errors_of(truth, grid, cut.height), _turned(grid, block, true, cut.height))


def _turned(grid: MapGrid, block: Block, true: Block, height: np.ndarray) -> np.ndarray:
    """What the orientations do to heights (rows, cols) m: on a lattice at two levels, between which it is straight in height (a
    wrong camera constant raises roofs more than streets)."""
    row, col = (np.linspace(0, count - 1, NODES) for count in grid.shape)
    x, y = np.meshgrid(grid.west + (col + 0.5) * grid.cell, grid.north - (row + 0.5) * grid.cell)
    at = np.meshgrid(*(np.arange(count) * (NODES - 1) / (count - 1) for count in grid.shape), indexing="ij")
    low, high = (
        map_coordinates(
            datum_heights(block, true, np.column_stack([x.ravel(), y.ravel(), np.full(x.size, level)])).reshape(x.shape),
            at,
            order=1,
            output=np.float32,
        )
        for level in (true.ground_mean, true.ground_mean + LEVELS)
    )
    return np.asarray(low + (high - low) * ((height - true.ground_mean) / np.float32(LEVELS)))


class Found(NamedTuple):
    """The error of a mean height, m, and that of a volume in standard errors."""

    height: float
    ratio: float


@dataclass(frozen=True)
class Kind:
    """Which polygons, against what, and what of the datum is taken out of errors and promises: nothing, the one level of the block
    (a mean over all of it), or all of it in every cell."""

    name: str
    only_measured: bool = True
    border: bool = False
    known: Literal["nothing", "level", "datum"] = "nothing"


def without_level(weights: np.ndarray, datum: np.ndarray, corner: tuple[int, int], lattice: DatumLattice | None) -> float:
    """The datum's share where the mean of its errors over the block is known: what a part errs apart from the whole."""
    nodes = None if lattice is None else lattice.shared(weights, datum, corner)
    if lattice is None or nodes is None:
        return 0.0
    apart = nodes - nodes.mean()
    return math.sqrt(max(float(apart @ lattice.covariance @ apart), 0.0))


def sampled(town: Town, area: float, kind: Kind, correlation: ErrorCorrelation) -> list[Found]:
    """Errors of volumes under COUNT polygons, above a level or above the plane through their border."""
    only_measured, border = kind.only_measured, kind.border
    errors = town.wrong - town.turned if kind.known == "datum" else town.wrong
    if kind.known == "level":
        errors = errors - np.float32(np.nanmean(town.turned))
    rng, grid, found = np.random.default_rng(39), town.grid, []
    radius = math.sqrt(area / math.pi) / grid.cell
    side = 2 * math.ceil(1.2 * radius) + 3
    for tried in range(TRIES):
        if tried > TRIES // 8 and len(found) < COUNT // 40:
            break
        row, col = rng.integers(0, grid.rows - side), rng.integers(0, grid.cols - side)
        ring = star(rng, radius) + side / 2
        window = Window(int(row), int(col), side, side)
        cut, wrong = town.read(window), errors[window.slices]
        # The middle half first, which spares most of the work on places that do not serve.
        middle = slice(side // 4, side - side // 4)
        if not np.isfinite(wrong[middle, middle]).all() or (
            only_measured and not cut.measured[middle, middle].mean() > LEAST_MEASURED
        ):
            continue
        share = inside_share(ring, window.shape)
        inside = share > 0
        if not inside.any() or not np.isfinite(wrong[inside]).all():
            continue
        if only_measured and not cut.measured[inside].mean() > LEAST_MEASURED:
            continue
        weights = volume_weights(share * grid.cell**2, cut.measured, border)
        corner = int(row), int(col)
        error = error_of(weights, SurfacePart(cut.height, cut.relative, cut.datum, cut.measured, corner), correlation)
        volume = float((weights * np.where(inside, wrong, 0.0)).sum())
        shares = {"nothing": error.datum, "datum": 0.0}
        if kind.known == "level":
            shares["level"] = without_level(weights, np.where(inside, cut.datum, 0.0), corner, correlation.datum)
        sigma = math.hypot(error.measured, error.estimated, shares[kind.known])
        found.append(Found(volume / float(share.sum() * grid.cell**2), abs(volume) / sigma))
        if len(found) == COUNT:
            break
    return found


def modes_of(town: Town, lattice: DatumLattice | None) -> str:
    """The largest parts of the datum's error, in what is stated for them."""
    if lattice is None:
        return "The block states no covariances."
    row, col = (a.ravel() for a in np.meshgrid(np.rint(lattice.rows).astype(int), np.rint(lattice.cols).astype(int), indexing="ij"))
    error = town.turned[row, col]
    known = np.isfinite(error)
    values, parts = np.linalg.eigh(lattice.covariance[np.ix_(known, known)])
    found = [
        f"{parts[:, k] @ error[known] / math.sqrt(values[k]):+.1f} of {1000 * math.sqrt(values[k] / known.sum()):.0f} mm"
        for k in np.argsort(-values)[:MODES]
    ]
    return f"The datum's error by modes, in their standard errors (rms over the block): {', '.join(found)}."


def independent(town: Town, area: float) -> int:
    """How many polygons of this area find room beside each other on the ground of a town, COUNT at most."""
    ground = int(np.isfinite(town.wrong).sum()) * town.grid.cell**2
    return min(COUNT, max(1, int(ground / area)))


def row_of(name: str, area: float, room: int, found: list[Found]) -> str:
    """A line of the table; beside each share the range of 95 of 100 such shares of `room` normal errors."""
    if len(found) < COUNT // 4:
        return f"| {name} | {area:g} | {len(found)} | | too few such places | | | |"
    ratios = np.array([one.ratio for one in found])
    rms = 1000 * math.sqrt(float(np.mean([one.height**2 for one in found])))
    shares = " | ".join(
        f"{100 * (ratios <= k).mean():.0f} ({100 * low / room:.0f} to {100 * high / room:.0f})"
        for k in (1, 2)
        for low, high in [binom.interval(0.95, room, math.erf(k / math.sqrt(2)))]
    )
    return f"| {name} | {area:g} | {len(found)} | {room} | {rms:.0f} | {math.sqrt((ratios**2).mean()):.2f} | {shares} |"


_KINDS = (
    Kind("measured, above a level"),
    Kind("measured, above a level, the block's level known", known="level"),
    Kind("measured, above a level, the datum known everywhere", known="datum"),
    Kind("measured, above the border's plane", border=True),
    Kind("measured, above the border's plane, the datum known everywhere", border=True, known="datum"),
    Kind("anywhere, above a level", only_measured=False),
    Kind("anywhere, above a level, the datum known everywhere", only_measured=False, known="datum"),
)
_AS_EVERYBODY = Kind("measured, above the border's plane, cells as if independent", border=True)


def main(words: list[str]) -> None:
    """The page."""
    lines = ["# Volumes against their standard errors", ""]
    most = max((float(word) for word in words if word.isdigit()), default=AREAS[-1])
    for run in [word for word in words if not word.isdigit()] or ["runs/volos"]:
        town = town_of(run)
        known = surface_correlation(town)
        lines += [f"## {Path(run).name}", "", correlation_words(known), "", modes_of(town, known.datum), ""]
        head = ("polygons", "area m2", "number", "independent", "rms mean height error mm", "rms error / sigma")
        lines += [f"| {' | '.join((*head, 'within 1 (%)', 'within 2 (%)'))} |", "| --- " * 8 + "|"]
        for kind in _KINDS:
            for area in (area for area in AREAS if area <= most):
                lines += [row_of(kind.name, area, independent(town, area), sampled(town, area, kind, known))]
        alone = sampled(town, 1000.0, _AS_EVERYBODY, _ALONE)
        lines += [row_of(_AS_EVERYBODY.name, 1000.0, independent(town, 1000.0), alone), ""]
    lines += [
        "Errors of a volume divided by the standard error that is stated for it; of normal errors 68 and 95 % lie within 1 and 2.",
        "Independent: how many polygons of this size find room beside each other; in brackets the range in which 95 of 100 such",
        "shares lie, were errors normal and the stated standard errors true.",
        "Above a level the datum of the one block counts in every row: one draw of its level, leans and bends, not many. The level",
        "of the block, and the datum of every cell, are taken out of errors by the true orientations, and out of promises by the",
        "block's covariances, where they are known. Modes: the datum's error at the places of the lattice by its principal parts,",
        "in standard errors: independent of each other, so a test of as many draws. Anywhere: estimates, walls and trees too.",
    ]
    write_page("volume_errors", words, "\n".join(lines))


if __name__ == "__main__":
    main(sys.argv[1:])
