"""What is told of a surface model, whatever its heights come from: figures, verdict, answers, doubts and pictures."""

from collections.abc import Iterator
from typing import Literal

from orthomill.schemas.stage_report import Answer, Chart, Grid, Picture, Topic, Verdict
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
from orthomill.tasks.densification.precision.class_medians import height_error_middles, median_height_error
from orthomill.tasks.densification.surface_tile import SurfaceStatistics

_DISPUTED_LIMIT = 0.05
"""share of heights on which pairs disagree that is worth a warning"""
_ARE_ESTIMATES = "of the heights are estimates"
_ESTIMATED_LIMIT = 0.1
"""share of heights that were not measured that is worth a warning"""
SURFACE_FIGURES = (
    ("pairs", "", "Pairs of photographs that were matched densely."),
    ("nodes", "", "Nodes inside the photographs, over all pairs."),
    ("nodes_matched", "", "Nodes matched by least squares."),
    ("completeness_nodes", "", "Share of the nodes that were matched."),
    ("parallax_precision_median", "px", "Median standard error of a parallax, from matching alone."),
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
    ("share_filled", "", "Estimated heights: interpolated between their neighbours."),
    ("spikes_removed", "", "Heights of pairs removed by the spike filter."),
    ("precision_median", "m", "Median standard error of a measured height among its neighbours."),
    ("datum_precision_median", "m", "Median standard error that the orientation adds, common to neighbours."),
    ("height_lowest", "m", "Lowest height of the surface model."),
    ("height_highest", "m", "Highest height of the surface model."),
)
"""name, unit and meaning of every figure, in the order of the report"""
LABELS = {
    "precision_median": "Precision among neighbours",
    "datum_precision_median": "Precision of the datum",
    "completeness_nodes": "Matched of what photographs share",
    "completeness_grid": "Filled of the rectangle",
    "parallax_precision_median": "Precision of matching",
    "share_incoherent": "Estimated, contradicted by neighbours",
    "share_filled": "Estimated from neighbours",
    "share_volume": "Measured by all photographs together",
}
"""what people call a figure whose name does not say it"""
_MOST_ESTIMATED = 0.5
"""share of the heights: with more, the surface is a sketch for most of its area"""
HEADLINES = ("completeness_nodes", "precision_median")


def rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


def share(part: int, whole: int) -> float | None:
    return round(part / whole, 4) if whole else None


def surface_values(surface: Surface, cells: SurfaceStatistics) -> dict[str, float | int | None]:
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
        "share_filled": share(counts[Provenance.INTERPOLATED], known),
        "spikes_removed": cells.spikes,
        "precision_median": rounded(median_height_error(cells.precision, grid.cell), 3),
        "datum_precision_median": rounded(median_height_error(cells.datum, grid.cell), 3),
        "height_lowest": rounded(cells.lowest, 2),
        "height_highest": rounded(cells.highest, 2),
    }


def _known_cells(cells: SurfaceStatistics) -> int:
    return sum(cells.provenance) - cells.provenance[Provenance.EMPTY]


def provenance_grid(cells: SurfaceStatistics) -> Grid:
    rows = tuple(
        (int(code), meaning, cells.provenance[code], share(cells.provenance[code], sum(cells.provenance)))
        for code, _, meaning in PROVENANCE_CODES
    )
    return Grid(title="Origin of the heights", columns=("code", "meaning", "cells", "share"), rows=rows)


def precision_chart(surface: Surface, cells: SurfaceStatistics) -> Chart:
    return Chart(
        title="Standard error of the heights",
        style="bars",
        x_label="m",
        y_label="cells",
        x=height_error_middles(surface.grid.cell),
        series={"cells": tuple(map(float, cells.precision))},
        caption="The last class is open.",
    )


def surface_pictures() -> tuple[Picture, ...]:
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


def surface_verdict(cells: SurfaceStatistics, surface: Surface) -> Verdict:
    known, precision = _known_cells(cells), median_height_error(cells.precision, surface.grid.cell)
    if not known:
        return Verdict(level="poor", sentence="The surface is empty: no pair of photographs could be matched.", weighs=True)
    estimated = sum(cells.provenance[code] for code in ESTIMATED) / known
    level: Literal["good", "fair", "poor"] = (
        "good" if estimated <= _ESTIMATED_LIMIT else "fair" if estimated <= _MOST_ESTIMATED else "poor"
    )
    words = f"{100 * (1 - estimated):.0f} % of the heights are measured"
    precise = "" if precision is None else f", to {precision:.2g} m among their neighbours (median standard error)"
    return Verdict(level=level, sentence=f"{words}{precise}; {100 * estimated:.0f} % are estimates.", weighs=True)


def surface_answers(cells: SurfaceStatistics, surface: Surface) -> Iterator[Answer]:
    known, cell = _known_cells(cells), surface.grid.cell
    area = known * cell * cell
    yield Answer(topic=Topic.AREA, text=f"{area / 1e6:.3g} km²" if area >= 1e6 else f"{area / 1e4:.3g} ha")
    if known:
        estimated = 100 * sum(cells.provenance[code] for code in ESTIMATED) / known
        empty = 100 * (1 - known / sum(cells.provenance))
        yield Answer(
            topic=Topic.HEIGHTS,
            text=f"{100 - estimated:.0f} % measured, {estimated:.0f} % estimated, every {cell:g} m; "
            f"{empty:.0f} % of the rectangle is empty",
        )


def surface_doubts(cells: SurfaceStatistics) -> Iterator[str]:
    """The warnings of a surface that is no measurement for the most part, or that its pairs contradict. A tenth of estimates is
    what every block with trees has."""
    measured = _known_cells(cells) > 2 * sum(cells.provenance[code] for code in ESTIMATED)
    return (sentence for sentence in surface_warnings(cells) if not (measured and _ARE_ESTIMATES in sentence))


def surface_warnings(cells: SurfaceStatistics) -> Iterator[str]:
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
