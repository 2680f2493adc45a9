"""The report of the check: how well surface and photographs agree, and where they do not."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import MapGrid
from orthomill.schemas.stage_report import Chart, Figure, Grid, Picture, Product, StageReport
from orthomill.schemas.surface import CORRECTED
from orthomill.tasks.dsm_check.area_map import AreaMap, AreaRule, area_map
from orthomill.tasks.dsm_check.areas import CoarseBlocks, SuspiciousArea, Trend, fitted_trend, suspicious_areas
from orthomill.tasks.dsm_check.coverage import CheckedPair, CheckedPairs
from orthomill.tasks.dsm_check.difference_words import ERRORS, AreaWords
from orthomill.tasks.dsm_check.joint_correction import NO_BENDS, PairBends
from orthomill.tasks.dsm_check.judged_blocks import median_detectable, tolerance_values
from orthomill.tasks.dsm_check.report.area_words import area_warnings, areas_grid
from orthomill.tasks.dsm_check.report.check_verdict import CheckSight, check_answer, check_verdict, percent
from orthomill.tasks.dsm_check.report.round_words import (
    beyond_warning,
    check_evidence,
    code_picture,
    relief_grid,
    relief_values,
    rounds_grid,
    shift_values,
    shift_warnings,
)
from orthomill.tasks.dsm_check.rounds.round_state import RoundState
from orthomill.tasks.dsm_check.statistics import Counts, PairCounts, Summary, TileCounts, added, correction_classes, summarised
from orthomill.tasks.dsm_check.surfaces.surface_shift import SurfaceShift, SurfaceTrend
from orthomill.tasks.dsm_check.surfaces.whole_shift import whole_shift, with_pairs_apart

__all__ = ["DETECTABLE", "DH", "LAST_ROUND", "PRECISION", "TEST", "Blocks", "report"]

DH = "dsm_check/dh"
PRECISION = "dsm_check/precision"
TEST = "dsm_check/test"
"""float32: dh in units of its standard error"""
LAST_ROUND = "dsm_check/rounds/{}/last"
"""uint8: the round that changed a cell last, 0 for none"""
DETECTABLE = "dsm_check/detectable"
"""float32 m: the smallest error that the check would have found, see `correction_map.detectable_error`"""
_CORRECTED_PRODUCT = (Product(path="products/dsm_corrected.tif", purpose="The surface, corrected by the photographs", main=True),)
_SHIFT_LIMIT, _TILT_LIMIT = 0.3, 0.5
"""orthoimage pixels: shift and range of the trend beyond the errors that a sound orientation causes"""
_COMPASS = ("east", "north-east", "north", "north-west", "west", "south-west", "south", "south-east")


@dataclass(frozen=True)
class Blocks:
    """The blocks of the coarse raster."""

    grid: MapGrid
    """of the surface"""
    size: int
    """cells along a side"""
    significance: float
    crs: str
    tolerance: float | None = None
    """m: the error that the survey allows"""
    wide: float | None = None
    """m: width from which on an error is seen: that of the ground of which one correction is made"""
    words: AreaWords = ERRORS
    """what differences are called"""


class Reported(NamedTuple):
    """The report, and the suspicious areas on a map."""

    report: StageReport
    areas: AreaMap


def report(
    tiles: tuple[TileCounts, ...],
    pairs: CheckedPairs,
    coarse: CoarseBlocks,
    blocks: Blocks,
    rounds: tuple[RoundState, ...] = (),
    shift: SurfaceShift | None = None,
    raised: float = 0.0,
    keeps: bool = True,
    last_round: int = 1,
    level: SurfaceTrend | None = None,
    bends: PairBends = NO_BENDS,
) -> Reported:
    """Figures, tables, histogram, maps and warnings from the counts of all tiles and the coarse raster (rows, cols, 5).

    rounds: what each did. shift: of a surface from a file, which was raised by so many m before the check; keeps: whether the
    corrected surface keeps it; level: the plane that is in none of the corrections; bends: of the pairs.
    """
    total = added([tile.dh for tile in tiles])
    whole = summarised(total, pairs.pixel_height)
    trend, plane = fitted_trend(coarse, blocks.grid, blocks.size)
    areas = suspicious_areas(coarse, plane, blocks.grid, blocks.size, blocks.significance)
    of_file = None
    if shift:
        medians = [_summary(_of_pair(tiles, pair.name), pairs).median for pair in pairs.pairs]
        of_file = with_pairs_apart(whole_shift(shift, raised, shift.in_plan and not keeps), medians)
    trend = trend if level is None else _with_level(trend, level, blocks.grid)
    detectable = median_detectable(coarse, blocks.significance)
    kept = tolerance_values(coarse, blocks.significance, blocks.tolerance)
    sight = CheckSight(detectable, blocks.wide, pairs.pixel_height, blocks.tolerance, kept)
    tilts = _tilt_warnings(trend, pairs, detectable)
    shifted = shift_warnings(of_file, not keeps, blocks.grid.cell) if of_file else ()
    own = () if of_file else _shift_of_whole(trend.middle, whole.nmad, pairs.pixel_height)
    told = (*_surface_warnings(tiles), *own, *tilts, *shifted)
    losses = (*area_warnings(areas, trend, blocks.words), *beyond_warning(tiles, blocks.grid.cell))
    found = StageReport(
        verdict=check_verdict(tiles, whole, sight, blocks.words),
        answers=(check_answer(tiles, whole, len(areas), sight),),
        products=(
            Product(path="products/dsm_check.tif", purpose="What the photographs say against the surface, and the surface mended"),
            Product(path="products/dsm_check_areas.geojson", purpose="Areas where photographs and surface disagree"),
            *(_CORRECTED_PRODUCT if of_file else ()),
        ),
        evidence=() if of_file else check_evidence(coarse, "products/dsm.tif"),
        doubts=told,
        losses=losses,
        figures=_figures(
            _cell_values(tiles, whole, pairs)
            | {"detectable": _known(detectable), "detectable_width": blocks.wide}
            | {"bend": _known(bends.error * pairs.pixel_height) if len(pairs.pairs) > 1 else None}
            | relief_values(tiles)
            | _estimate_values(tiles, pairs)
            | _place_values(trend, areas)
            | shift_values(of_file)
            | sight.kept
            | {"rounds": max(len(rounds), 1), "beyond_reach": percent(sum(t.beyond for t in tiles), sum(t.heights for t in tiles))}
        ),
        grids=(
            _pairs_grid(tiles, pairs),
            _outcomes_grid(tiles, pairs),
            *areas_grid(areas, blocks.words),
            *rounds_grid(rounds),
            *relief_grid(tiles),
        ),
        charts=(_histogram(total, pairs.pixel_height),) if whole.number else (),
        pictures=(*_pictures(pairs, whole, blocks.words), code_picture(), *_round_picture(rounds, last_round)),
        warnings=(*told, *losses),
    )
    return Reported(found, area_map(areas, AreaRule(blocks.grid, blocks.size, blocks.crs, blocks.words)))


def _with_level(trend: Trend, level: SurfaceTrend, grid: MapGrid) -> Trend:
    """The tilt of the corrections with that of the plane which is in none of them."""
    east, north = (trend.east + 1000 * level.by_col / grid.cell, trend.north - 1000 * level.by_row / grid.cell)
    width, height = (side * grid.cell / 1000 for side in (grid.cols, grid.rows))
    return Trend(trend.middle, east, north, abs(east) * width + abs(north) * height)


def _round_picture(rounds: tuple[RoundState, ...], last: int) -> tuple[Picture, ...]:
    """Where the rounds converged."""
    if len(rounds) < 2:
        return ()
    return (
        Picture(
            title="Round of the last correction",
            raster=LAST_ROUND.format(last),
            style="ramp",
            low=0,
            high=float(last),
            caption="0: never corrected. Where the last round still corrected, the check has not come to an end.",
        ),
    )


def _known(value: float, digits: int = 3) -> float | None:
    return round(value, digits) if math.isfinite(value) else None


_LABELS = {
    "dh_mean": "Mean correction",
    "dh_std": "Standard deviation of the corrections",
    "dh_median": "Median correction",
    "dh_nmad": "Robust spread of the corrections",
    "dh_within_1_sigma": "Below one standard error",
    "dh_within_3_sigma": "Below three standard errors",
    "detectable": "Smallest error that would be found",
    "estimates_dh_nmad": "Robust spread, estimated heights",
}
"""what people call a figure whose name does not say it"""
_FIGURES = (
    ("dh_mean", "m", "Mean correction: photographs minus surface model."),
    ("dh_std", "m", "Standard deviation of the corrections."),
    ("dh_median", "m", "Median correction."),
    ("dh_nmad", "m", "Robust spread of the corrections: agreement of surface and photographs, not the accuracy of the surface."),
    ("dh_within_1_sigma", "%", "Cells whose correction is below its own standard error (68 % if all errors are random)."),
    ("dh_within_3_sigma", "%", "Cells whose correction is below three of its standard errors."),
    (
        "detectable",
        "m",
        "Smallest error that would have been found with 95 %, in half of the checked blocks; of narrower ones only a part is seen.",
    ),
    ("bend", "m", "Error that orientation and lens leave all over a pair, from pairs that overlap: in all standard errors."),
    ("detectable_width", "m", "Width from which on that holds: that of the ground from which one correction is made."),
    ("checked", "%", "Share of the measured cells that could be checked."),
    ("shown", "%", "Share of the measured cells that both photographs of a pair show: no others could be checked."),
    ("checked_of_shown", "%", "Share of these that could be checked."),
    ("checked_level", "%", "The same of level or gently sloping surface: open ground, flat roofs."),
    ("checked_steep", "%", "The same of steep surface: banks, pitched roofs."),
    ("checked_steps", "%", "The same where the surface has steps: walls and what lies beside them, crowns."),
    ("changed", "%", "Share of the measured cells that the check changed."),
    ("estimates", "%", "Share of the heights that are estimated: neither checked nor changed, and in no other figure here."),
    ("estimates_compared", "%", "Share of the estimated cells in which the photographs could be compared nevertheless."),
    ("estimates_dh_nmad", "m", "Robust spread of their corrections; an estimate that agrees is no measurement yet."),
    ("pairs", "", "Pairs of orthoimages that were compared."),
    ("rounds", "", "Rounds of the check: each later one looks again where the one before corrected."),
    ("beyond_reach", "%", "Share of the measured cells with a large error that only coarse orthoimages saw: left as they are."),
    ("proved", "%", "Share of the judged ground whose heights keep the tolerance: an error of its size would have been found."),
    ("broken", "%", "Share of the judged ground whose heights break the tolerance beyond doubt."),
    ("untold", "%", "Share of the judged ground of which the check cannot tell: it is not precise enough there."),
    ("shift_up", "m", "How far the surface from a file as a whole lies above the photographs."),
    ("shift_up_sigma", "m", "Its standard error."),
    ("shift_east", "m", "How far it lies too far east."),
    ("shift_north", "m", "How far it lies too far north."),
    ("shift_plan_sigma", "m", "Standard error of both; slopes in all directions make it small."),
    ("pixel_height", "m", "Height error that shifts the two orthoimages by one pixel, on average."),
    ("suspicious_areas", "", "Connected areas where the surface deviates significantly from its own trend, too high or too low."),
    ("suspicious_area", "m2", "Their total area."),
    ("tilt_east", "m/km", "Gradient of the correction to the east."),
    ("tilt_north", "m/km", "Gradient of the correction to the north."),
    ("trend_range", "m", "Range of the trend of the corrections between the corners of the surface."),
)
"""name, unit and meaning of every figure, in the order of the report"""
_HEADLINES = ("dh_nmad", "checked", "suspicious_areas")


def _figures(values: dict[str, float | int | None]) -> tuple[Figure, ...]:
    return tuple(
        Figure(
            name=name, label=_LABELS.get(name, ""), value=values[name], unit=unit, sentence=sentence, headline=name in _HEADLINES
        )
        for name, unit, sentence in _FIGURES
    )


def _cell_values(tiles: tuple[TileCounts, ...], whole: Summary, pairs: CheckedPairs) -> dict[str, float | int | None]:
    heights, checked, changed, shown = (
        sum(getattr(tile, name) for tile in tiles) for name in ("heights", "checked", "changed", "shown")
    )
    return {
        "dh_mean": _known(whole.mean),
        "dh_std": _known(whole.std),
        "dh_median": _known(whole.median),
        "dh_nmad": _known(whole.nmad),
        "dh_within_1_sigma": _known(100 * whole.within_1, 1),
        "dh_within_3_sigma": _known(100 * whole.within_3, 1),
        "checked": percent(checked, heights),
        "shown": percent(shown, heights),
        "checked_of_shown": min(percent(checked, shown), 100.0) if shown else None,
        "changed": percent(changed, heights),
        "pairs": len(pairs.pairs),
        "pixel_height": _known(pairs.pixel_height),
    }


def _estimate_values(tiles: tuple[TileCounts, ...], pairs: CheckedPairs) -> dict[str, float | int | None]:
    counts = added([tile.dh_estimates for tile in tiles])
    measured, estimates = (sum(getattr(tile, name) for tile in tiles) for name in ("heights", "estimates"))
    return {
        "estimates": percent(estimates, measured + estimates),
        "estimates_compared": percent(counts.number, estimates) if estimates else None,
        "estimates_dh_nmad": _known(summarised(counts, pairs.pixel_height).nmad),
    }


def _place_values(trend: Trend, areas: list[SuspiciousArea]) -> dict[str, float | int | None]:
    return {
        "suspicious_areas": len(areas),
        "suspicious_area": round(sum(a.area for a in areas), 1),
        "tilt_east": _known(trend.east),
        "tilt_north": _known(trend.north),
        "trend_range": _known(trend.range),
    }


def _of_pair(tiles: tuple[TileCounts, ...], name: str) -> list[PairCounts]:
    return [pair for tile in tiles for pair in tile.pairs if pair.pair == name]


_PAIR_COLUMNS = (
    "pair",
    "base/height",
    "nodes",
    "matched (%)",
    "mean (m)",
    "std (m)",
    "median (m)",
    "NMAD (m)",
    "within 1 sigma (%)",
    "within 3 sigma (%)",
)


def _summary(parts: list[PairCounts], pairs: CheckedPairs) -> Summary:
    return summarised(added([part.dh for part in parts]), pairs.pixel_height)


def _pair_row(pair: CheckedPair, parts: list[PairCounts], pairs: CheckedPairs) -> tuple[float | int | str | None, ...]:
    s = _summary(parts, pairs)
    # nodes outside the photographs or in gaps of the surface were never to be matched
    tried = sum(sum(part.outcomes) - part.outcomes[Outcome.OUTSIDE] for part in parts)
    lengths = _known(s.mean), _known(s.std), _known(s.median), _known(s.nmad)
    shares = _known(100 * s.within_1, 1), _known(100 * s.within_3, 1)
    return pair.name, round(pair.base_height, 3), tried, percent(s.number, tried), *lengths, *shares


def _pairs_grid(tiles: tuple[TileCounts, ...], pairs: CheckedPairs) -> Grid:
    return Grid(
        title="The check by pairs",
        columns=_PAIR_COLUMNS,
        rows=tuple(_pair_row(pair, _of_pair(tiles, pair.name), pairs) for pair in pairs.pairs),
        note="A mean that differs between pairs indicates an error of the orientation rather than of the surface. Errors common to "
        "surface and check remain undetected: those of orientation and camera and, where the surface was matched in the same "
        "photographs, those of matching at building edges, in trees and in narrow gaps.",
    )


def _outcomes_grid(tiles: tuple[TileCounts, ...], pairs: CheckedPairs) -> Grid:
    every = [part.outcomes for pair in pairs.pairs for part in _of_pair(tiles, pair.name)]
    totals = [sum(numbers) for numbers in zip(*every, strict=True)]
    return Grid(
        title="Outcomes of the nodes",
        columns=("outcome", "nodes"),
        rows=tuple((Outcome(code).sentence, number) for code, number in enumerate(totals) if number),
        note="Moving vehicles and places visible in one photograph only must fail here; those that pass cause false alarms.",
    )


def _histogram(counts: Counts, pixel_height: float) -> Chart:
    middles, numbers = correction_classes(counts, pixel_height)
    return Chart(
        title="Corrections of the surface",
        style="bars",
        x_label="dh (m)",
        y_label="cells",
        x=middles,
        series={"cells": numbers},
        caption="Photographs minus surface model; the outermost bars contain everything beyond.",
    )


def _pictures(pairs: CheckedPairs, whole: Summary, words: AreaWords) -> tuple[Picture, ...]:
    # at least one pixel of shift: on a good surface the colours must not turn noise into mountains
    reach = round(max(5 * whole.nmad, pairs.pixel_height), 2) if whole.number else None
    low = -reach if reach else None
    return (
        Picture(
            title=words.picture,
            raster=DH,
            style="diverging",
            unit="m",
            low=low,
            high=reach,
            caption="Correction derived from the photographs. Negative: the surface is too high. "
            "Empty: estimated, or could not be checked.",
        ),
        Picture(
            title="Precision of the check", raster=PRECISION, style="ramp", unit="m", caption="Standard error of the correction."
        ),
        Picture(
            title="Smallest error that the check would find",
            raster=DETECTABLE,
            style="ramp",
            unit="m",
            caption="With a probability of 95 %, where an error is at least as wide as the windows that are compared. "
            "Empty: nothing would be found here.",
        ),
        Picture(title="Surface after the check", raster=CORRECTED, style="hillshade", unit="m"),
    )


def _surface_warnings(tiles: tuple[TileCounts, ...]) -> Iterator[str]:
    heights, checked = sum(tile.heights for tile in tiles), sum(tile.checked for tile in tiles)
    # with less than half of the surface checked the figures above do not speak for the whole
    if checked < 0.5 * heights:
        yield (
            f"Only {percent(checked, heights):.0f} % of the measured surface could be checked; the rest lies outside the pairs of "
            "photographs, has too little texture, or is hidden in one of them. What is said here holds for what was checked."
        )


def _shift_of_whole(middle: float, nmad: float, pixel_height: float) -> Iterator[str]:
    """Of a surface that was matched here (m); one from a file has a sentence of its own, with its standard error."""
    if abs(middle) <= _SHIFT_LIMIT * pixel_height:
        return
    # A shift is in all heights alike; corrections that scatter by more than it are of heights that are wrong one by one.
    if abs(middle) > nmad:
        yield (
            f"The surface as a whole is {_side(middle)} by about {abs(middle):.2g} m relative to the photographs. Matching does "
            "not do that: check control, positions and camera."
        )
    else:
        yield (
            f"The corrections that the photographs ask for scatter by {nmad:.2g} m (robust spread) about {middle:+.2g} m: heights "
            "are wrong in many places, and no shift of the whole explains that. Smaller windows, or the default way of matching "
            "(object_space), follow the ground more closely."
        )


def _tilt_warnings(trend: Trend, pairs: CheckedPairs, detectable: float) -> Iterator[str]:
    """A tilt that is neither what a sound orientation leaves nor less than the errors that the check finds one by one."""
    if trend.range > max(_TILT_LIMIT * pairs.pixel_height, 0.0 if math.isnan(detectable) else detectable):
        low, high = (_COMPASS[round(math.atan2(way * trend.north, way * trend.east) / (math.pi / 4)) % 8] for way in (1, -1))
        yield (
            f"The surface is tilted relative to the photographs: by {trend.range:.2g} m from corner to corner, too low in the "
            f"{low} as compared with the {high}. Matching does not do that: check control, positions and camera."
        )


def _side(dh: float) -> str:
    # dh is what must be added to the surface
    return "too high" if dh < 0 else "too low"
