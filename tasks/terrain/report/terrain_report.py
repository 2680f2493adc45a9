"""What is said of the terrain: how much of it was measured, how well the rest is known, and what stands on it."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import sqrt
from typing import Literal

from orthomill.schemas.bare_ground import (
    ABOVE_GROUND,
    CELL_CLASS,
    CELL_CLASSES,
    TERRAIN,
    TERRAIN_CODE,
    TERRAIN_CODES,
    TERRAIN_PRECISION,
    TerrainCode,
)
from orthomill.schemas.stage_report import Answer, Chart, Figure, Grid, Picture, Product, StageReport, Topic, Verdict
from orthomill.tasks.terrain.contours.contour_interval import ContourInterval
from orthomill.tasks.terrain.ground.learned_errors import LEAST_SAMPLES, FillErrors
from orthomill.tasks.terrain.terrain_sums import TerrainSums

_NAMES = {
    TerrainCode.MEASURED: "measured",
    TerrainCode.UNDER_BUILDING: "under_buildings",
    TerrainCode.UNDER_WOOD: "under_wood",
    TerrainCode.GUESSED: "guessed",
    TerrainCode.WATER: "water",
}
_INVENTED = (TerrainCode.UNDER_BUILDING, TerrainCode.UNDER_WOOD, TerrainCode.GUESSED)
_PRODUCTS = (
    Product(
        path="products/terrain.tif",
        purpose="Bare ground without buildings and trees, its standard error, and where it was measured, bridged or guessed",
        main=True,
        classed=("plan", "height"),
    ),
    Product(path="products/height_above_ground.tif", purpose="Heights of buildings and trees above the ground"),
    Product(path="products/classes.tif", purpose="Ground, buildings and plants by the numbers of ASPRS"),
)
_CONTOUR_PRODUCTS = (
    Product(path="products/contours.gpkg", purpose="Contours for a GIS, dashed where the ground was not measured", main=True),
    Product(path="products/contours.dxf", purpose="Contours for CAD: layers for index, plain and dashed lines"),
    Product(path="products/contours.geojson", purpose="Contours in longitude and latitude"),
)
_GOOD, _FAIR = 0.6, 0.2
"""share of the terrain that was measured"""


@dataclass(frozen=True)
class TerrainFacts:
    """Cell of the terrain, and the block in which ground was told from objects, m."""

    cell: float
    block: float


@dataclass(frozen=True)
class _TerrainTotals:
    cells: tuple[int, ...]
    squares: tuple[float, ...]
    classes: tuple[int, ...]
    tallest: float

    @property
    def terrain(self) -> int:
        """Cells that have a ground."""
        return sum(self.cells[1:])

    def share(self, code: int) -> float:
        return 100.0 * self.cells[code] / self.terrain if self.terrain else 0.0

    def error(self, code: int) -> float | None:
        """Root mean square of the standard errors, m."""
        return sqrt(self.squares[code] / self.cells[code]) if self.cells[code] else None


def terrain_report(
    sums: tuple[TerrainSums, ...], errors: FillErrors, facts: TerrainFacts, interval: ContourInterval | None = None
) -> StageReport:
    """The report of the stage from the sums of all tiles and what hiding ground told."""
    totals = _TerrainTotals(
        tuple(map(sum, zip(*(tile.cells for tile in sums), strict=True))),
        tuple(map(sum, zip(*(tile.squares for tile in sums), strict=True))),
        tuple(map(sum, zip(*(tile.classes for tile in sums), strict=True))),
        max(tile.tallest for tile in sums),
    )
    warnings = tuple(_warnings(totals, errors))
    return StageReport(
        verdict=_verdict(totals),
        answers=_answers(totals),
        products=(*_PRODUCTS, *(_CONTOUR_PRODUCTS if interval else ())),
        figures=(*_figures(totals, errors, facts), *_contour_figures(interval)),
        grids=(_code_grid(totals), _class_grid(totals)),
        charts=(_error_chart(errors, facts),),
        pictures=_pictures(),
        warnings=warnings,
        losses=warnings,
    )


def _verdict(totals: _TerrainTotals) -> Verdict:
    if not totals.terrain:
        return Verdict(level="poor", sentence="There is no terrain: nowhere was ground found among the measured heights.")
    measured, water = totals.share(TerrainCode.MEASURED), totals.share(TerrainCode.WATER)
    level: Literal["good", "fair", "poor"] = "good" if measured >= 100 * _GOOD else "fair" if measured >= 100 * _FAIR else "poor"
    return Verdict(
        level=level,
        sentence=f"{measured:.0f} % of the terrain is measured ground; {totals.share(TerrainCode.UNDER_BUILDING):.0f} % is bridged "
        f"under buildings, {totals.share(TerrainCode.UNDER_WOOD):.0f} % under trees and shrubs, "
        f"{totals.share(TerrainCode.GUESSED):.0f} % is guessed{f', {water:.0f} % is water' if water else ''}.",
    )


def _answers(totals: _TerrainTotals) -> tuple[Answer, ...]:
    if not totals.terrain:
        return ()
    known = totals.error(TerrainCode.MEASURED)
    text = f"{totals.share(TerrainCode.MEASURED):.0f} % measured"
    if known is not None:
        text += f", standard error {_metres(known)}"
    squares, cells = (sum(of[code] for code in _INVENTED) for of in (totals.squares, totals.cells))
    if cells:
        text += f"; the rest bridged or guessed, {_metres(sqrt(squares / cells))}"
    return (Answer(topic=Topic.TERRAIN, text=text),)


def _metres(value: float) -> str:
    return f"{value:.2f} m" if value >= 0.1 else f"{100 * value:.1f} cm"


def _figures(totals: _TerrainTotals, errors: FillErrors, facts: TerrainFacts) -> Iterator[Figure]:
    yield Figure(name="cell", value=facts.cell, unit="m", sentence="Cell of the terrain.")
    yield Figure(
        name="block", value=facts.block, unit="m", sentence="Side of the blocks in which ground is separated from objects."
    )
    meanings = {code: meaning for code, _, meaning in TERRAIN_CODES}
    for code, name in _NAMES.items():
        share = round(totals.share(code), 2)
        yield Figure(
            name=f"{name}_share",
            value=share,
            unit="%",
            sentence=f"Of the terrain: {meanings[code]}.",
            headline=code == TerrainCode.MEASURED,
        )
        error = totals.error(code)
        rounded = None if error is None else round(error, 4)
        yield Figure(
            name=f"{name}_sigma", value=rounded, unit="m", sentence=f"Root mean square of the standard errors: {meanings[code]}."
        )
    yield Figure(name="highest_object", value=totals.tallest, unit="m", sentence="Greatest height above the ground.")
    hidden = sum(errors.enclosed.samples) + sum(errors.one_sided.samples)
    sentence = "Samples of measured ground that were hidden and bridged again, to learn its errors."
    yield Figure(name="hidden_blocks", value=hidden, sentence=sentence)
    why = "By how much ground is measured too high at the foot of walls and crowns, which is taken off."
    yield Figure(name="lifted_at_objects", value=round(errors.lifted[0], 4), unit="m", sentence=why)


def _contour_figures(interval: ContourInterval | None) -> Iterator[Figure]:
    if interval is not None:
        why = "Interval of the contours: nine of ten points of measured ground lie within half of it, but for what all share."
        yield Figure(name="contour_interval", value=interval.interval, unit="m", sentence=why)


def _warnings(totals: _TerrainTotals, errors: FillErrors) -> Iterator[str]:
    if totals.terrain and max(errors.enclosed.samples) < LEAST_SAMPLES:
        yield (
            "Too little open ground was measured to learn how wrong bridged ground is: its standard errors are those of hilly "
            "land. "
            "Trust the terrain only where its code says measured."
        )
    if totals.terrain and totals.share(TerrainCode.GUESSED) > 20:
        yield (
            f"{totals.share(TerrainCode.GUESSED):.0f} % of the terrain is guessed: no ground was measured there, or on one side "
            "only. "
            "Fly beyond the area that is needed, and when trees are bare."
        )


def _code_grid(totals: _TerrainTotals) -> Grid:
    rows = []
    for code, _, meaning in TERRAIN_CODES[1:]:
        error = totals.error(code)
        rows.append((meaning, round(totals.share(code), 2), None if error is None else round(error, 3)))
    return Grid(title="Where the ground comes from", columns=("ground", "share %", "standard error m"), rows=tuple(rows))


def _class_grid(totals: _TerrainTotals) -> Grid:
    whole = sum(totals.classes[1:])
    rows = [(meaning, code, round(100.0 * totals.classes[code] / whole, 2)) for code, _, meaning in CELL_CLASSES[1:] if whole]
    return Grid(
        title="What the surface shows",
        columns=("class", "number", "share %"),
        rows=tuple(row for row in rows if row[2]),
        note="Numbers of ASPRS, LAS 1.4. Plants and buildings differ by their surface alone: hedges and sheds may be mixed up.",
    )


def _error_chart(errors: FillErrors, facts: TerrainFacts) -> Chart:
    samples = errors.enclosed.samples
    known = [k for k, count in enumerate(samples) if count >= LEAST_SAMPLES] or list(range(len(samples)))
    return Chart(
        title="How wrong bridged ground is",
        style="lines",
        x_label="distance to measured ground, m",
        y_label="standard error, m",
        x=tuple(round(errors.distance[k] * facts.block, 3) for k in known),
        series={
            "ground on all sides": tuple(round(errors.enclosed.error[k], 4) for k in known),
            "ground on one side": tuple(round(errors.one_sided.error[k], 4) for k in known),
        },
        caption="Learned by hiding measured ground of this block and bridging it again. Where the ground beyond a gap bends, on "
        "hilltops and in valleys, the error is larger: by a share of that bend, learned as well.",
    )


def _pictures() -> tuple[Picture, ...]:
    return (
        Picture(
            title="Terrain",
            raster=TERRAIN,
            style="hillshade",
            unit="m",
            caption="The bare ground, without buildings and trees.",
            first_page=True,
        ),
        Picture(
            title="Where the terrain was measured",
            raster=TERRAIN_CODE,
            style="classes",
            classes=TERRAIN_CODES,
            caption="Contours are drawn dashed where the ground was not measured; products/terrain.tif, band 3.",
        ),
        Picture(title="Standard error of the terrain", raster=TERRAIN_PRECISION, style="ramp", unit="m", low=0.0, colours="magma"),
        Picture(
            title="Height above the ground", raster=ABOVE_GROUND, style="ramp", unit="m", low=0.0, caption="Buildings and trees."
        ),
        Picture(title="What the surface shows", raster=CELL_CLASS, style="classes", classes=CELL_CLASSES),
    )
