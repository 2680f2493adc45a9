"""Height differences as histograms that can be added, and the measures derived from their sum.

A tile keeps, per stratum (class, code, seen twice), a histogram in bins of a hundredth of a cell over +-20 cells and a few exact
sums. Summed histograms give median, NMAD and quantiles of the whole surface to within a bin, without ever holding all differences
in memory.

Source: Karfis 2009 (sources/epipolar.md#evaluation: bias, SD, RMS, shares within n sigma); Skarlatos
(sources/surface_check.md#measures: 95 % of the normal law is 1.96 RMSE; #against-points); Hoehle & Hoehle 2009 (NMAD, quantiles).
"""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.job import Columns

BINS_PER_CELL = 100
"""bins along one cell: the least height difference that matters is far larger than a hundredth of a cell"""
REACH = 20
"""Differences of more than this many cells share the outermost bins."""
SIGMAS = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 10.0)


@dataclass(frozen=True)
class HeightHistogram(Columns):
    """Non-empty bins: differences whose nearest multiple of the bin width is `bin`."""

    part: np.ndarray
    """int32: stratum (classes.py) of the cells, or number of their building"""
    bin: np.ndarray
    """int32, in bin widths; differences beyond +-REACH cells are collected in the outermost bins"""
    count: np.ndarray
    """int64"""


@dataclass(frozen=True)
class HeightSums(Columns):
    """One row per stratum."""

    part: np.ndarray
    """int32: stratum (classes.py)"""
    cells: np.ndarray
    """int64: cells with a reference height"""
    heights: np.ndarray
    """int64: of those, cells with a height"""
    total: np.ndarray
    squares: np.ndarray
    """float64: sums of the differences and their squares, m and m^2"""
    lowest: np.ndarray
    highest: np.ndarray
    """float64, m"""
    beyond_metre: np.ndarray
    beyond_cell: np.ndarray
    """int64: differences larger than 1 m, than one cell"""
    with_precision: np.ndarray
    """int64: heights that report a precision"""
    within_1: np.ndarray
    within_2: np.ndarray
    within_3: np.ndarray
    within_4: np.ndarray
    within_5: np.ndarray
    within_6: np.ndarray
    within_10: np.ndarray
    """int64: differences within n of the cell's own reported standard errors"""
    with_relative: np.ndarray
    """int64: heights that report a precision among their neighbours, where the error of the datum is known"""
    relative_1: np.ndarray
    relative_2: np.ndarray
    relative_3: np.ndarray
    relative_4: np.ndarray
    relative_5: np.ndarray
    relative_6: np.ndarray
    relative_10: np.ndarray
    """int64: differences without that of the datum within n of these standard errors"""


def bin_width(cell: float) -> float:
    """Width of a bin, m."""
    return cell / BINS_PER_CELL


def histogram(dh: np.ndarray, part: np.ndarray, cell: float) -> HeightHistogram:
    """The histogram of differences `dh` (N,) m of parts (N,): strata or buildings."""
    # part and bin in one number: one call of `unique` counts all parts
    limit = REACH * BINS_PER_CELL
    bins = np.clip(np.rint(dh / bin_width(cell)), -limit, limit).astype(np.int64)
    keys, counts = np.unique(part.astype(np.int64) * (4 * limit) + bins + 2 * limit, return_counts=True)
    return HeightHistogram(
        (keys // (4 * limit)).astype(np.int32), (keys % (4 * limit) - 2 * limit).astype(np.int32), counts.astype(np.int64)
    )


@dataclass(frozen=True)
class JudgedCells:
    """Cells of a tile, flat (N,): stratum, difference dh (m, NaN where there is no height), reported precision (m, may be NaN).

    The same among neighbours: `relative`, and what the datum adds to dh (`datum`, NaN where it is not known).
    """

    stratum: np.ndarray
    dh: np.ndarray
    precision: np.ndarray
    relative: np.ndarray
    datum: np.ndarray


def _sums_of(cells: JudgedCells, stratum: int, cell: float) -> dict[str, float]:
    """A row of HeightSums."""
    mine = cells.stratum == stratum
    dh = cells.dh[mine].astype(np.float64)
    measured = np.isfinite(dh)
    ratio = _ratios(dh, cells.precision[mine])
    relative = _ratios(dh - cells.datum[mine], cells.relative[mine])
    good = dh[measured]
    return {
        "part": stratum,
        "cells": len(dh),
        "heights": len(good),
        "total": good.sum(),
        "squares": (good**2).sum(),
        "lowest": good.min(initial=np.inf),
        "highest": good.max(initial=-np.inf),
        "beyond_metre": (np.abs(good) > 1.0).sum(),
        "beyond_cell": (np.abs(good) > cell).sum(),
        "with_precision": len(ratio),
        **{f"within_{k:.0f}": (ratio <= k).sum() for k in SIGMAS},
        "with_relative": len(relative),
        **{f"relative_{k:.0f}": (relative <= k).sum() for k in SIGMAS},
    }


def _ratios(dh: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """|dh| over their standard errors, where both are known."""
    # a precision of zero is no statement, and a ratio to it would be infinite
    rated = np.isfinite(dh) & np.isfinite(sigma) & (sigma > 0)
    return np.abs(dh[rated]) / sigma[rated]


_FLOATS = ("total", "squares", "lowest", "highest")


def _columns(rows: list[dict[str, float]]) -> HeightSums:
    names = HeightSums.__dataclass_fields__
    types = dict.fromkeys(names, np.int64) | dict.fromkeys(_FLOATS, np.float64) | {"part": np.int32}
    return HeightSums(**{name: np.array([row[name] for row in rows], types[name]) for name in names})


def height_sums(cells: JudgedCells, cell: float) -> HeightSums:
    """The sums of every stratum that occurs; `cell` in m."""
    return _columns([_sums_of(cells, int(stratum), cell) for stratum in np.unique(cells.stratum)])


def merged_sums(parts: tuple[HeightSums, ...], strata: tuple[int, ...]) -> dict[str, float]:
    """The sum of all rows of `strata`, as one row."""
    # extremes are not sums: the only two columns that are merged by comparison
    together = {name: np.concatenate([getattr(p, name) for p in parts]) for name in HeightSums.__dataclass_fields__}
    mine = np.isin(together["part"], strata)
    merged = {name: values[mine].sum() for name, values in together.items() if name not in ("part", "lowest", "highest")}
    merged["lowest"] = together["lowest"][mine].min(initial=np.inf)
    merged["highest"] = together["highest"][mine].max(initial=-np.inf)
    return {name: float(value) for name, value in merged.items()}


def merged_histogram(parts: tuple[HeightHistogram, ...], strata: tuple[int, ...] | None = None) -> np.ndarray:
    """Counts (2 REACH BINS_PER_CELL + 1,) of the bins of `strata` (None: all), lowest first."""
    # dense: a few thousand bins, whatever the number of tiles
    limit = REACH * BINS_PER_CELL
    counts = np.zeros(2 * limit + 1, np.int64)
    for part in parts:
        mine = slice(None) if strata is None else np.isin(part.part, strata)
        np.add.at(counts, part.bin[mine] + limit, part.count[mine])
    return counts


def quantile(counts: np.ndarray, share: float, low_edge: float, width: float) -> float:
    """The value below which `share` of a histogram lies, linear within a bin; NaN when it is empty."""
    # low_edge: of the first bin; bins are centred on multiples of their width
    total = counts.sum()
    if not total:
        return float("nan")
    running = np.cumsum(counts)
    index = int(np.searchsorted(running, share * total, side="left"))
    before = running[index] - counts[index]
    return float(low_edge + width * (index + (share * total - before) / max(counts[index], 1)))


@dataclass(frozen=True)
class Measures:
    """Accuracy of some heights. Lengths in m, shares in %."""

    heights: int
    bias: float
    sd: float
    rmse: float
    median: float
    nmad: float
    median_absolute: float
    q68: float
    q95: float
    fgdc95: float
    lowest: float
    highest: float
    beyond_metre: float
    beyond_cell: float
    within: tuple[float, ...]
    """% within SIGMAS of the reported precision"""
    within_relative: tuple[float, ...]
    """% within SIGMAS of the reported precision among neighbours, without the error of the datum"""
    within_expected: tuple[float, ...]
    """% within SIGMAS of the expected standard error"""


def percent(part: float, whole: float) -> float:
    """NaN where there is nothing to share."""
    return 100.0 * part / whole if whole else float("nan")


def _absolute(counts: np.ndarray, centre: float, width: float) -> tuple[np.ndarray, np.ndarray]:
    """|value - centre| of every bin in ascending order, and the counts of these bins."""
    values = (np.arange(len(counts)) - len(counts) // 2) * width
    distance = np.abs(values - centre)
    order = np.argsort(distance, kind="stable")
    return distance[order], counts[order]


def _absolute_quantile(counts: np.ndarray, centre: float, width: float, share: float) -> float:
    """The value of |difference - centre| below which `share` lies; NaN when the histogram is empty."""
    distance, ordered = _absolute(counts, centre, width)
    total = ordered.sum()
    return float(distance[min(np.searchsorted(np.cumsum(ordered), share * total), len(distance) - 1)]) if total else float("nan")


def measures(sums: dict[str, float], counts: np.ndarray, cell: float, expected: float | None) -> Measures:
    """The measures of some strata from their sums and bins.

    `expected`: the published standard error of a height, m, None where it is not known.
    """
    n, width, nan = sums["heights"], bin_width(cell), float("nan")
    # exact moments from the sums, order statistics from the bins
    bias = sums["total"] / n if n else nan
    rmse = float(np.sqrt(sums["squares"] / n)) if n else nan
    median = quantile(counts, 0.5, -(len(counts) / 2) * width, width)
    return Measures(
        heights=int(n),
        bias=bias,
        sd=float(np.sqrt(max(rmse**2 - bias**2, 0.0))) if n else nan,
        rmse=rmse,
        median=median,
        # 1.4826: the factor that makes the median absolute deviation of a normal law its standard deviation
        nmad=1.4826 * _absolute_quantile(counts, median, width, 0.5),
        median_absolute=_absolute_quantile(counts, 0.0, width, 0.5),
        q68=_absolute_quantile(counts, 0.0, width, 0.68),
        q95=_absolute_quantile(counts, 0.0, width, 0.95),
        fgdc95=1.96 * rmse,
        lowest=sums["lowest"] if n else nan,
        highest=sums["highest"] if n else nan,
        beyond_metre=percent(sums["beyond_metre"], n),
        beyond_cell=percent(sums["beyond_cell"], n),
        within=tuple(percent(sums[f"within_{k:.0f}"], sums["with_precision"]) for k in SIGMAS),
        within_relative=tuple(percent(sums[f"relative_{k:.0f}"], sums["with_relative"]) for k in SIGMAS),
        within_expected=_within_expected(counts, width, expected),
    )


def _within_expected(counts: np.ndarray, width: float, expected: float | None) -> tuple[float, ...]:
    """% of the differences within SIGMAS of the expected standard error (m); empty where it is not known."""
    if not expected:
        return ()
    distance, ordered = _absolute(counts, 0.0, width)
    return tuple(percent(ordered[distance <= k * expected].sum(), ordered.sum()) for k in SIGMAS)


def building_medians(parts: tuple[HeightHistogram, ...], cell: float, least: int) -> np.ndarray:
    """(N, 3) building, measured cells, median difference (m): one row per building with at least `least` measured cells."""
    width, limit = bin_width(cell), REACH * BINS_PER_CELL
    if not any(len(part) for part in parts):
        return np.empty((0, 3))
    building = np.concatenate([p.part for p in parts])
    bins, count = np.concatenate([p.bin for p in parts]), np.concatenate([p.count for p in parts])
    rows = []
    # the median of a building, not its mean: chimneys and wrong matches at the eaves are part of no roof plane
    for number in np.unique(building[building > 0]):
        mine = building == number
        counts = np.bincount(bins[mine] + limit, count[mine], 2 * limit + 1)
        if counts.sum() >= least:
            rows.append((number, counts.sum(), quantile(counts, 0.5, -(len(counts) / 2) * width, width)))
    return np.array(rows).reshape(-1, 3)
