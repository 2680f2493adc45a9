"""Contours of a simulated town against its true ground: how many vertices lie within their standard errors of the contour's height.

A vertex has the standard error of the terrain in its cell (`terrain.tif`, band 2), and the error that its height has there: the
true ground at the vertex, bilinear, minus the height of its line.
"""

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from benchmarks.instrument.result_page import write_page
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.bare_ground import (
    CONTOUR_SHEET,
    TERRAIN_CODE,
    TERRAIN_CODES,
    TERRAIN_PRECISION,
    TerrainCode,
    terrain_lines_table,
)
from orthomill.schemas.raster import MapGrid, tiles_of
from orthomill.schemas.surface import SURFACE
from orthomill.schemas.truth import TRUTH_GRID, TRUTH_GROUND

_FEWEST = 50
"""vertices of a kind below which nothing is said"""


class Vertices(NamedTuple):
    """Of every vertex (N,): its error and standard error, m, the code of the terrain there, and whether its line is dashed."""

    off: np.ndarray
    sigma: np.ndarray
    code: np.ndarray
    dashed: np.ndarray


def vertices_of(run: Path) -> Vertices:
    """Of the contours of a finished run; those beyond the truth are left out."""
    store = Store(run)
    grid, truth = store.table(SURFACE).grid, store.table(TRUTH_GRID)
    # Truth is known of small scenes, whose terrain is one sheet.
    lines = store.table(terrain_lines_table(next(tiles_of(grid.shape, CONTOUR_SHEET))))
    sigma, code = (_nearest(store, name, grid, lines.x, lines.y) for name in (TERRAIN_PRECISION, TERRAIN_CODE))
    ground = store.read(TRUTH_GROUND, store.spec(TRUTH_GROUND).full).astype(np.float64)
    col, row = truth.pixel(lines.x, lines.y)
    off = lines.height - ndimage.map_coordinates(ground, [row, col], order=1, mode="constant", cval=np.nan)
    known = np.isfinite(off) & np.isfinite(sigma)
    return Vertices(off[known], sigma[known], code[known], lines.dashed[known])


def _nearest(store: Store, name: str, grid: MapGrid, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    values = store.read(name, store.spec(name).full)
    col, row = grid.pixel(x, y)
    rows, cols = (np.clip(np.rint(at).astype(np.int64), 0, side - 1) for at, side in ((row, grid.rows), (col, grid.cols)))
    return values[rows, cols]


def row_of(name: str, run: str, vertices: Vertices, where: np.ndarray) -> str:
    """A line of the table."""
    off, sigma = np.abs(vertices.off[where]), vertices.sigma[where]
    if len(off) < _FEWEST:
        return f"| {run} | {name} | {len(off)} | - | - | - | - |"
    within = [f"{100 * (off <= k * sigma).mean():.1f}" for k in (1, 2, 3)]
    return f"| {run} | {name} | {len(off)} | {np.sqrt((off**2).mean()):.3f} | {' | '.join(within)} |"


def main(words: list[str]) -> None:
    """The page."""
    lines = ["# Contours against the true ground", ""]
    lines += ["| town | vertices | number | rms error m | within 1 (%) | within 2 (%) | within 3 (%) |"]
    lines += ["| --- | --- | --- | --- | --- | --- | --- |"]
    for run in words or ["runs/volos"]:
        name, found = Path(run).name, vertices_of(Path(run))
        lines += [row_of("all", name, found, np.ones(len(found.off), bool))]
        lines += [
            row_of(words, name, found, found.dashed == dashed) for words, dashed in (("solid lines", False), ("dashed", True))
        ]
        lines += [
            row_of(meaning, name, found, found.code == code) for code, _, meaning in TERRAIN_CODES if code != TerrainCode.EMPTY
        ]
    lines += ["", "Standard errors are those of the terrain in the cell of the vertex; to reach: 95 % within two of them."]
    write_page("contour_errors", words, "\n".join(lines))


if __name__ == "__main__":
    main(sys.argv[1:])
