"""Ground on which ways to heights are compared: parts of finished runs, what is known of them, and coarse models of them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import map_coordinates

from benchmarks.compare.replayed_crop import Crop
from orthomill.schemas.job import Table
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import HEIGHT, PROVENANCE, SURFACE, Provenance
from orthomill.schemas.truth import TRUTH_MATERIAL, TRUTH_SURFACE, TRUTH_VISIBILITY
from orthomill.tasks.evaluation.classes import PlaceClass, place_classes
from orthomill.tasks.imagery.pull_push import filled

_POSTS, _NOISE = 30.0, 2.0
"""m: between the posts of a coarse height model; their standard error"""


@dataclass(frozen=True, eq=False)
class Known:
    """What is known of the cells of a part (rows, cols): heights m, NaN where unknown; classes; whether two photographs see it."""

    height: np.ndarray
    classes: np.ndarray
    seen: np.ndarray


@dataclass(frozen=True, eq=False)
class Scene:
    """A part of a run, what is known of it, the departure that counts as gross, m, and a coarse height model of it: its posts and
    their heights, m."""

    name: str
    crop: Crop
    known: Known
    gross: float
    model: tuple[MapGrid, np.ndarray]


def town(run: Path, centre: tuple[float, float] = (0.5, 0.5)) -> Scene:
    """A part of a simulated town, by default its centre."""
    crop = Crop.of(run, centre, 220.0)
    grid, store = crop.surface.grid, crop.store
    truth = store.table(Table("truth/grid.json", MapGrid))
    col, row = truth.pixel(*np.meshgrid(*grid.centres(Window(0, 0, *grid.shape))))
    part = Window(int(row.min()) - 2, int(col.min()) - 2, int(np.ptp(row)) + 6, int(np.ptp(col)) + 6).clipped(truth.shape)
    at = np.rint(row - part.row).astype(int), np.rint(col - part.col).astype(int)
    heights = map_coordinates(store.read(TRUTH_SURFACE, part), [row - part.row, col - part.col], order=1)
    seen = np.bitwise_count(store.read(TRUTH_VISIBILITY, part))[at] >= 2
    return Scene(
        "simulated town", crop, Known(heights, place_classes(store.read(TRUTH_MATERIAL, part)[at]), seen), 1.0, coarse_model(crop)
    )


def shore(run: Path) -> Scene:
    """Open ground of the real drone block, which has no truth."""
    crop = Crop.of(run, (0.5, 0.42), 11.0)
    heights, codes = (crop.store.read(name, crop.window) for name in (HEIGHT, PROVENANCE))
    agreed = codes == Provenance.AGREED
    classes = np.where(agreed, PlaceClass.CLEAR_GROUND, PlaceClass.UNKNOWN)
    return Scene(
        "real shore", crop, Known(np.where(agreed, heights, np.nan), classes, np.isfinite(heights)), 0.25, coarse_model(crop)
    )


def coarse_model(crop: Crop) -> tuple[MapGrid, np.ndarray]:
    """The heights of a run at posts `_POSTS` m apart, or as many cells as a part of such a model holds, with noise.

    On a small block both are reduced alike, to a ninth of its width at most.
    """
    grid = crop.store.table(SURFACE).grid
    scale = min(1.0, grid.cols * grid.cell / 9 / _POSTS)
    every = max(1, round(_POSTS * scale / grid.cell))
    heights = crop.store.read(HEIGHT, Window(0, 0, *grid.shape))[every // 2 :: every, every // 2 :: every]
    noise = np.random.default_rng(1).normal(0, _NOISE * scale, heights.shape)
    posts = MapGrid(west=grid.west, north=grid.north, cell=grid.cell * every, rows=heights.shape[0], cols=heights.shape[1])
    return posts, (filled(heights) + noise).astype(np.float32)


def exact_model(grid: MapGrid, heights: np.ndarray) -> tuple[MapGrid, np.ndarray]:
    """Posts of known heights (rows, cols) m of the cells of `grid`, with noise."""
    every = round(_POSTS / grid.cell)
    posts = heights[every // 2 :: every, every // 2 :: every]
    places = MapGrid(west=grid.west, north=grid.north, cell=grid.cell * every, rows=posts.shape[0], cols=posts.shape[1])
    return places, (posts + np.random.default_rng(1).normal(0, _NOISE, posts.shape)).astype(np.float32)
