"""What heights of the volume are worth, from a block's own photographs: two sets that share none of them.

`python -m benchmarks disjoint_halves RUN` parts the photographs of a finished run in turn; names after RUN are the first set, and
all others the second. Each set has a volume of its own, from the coarsest level to the finest, over the part of the block where
neighbours go along least. The sets share the orientation, the terrain of the tie points and the grid; chance makes two independent
searches agree rarely. What both say of a place is compared with their difference; half of the photographs are worth less than all.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import run_folders
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.orientation import BLOCK, Block
from orthomill.schemas.photo import PHOTOS, photo_raster
from orthomill.schemas.raster import Window, tiles_of
from orthomill.schemas.surface import SURFACE
from orthomill.tasks.densification.plan.volume_jobs import TERRAIN, volume_quality
from orthomill.tasks.densification.volume.coherent_levels import standard_errors
from orthomill.tasks.densification.volume.confidence import Confidence, ConfidenceLimits, JudgedTile, JudgedVolume, judged
from orthomill.tasks.densification.volume.levels import SIDE, VolumeScene
from orthomill.tasks.densification.volume.quality import LEVEL_UNIT, Band, Judgement
from orthomill.tasks.densification.volume.terrain import terrain_grid
from orthomill.tasks.densification.volume.volume_tile import SolvedVolume, VolumeTile, solve_volume, volume_tiles
from orthomill.tasks.matching.volume.height_volume import HeightVolume

PART = 2
"""tiles of the volume along the side of the part"""
_AROUND, _RIM = 48, 32
"""cells around the part that are solved on coarser levels, and along its edge that are not judged"""
_FEWEST, _ALONE = 500, 50
"""cells without which nothing is said, and % of the cells around below which a height stands alone"""


@dataclass(frozen=True, eq=False)
class HalfBlock:
    """A set of the photographs of a run: its volume over `part`, with the levels of the whole block."""

    store: Store
    scene: VolumeScene
    whole: VolumeScene
    part: Window
    terrain: np.ndarray

    def judged(self) -> JudgedVolume:
        """The judged cells of the part."""
        solved = self._levels()
        shapes = [level.grid.shape for level in reversed(self.whole.levels)]
        height = np.full(self.part.shape, np.nan, np.float32)
        judgement = np.zeros((*self.part.shape, len(Judgement)), np.uint8)
        confidence = np.full(self.part.shape, Confidence.LOW, np.uint8)
        for tile in tiles_of(shapes[0], SIDE):
            if tile.window.overlap(self.part) != tile.window:
                continue
            judging = JudgedTile.of(tile.window, shapes, self.terrain.shape)
            coarser = list(enumerate(judging.levels.read))[1:]
            found = judged(
                judging,
                ConfidenceLimits(),
                height=solved[0].height[judging.around.slices],
                quality=solved[0].quality[judging.around.slices],
                terrain=self.terrain[judging.places.slices],
                step=self.whole.levels[-1].step,
                coarser_heights=tuple(solved[level].height[window.slices] for level, window in coarser),
                coarser_qualities=tuple(solved[level].quality[window.slices] for level, window in coarser),
            )
            at = tile.window.within(self.part).slices
            height[at], judgement[at], confidence[at] = found
        return JudgedVolume(height, judgement, confidence)

    def _levels(self) -> dict[int, SolvedVolume]:
        """The levels by number, empty beside the part."""
        solved: dict[int, SolvedVolume] = {}
        for level in self.whole.levels:
            near = self.part.reduced(2**level.number).grown(_AROUND if level.number else 0)
            whole = _no_heights(level.grid.shape)
            for tile in volume_tiles(level, self.scene):
                if tile.window.overlap(near).empty or not tile.photos:
                    continue
                found = self._solved(tile, solved)
                whole.height[tile.window.slices], whole.quality[tile.window.slices] = found
            solved[level.number] = whole
        return solved

    def _solved(self, tile: VolumeTile, solved: dict[int, SolvedVolume]) -> SolvedVolume:
        photos = tuple(_bands(self.store.read(photo_raster(part.name, part.level), part.window)) for part in tile.photos)
        coarser = solved[tile.level.number + 1].height[tile.coarser.slices] if tile.coarser else None
        return solve_volume(tile, self.scene.settings, self.scene.block, photos, self.terrain[tile.places.slices], coarser)


def _no_heights(shape: tuple[int, int]) -> SolvedVolume:
    """A level without heights."""
    return SolvedVolume(np.full(shape, np.nan, np.float32), np.zeros((*shape, len(Band)), np.uint8))


def _bands(pixels: np.ndarray) -> np.ndarray:
    return pixels if pixels.ndim == 3 else pixels[..., None]


def halves(run: Path, names: tuple[str, ...] = (), part: Window | None = None) -> tuple[JudgedVolume, JudgedVolume, float]:
    """The two judged volumes, and the step between heights of the finest level, m. names: photographs of the first set; part: whole
    tiles of the volume, by default those that are least coherent."""
    store = Store(run)
    block, photos, surface = store.table(BLOCK), store.table(PHOTOS), store.table(SURFACE)
    whole = VolumeScene(block, photos, surface, HeightVolume())
    first = set(names or block.names[::2])
    grid = terrain_grid(surface.grid)
    terrain = store.read(TERRAIN, Window(0, 0, *grid.shape))
    part = part or _least_coherent(store, surface.grid.shape)
    sets = (
        HalfBlock(store, _scene_of(_only(block, chosen), whole), whole, part, terrain)
        for chosen in (first, set(block.names) - first)
    )
    one, other = (half.judged() for half in sets)
    return one, other, whole.levels[-1].step


def _only(block: Block, names: set[str]) -> Block:
    return block.model_copy(update={"photos": tuple(photo for photo in block.photos if photo.photo in names)})


def _scene_of(block: Block, whole: VolumeScene) -> VolumeScene:
    """The scene of some photographs with the levels of all: their bases alone would ask for other steps."""
    scene = VolumeScene(block, whole.photos, whole.surface, whole.settings)
    scene.__dict__["levels"] = whole.levels
    return scene


def _least_coherent(store: Store, shape: tuple[int, int]) -> Window:
    """The part in which neighbours go along least with the heights of the run."""
    quality = store.read(volume_quality(0), Window(0, 0, *shape))
    rows, cols = shape[0] // SIDE, shape[1] // SIDE
    alone = ((quality[..., Band.SEEN] >= 2) & (quality[..., Band.COHERENCE] < _ALONE))[: rows * SIDE, : cols * SIDE]
    share = alone.reshape(rows, SIDE, cols, SIDE).mean(axis=(1, 3))
    side = min(PART, rows, cols)
    sums = np.lib.stride_tricks.sliding_window_view(share, (side, side)).sum(axis=(2, 3))
    row, col = np.unravel_index(np.argmax(sums), sums.shape)
    return Window(int(row) * SIDE, int(col) * SIDE, side * SIDE, side * SIDE)


def rows(one: JudgedVolume, other: JudgedVolume, step: float) -> Iterator[str]:
    """What both say of a place, and how far they differ."""
    yield "| both say | cells | standard error of one (m) | stated (m) | within 1 / within 2 / beyond 4 of it |"
    yield "| --- | --- | --- | --- | --- |"
    inner = slice(_RIM, -_RIM), slice(_RIM, -_RIM)
    away = np.abs(one.height - other.height)[inner]
    levels = [half.judgement[..., Judgement.LEVEL][inner] / LEVEL_UNIT for half in (one, other)]
    stated = np.hypot(*(standard_errors(level.astype(np.float32), step) for level in levels))
    codes = [half.confidence[inner] for half in (one, other)]
    worse = np.maximum(*levels)
    for code in (Confidence.COARSE, Confidence.CALMED):
        both = np.isfinite(away) & (codes[0] == code) & (codes[1] == code)
        bounds = ((-0.5, 0.5), (0.5, 1.5), (1.5, 2.5), (2.5, 9.0)) if code == Confidence.COARSE else ((-0.5, 99.0),)
        for low, high in bounds:
            here = both & (worse >= low) & (worse < high)
            if here.sum() < _FEWEST:
                continue
            words = f"level {low + 0.5:.0f}" if code == Confidence.COARSE else "no level"
            ratio = away[here] / stated[here]
            shares = " / ".join(f"{100 * share:.1f}" for share in ((ratio < 1).mean(), (ratio < 2).mean(), (ratio > 4).mean()))
            error = 1.4826 * np.median(away[here]) / np.sqrt(2)
            said = np.median(stated[here]) / np.sqrt(2)
            yield f"| {words} | {here.sum()} | {error:.3f} | {said:.3f} | {shares} % |"


def main(words: list[str]) -> None:
    """Write the page, of the finished run that is named first."""
    run, *names = words or [""]
    folder = run_folders([run] if run else [])[0]
    one, other, step = halves(folder, tuple(names))
    about = (__doc__ or "").split("\n\n")[1].replace("\n", " ").strip()
    table = list(rows(one, other, step))
    lines = ["# Disjoint halves", "", about, "", f"{folder.name}: steps of {step:.3f} m at the finest level.", "", *table]
    write_page("disjoint_halves", words, "\n".join([*lines, ""]))
