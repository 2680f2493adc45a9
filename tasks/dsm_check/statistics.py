"""The check in numbers: counts and histograms per tile that add up to the statistics of the whole surface.

Strategy. Medians cannot be added, histograms can: corrections are counted in bins of a two-hundredth of the height that one pixel
of shift stands for, so that median and NMAD of any number of tiles are known to within a bin.
"""

from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.outcome import Outcome
from orthomill.tasks.dsm_check.correction_map import CorrectionMap
from orthomill.tasks.dsm_check.nodes import DH, OUTCOME, SIGMA

BINS_PER_PIXEL = 200
_LAST_BIN = 100 * BINS_PER_PIXEL
"""Corrections of more than a hundred pixels share the outermost bins: no search reaches that far."""


class Counts(BaseModel):
    """Sums over corrections: number, sum and sum of squares (m), number within 1 and 3 of their sigma, occupied bins."""

    model_config = ConfigDict(frozen=True)

    number: int = 0
    total: float = 0.0
    squares: float = 0.0
    within_1: int = 0
    within_3: int = 0
    bins: tuple[int, ...] = ()
    """numbers of the bins that are not empty"""
    filled: tuple[int, ...] = ()
    """number of corrections in each of them"""


class PairCounts(BaseModel):
    """The nodes of one pair in one tile: their outcomes, and the accepted corrections."""

    model_config = ConfigDict(frozen=True)

    pair: str
    outcomes: tuple[int, ...]
    """by code of `Outcome`"""
    dh: Counts


class TileCounts(BaseModel):
    """One tile: its cells and its nodes."""

    model_config = ConfigDict(frozen=True)

    heights: int
    """cells with a measured height"""
    checked: int
    """of these, cells with a correction"""
    changed: int
    """cells whose height was changed"""
    dh: Counts
    pairs: tuple[PairCounts, ...]
    estimates: int = 0
    """cells with an estimated height; they are never changed"""
    dh_estimates: Counts = Counts()
    """what the comparison says where heights are estimated"""
    beyond: int = 0
    """cells with a large error that only coarse orthoimages saw"""
    shown: int = 0
    """measured cells that both photographs of a pair show"""
    relief: tuple[tuple[int, int], ...] = ()
    """(measured cells, checked ones) by class of `RELIEF`"""


RELIEF = ("level or gently sloping", "steep", "steps: walls, crowns, edges")
"""classes of the surface by the slope across four cells"""
_SLOPES = (0.5, 1.5)
"""limits of the classes"""
_ACROSS = 4
"""cells; every tile begins at a multiple"""


@dataclass(frozen=True)
class Summary:
    """Statistics of many corrections, m; NaN without any."""

    number: int
    mean: float
    std: float
    median: float
    nmad: float
    within_1: float
    within_3: float
    """shares of all, 0 to 1"""


def count(dh: np.ndarray, sigma: np.ndarray, pixel_height: float) -> Counts:
    """Counts of corrections dh (any shape) m with their sigma; NaN is left out."""
    # float64 before summing: the sum of float32 squares of a million cells loses the small ones
    known = np.isfinite(dh)
    dh, sigma = dh[known].astype(np.float64), sigma[known]
    bins, filled = np.unique(np.clip(np.rint(dh / bin_width(pixel_height)), -_LAST_BIN, _LAST_BIN).astype(int), return_counts=True)
    return Counts(
        number=len(dh),
        total=float(dh.sum()),
        squares=float((dh**2).sum()),
        within_1=int((np.abs(dh) <= sigma).sum()),
        within_3=int((np.abs(dh) <= 3 * sigma).sum()),
        bins=tuple(bins.tolist()),
        filled=tuple(filled.tolist()),
    )


def bin_width(pixel_height: float) -> float:
    """Width of a bin, m."""
    return pixel_height / BINS_PER_PIXEL


def count_pair(name: str, nodes: np.ndarray, pixel_height: float) -> PairCounts:
    """Counts of the nodes (..., bands) of one pair."""
    # NaN is what the store holds of nodes that no job wrote: NOT_TRIED
    codes = np.nan_to_num(nodes[..., OUTCOME]).astype(int).ravel()
    return PairCounts(
        pair=name,
        outcomes=tuple(np.bincount(codes, minlength=len(Outcome)).tolist()),
        dh=count(nodes[..., DH], nodes[..., SIGMA], pixel_height),
    )


def count_tile(
    heights: np.ndarray,
    correction: CorrectionMap,
    share: np.ndarray,
    estimated: np.ndarray,
    pairs: tuple[PairCounts, ...],
    pixel_height: float,
    cell: float = 1.0,
) -> TileCounts:
    """Counts of one tile; cell: m; arrays are (rows, cols); estimated: bool, cells whose height is no measurement."""
    # corrections reach beyond the surface; where it has no height there is nothing to check
    known, guessed = (np.isfinite(heights) & cells for cells in (~estimated, estimated))
    dh, of_estimates = (np.where(cells, correction.dh, np.nan) for cells in (known, guessed))
    return TileCounts(
        heights=int(known.sum()),
        checked=int(np.isfinite(dh).sum()),
        changed=int((known & (share > 0)).sum()),
        dh=count(dh, correction.sigma, pixel_height),
        pairs=pairs,
        estimates=int(guessed.sum()),
        dh_estimates=count(of_estimates, correction.sigma, pixel_height),
        relief=_by_relief(heights, known, np.isfinite(dh), cell),
    )


def _by_relief(heights: np.ndarray, known: np.ndarray, checked: np.ndarray, cell: float) -> tuple[tuple[int, int], ...]:
    """Known and checked cells by class of `RELIEF`."""
    rows, cols = (-(-side // _ACROSS) for side in heights.shape)
    padding = (0, rows * _ACROSS - heights.shape[0]), (0, cols * _ACROSS - heights.shape[1])
    folded = np.pad(heights, padding, constant_values=np.nan).reshape(rows, _ACROSS, cols, _ACROSS)
    empty = np.isnan(folded)
    rise = np.where(empty, -np.inf, folded).max(axis=(1, 3)) - np.where(empty, np.inf, folded).min(axis=(1, 3))
    classes = np.digitize(rise / (_ACROSS * cell), _SLOPES)
    of_cells = np.repeat(np.repeat(classes, _ACROSS, 0), _ACROSS, 1)[: heights.shape[0], : heights.shape[1]]
    counts = (np.bincount(of_cells[cells], minlength=len(RELIEF)) for cells in (known, known & checked))
    return tuple((int(total), int(part)) for total, part in zip(*counts, strict=True))


def added(parts: list[Counts]) -> Counts:
    """The counts of several sets together."""
    histogram: dict[int, int] = {}
    for part in parts:
        for number, filled in zip(part.bins, part.filled, strict=True):
            histogram[number] = histogram.get(number, 0) + filled
    return Counts(
        number=sum(p.number for p in parts),
        total=sum(p.total for p in parts),
        squares=sum(p.squares for p in parts),
        within_1=sum(p.within_1 for p in parts),
        within_3=sum(p.within_3 for p in parts),
        bins=tuple(sorted(histogram)),
        filled=tuple(histogram[b] for b in sorted(histogram)),
    )


def summarised(counts: Counts, pixel_height: float) -> Summary:
    """Mean, standard deviation, median, NMAD and shares of counted corrections."""
    n, nan = counts.number, float("nan")
    if not n:
        return Summary(number=0, mean=nan, std=nan, median=nan, nmad=nan, within_1=nan, within_3=nan)
    values, filled = np.array(counts.bins) * bin_width(pixel_height), np.array(counts.filled)
    middle = _weighted_median(values, filled)
    nmad = 1.4826 * _weighted_median(np.abs(values - middle), filled)
    # mean and std from exact sums; only median and NMAD depend on the bins
    mean = counts.total / n
    std = float(np.sqrt(max(counts.squares / n - mean**2, 0)))
    return Summary(
        number=n, mean=mean, std=std, median=middle, nmad=nmad, within_1=counts.within_1 / n, within_3=counts.within_3 / n
    )


def _weighted_median(values: np.ndarray, filled: np.ndarray) -> float:
    # stable: bins of equal distance from the median keep their order, so every merge of tiles gives the same bits
    order = np.argsort(values, kind="stable")
    upto = np.cumsum(filled[order])
    return float(values[order][np.searchsorted(upto, upto[-1] / 2)])


def correction_classes(counts: Counts, pixel_height: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Middles (m) of 41 classes of corrections, and the number of cells in each; the outermost contain everything beyond."""
    values, filled = np.array(counts.bins) * bin_width(pixel_height), np.array(counts.filled)
    # Four NMAD show the body of the distribution; a few blunders would otherwise squeeze it into one bar.
    reach = max(4 * summarised(counts, pixel_height).nmad, 0.5 * pixel_height)
    edges = np.linspace(-reach, reach, 42)
    number, _ = np.histogram(np.clip(values, -reach, reach), edges, weights=filled)
    return tuple(((edges[:-1] + edges[1:]) / 2).round(4).tolist()), tuple(map(float, number))
