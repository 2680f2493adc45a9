"""Sums over all tiles: one small summary each of the heights, the orthoimage and the orientation."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.epipolar import EpipolarPairs
from orthomill.schemas.orientation import Block
from orthomill.schemas.surface import JUDGED, MEASURED, UNJUDGED, CheckCode
from orthomill.tasks.evaluation.accuracy import (
    BINS_PER_CELL,
    HeightHistogram,
    HeightSums,
    Measures,
    building_medians,
    measures,
    merged_histogram,
    merged_sums,
    percent,
)
from orthomill.tasks.evaluation.classes import CODE_GROUPS, GROUPS, CheckCounts, PlaceClass, strata_of
from orthomill.tasks.evaluation.edges import EdgeCounts, edge_shares
from orthomill.tasks.evaluation.orientation_accuracy import (
    InteriorDifference,
    PhotoDifference,
    interior_differences,
    photo_differences,
)
from orthomill.tasks.evaluation.orthoimage_accuracy import GreyFit, OrthoCounts, Shifts, merged_counts
from orthomill.tasks.evaluation.porous_crowns import CrownCounts, crown_shares
from orthomill.tasks.geometry.view import block_view

LEAST_ROOF = 9
"""measured cells that a building needs to be evaluated by itself"""


class _Summary(BaseModel):
    model_config = ConfigDict(frozen=True)


class GroupMeasures(_Summary):
    """`Measures` of the measured heights of one group of classes; numbers that do not exist are None."""

    name: str
    words: str
    numbers: dict[str, float | None]
    within: tuple[float | None, ...]
    within_expected: tuple[float | None, ...]


class CodeMeasures(_Summary):
    """`Measures` of the heights of one group of codes in one group of classes, on cells truly seen twice only."""

    code: str
    place: str
    words: str
    numbers: dict[str, float | None]
    """with `share`: % of all cells of the classes that are seen twice"""
    within: tuple[float | None, ...]
    within_relative: tuple[float | None, ...]


class EdgeShares(_Summary):
    """Roofs of one group of codes: % of the ground beside them that grew, and of their edges that were lost."""

    code: str
    words: str
    grown: float | None
    lost: float | None


class CrownShares(_Summary):
    """Trees of one group of codes: % of their heights at the crown, at the ground below it, at neither, and % within 2 and beyond 4
    of their standard errors from the nearer one."""

    code: str
    words: str
    numbers: dict[str, float | None]


class HeightsSummary(_Summary):
    """The height differences of the whole surface model."""

    groups: tuple[GroupMeasures, ...]
    codes: tuple[CodeMeasures, ...] = ()
    edges: tuple[EdgeShares, ...] = ()
    crowns: tuple[CrownShares, ...] = ()
    expected_sigma: float | None
    cell: float
    buildings: tuple[tuple[int, int, float], ...] = ()
    """building, measured cells, median difference (m)"""
    chart_x: tuple[float, ...] = ()
    chart: dict[str, tuple[float, ...]] = {}


class CheckedGroup(_Summary):
    """What the check says of the measured heights of one group of classes: cells, % judged, % of these called wrong, disputed."""

    name: str
    words: str
    cells: int
    judged: float | None
    wrong: float | None
    disputed: float | None


class CheckSummary(_Summary):
    """What the check says of the whole surface model, by class of the truth."""

    groups: tuple[CheckedGroup, ...] = ()


class OrthoSummary(_Summary):
    """The orthoimage as a whole."""

    fit: GreyFit
    counts: OrthoCounts
    shift: dict[str, float | None]
    chart_x: tuple[float, ...] = ()
    chart_y: tuple[float, ...] = ()


class OrientationSummary(_Summary):
    """The block against the true one."""

    photos: tuple[tuple[str, float, float, float, float, float, float, float | None, float | None], ...] = ()
    """photo, dX, dY, dZ (m), domega, dphi, dkappa (degrees), largest ratio of a centre, of an angle"""
    places: tuple[tuple[float, float], ...] = ()
    interior: tuple[tuple[str, str, float, float, float | None, float | None], ...] = ()
    """camera, parameter, block, truth, standard error, ratio"""
    numbers: dict[str, int | float | None] = {}


def rounded(value: float | None, digits: int = 4) -> float | None:
    """The number for a table: rounded, None where there is none."""
    return None if value is None or not isfinite(value) else round(float(value), digits)


def expected_sigma(block: Block, pairs: EpipolarPairs | None, parallax_sigma: float) -> float | None:
    """Standard error of a height as published: (H/B) times the ground pixel times the parallax error (px); m.

    Source: Karfis 2009 (sources/epipolar.md#evaluation), sigma_Z = k (H/B) sigma_p.
    """
    # without pairs no base is known, and without a base no expectation
    if pairs is None or not pairs.pairs:
        return None
    ground = block.ground_mean
    # medians: a few oblique or high photographs must not set the expectation for all heights
    pixel = np.median([(v.centre[2] - ground) / v.camera.c for v in (block_view(block, name) for name in block.names)])
    return float(parallax_sigma * pixel / np.median([pair.base_height for pair in pairs.pairs]))


@dataclass(frozen=True)
class _Tiles:
    """Sums and histograms of all tiles, and what is known of the surface as a whole."""

    sums: tuple[HeightSums, ...]
    histograms: tuple[HeightHistogram, ...]
    cell: float
    expected: float | None

    def count(self, name: str, strata: tuple[int, ...]) -> float:
        return merged_sums(self.sums, strata)[name]

    def measures(self, strata: tuple[int, ...]) -> Measures:
        return measures(merged_sums(self.sums, strata), merged_histogram(self.histograms, strata), self.cell, self.expected)


def _numbers(m: Measures) -> dict[str, float | None]:
    return {key: rounded(value) for key, value in vars(m).items() if not key.startswith("within")}


def _groups(tiles: _Tiles) -> Iterator[GroupMeasures]:
    """The measured heights of every group of classes that occurs."""
    for name, words, places in GROUPS:
        cells, twice = tiles.count("cells", strata_of(places)), tiles.count("cells", strata_of(places, only_seen_twice=True))
        # classes that do not occur have no figures: a file as reference knows no roofs
        if not cells:
            continue
        m = tiles.measures(strata_of(places, MEASURED))
        measured_twice = tiles.count("heights", strata_of(places, MEASURED, only_seen_twice=True))
        completeness = {
            "cells": rounded(cells),
            "completeness": rounded(percent(m.heights, cells)),
            "completeness_seen_twice": rounded(percent(measured_twice, twice)),
            # a height that is called measured although no two photographs see the place is a wrong match by definition
            "measured_unseen": rounded(percent(m.heights - measured_twice, cells - twice)),
        }
        yield GroupMeasures(
            name=name,
            words=words,
            numbers={**completeness, **_numbers(m)},
            within=tuple(rounded(v, 2) for v in m.within),
            within_expected=tuple(rounded(v, 2) for v in m.within_expected),
        )


def _codes(tiles: _Tiles) -> Iterator[CodeMeasures]:
    """The heights of every group of codes in every group of classes, of cells seen twice; combinations that occur."""
    for code, code_words, codes in CODE_GROUPS:
        for place, words, places in GROUPS:
            m = tiles.measures(strata_of(places, codes, only_seen_twice=True))
            if not m.heights:
                continue
            cells = tiles.count("cells", strata_of(places, only_seen_twice=True))
            yield CodeMeasures(
                code=code,
                place=place,
                words=f"{code_words}, {words}",
                numbers={"share": rounded(percent(m.heights, cells)), **_numbers(m)},
                within=tuple(rounded(v, 2) for v in m.within),
                within_relative=tuple(rounded(v, 2) for v in m.within_relative),
            )


def _edges(edges: tuple[EdgeCounts, ...]) -> Iterator[EdgeShares]:
    """The edges of roofs by group of codes; groups that have none are left out."""
    for code, words, codes in CODE_GROUPS:
        grown, lost = (rounded(share, 2) for share in edge_shares(edges, codes))
        if grown is not None or lost is not None:
            yield EdgeShares(code=code, words=words, grown=grown, lost=lost)


def _crowns(crowns: tuple[CrownCounts, ...]) -> Iterator[CrownShares]:
    """The heights on trees by group of codes; groups that have none are left out."""
    for code, words, codes in CODE_GROUPS:
        numbers = {name: rounded(share, 2) for name, share in crown_shares(crowns, codes).items()}
        if numbers["at_crown"] is not None:
            yield CrownShares(code=code, words=words, numbers=numbers)


def _chart(histograms: tuple[HeightHistogram, ...], cell: float) -> tuple[tuple[float, ...], dict[str, tuple[float, ...]]]:
    """Shares of measured cells in bins of a twentieth of a cell over +-3 cells, for the groups that occur."""
    # a curve of 121 points: the bins themselves are too fine to be drawn
    step, reach = BINS_PER_CELL // 20, 60
    series = {}
    for name, words, places in GROUPS:
        counts = merged_histogram(histograms, strata_of(places, MEASURED))
        if name not in ("all", "open_ground", "roof", "tree") or not counts.sum():
            continue
        middle = len(counts) // 2
        edges = middle - step // 2 + step * np.arange(-reach, reach + 1)
        series[words] = tuple(round(100.0 * float(counts[e : e + step].sum()) / float(counts.sum()), 4) for e in edges)
    return tuple(round(cell * k / 20, 4) for k in range(-reach, reach + 1)), series


def summarise_heights(
    sums: tuple[HeightSums, ...],
    histograms: tuple[HeightHistogram, ...],
    buildings: tuple[HeightHistogram, ...],
    edges: tuple[EdgeCounts, ...],
    crowns: tuple[CrownCounts, ...],
    block: Block,
    cell: float,
    parallax_sigma: float,
    pairs: EpipolarPairs | None = None,
) -> HeightsSummary:
    """The summary of all tiles."""
    sigma = expected_sigma(block, pairs, parallax_sigma)
    tiles = _Tiles(sums, histograms, cell, sigma)
    roofs = building_medians(buildings, cell, LEAST_ROOF)
    x, series = _chart(histograms, cell)
    return HeightsSummary(
        groups=tuple(_groups(tiles)),
        codes=tuple(_codes(tiles)),
        edges=tuple(_edges(edges)),
        crowns=tuple(_crowns(crowns)),
        expected_sigma=rounded(sigma),
        cell=cell,
        chart_x=x,
        chart=series,
        buildings=tuple((int(b), int(n), round(float(m), 3)) for b, n, m in roofs),
    )


def summarise_check(counts: tuple[CheckCounts, ...]) -> CheckSummary:
    """The summary of all tiles."""
    place, code, cells = (np.concatenate([getattr(part, name) for part in counts]) for name in ("place", "code", "cells"))
    groups = []
    for name, words, places in GROUPS:
        mine = np.isin(place, places)
        judged, wrong, disputed, others = (
            int(cells[mine & np.isin(code, codes)].sum())
            for codes in (JUDGED, (CheckCode.CORRECTED, CheckCode.WRONG), (CheckCode.DISPUTED,), UNJUDGED)
        )
        if judged + others:
            shares = (rounded(percent(part, of)) for part, of in ((judged, judged + others), (wrong, judged), (disputed, judged)))
            groups.append(CheckedGroup(name=name, words=words, cells=judged + others, **dict(zip(_SHARES, shares, strict=True))))
    return CheckSummary(groups=tuple(groups))


_SHARES = ("judged", "wrong", "disputed")


def _shift_numbers(shifts: Shifts) -> dict[str, float | None]:
    """Statistics of the shifts of all nodes, of those on open ground and of those on roofs."""
    # Ground that fewer than two photographs show has no height of its own: what is draped there lies where its guess is, and
    # the layer of height sources says so.
    found = np.isfinite(shifts.dx)
    # Cars and glints differ from photograph to photograph, and the truth has none: there is nothing to match.
    visible = (shifts.seen >= 2) & ~np.isin(shifts.place, (PlaceClass.VEHICLE, PlaceClass.WATER))
    size = np.hypot(shifts.dx, shifts.dy)
    numbers: dict[str, float | None] = {"nodes": float(visible.sum()), "matched": float((found & visible).sum())}
    chosen = {
        "": visible,
        "open_ground_": visible & np.isin(shifts.place, (PlaceClass.CLEAR_GROUND, PlaceClass.TREE_MARGIN)),
        "measured_": visible & shifts.measured,
        "roof_": visible & np.isin(shifts.place, (PlaceClass.ROOF_INTERIOR, PlaceClass.ROOF_EDGE)),
    }
    for name, mask in chosen.items():
        mine = size[mask & found]
        numbers[f"{name}median"] = rounded(np.median(mine)) if len(mine) else None
        numbers[f"{name}q95"] = rounded(np.quantile(mine, 0.95)) if len(mine) else None
        numbers[f"{name}share_above_half"] = rounded(100.0 * float((mine > 0.5).mean()), 3) if len(mine) else None
        numbers[f"{name}nodes_matched"] = float(len(mine))
    mine = found & visible
    numbers |= _own_numbers(shifts, visible & found)
    numbers["mean_dx"] = rounded(shifts.dx[mine].mean()) if mine.any() else None
    numbers["mean_dy"] = rounded(shifts.dy[mine].mean()) if mine.any() else None
    return numbers


def _own_numbers(shifts: Shifts, mine: np.ndarray) -> dict[str, float | None]:
    """The shifts of the datum, and what is left without them, where both are known."""
    known = mine & np.isfinite(shifts.datum_dx)
    own = np.hypot(shifts.dx - shifts.datum_dx, shifts.dy - shifts.datum_dy)[known]
    if not known.any():
        return dict.fromkeys(("datum_mean_dx", "datum_mean_dy", "own_median", "own_share_above_half"))
    return {
        "datum_mean_dx": rounded(shifts.datum_dx[known].mean()),
        "datum_mean_dy": rounded(shifts.datum_dy[known].mean()),
        "own_median": rounded(np.median(own)),
        "own_share_above_half": rounded(100.0 * float((own > 0.5).mean()), 3),
    }


def summarise_ortho(counts: tuple[OrthoCounts, ...], shifts: tuple[Shifts, ...], fit: GreyFit) -> OrthoSummary:
    """The summary of all tiles."""
    merged = Shifts(**{name: np.concatenate([getattr(s, name) for s in shifts]) for name in Shifts.__dataclass_fields__})
    size = np.hypot(merged.dx, merged.dy)
    size = size[np.isfinite(size) & (merged.seen >= 2)]
    # bars up to two pixels: beyond, least squares has found another object
    bars, edges = np.histogram(np.minimum(size, 1.999), bins=40, range=(0, 2))
    return OrthoSummary(
        fit=fit,
        counts=merged_counts(counts),
        shift=_shift_numbers(merged),
        chart_x=tuple(round(float(e), 3) for e in edges[:-1] + 0.025),
        chart_y=tuple(float(b) for b in bars),
    )


def _share_within(ratios: np.ndarray, limit: float) -> float | None:
    """% of the known ratios within +-limit."""
    known = ratios[np.isfinite(ratios)]
    return rounded(100.0 * float((np.abs(known) <= limit).mean()), 2) if len(known) else None


def _largest(ratios: np.ndarray) -> float | None:
    return rounded(np.abs(ratios).max(), 2)


def _root(values: np.ndarray) -> float | None:
    """Root mean square."""
    return rounded(np.sqrt((values**2).mean()), 6) if values.size else None


def summarise_orientation(block: Block, truth: Block) -> OrientationSummary:
    """Differences of every photograph and of the interior orientation, and their shares within three standard errors."""
    rows, interior = photo_differences(block, truth), interior_differences(block, truth)
    if not rows:
        return OrientationSummary(numbers={"photos_compared": 0})
    unoriented = len(set(truth.names) - set(block.names))
    return OrientationSummary(
        numbers={
            "photos_compared": len(rows),
            "photos_unoriented": unoriented,
            **_photo_numbers(rows),
            "interior_within_3_sigma": _share_within(np.array([(i.block - i.truth) / i.sigma for i in interior]), 3.0),
        },
        photos=tuple(map(_photo_row, rows)),
        places=tuple((float(x), float(y)) for x, y, _ in (truth.of(r.photo).centre for r in rows)),
        interior=tuple(map(_interior_row, interior)),
    )


def _photo_numbers(rows: tuple[PhotoDifference, ...]) -> dict[str, float | None]:
    centres, rotations = np.array([r.centre for r in rows]), np.array([r.rotation for r in rows])
    ratios, sigma = np.array([r.ratios for r in rows]), np.array([r.sigma for r in rows])
    return {
        "centre_rmse_plan": _root(np.hypot(centres[:, 0], centres[:, 1])),
        "centre_rmse_height": _root(centres[:, 2]),
        "centre_largest": rounded(np.abs(centres).max()),
        "rotation_rmse": _root(rotations),
        "rotation_largest": rounded(np.abs(rotations).max(), 6),
        "centre_sigma_mean": rounded(np.nanmean(sigma[:, :3])) if np.isfinite(sigma[:, :3]).any() else None,
        "centres_within_1_sigma": _share_within(ratios[:, :3], 1.0),
        "centres_within_3_sigma": _share_within(ratios[:, :3], 3.0),
        "rotations_within_3_sigma": _share_within(ratios[:, 3:], 3.0),
    }


def _photo_row(r: PhotoDifference) -> tuple[str, float, float, float, float, float, float, float | None, float | None]:
    x, y, z = (round(float(v), 4) for v in r.centre)
    omega, phi, kappa = (round(float(v), 6) for v in r.rotation)
    return r.photo, x, y, z, omega, phi, kappa, _largest(r.ratios[:3]), _largest(r.ratios[3:])


def _interior_row(i: InteriorDifference) -> tuple[str, str, float, float, float | None, float | None]:
    ratio = rounded((i.block - i.truth) / i.sigma, 2)
    return i.camera, i.parameter, float(i.block), float(i.truth), rounded(i.sigma, 9), ratio
