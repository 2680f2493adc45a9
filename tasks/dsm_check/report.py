"""What the check tells people: how far the surface agrees with the photographs, and where it does not."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import MapGrid
from orthomill.schemas.stage_report import Chart, Figure, Grid, Picture, StageReport
from orthomill.schemas.surface import CORRECTED
from orthomill.tasks.dsm_check.areas import SuspiciousArea, Trend, fitted_trend, suspicious_areas
from orthomill.tasks.dsm_check.coverage import CheckedPairs
from orthomill.tasks.dsm_check.statistics import Counts, Summary, TileCounts, added, bin_width, summarised

DH = "dsm_check/dh"
PRECISION = "dsm_check/precision"
_LISTED = 20
_WARNED = 5


@dataclass(frozen=True)
class Blocks:
    """What the coarse raster's blocks are."""

    grid: MapGrid
    """of the surface"""
    size: int
    """cells along a side"""
    significance: float


def report(tiles: tuple[TileCounts, ...], pairs: CheckedPairs, coarse: np.ndarray, blocks: Blocks) -> StageReport:
    """Figures, tables, histogram, maps and warnings from the counts of all tiles and the coarse raster (rows, cols, 3)."""
    total = added([tile.dh for tile in tiles])
    whole = summarised(total, pairs.pixel_height)
    trend, plane = fitted_trend(coarse, blocks.grid, blocks.size)
    areas = suspicious_areas(coarse, plane, blocks.grid, blocks.size, blocks.significance)
    return StageReport(
        figures=(*_figures(tiles, whole, pairs), *_place_figures(trend, areas)),
        grids=(_pairs_grid(tiles, pairs), _outcomes_grid(tiles, pairs), *_areas_grid(areas)),
        charts=(_histogram(total, pairs.pixel_height),) if whole.number else (),
        pictures=_pictures(pairs, whole),
        warnings=(*_surface_warnings(tiles, trend, pairs), *_area_warnings(areas)),
    )


def _known(value: float, digits: int = 3) -> float | None:
    return round(value, digits) if math.isfinite(value) else None


def _share(part: int, of: int) -> float:
    return round(100 * part / max(of, 1), 2)


def _figures(tiles: tuple[TileCounts, ...], whole: Summary, pairs: CheckedPairs) -> tuple[Figure, ...]:
    heights, checked, changed = (sum(getattr(tile, name) for tile in tiles) for name in ("heights", "checked", "changed"))
    return (
        Figure(name="dh_mean", value=_known(whole.mean), unit="m", sentence="Mean correction: photographs minus surface model."),
        Figure(name="dh_std", value=_known(whole.std), unit="m", sentence="Standard deviation of the corrections."),
        Figure(name="dh_median", value=_known(whole.median), unit="m", sentence="Median correction."),
        Figure(
            name="dh_nmad",
            value=_known(whole.nmad),
            unit="m",
            headline=True,
            sentence="Robust spread of the corrections: agreement of surface and photographs, not the accuracy of the surface.",
        ),
        Figure(
            name="dh_within_1_sigma",
            value=_known(100 * whole.within_1, 1),
            unit="%",
            sentence="Cells whose correction is below its own standard error (68 % if only chance were at work).",
        ),
        Figure(
            name="dh_within_3_sigma",
            value=_known(100 * whole.within_3, 1),
            unit="%",
            sentence="Cells whose correction is below three of its standard errors.",
        ),
        Figure(
            name="checked",
            value=_share(checked, heights),
            unit="%",
            headline=True,
            sentence="Share of the measured cells that could be checked.",
        ),
        Figure(
            name="changed", value=_share(changed, heights), unit="%", sentence="Share of the measured cells that the check changed."
        ),
        Figure(name="pairs", value=len(pairs.pairs), sentence="Pairs of orthoimages that the check compared."),
        Figure(
            name="pixel_height",
            value=_known(pairs.pixel_height),
            unit="m",
            sentence="Height error that shifts the two orthoimages by one pixel, on average.",
        ),
    )


def _place_figures(trend: Trend, areas: list[SuspiciousArea]) -> tuple[Figure, ...]:
    return (
        Figure(
            name="suspicious_areas",
            value=len(areas),
            headline=True,
            sentence="Connected areas where the surface leaves its own trend clearly, too high or too low.",
        ),
        Figure(name="suspicious_area", value=round(sum(a.area for a in areas), 1), unit="m2", sentence="Their area together."),
        Figure(name="tilt_east", value=_known(trend.east), unit="m/km", sentence="How the correction grows to the east."),
        Figure(name="tilt_north", value=_known(trend.north), unit="m/km", sentence="How the correction grows to the north."),
        Figure(
            name="trend_range",
            value=_known(trend.range),
            unit="m",
            sentence="Difference of the trend of the corrections between the corners of the surface.",
        ),
    )


def _of_pair(tiles: tuple[TileCounts, ...], name: str) -> list:
    return [pair for tile in tiles for pair in tile.pairs if pair.pair == name]


def _pairs_grid(tiles: tuple[TileCounts, ...], pairs: CheckedPairs) -> Grid:
    rows = []
    for pair in pairs.pairs:
        parts = _of_pair(tiles, pair.name)
        s = summarised(added([part.dh for part in parts]), pairs.pixel_height)
        tried = sum(sum(part.outcomes) for part in parts) - sum(part.outcomes[Outcome.OUTSIDE] for part in parts)
        rows.append(
            (
                pair.name,
                round(pair.base_height, 3),
                tried,
                _share(s.number, tried),
                _known(s.mean),
                _known(s.std),
                _known(s.median),
                _known(s.nmad),
                _known(100 * s.within_1, 1),
                _known(100 * s.within_3, 1),
            )
        )
    return Grid(
        title="The check by pairs",
        rows=tuple(rows),
        columns=(
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
        ),
        note="A mean that differs from pair to pair points at the orientation rather than at the surface. Errors that surface and "
        "check share stay unseen: orientation and camera, and, where the surface was matched in the same photographs, what "
        "matching gets wrong at building edges, in trees and in narrow gaps.",
    )


def _outcomes_grid(tiles: tuple[TileCounts, ...], pairs: CheckedPairs) -> Grid:
    every = [part.outcomes for pair in pairs.pairs for part in _of_pair(tiles, pair.name)]
    totals = np.sum(every or [[0] * len(Outcome)], axis=0)
    return Grid(
        title="What became of the nodes",
        columns=("outcome", "nodes"),
        rows=tuple((Outcome(code).sentence, int(number)) for code, number in enumerate(totals) if number),
        note="Vehicles that moved and places that only one photograph sees must fail here; what slips through is a false alarm.",
    )


def _areas_grid(areas: list[SuspiciousArea]) -> tuple[Grid, ...]:
    if not areas:
        return ()
    rows = tuple(
        (round(a.x, 1), round(a.y, 1), round(a.area, 1), round(a.dh, 2), round(a.extreme, 2), _side(a.dh)) for a in areas[:_LISTED]
    )
    columns = ("X (m)", "Y (m)", "area (m2)", "mean correction (m)", "greatest (m)", "surface is")
    note = f"The {len(rows)} largest of {len(areas)} by volume, against the trend of the whole surface: look at them first."
    return (Grid(title="Suspicious areas", columns=columns, rows=rows, note=note),)


def _histogram(counts: Counts, pixel_height: float) -> Chart:
    values, filled = np.array(counts.bins) * bin_width(pixel_height), np.array(counts.filled)
    reach = max(4 * summarised(counts, pixel_height).nmad, 0.5 * pixel_height)
    edges = np.linspace(-reach, reach, 42)
    number, _ = np.histogram(np.clip(values, -reach, reach), edges, weights=filled)
    return Chart(
        title="Corrections of the surface",
        style="bars",
        x_label="dh (m)",
        y_label="cells",
        x=tuple(((edges[:-1] + edges[1:]) / 2).round(4).tolist()),
        series={"cells": tuple(map(float, number))},
        caption="Photographs minus surface model; the outermost bars hold everything beyond.",
    )


def _pictures(pairs: CheckedPairs, whole: Summary) -> tuple[Picture, ...]:
    reach = round(max(5 * whole.nmad, pairs.pixel_height), 2) if whole.number else None
    low = -reach if reach else None
    return (
        Picture(
            title="Check of the surface",
            raster=DH,
            style="diverging",
            unit="m",
            low=low,
            high=reach,
            caption="Correction that the photographs ask for. Negative: the surface is too high. Empty: could not be checked.",
        ),
        Picture(
            title="Precision of the check", raster=PRECISION, style="ramp", unit="m", caption="Standard error of the correction."
        ),
        Picture(title="Surface after the check", raster=CORRECTED, style="hillshade", unit="m"),
    )


def _surface_warnings(tiles: tuple[TileCounts, ...], trend: Trend, pairs: CheckedPairs) -> Iterator[str]:
    heights, checked = sum(tile.heights for tile in tiles), sum(tile.checked for tile in tiles)
    if checked < 0.5 * heights:
        yield (
            f"Only {_share(checked, heights):.0f} % of the surface could be checked; the rest lies outside the pairs of "
            "photographs, has too little texture, or is hidden in one of them."
        )
    if abs(trend.middle) > 0.3 * pairs.pixel_height:
        yield f"The surface as a whole is {_side(trend.middle)} by about {abs(trend.middle):.2f} m against the photographs."
    if trend.range > 0.5 * pairs.pixel_height:
        yield (
            f"The surface is tilted against the photographs: the correction grows by {trend.east:.2f} m per km to the east "
            f"and by {trend.north:.2f} m per km to the north, {trend.range:.1f} m in all."
        )


def _area_warnings(areas: list[SuspiciousArea]) -> Iterator[str]:
    if not areas:
        return
    named = "; ".join(
        f"{_side(area.dh)} by about {abs(area.dh):.2g} m over {area.area:.2g} m2 at X {area.x:.0f}, Y {area.y:.0f}"
        for area in areas[:_WARNED]
    )
    more = f"; {len(areas) - _WARNED} more areas stand in the table" if len(areas) > _WARNED else ""
    yield f"Photographs and surface disagree in places: the surface is {named}{more}."


def _side(dh: float) -> str:
    return "too high" if dh < 0 else "too low"
