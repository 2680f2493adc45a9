"""What is known of the surface after each pass, and where the next one looks again.

Strategy. A pass leaves three rasters: the heights, what the photographs still ask for, and its standard error. The next pass judges
again the blocks of cells that were changed, and those around them whose windows saw the change; all others keep what is known of
them. Blocks lie on the grid of the surface, so that every tiling looks at the same cells.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict
from scipy.ndimage import binary_dilation

from orthomill.schemas.job import Table
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import Window, tiles_of
from orthomill.schemas.surface import ESTIMATED, CheckCode
from orthomill.tasks.dsm_check.correction_map import CorrectionMap, CorrectionNodes, corrected_heights, share_applied
from orthomill.tasks.dsm_check.joint_correction import NO_BENDS, PairBends
from orthomill.tasks.dsm_check.rounds.second_look import Look, better_of
from orthomill.tasks.dsm_check.statistics import TileCounts
from orthomill.tasks.dsm_check.surfaces.surface_shift import SurfaceTrend
from orthomill.tasks.dsm_check.tile import CorrectionRule, JointNodes, NodeWindow, answered, cells_of_nodes, joint_nodes


class RoundCounts(BaseModel):
    """One tile in one pass: cells judged, cells changed, and the sums of their changes and of the squares (m)."""

    model_config = ConfigDict(frozen=True)

    judged: int = 0
    changed: int = 0
    total: float = 0.0
    squares: float = 0.0


class RoundState(BaseModel):
    """After a pass: what it did, and the tiles (row, col) that the next pass judges, of which it needs nodes and orthoimages."""

    model_config = ConfigDict(frozen=True)

    counts: RoundCounts
    judged: tuple[tuple[int, int], ...] = ()
    nodes: tuple[tuple[int, int], ...] = ()
    orthoimages: tuple[tuple[int, int], ...] = ()


def state_table(number: int) -> Table[RoundState]:
    """The state after pass `number`."""
    return Table(f"dsm_check/rounds/{number}.json", RoundState)


@dataclass(frozen=True)
class LookAgain:
    """Where the next pass looks: side of a block and of a tile, shape of the surface (cells); cells around a change that are judged
    again, around a tile whose nodes it needs, and around those whose orthoimages they need."""

    block: int
    tile: int
    shape: tuple[int, int]
    around: int
    nodes: int
    seen: int
    everywhere: bool = False
    """whether all blocks are looked at again as long as any changes"""


class FirstJudged(NamedTuple):
    """A tile after the first pass: heights, what is still asked for and its standard error (m), pairs that disagree, changed cells
    by block (uint16), round of the last change, counts of the pass, and of cells and nodes."""

    height: np.ndarray
    residual: np.ndarray
    precision: np.ndarray
    disputed: np.ndarray
    asks: np.ndarray
    last: np.ndarray
    changes: RoundCounts
    counts: TileCounts


class LookedAgain(NamedTuple):
    """Active blocks (uint8), and the state."""

    active: np.ndarray
    state: RoundState


class CorrectedAgain(NamedTuple):
    """dh and its standard error (m) of a small tile, NaN where it was not looked at."""

    dh: np.ndarray
    precision: np.ndarray


class MergedCells(NamedTuple):
    """A tile after a later pass: as `FirstJudged`."""

    height: np.ndarray
    residual: np.ndarray
    precision: np.ndarray
    asks: np.ndarray
    last: np.ndarray
    changes: RoundCounts


def look_again(asks: np.ndarray, counts: tuple[RoundCounts, ...], where: LookAgain) -> LookedAgain:
    """Where the next pass looks, from the changed cells per block (rows, cols) of the whole surface."""
    summed = RoundCounts(
        judged=sum(c.judged for c in counts),
        changed=sum(c.changed for c in counts),
        total=float(sum(c.total for c in counts)),
        squares=float(sum(c.squares for c in counts)),
    )
    # A single cell is an error of interpolation at the border of what was judged.
    changed = asks >= where.block
    active = _grown(changed, where.around, where.block)
    if where.everywhere and changed.any():
        active = np.ones_like(changed)
    judged = _tiles(active, where)
    nodes = _tiles(_grown(_blocks_of(judged, active.shape, where), where.nodes, where.block), where)
    seen = _tiles(_grown(_blocks_of(nodes, active.shape, where), where.seen, where.block), where)
    state = RoundState(counts=summed, judged=judged, nodes=nodes, orthoimages=seen)
    return LookedAgain(active.astype(np.uint8), state)


def _grown(mask: np.ndarray, cells: int, block: int) -> np.ndarray:
    size = 2 * -(-cells // block) + 1
    return np.asarray(binary_dilation(mask, np.ones((size, size)))) if mask.any() else mask


def _tiles(active: np.ndarray, where: LookAgain) -> tuple[tuple[int, int], ...]:
    """The tiles with an active block."""
    side = where.tile // where.block
    tiles = tiles_of(active.shape, side)
    return tuple((tile.row, tile.col) for tile in tiles if active[tile.window.slices].any())


def _blocks_of(tiles: tuple[tuple[int, int], ...], shape: tuple[int, ...], where: LookAgain) -> np.ndarray:
    side, mask = where.tile // where.block, np.zeros(shape, np.bool_)
    for row, col in tiles:
        mask[row * side : (row + 1) * side, col * side : (col + 1) * side] = True
    return mask


def judge_again(
    window: Window,
    pairs: tuple[NodeWindow, ...],
    grid: CorrectionNodes,
    active: np.ndarray,
    block: int,
    nodes: tuple[np.ndarray, ...] = (),
    trend: SurfaceTrend | None = None,
    bends: PairBends = NO_BENDS,
) -> CorrectedAgain:
    """What a later pass says of a small tile; active: (rows, cols) uint8 of its blocks; trend and bends as in `joint_nodes`."""
    found = joint_nodes(window, pairs, grid, nodes, trend, bends).found
    looked = _cells(active, block, window.shape)
    return CorrectedAgain(*(np.where(looked, band, np.float32(np.nan)) for band in (found.dh, found.sigma)))


def _cells(blocks: np.ndarray, block: int, shape: tuple[int, int]) -> np.ndarray:
    """Blocks (rows, cols) as cells, bool."""
    return np.repeat(np.repeat(blocks > 0, block, 0), block, 1)[: shape[0], : shape[1]]


@dataclass(frozen=True)
class MergeRule:
    """How what a pass says is taken over: which corrections are applied, side of a block, number of the pass."""

    apply: Literal["all", "significant", "none"]
    significance: float
    block: int
    number: int
    least: float
    """m: smaller changes ask for no other look"""
    precise: float
    """m: standard error that a cell must reach which no earlier round could judge"""


def merge(
    window: Window,
    parts: tuple[Window, ...],
    rule: MergeRule,
    heights: np.ndarray,
    residual: np.ndarray,
    precision: np.ndarray,
    last: np.ndarray,
    dh: tuple[np.ndarray, ...] = (),
    sigma: tuple[np.ndarray, ...] = (),
    provenance: np.ndarray | None = None,
) -> MergedCells:
    """The tile `window` after a later pass, which looked at `parts` of it (windows of the whole surface) and found `dh` and `sigma`
    there."""
    asked, error = np.full(window.shape, np.nan, np.float32), np.full(window.shape, np.nan, np.float32)
    for part, one, other in zip(parts, dh, sigma, strict=True):
        place = part.within(window).slices
        asked[place], error[place] = one, other
    if provenance is not None:
        asked[np.isin(provenance, ESTIMATED)] = np.nan
    asked[np.isnan(heights)] = np.nan
    # Closer windows judge cells that earlier ones could not: beside ground that nobody judged they straddle a step which the rounds
    # made themselves, and that shows in their precision.
    with np.errstate(invalid="ignore"):
        asked[np.isnan(residual) & (error > rule.precise)] = np.nan
    found = CorrectionMap(asked, error)
    share = share_applied(found, rule.apply, rule.significance)
    # The smaller windows of a closer look are less precise: where they ask for nothing and agree with the wider ones, those count.
    with np.errstate(invalid="ignore"):
        alike = np.abs(asked - residual) <= _ALIKE * np.hypot(error, precision)
        asked[alike & (share == 0) & (precision <= error)] = np.nan
    change = np.where(share > 0, share * np.nan_to_num(asked), np.float32(0.0))
    known = np.isfinite(asked)
    return MergedCells(
        height=corrected_heights(heights, found, share),
        residual=np.where(known, asked - change, residual).astype(np.float32),
        precision=np.where(known, error, precision).astype(np.float32),
        asks=by_block(np.abs(change) > rule.least, rule.block),
        last=np.where(change != 0, np.uint8(rule.number), last),
        changes=round_counts(known, change),
    )


def least_change(pixel_height: float) -> float:
    """m: changes below it ask for no other look."""
    # A quarter of a pixel: windows that fit so well show nothing that they did not show before.
    return 0.25 * pixel_height


def precise_enough(pixel_height: float) -> float:
    """m: standard error that a cell must reach which no earlier round could judge."""
    return 0.1 * pixel_height


_ALIKE = 2.0
"""standard errors of a difference"""
_SUSPECTED = 0.6
"""of the significance: corrections that are looked at more closely"""
_HOPELESS = (Outcome.NOT_TRIED, Outcome.OUTSIDE, Outcome.OCCLUDED, Outcome.CONVERGED)
"""outcomes of nodes that a closer look would not change"""


def by_block(cells: np.ndarray, block: int) -> np.ndarray:
    """uint16 (rows, cols): how many cells of each block are true."""
    rows, cols = (-(-side // block) for side in cells.shape)
    padded = np.pad(cells, ((0, rows * block - cells.shape[0]), (0, cols * block - cells.shape[1])))
    return padded.reshape(rows, block, cols, block).sum(axis=(1, 3)).astype(np.uint16)


def round_counts(known: np.ndarray, change: np.ndarray) -> RoundCounts:
    """Counts of a tile from judged cells (bool) and the changes of heights (m)."""
    moved = change[change != 0].astype(np.float64)
    return RoundCounts(
        judged=int(known.sum()), changed=len(moved), total=float(np.abs(moved).sum()), squares=float((moved**2).sum())
    )


def judge(
    *,
    window: Window,
    pairs: tuple[NodeWindow, ...],
    rule: CorrectionRule,
    heights: np.ndarray,
    nodes: tuple[np.ndarray, ...] = (),
    provenance: np.ndarray | None = None,
    second: np.ndarray | None = None,
    second_nodes: tuple[np.ndarray, ...] = (),
    wide: Window | None = None,
    trend: SurfaceTrend | None = None,
    bends: PairBends = NO_BENDS,
) -> FirstJudged:
    """The first pass over a tile of the surface, and over the second one where there is one; arguments as in `correct_tile`. With a
    second surface, it and the heights are given in `wide`, two cells more to every side."""
    undecided = np.zeros(window.shape, np.bool_)
    if second is None or wide is None:
        says = joint_nodes(window, pairs, rule.nodes, nodes, trend, bends)
    else:
        says, heights, undecided = _two_looks(window, wide, pairs, rule, (heights, second), (nodes, second_nodes), trend, bends)
    # What is wrong beyond doubt is told at the end, of the sum of all passes.
    cells = answered(window, pairs, rule, heights, says, np.zeros(window.shape, np.bool_), provenance)
    change = np.nan_to_num(cells.height - heights)
    # What two photographs see and windows of this size do not understand may be a narrow error: it is looked at more closely.
    failed = cells_of_nodes(window, pairs, rule.nodes.step, nodes, _HOPELESS) & np.isnan(cells.dh) & np.isfinite(heights)
    # Of an error narrower than its windows a pass sees a part, which may be no more than a suspicion.
    with np.errstate(invalid="ignore"):
        suspected = (np.abs(cells.test) > _SUSPECTED * rule.significance) | undecided
    return FirstJudged(
        height=cells.height,
        residual=(cells.dh - change).astype(np.float32),
        precision=cells.precision,
        disputed=(cells.code == CheckCode.DISPUTED).astype(np.uint8),
        asks=by_block((np.abs(change) > least_change(rule.pixel_height)) | failed | suspected, rule.block),
        last=(change != 0).astype(np.uint8),
        changes=round_counts(np.isfinite(cells.dh), change),
        counts=cells.counts,
    )


def _two_looks(
    window: Window,
    wide: Window,
    pairs: tuple[NodeWindow, ...],
    rule: CorrectionRule,
    heights: tuple[np.ndarray, np.ndarray],
    nodes: tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]],
    trend: SurfaceTrend | None,
    bends: PairBends,
) -> tuple[JointNodes, np.ndarray, np.ndarray]:
    """What both surfaces say of `window`, its heights, and cells (bool) of which they say different things; heights and nodes: of
    the surface under test and of the second one."""
    looks = [Look(h, joint_nodes(wide, pairs, rule.nodes, n, trend, bends), n) for h, n in zip(heights, nodes, strict=True)]
    both = better_of(looks[0], looks[1], wide, pairs, rule.nodes, rule.significance)
    inside = window.within(wide).slices
    own = CorrectionMap(both.found.dh[inside], both.found.sigma[inside])
    return JointNodes(own, both.disputed[inside], looks[0].says.clean), heights[0][inside], both.undecided[inside]
