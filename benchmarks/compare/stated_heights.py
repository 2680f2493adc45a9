"""What stated standard errors of heights are worth, by code and class, on finished runs of simulated scenes.

`python -m benchmarks stated_heights RUN...` makes the surface of finished runs again, from their stored volumes and nodes, with the
code of today, on every other tile; nothing is matched again. Heights are compared with the truth without the datum of the block, a
surface of second degree through open measured ground. In crowns a height may be that of the ground below: both are visible there.
Codes and classes of fewer cells than two thousand are left out.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import run_folders
from orthomill.pipeline.storage.store import Store
from orthomill.schemas import truth
from orthomill.schemas.epipolar import PAIRS
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.raster import Window, tiles_of
from orthomill.schemas.surface import MEASURED, SURFACE, Provenance
from orthomill.tasks.densification.difference_square import REACH, square_differences
from orthomill.tasks.densification.plan.densification_jobs import surface_rules
from orthomill.tasks.densification.plan.difference_jobs import squares
from orthomill.tasks.densification.plan.pair_jobs import nodes_raster
from orthomill.tasks.densification.plan.surface_jobs import SurfaceSource, pieces_of, surface_tile
from orthomill.tasks.densification.plan.volume_jobs import CONFIDENCE, JUDGED_HEIGHT, JUDGEMENT
from orthomill.tasks.densification.precision.pair_differences import MatchingDifferences, sum_differences
from orthomill.tasks.densification.stage import DensificationStage, ObjectSpace
from orthomill.tasks.densification.surface_tile import SurfaceCells, make_surface
from orthomill.tasks.densification.volume.levels import VolumeScene
from orthomill.tasks.evaluation.classes import place_classes
from orthomill.tasks.evaluation.grids import codes_on, heights_on, placement

_TILE = 512
_FEWEST = 2000
_CODES = {
    Provenance.ONE_PAIR: "one pair",
    Provenance.AGREED: "agreed",
    Provenance.VOLUME: "volume",
    Provenance.COARSE: "less sharply",
    Provenance.INCOHERENT: "incoherent",
    Provenance.INTERPOLATED: "interpolated",
}
_CLASSES = {"open": (1, 2), "beside buildings": (3,), "roofs": (4, 5), "trees": (6,)}
_OPEN = (1, 2)
_TREE = 6


@dataclass(frozen=True, eq=False)
class StatedHeights:
    """Judged cells (N,): departure from the truth (m), the stated standard error among neighbours (m), code and class."""

    off: np.ndarray
    stated: np.ndarray
    code: np.ndarray
    kind: np.ndarray


@dataclass(frozen=True, eq=False)
class Remade:
    """A finished run whose surface is made again."""

    store: Store
    source: SurfaceSource
    stage: DensificationStage

    @classmethod
    def of(cls, run: Path) -> "Remade":
        """The run of a project with the default way to heights."""
        store, stage = Store(run), DensificationStage()
        assert isinstance(stage.matching, ObjectSpace)
        scene = VolumeScene(store.table(BLOCK), store.table(PHOTOS), store.table(SURFACE), stage.matching.volume)
        volume = {"height": JUDGED_HEIGHT, "judgement": JUDGEMENT, "confidence": CONFIDENCE}
        step, ground = scene.levels[-1].step, scene.block.ground_mean
        return cls(store, SurfaceSource(make_surface, volume, scene.surface, ground, step, stage.matching.pairs.step), stage)

    def differences(self) -> MatchingDifferences:
        """What pairs without a common photograph say."""
        places = squares(self.source.surface.grid.shape)
        return sum_differences(tuple(self._made(square_differences, window, REACH) for window in places))

    def surface(self, window: Window, differences: MatchingDifferences) -> SurfaceCells:
        """A tile."""
        return self._made(make_surface, window, surface_rules(self.stage).halo, differences=differences)

    def _made(self, function: Callable[..., Any], window: Window, halo: int, **more: MatchingDifferences) -> Any:
        shape = self.source.surface.grid.shape
        around = window.grown(halo)
        work, pieces = around.clipped(shape), pieces_of(self.source, self.store.table(PAIRS).pairs, around)
        volume = {key: self.store.read(name, work) for key, name in self.source.rasters.items()}
        nodes = (self.store.read(nodes_raster(piece.pair.name), piece.nodes) for piece in pieces)
        tile = surface_tile(self.source, window, work, pieces)
        return function(tile=tile, rules=surface_rules(self.stage), nodes=nodes, **volume, **more)


def stated_heights(run: Path) -> tuple[StatedHeights, MatchingDifferences]:
    """Of every other tile of a run."""
    made = Remade.of(run)
    differences, grid = made.differences(), made.source.surface.grid
    parts = []
    for tile in tiles_of(grid.shape, _TILE):
        if (tile.row + tile.col) % 2 == 0:
            parts.append(_judged(made.store, made.surface(tile.window, differences), made, tile.window))
    rows, cols, off, below, stated, code, kind = (np.concatenate(part) for part in zip(*parts, strict=True))
    datum = _datum(rows / grid.rows, cols / grid.cols, off, np.isin(code, MEASURED) & np.isin(kind, _OPEN))
    off = np.abs(off - datum)
    off = np.where(kind == _TREE, np.fmin(off, np.abs(below - datum)), off)
    return StatedHeights(off, stated, code, kind), differences


def _judged(store: Store, cells: SurfaceCells, made: Remade, window: Window) -> tuple[np.ndarray, ...]:
    """Of the cells that two photographs truly see: row, column, departure from the surface and from the ground, stated error, code,
    class."""
    place = placement(made.source.surface.grid, window, store.table(truth.TRUTH_GRID))
    read = [store.read(name, place.source_window) for name in (truth.TRUTH_SURFACE, truth.TRUTH_GROUND)]
    surface, ground = (heights_on(heights, place) for heights in read)
    photographs = codes_on(store.read(truth.TRUTH_VISIBILITY, place.source_window), place)
    kind = place_classes(codes_on(store.read(truth.TRUTH_MATERIAL, place.source_window), place))
    counted = np.where(photographs == np.uint32(2**32 - 1), 0, photographs).astype(np.uint32)
    seen = (np.bitwise_count(counted) >= 2) & np.isfinite(cells.height - surface)
    rows, cols = (at + first for at, first in zip(np.indices(window.shape), (window.row, window.col), strict=True))
    values = rows, cols, cells.height - surface, cells.height - ground, cells.relative, cells.provenance, kind
    return tuple(value[seen] for value in values)


def _datum(row: np.ndarray, col: np.ndarray, off: np.ndarray, known: np.ndarray) -> np.ndarray:
    """A surface of second degree through the departures of known cells, robustly; row, col: shares of the grid."""
    x, y = 2 * col - 1, 2 * row - 1
    design = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    basis, value, weight = design[known][::7], off[known][::7], 1.0
    for _ in range(6):
        root = np.sqrt(np.broadcast_to(weight, value.shape))
        plane = np.linalg.lstsq(basis * root[:, None], value * root, rcond=None)[0]
        left = value - basis @ plane
        weight = 1 / (1 + (left / (2 * 1.4826 * np.median(np.abs(left)))) ** 2)
    return np.asarray(design @ plane)


def rows(heights: StatedHeights) -> Iterator[str]:
    """The table of a run."""
    yield "| code | class | cells | 68 % of the errors below (m) | stated (m) | within 1 / within 2 / beyond 4 of it |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for code, word in _CODES.items():
        for name, kinds in _CLASSES.items():
            here = (heights.code == code) & np.isin(heights.kind, kinds)
            if here.sum() < _FEWEST:
                continue
            off, ratio = heights.off[here], heights.off[here] / heights.stated[here]
            shares = " / ".join(f"{100 * share:.1f}" for share in ((ratio < 1).mean(), (ratio < 2).mean(), (ratio > 4).mean()))
            stated = np.median(heights.stated[here])
            yield f"| {word} | {name} | {here.sum()} | {np.quantile(off, 0.683):.3f} | {stated:.3f} | {shares} % |"


def main(words: list[str]) -> None:
    """Write the page of the finished runs that are named."""
    about = (__doc__ or "").split("\n\n", 1)[1].replace("\n", " ").strip()
    lines = ["# Stated standard errors of heights", "", about, ""]
    for run in run_folders(words):
        heights, differences = stated_heights(run)
        lines += [f"## {run.name}", "", f"{differences.cells} cells on which pairs without a common photograph were compared.", ""]
        lines += [*rows(heights), ""]
    write_page("stated_heights", words, "\n".join(lines))
