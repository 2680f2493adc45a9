"""The report on the orthoimage: how many photos see each pixel, the contribution of each photo, and how well they agree."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from statistics import fmean
from typing import Literal

from orthomill.schemas.maps.straight_edges import EDGES
from orthomill.schemas.stage_report import Accuracy, Answer, Chart, Figure, Grid, Picture, Product, StageReport, Topic, Verdict
from orthomill.schemas.surface import HEIGHT_SOURCE, HEIGHT_SOURCE_CODES, ORTHO, HeightSource
from orthomill.tasks.colouring.balance.photo_radiometry import PhotoRadiometry, Radiometry
from orthomill.tasks.colouring.blending.colour_sums import ColourSums, sum_of
from orthomill.tasks.colouring.report.colour_words import (
    MORE_SIDES,
    balance_figures,
    coverage_classes,
    coverage_picture,
    difference_figure,
    percent,
    rejected_figure,
    seen_figures,
)
from orthomill.tasks.texture.edges.drawn_edges import DrawnEdges, all_drawn
from orthomill.tasks.texture.edges.grown_lines import EdgeSums
from orthomill.tasks.texture.mosaic import TileTexture

COVERAGE = "texture/coverage"
"""uint8: number of photographs that see the pixel; 0 also where there is no height"""
REJECTED = "texture/rejected"
"""uint8: number of colours rejected at the pixel"""

_SEEN = ("seen_by_0", "seen_by_1", "seen_by_2", "seen_by_3_or_more")
_DIGITS = 3
_PHOTO_COLUMNS = (
    "photo",
    "pixels seen",
    "part of the orthoimage %",
    *(f"gain {channel}" for channel in (1, 2, 3)),
    *(f"offset {channel}" for channel in (1, 2, 3)),
    "falloff at the corner",
    "samples",
)
_BOTH: tuple[Accuracy, ...] = ("plan", "height")
_PRODUCTS = (
    Product(path="products/ortho.tif", purpose="Orthoimage, true to the surface, for any GIS", main=True, classed=("plan",)),
    Product(path="products/points.laz", purpose="Point cloud in colour: every matched point", main=True, classed=_BOTH),
    Product(
        path="products/points",
        purpose="Point cloud in colour: every matched point, one file for each tile",
        main=True,
        classed=_BOTH,
    ),
    Product(path="products/dsm_cells.laz", purpose="The surface model as a point cloud in colour", main=True, classed=_BOTH),
    Product(path="products/ortho_source.tif", purpose="Which photograph weighs most at a place, and how many see it"),
    Product(path="products/ortho_seams.gpkg", purpose="Seams: the area of every photograph in the orthoimage, and its time"),
    Product(path="products/ortho_height_source.tif", purpose="Where the orthoimage rests on measured, estimated or draped heights"),
)
_EDGE_PRODUCTS = (
    Product(
        path=EDGES,
        purpose="Straight edges of roofs and walls as lines in space, measured in the photographs, with standard errors",
        classed=_BOTH,
    ),
    Product(path="products/edges.dxf", purpose="The same for CAD", classed=_BOTH),
)
_FILLED = 0.99
"""Share of the photographed ground that a good orthoimage shows."""
# Shares of pixels and colours, and grey levels, from which on a warning helps: below, vehicles and facades explain them.
_MOST_JAGGED, _MORE_THAN_PHOTOS = 1.0, 1.5  # px; times what photographs show
_MOST_HIDDEN, _MOST_REJECTED, _MOST_DIFFERENCE = 0.05, 0.25, 10.0


@dataclass(frozen=True)
class TextureFacts:
    """Facts known at planning: cell sizes, m, the median ground pixel of the photos, and the raster of heights."""

    cell: float
    dsm_cell: float
    ground_pixel: float
    heights: str


@dataclass(frozen=True)
class _Totals:
    """Sums over all tiles."""

    pixels: int
    heights: tuple[int, ...]
    """by code of HeightSource"""
    outside: int
    hidden: int
    missed: int
    colours: ColourSums
    drawn: DrawnEdges

    @property
    def with_height(self) -> int:
        """Pixels that have a height."""
        return self.pixels - self.heights[HeightSource.NONE]


def _totals(statistics: tuple[TileTexture, ...]) -> _Totals:
    return _Totals(
        pixels=sum(tile.pixels for tile in statistics),
        heights=tuple(sum(tile.heights[code] for tile in statistics) for code in HeightSource),
        outside=sum(tile.outside for tile in statistics),
        hidden=sum(tile.hidden for tile in statistics),
        missed=sum(tile.missed for tile in statistics),
        colours=sum_of(tile.colours for tile in statistics),
        drawn=all_drawn([tile.drawn for tile in statistics]),
    )


def _share(part: float, whole: float) -> float:
    return percent(part, whole, _DIGITS)


def _figures(totals: _Totals, radiometry: Radiometry, facts: TextureFacts) -> tuple[Figure, ...]:
    return (
        *_pixel_figures(totals, facts),
        *_seen_figures(totals),
        rejected_figure("rejected_share", totals.colours, _DIGITS),
        difference_figure("seam_difference", totals.colours, _DIGITS),
        *balance_figures(radiometry, _DIGITS),
    )


def _pixel_figures(totals: _Totals, facts: TextureFacts) -> tuple[Figure, ...]:
    ground_pixel, height = round(facts.ground_pixel, 4), _share(totals.with_height, totals.pixels)
    interpolated = "Pixels whose height was interpolated for the texture only."
    guessed = "Pixels whose height the surface model estimates."
    draped, estimated = (_share(totals.heights[code], totals.pixels) for code in (HeightSource.DRAPED, HeightSource.ESTIMATED))
    return (
        Figure(name="cell", value=facts.cell, unit="m", sentence="Pixel of the orthoimage on the ground."),
        Figure(name="photo_ground_pixel", value=ground_pixel, unit="m", sentence="Pixel of the photos on the ground, median."),
        Figure(name="pixels", value=totals.pixels, sentence="Pixels of the orthoimage."),
        Figure(name="height_share", value=height, unit="%", sentence="Pixels that have a height."),
        Figure(name="estimated_share", value=estimated, unit="%", sentence=guessed),
        Figure(name="draped_share", value=draped, unit="%", sentence=interpolated),
    )


def _seen_figures(totals: _Totals) -> tuple[Figure, ...]:
    empty = (
        ("outside_share", totals.outside, "Pixels without colour in the frame of no photo, or beyond the area that is wanted."),
        (
            "occluded_share",
            totals.hidden,
            "Pixels without colour because a measured surface hides them from every photo that shows the place.",
        ),
        ("missed_share", totals.missed, "Pixels without colour although a photo sees them, for want of a height."),
    )
    return (
        *seen_figures(_SEEN, totals.colours, totals.pixels, _DIGITS, of="Pixels", none="no photo, or without height"),
        *(Figure(name=name, value=_share(count, totals.pixels), unit="%", sentence=words) for name, count, words in empty),
    )


def _edge_figures(edges: tuple[EdgeSums, ...]) -> Iterator[Figure]:
    if not edges:
        return
    lines, length = sum(sheet.lines for sheet in edges), sum(sheet.length for sheet in edges)
    yield Figure(name="edges", value=lines, sentence="Straight edges of roofs and walls that were measured in the photographs.")
    yield Figure(name="edge_length", value=round(length, 1), unit="m", sentence="Their length in plan.")
    if length:
        sigma = (sum(sheet.variance for sheet in edges) / length) ** 0.5
        yield Figure(
            name="edge_sigma",
            value=round(sigma, 4),
            unit="m",
            sentence="Standard error across them, within the block (root mean square along all of them).",
        )


def _drawn_figures(drawn: DrawnEdges) -> Iterator[Figure]:
    if not drawn.places:
        return
    known = "Places at edges that are straight in the photographs, whose edge the orthoimage shows."
    own = "Departure of these edges from straight lines in the orthoimage (root mean square)."
    photos = "The same in the photograph that looks down most steeply: noise, and what lies beside them."
    shares = (
        ("edges_drawn", _share(drawn.drawn, drawn.places), "%", known),
        ("edges_jagged", drawn.jagged, "px", own),
        ("edges_jagged_in_photos", drawn.photo_jagged, "px", photos),
    )
    for name, value, unit, sentence in shares:
        if value is not None:
            yield Figure(name=name, value=round(value, 3), unit=unit, sentence=sentence)


def _photo_grid(statistics: tuple[TileTexture, ...], radiometry: Radiometry) -> Grid:
    seen: Counter[str] = Counter()
    share = sum_of(tile.colours for tile in statistics).shares
    for tile in statistics:
        seen.update(tile.photo_seen)
    whole = sum(share.values())
    return Grid(
        title="Contribution of each photo",
        columns=_PHOTO_COLUMNS,
        rows=tuple(_photo_row(photo, seen[photo.photo], _share(share.get(photo.photo, 0.0), whole)) for photo in radiometry.photos),
        note="Gains and offsets are relative to the block's mean; the falloff is the share of light lost (negative) at "
        "the corners.",
    )


def _photo_row(photo: PhotoRadiometry, seen: int, share: float) -> tuple[str | int | float, ...]:
    # r is 1 at the corner: there the falloff is v1 + v2.
    falloff = round(fmean(photo.v1) + fmean(photo.v2), 4)
    return (
        photo.photo,
        seen,
        share,
        *(round(g, 4) for g in photo.gain),
        *(round(o, 2) for o in photo.offset),
        falloff,
        photo.samples,
    )


def _filled(totals: _Totals) -> float:
    """Share of the pixels in the frame of a photograph, within the area that is wanted, that have a colour."""
    shown = totals.pixels - totals.outside
    return (shown - totals.hidden - totals.missed) / shown if shown else 0.0


def _verdict(totals: _Totals) -> Verdict:
    filled, heights = _filled(totals), totals.heights
    if not filled:
        return Verdict(level="poor", sentence="The orthoimage is empty.", weighs=True)
    # Draped heights are left out: most of them lie beyond the photographs.
    estimated = _share(heights[HeightSource.ESTIMATED], heights[HeightSource.ESTIMATED] + heights[HeightSource.MEASURED])
    rests = f"; {estimated:.0f} % of its heights are estimates, where it may be displaced" if estimated >= 1 else ""
    level: Literal["good", "fair"] = "good" if filled >= _FILLED else "fair"
    return Verdict(
        level=level, sentence=f"The orthoimage shows {_percent(filled)} of the ground in the photographs{rests}.", weighs=True
    )


def _percent(share: float) -> str:
    # 99.95 % must not be rounded to all of it.
    return "all" if share == 1.0 else f"{min(100 * share, 99.9):.1f} %"


def _answers(totals: _Totals, facts: TextureFacts) -> Iterator[Answer]:
    pixel = f"{facts.cell:.3g} m in the orthoimage, {facts.ground_pixel:.2g} m in the photographs"
    yield Answer(topic=Topic.GROUND_PIXEL, text=pixel)
    twice = _share(totals.colours.seen[2] + totals.colours.seen[3], totals.pixels - totals.outside)
    yield Answer(
        topic=Topic.ORTHOIMAGE, text=f"shows {_percent(_filled(totals))} of the photographed ground, {twice:.0f} % from two or more"
    )


def _doubts(totals: _Totals) -> Iterator[str]:
    """What speaks against the heights and the orientation that the orthoimage was made with."""
    if totals.colours.seen[0] == totals.pixels:
        yield "The orthoimage is empty: no photo sees any ground that has a height. Check the surface model first."
    rejected, values = totals.colours.rejected, totals.colours.values
    if values and rejected > _MOST_REJECTED * values:
        yield (
            f"{_share(rejected, values):.0f} % of all colours were rejected: heights or orientation may be wrong, "
            "or the photos differ in more than brightness. On the map of rejected colours, "
            "scattered ones are traffic and leaves, patches are wrong heights."
        )


def _other_warnings(statistics: tuple[TileTexture, ...], totals: _Totals, radiometry: Radiometry) -> Iterator[str]:
    if totals.hidden > _MOST_HIDDEN * totals.pixels:
        yield (
            f"{_share(totals.hidden, totals.pixels):.1f} % of the orthoimage is hidden by objects in front from every photo that "
            f"shows the place; it stays transparent. {MORE_SIDES}"
        )
    yield from _frayed(totals.drawn)
    yield from _balance_warnings(radiometry)
    idle = [photo.photo for photo in radiometry.photos if not any(tile.photo_seen.get(photo.photo) for tile in statistics)]
    if idle:
        yield f"No ground of the orthoimage is seen by: {', '.join(idle)}."


def _frayed(drawn: DrawnEdges) -> Iterator[str]:
    jagged, in_photos = drawn.jagged or 0.0, drawn.photo_jagged or 0.0
    if jagged > max(_MOST_JAGGED, _MORE_THAN_PHOTOS * in_photos):
        yield (
            f"Edges of roofs and walls are frayed: they depart by {jagged:.1f} px from straight lines, in the photographs by "
            f"{in_photos:.1f} px. Heights beside walls may be wrong; draw along the lines of {EDGES}, not along the orthoimage."
        )


def _balance_warnings(radiometry: Radiometry) -> Iterator[str]:
    if len(radiometry.photos) > 1 and not radiometry.points:
        yield "The photos were not adjusted to one brightness: no ground is seen by two of them, or balance is none."
    if radiometry.difference_median_after is not None and radiometry.difference_median_after > _MOST_DIFFERENCE:
        yield (
            f"After the radiometric balance the photos still differ by {radiometry.difference_median_after:.0f} grey "
            "levels (median): seams may show. Take photographs in one light, or leave out those that differ."
        )


def _pictures(most: int) -> tuple[Picture, ...]:
    return (
        Picture(
            title="True orthoimage",
            raster=ORTHO,
            style="rgb",
            caption="Blended from all photographs that see the ground, or, where its height is unsure, from the one that looks down"
            " most steeply; transparent where none does.",
            first_page=True,
        ),
        coverage_picture("Coverage", COVERAGE, coverage_classes(most)),
        _rejection_picture(most),
        _height_source_picture(),
    )


def _rejection_picture(most: int) -> Picture:
    # Counts from three on are listed one by one, for a picture of classes needs every code that occurs.
    several = tuple((count, "#7b1fa2", f"{count} colours") for count in range(3, max(most, 3) + 1))
    return Picture(
        title="Rejected colours",
        raster=REJECTED,
        style="classes",
        caption="Vehicles, people, leaves, and places where heights are wrong.",
        classes=((0, "#ffffff", "none"), (1, "#fdae61", "one"), (2, "#d7191c", "two"), *several),
    )


def _height_source_picture() -> Picture:
    return Picture(
        title="Where heights come from",
        raster=HEIGHT_SOURCE,
        style="classes",
        classes=HEIGHT_SOURCE_CODES,
        caption="Where the height is estimated or draped, the orthoimage may be displaced; products/ortho_height_source.tif.",
    )


def texture_report(
    statistics: tuple[TileTexture, ...], radiometry: Radiometry, edges: tuple[EdgeSums, ...], facts: TextureFacts
) -> StageReport:
    """The report of the stage from the statistics of all tiles and the sums of all sheets of straight edges."""
    most = max((tile.most for tile in statistics), default=0)
    totals = _totals(statistics)
    chart = Chart(
        title="Pixels by number of photos",
        style="bars",
        x_label="photos (3: three or more)",
        y_label="pixels",
        x=(0.0, 1.0, 2.0, 3.0),
        series={"pixels": tuple(float(count) for count in totals.colours.seen)},
    )
    return StageReport(
        verdict=_verdict(totals),
        answers=tuple(_answers(totals, facts)),
        products=(*_PRODUCTS, *(_EDGE_PRODUCTS if edges else ())),
        doubts=tuple(_doubts(totals)),
        losses=tuple(_other_warnings(statistics, totals, radiometry)),
        figures=(*_figures(totals, radiometry, facts), *_edge_figures(edges), *_drawn_figures(totals.drawn)),
        grids=(_photo_grid(statistics, radiometry),),
        charts=(chart,),
        pictures=_pictures(most),
        warnings=(*_doubts(totals), *_other_warnings(statistics, totals, radiometry)),
    )
