"""One tile of the result: from the nodes of all pairs to correction, precision, corrected surface, codes, coarse blocks and counts.

Strategy. Every pair gives a map of its own, then they are joined. Only heights that were measured can be confirmed or corrected.
Where a height is an estimate, two orthoimages made with it agree or disagree by chance within the small reach of the search: its
corrections are counted apart and appear nowhere else.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import Window
from orthomill.schemas.surface import ESTIMATED, CheckCode
from orthomill.tasks.dsm_check.areas import blocks, slopes
from orthomill.tasks.dsm_check.correction_map import (
    TOGETHER,
    CorrectionMap,
    CorrectionNodes,
    clearly_wrong,
    corrected_heights,
    detectable_error,
    interpolate,
    node_points,
    share_applied,
    without_spikes,
)
from orthomill.tasks.dsm_check.joint_correction import ALONE, NO_BENDS, PairBends, PairGeometry, joint, shared_noise
from orthomill.tasks.dsm_check.nodes import OUTCOME, node_offset
from orthomill.tasks.dsm_check.statistics import TileCounts, count_pair, count_tile
from orthomill.tasks.dsm_check.surfaces.surface_shift import SurfaceTrend


@dataclass(frozen=True)
class NodeWindow:
    """The nodes of one pair that a tile needs. Windows count the nodes of the whole surface."""

    pair: str
    given: Window
    own: Window
    """the nodes in the tile itself; the others are its halo"""
    geometry: PairGeometry = ALONE

    def inner(self, nodes: np.ndarray) -> np.ndarray:
        """The tile's own nodes of the given array."""
        return nodes[self.own.within(self.given).slices]


@dataclass(frozen=True)
class CorrectionRule:
    """How corrections become a surface."""

    apply: Literal["all", "significant", "none"]
    significance: float
    nodes: CorrectionNodes
    block: int
    """cells along a block of the coarse raster"""
    pixel_height: float
    """m: height error that one pixel of shift stands for"""
    cell: float = 1.0
    """m, of the surface"""


class CheckedCells(NamedTuple):
    """A checked tile: dh, its standard error, dh in standard errors, the smallest error that would have been found and the
    corrected height (rows, cols) float32 m, NaN where unknown; uint8 codes of `CheckCode`; `areas.blocks` and `areas.slopes`
    (rows, cols, 5) float32; counts of cells and nodes."""

    dh: np.ndarray
    precision: np.ndarray
    test: np.ndarray
    detectable: np.ndarray
    height: np.ndarray
    code: np.ndarray
    coarse: np.ndarray
    counts: TileCounts


@dataclass(frozen=True)
class JointNodes:
    """What the nodes of all pairs say of a tile: the correction of every cell, cells whose pairs disagree (rows, cols) bool, and
    the nodes of every pair without spikes."""

    found: CorrectionMap
    disputed: np.ndarray
    clean: tuple[np.ndarray, ...]


def take_surface(heights: np.ndarray) -> np.ndarray:
    """The surface under test (rows, cols) float32 m, NaN where it has no height."""
    # infinite values, which some programs write into gaps, would pass every later test for NaN
    return np.where(np.isfinite(heights), heights, np.nan).astype(np.float32)


def correct_tile(
    window: Window,
    pairs: tuple[NodeWindow, ...],
    rule: CorrectionRule,
    heights: np.ndarray,
    nodes: tuple[np.ndarray, ...] = (),
    provenance: np.ndarray | None = None,
    shape: tuple[int, int] | None = None,
    bends: PairBends = NO_BENDS,
) -> CheckedCells:
    """The checked cells of `window`.

    heights: (window.shape) m, of the surface under test. nodes: one array (rows, cols, bands) for each of `pairs`. provenance:
    uint8 (window.shape) codes of the heights; None where all count as measured. shape: of the whole surface; None where the cells
    around the window are not asked. bends: what the cells of a pair have in common.
    """
    # Whether a cell stands alone is seen by the cells around the tile.
    wide = window.grown(TOGETHER - 1).clipped(shape) if shape else window
    says = joint_nodes(wide, pairs, rule.nodes, nodes, bends=bends)
    inside = window.within(wide).slices
    wrong = clearly_wrong(says.found, rule.significance)[inside]
    own = JointNodes(CorrectionMap(says.found.dh[inside], says.found.sigma[inside]), says.disputed[inside], says.clean)
    return answered(window, pairs, rule, heights, own, wrong, provenance)


def answered(
    window: Window,
    pairs: tuple[NodeWindow, ...],
    rule: CorrectionRule,
    heights: np.ndarray,
    says: JointNodes,
    wrong: np.ndarray,
    provenance: np.ndarray | None = None,
) -> CheckedCells:
    """The checked cells of `window` from what all pairs say; wrong: cells (bool) whose height is wrong beyond doubt; other
    arguments as in `correct_tile`."""
    estimated = np.isin(np.zeros(window.shape, np.uint8) if provenance is None else provenance, ESTIMATED)
    correction = CorrectionMap(*(np.where(estimated, np.float32(np.nan), band) for band in (says.found.dh, says.found.sigma)))
    share = share_applied(correction, rule.apply, rule.significance)
    # own nodes only: those of the halo are counted by the tiles to which they belong
    counted = tuple(
        count_pair(pair.pair, pair.inner(one)[_of_nodes(~estimated, pair, window, rule.nodes)], rule.pixel_height)
        for one, pair in zip(says.clean, pairs, strict=True)
    )
    bands = blocks(correction.dh, correction.sigma, rule.block), slopes(heights, correction.dh, rule.block, rule.cell)
    shown = cells_of_nodes(window, pairs, rule.nodes.step, says.clean, (Outcome.NOT_TRIED, Outcome.OUTSIDE))
    counts = count_tile(heights, says.found, share, estimated, counted, rule.pixel_height, rule.cell)
    return CheckedCells(
        dh=correction.dh,
        precision=correction.sigma,
        test=(correction.dh / correction.sigma).astype(np.float32),
        detectable=detectable_error(correction.sigma, rule.significance),
        height=corrected_heights(heights, correction, share),
        code=cell_codes(heights, correction, share, Conditions(wrong, estimated, says.disputed)),
        coarse=np.concatenate(bands, axis=-1),
        counts=counts.model_copy(update={"shown": int((shown & np.isfinite(heights) & ~estimated).sum())}),
    )


def joint_nodes(
    window: Window,
    pairs: tuple[NodeWindow, ...],
    grid: CorrectionNodes,
    nodes: tuple[np.ndarray, ...],
    trend: SurfaceTrend | None = None,
    bends: PairBends = NO_BENDS,
) -> JointNodes:
    """What all pairs together say of the cells of `window`; nodes: one array (rows, cols, bands) for each of `pairs`; trend: what
    is no error of single cells; bends: standard errors that the cells of a pair share."""
    clean = tuple(without_spikes(one) for one in nodes)
    points = [node_points(one, (pair.given.row, pair.given.col), grid) for one, pair in zip(clean, pairs, strict=True)]
    maps = [interpolate(of_pair, window, grid) for of_pair in points]
    bent = bends.of([pair.pair for pair in pairs])
    found, disputed = joint(maps, window.shape, shared_noise([pair.geometry for pair in pairs]), bent)
    if trend is not None:
        found = CorrectionMap(found.dh - trend.at(window), found.sigma)
    return JointNodes(found, disputed, clean)


def blocks_of_nodes(
    window: Window,
    pairs: tuple[NodeWindow, ...],
    grid: CorrectionNodes,
    size: int,
    heights: np.ndarray,
    nodes: tuple[np.ndarray, ...] = (),
    bends: PairBends = NO_BENDS,
) -> np.ndarray:
    """`areas.blocks` (rows, cols, 3) of `size` cells of what all pairs say of the surface with these heights (window.shape) m."""
    found = joint_nodes(window, pairs, grid, nodes, bends=bends).found
    dh, sigma = (np.where(np.isfinite(heights), band, np.float32(np.nan)) for band in (found.dh, found.sigma))
    return blocks(dh, sigma, size)


@dataclass(frozen=True)
class Conditions:
    """What else is known of the cells of a tile, (rows, cols) bool: their height is wrong beyond doubt; it is an estimate; their
    pairs disagree."""

    wrong: np.ndarray
    estimated: np.ndarray
    disputed: np.ndarray


def cell_codes(heights: np.ndarray, correction: CorrectionMap, share: np.ndarray, conditions: Conditions) -> np.ndarray:
    """uint8 (rows, cols) `CheckCode` of the cells of a tile."""
    # The later condition wins: what is not judged cannot be wrong, what has no height cannot be judged.
    cases = (
        (np.isfinite(correction.dh), CheckCode.AGREES),
        (conditions.wrong, CheckCode.WRONG),
        (conditions.wrong & (share > 0), CheckCode.CORRECTED),
        (conditions.disputed, CheckCode.DISPUTED),
        (np.isnan(correction.dh), CheckCode.NOT_JUDGED),
        (conditions.estimated, CheckCode.ESTIMATE),
        (np.isnan(heights), CheckCode.EMPTY),
    )
    codes = np.zeros(heights.shape, np.uint8)
    for cells, code in cases:
        codes[cells] = code
    return codes


def _of_nodes(cells: np.ndarray, pair: NodeWindow, window: Window, nodes: CorrectionNodes) -> np.ndarray:
    """What holds (bool) in the cells of `window` under a pair's own nodes."""
    within = round(node_offset(nodes.step, nodes.pixels_per_cell))
    rows, cols = (
        (first + np.arange(count)) * nodes.step + within - corner
        for first, count, corner in ((pair.own.row, pair.own.height, window.row), (pair.own.col, pair.own.width, window.col))
    )
    # A node of the last, incomplete step may lie beyond the surface.
    return cells[np.ix_(np.minimum(rows, window.height - 1), np.minimum(cols, window.width - 1))]


def cells_of_nodes(
    window: Window, pairs: tuple[NodeWindow, ...], step: int, nodes: tuple[np.ndarray, ...], without: tuple[Outcome, ...]
) -> np.ndarray:
    """Cells (bool) of `window` around nodes of any pair that had another outcome than those."""
    found = np.zeros(window.shape, np.bool_)
    for pair, one in zip(pairs, nodes, strict=True):
        codes = np.nan_to_num(pair.inner(one)[..., OUTCOME])
        cells = np.repeat(np.repeat(~np.isin(codes, without), step, 0), step, 1)
        row, col = pair.own.row * step - window.row, pair.own.col * step - window.col
        part = found[row : row + cells.shape[0], col : col + cells.shape[1]]
        part |= cells[: part.shape[0], : part.shape[1]]
    return found
