"""What is reported of a surface model, whatever matched it: figures, codes, pictures, its verdict, answers and products.

Every way of matching adds what it knows of itself (densification report, lines, guided): none can leave out whether its surface is
good. What is said rests on three things: how many heights are estimates, how precise the others are stated to be, and how many tie
points contradict them.
"""

from collections.abc import Iterator
from math import inf
from typing import Literal

from orthomill.schemas.stage_report import Answer, Chart, Figure, Grid, Picture, Product, StageReport, Topic, Verdict
from orthomill.schemas.surface import (
    COUNT,
    DATUM_PRECISION,
    ESTIMATED,
    HEIGHT,
    MEASURED,
    PROVENANCE,
    PROVENANCE_CODES,
    RELATIVE_PRECISION,
    Provenance,
    Surface,
)
from orthomill.tasks.densification.precision.class_medians import height_error_middles, median_height_error, median_tie_distance
from orthomill.tasks.densification.precision.tie_points import TieCounts
from orthomill.tasks.densification.surface_tile import SurfaceStatistics

_DISPUTED_LIMIT = 0.05
"""share of heights on which pairs disagree that is worth a warning"""
_ARE_ESTIMATES = "of the heights are estimates"
_ESTIMATED_LIMIT = 0.1
"""share of heights that were not measured that is worth a warning"""
_MOST_ESTIMATED = 0.5
"""share of the heights: with more, the surface is a sketch for most of its area"""
_TIES_FOUND = "tie points lie off the surface by more than three standard errors"
_COARSE_FOUND = "stated to no better than"
_ENOUGH_TIES = 30
"""tie points from which on their shares are stated"""
_OFF, _MOSTLY_OFF = 0.1, 0.2
"""share of the tie points that contradict a surface, or lie a pixel of parallax off it, above which it is usable within limits and
in doubt: below leaves and beside walls some always do"""
_COARSE = 1.0
"""pixels of parallax: a surface whose heights are stated to be less precise is usable within limits"""
_WALL_BLIND = (
    "This way of matching compares windows that know no walls. Its standard errors are too large on open ground, and on roofs, "
    "beside walls and at trees some heights are wrong by many of them: do not rely on that of a single height there. The windows "
    "of the default (object_space) keep to one surface."
)
_OF_A_PIXEL = 4
"""classes of distances of tie points that a pixel of parallax is wide"""
_AREAS = (("km²", 1e6, 1e6), ("ha", 1e3, 1e4), ("m²", 0.0, 1.0))
"""units of an area: from how many m2 on, and how many m2 they are"""

SURFACE_FIGURES = (
    ("cell", "m", "Cell size of the surface model."),
    ("rows", "", "Rows of the surface model."),
    ("columns", "", "Columns of the surface model."),
    ("cells_with_height", "", "Cells that carry a height, measured or estimated."),
    ("cells_measured", "", "Cells with a measured height."),
    ("completeness_grid", "", "Share of all cells of the rectangular grid; ground that no pair sees counts as empty."),
    ("share_measured", "", "Measured heights; the others are estimated."),
    ("share_agreed", "", "Heights on which two or more pairs agree."),
    ("share_one_pair", "", "Heights from a single pair."),
    ("share_disputed", "", "Heights on which the pairs disagree."),
    ("share_volume", "", "Heights that all photographs together measured, and no single pair."),
    ("share_incoherent", "", "Estimated heights: the best of the volume, contradicted by their neighbours."),
    ("share_coarse", "", "Estimated heights: shown by photographs, less sharply than their cells."),
    ("share_filled", "", "Estimated heights: interpolated between their neighbours."),
    ("spikes_removed", "", "Heights of pairs removed by the spike filter."),
    ("precision_median", "m", "Median standard error of a measured height among its neighbours."),
    ("datum_precision_median", "m", "Median standard error that the orientation adds, common to neighbours."),
    ("tie_points", "", "Tie points on measured heights, with which the surface was compared."),
    ("tie_points_off", "m", "Median distance of the tie points from the surface, beyond the heights of the cells around."),
    ("tie_points_contradicting", "", "Share of them that lie more than three standard errors (theirs and the height's) off it."),
    ("tie_points_pixel_off", "", "Share of them that lie off it by more than the height of one pixel of parallax."),
    ("height_lowest", "m", "Lowest height of the surface model."),
    ("height_highest", "m", "Highest height of the surface model."),
)
"""name, unit and meaning of every figure of a surface, in the order of the report"""
_LABELS = {
    "precision_median": "Precision among neighbours",
    "datum_precision_median": "Precision of the datum",
    "completeness_nodes": "Matched of what photographs share",
    "completeness_grid": "Filled of the rectangle",
    "parallax_precision_median": "Precision of matching",
    "share_incoherent": "Estimated, contradicted by neighbours",
    "share_coarse": "Estimated, shown less sharply",
    "share_filled": "Estimated from neighbours",
    "share_volume": "Measured by all photographs together",
    "tie_points_off": "Tie points off the surface",
}
"""what people call a figure whose name does not say it"""
_HEADLINES = ("completeness_nodes", "precision_median")
_PRODUCTS = (
    Product(
        path="products/dsm.tif", purpose="Surface model: heights with their standard errors", main=True, classed=("plan", "height")
    ),
    Product(path="products/dsm_provenance.tif", purpose="Where each height comes from: measured or estimated"),
)


def surface_report(
    surface: Surface, cells: SurfaceStatistics, ties: TieCounts, without: tuple[str, ...] = (), wall_blind: bool = False
) -> StageReport:
    """The parts that every surface has; without: names of figures that its way of matching does not know; wall_blind: whether its
    windows know no walls, so that standard errors do not hold place by place."""
    values = _surface_values(surface, cells, ties)
    warnings = tuple(_surface_warnings(cells, ties, median_height_error(cells.precision, surface.grid.cell)))
    verdict = _verdict(cells, surface, ties)
    return StageReport(
        verdict=_of_wall_blind(verdict) if wall_blind else verdict,
        answers=tuple(_answers(cells, surface)),
        products=_PRODUCTS,
        doubts=tuple(_doubts(cells, ties, warnings)),
        losses=(*warnings, _WALL_BLIND) if wall_blind else warnings,
        figures=tuple(figures_of(SURFACE_FIGURES, values, without)),
        grids=(_provenance_grid(cells),),
        charts=(_precision_chart(surface, cells),),
        pictures=_pictures(),
        warnings=warnings,
    )


def figures_of(
    kinds: tuple[tuple[str, str, str], ...], values: dict[str, float | int | None], without: tuple[str, ...] = ()
) -> Iterator[Figure]:
    """The figures (name, unit, meaning) with their values and labels."""
    for name, unit, sentence in kinds:
        if name not in without:
            yield Figure(
                name=name,
                label=_LABELS.get(name, ""),
                value=values[name],
                unit=unit,
                sentence=sentence,
                headline=name in _HEADLINES,
            )


def rounded(value: float | None, digits: int) -> float | None:
    """A value of so many digits, or none."""
    return None if value is None else round(value, digits)


def share(part: int, whole: int) -> float | None:
    """`part` of `whole`; None of nothing."""
    return round(part / whole, 4) if whole else None


def _surface_values(surface: Surface, cells: SurfaceStatistics, ties: TieCounts) -> dict[str, float | int | None]:
    grid, counts = surface.grid, cells.provenance
    known = _known_cells(cells)
    measured = sum(counts[code] for code in MEASURED)
    return {
        "cell": grid.cell,
        "rows": grid.rows,
        "columns": grid.cols,
        "cells_with_height": known,
        "completeness_grid": share(known, sum(counts)),
        "cells_measured": measured,
        "share_measured": share(measured, known),
        "share_one_pair": share(counts[Provenance.ONE_PAIR], known),
        "share_agreed": share(counts[Provenance.AGREED], known),
        "share_disputed": share(counts[Provenance.DISPUTED], known),
        "share_volume": share(counts[Provenance.VOLUME], known),
        "share_incoherent": share(counts[Provenance.INCOHERENT], known),
        "share_coarse": share(counts[Provenance.COARSE], known),
        "share_filled": share(counts[Provenance.INTERPOLATED], known),
        "spikes_removed": cells.spikes,
        "precision_median": rounded(median_height_error(cells.precision, grid.cell), 3),
        "datum_precision_median": rounded(median_height_error(cells.datum, grid.cell), 3),
        "tie_points": ties.points,
        "tie_points_off": rounded(median_tie_distance(ties.distances, ties.width), 3),
        "tie_points_contradicting": share(ties.contradicting, ties.points),
        "tie_points_pixel_off": share(_pixel_off(ties), ties.points),
        "height_lowest": rounded(cells.lowest, 2),
        "height_highest": rounded(cells.highest, 2),
    }


def _pixel_off(ties: TieCounts) -> int:
    return sum(ties.distances[_OF_A_PIXEL:])


def _known_cells(cells: SurfaceStatistics) -> int:
    return sum(cells.provenance) - cells.provenance[Provenance.EMPTY]


def _provenance_grid(cells: SurfaceStatistics) -> Grid:
    rows = tuple(
        (int(code), meaning, cells.provenance[code], share(cells.provenance[code], sum(cells.provenance)))
        for code, _, meaning in PROVENANCE_CODES
    )
    return Grid(title="Origin of the heights", columns=("code", "meaning", "cells", "share"), rows=rows)


def _precision_chart(surface: Surface, cells: SurfaceStatistics) -> Chart:
    return Chart(
        title="Standard error of the heights",
        style="bars",
        x_label="m",
        y_label="cells",
        x=height_error_middles(surface.grid.cell),
        series={"cells": tuple(map(float, cells.precision))},
        caption="The last class is open.",
    )


def _pictures() -> tuple[Picture, ...]:
    among, datum = "Standard error of the heights among their neighbours.", "What the orientation adds; neighbours share it."
    return (
        Picture(
            title="Surface model",
            raster=HEIGHT,
            style="hillshade",
            unit="m",
            caption="Measured and estimated heights.",
            first_page=True,
        ),
        Picture(title="Origin of the heights", raster=PROVENANCE, style="classes", classes=PROVENANCE_CODES),
        Picture(title="Precision among neighbours", raster=RELATIVE_PRECISION, style="ramp", unit="m", caption=among),
        Picture(title="Precision of the datum", raster=DATUM_PRECISION, style="ramp", unit="m", caption=datum),
        Picture(title="Agreeing pairs", raster=COUNT, style="ramp", caption="Number of pairs that support a height."),
    )


def _verdict(cells: SurfaceStatistics, surface: Surface, ties: TieCounts) -> Verdict:
    known, precision = _known_cells(cells), median_height_error(cells.precision, surface.grid.cell)
    if not known:
        return Verdict(level="poor", sentence="The surface is empty: no pair of photographs could be matched.", weighs=True)
    estimated = sum(cells.provenance[code] for code in ESTIMATED) / known
    off = _off(ties)
    coarse = (precision or 0.0) / (_OF_A_PIXEL * ties.width)
    limits = ((estimated, _ESTIMATED_LIMIT, _MOST_ESTIMATED), (off, _OFF, _MOSTLY_OFF), (coarse, _COARSE, inf))
    worst = max((value > fair) + (value > poor) for value, fair, poor in limits)
    level: Literal["good", "fair", "poor"] = ("good", "fair", "poor")[worst]
    words = f"{100 * (1 - estimated):.0f} % of the heights are measured"
    precise = "" if precision is None else f", to {precision:.2g} m among their neighbours (median standard error)"
    tested = f" Of {ties.points} tie points {100 * off:.0f} % contradict them." if off > _OFF else ""
    return Verdict(level=level, sentence=f"{words}{precise}; {100 * estimated:.0f} % are estimates.{tested}", weighs=True)


def _of_wall_blind(verdict: Verdict) -> Verdict:
    """Never good: what is stated of single heights does not hold where something rises or falls."""
    level = "fair" if verdict.level == "good" else verdict.level
    sentence = f"{verdict.sentence.rstrip('.')}. Standard errors do not hold on roofs, beside walls and at trees."
    return verdict.model_copy(update={"level": level, "sentence": sentence})


def _off(ties: TieCounts) -> float:
    """Share of the tie points that contradict the surface, or lie off it by more than a pixel of parallax; 0 for too few."""
    return max(ties.contradicting, _pixel_off(ties)) / ties.points if ties.points >= _ENOUGH_TIES else 0.0


def _answers(cells: SurfaceStatistics, surface: Surface) -> Iterator[Answer]:
    known, cell = _known_cells(cells), surface.grid.cell
    area = known * cell * cell
    unit, size = next((unit, size) for unit, least, size in _AREAS if area >= least)
    yield Answer(topic=Topic.AREA, text=f"{area / size:.3g} {unit}")
    if known:
        estimated = 100 * sum(cells.provenance[code] for code in ESTIMATED) / known
        empty = 100 * (1 - known / sum(cells.provenance))
        yield Answer(
            topic=Topic.HEIGHTS,
            text=f"{100 - estimated:.0f} % measured, {estimated:.0f} % estimated, every {cell:g} m; "
            f"{empty:.0f} % of the rectangle is empty",
        )


def _doubts(cells: SurfaceStatistics, ties: TieCounts, warnings: tuple[str, ...]) -> Iterator[str]:
    """The warnings of a surface that is no measurement for the most part, or that pairs or tie points contradict. A tenth of
    estimates is what every block with trees has."""
    measured = _known_cells(cells) > 2 * sum(cells.provenance[code] for code in ESTIMATED)
    for sentence in warnings:
        harmless = (measured and _ARE_ESTIMATES in sentence) or (_TIES_FOUND in sentence and _off(ties) <= _MOSTLY_OFF)
        if not harmless and _COARSE_FOUND not in sentence:
            yield sentence


def _surface_warnings(cells: SurfaceStatistics, ties: TieCounts, precision: float | None) -> Iterator[str]:
    known, disputed = _known_cells(cells), cells.provenance[Provenance.DISPUTED]
    estimated = sum(cells.provenance[code] for code in ESTIMATED)
    # An empty surface is an error of the block, not of matching: nothing else explains that no node in any pair converged.
    if known == 0:
        yield "The surface model is empty: no pair could be matched. Check the orientation and the heights of the block."
    elif estimated > _ESTIMATED_LIMIT * known:
        yield (
            f"{100 * estimated / known:.0f} % {_ARE_ESTIMATES}, not measurements (water, wood, or ground that few "
            "photographs see); the map of their origin shows where. More overlap, or photographs with more light and less wind, "
            "would measure more."
        )
    if known and disputed > _DISPUTED_LIMIT * known:
        yield (
            f"The pairs disagree on {100 * disputed / known:.0f} % of the heights; the map of their origin shows where. Look for "
            "things that moved between the photographs, or a poor calibration."
        )
    pixel = _OF_A_PIXEL * ties.width
    if (off := _off(ties)) > _OFF:
        yield (
            f"{100 * off:.0f} % of the {ties.points} {_TIES_FOUND} or by more than one pixel of parallax ({pixel:.2g} m): "
            "so many heights are wrong there. Look where the check disagrees; where another way of matching was chosen than the "
            "default (object_space), try that."
        )
    if precision is not None and precision > _COARSE * pixel:
        yield (
            f"Half of the heights are {_COARSE_FOUND} {precision:.2g} m, while one pixel of parallax is {pixel:.2g} m: "
            "this way of matching measured worse than the photographs allow."
        )
