"""The report of densification: how much was matched, how precisely, and what the surface model consists of."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Literal

import numpy as np

from orthomill.schemas.epipolar import EpipolarPair, EpipolarPairs
from orthomill.schemas.outcome import Outcome
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
from orthomill.tasks.densification.line_locus.locus_block import CORRELATION_CLASSES, LineStatistics
from orthomill.tasks.densification.line_locus.locus_plan import MARKERS
from orthomill.tasks.densification.matching_block import PRECISION_EDGES, MatchingStatistics
from orthomill.tasks.densification.surface_grid import ground_pixel
from orthomill.tasks.densification.surface_tile import CLASSES, SurfaceStatistics

COMPLETE_ENOUGH = 0.7
"""share of nodes inside the photographs below which a pair is worth a warning"""
Y_PARALLAX_LIMIT = 0.5
"""px; beyond it matching along rows starts to lose points and heights of edges across the base become biased"""
_DISPUTED_LIMIT = 0.05
"""share of heights on which pairs disagree that is worth a warning"""

_ARE_ESTIMATES = "of the heights are estimates"
_ESTIMATED_LIMIT = 0.1
"""share of heights that were not measured that is worth a warning"""

_FIGURES = (
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
_LABELS = {
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
_PRODUCTS = (
    Product(
        path="products/dsm.tif", purpose="Surface model: heights with their standard errors", main=True, classed=("plan", "height")
    ),
    Product(path="products/dsm_provenance.tif", purpose="Where each height comes from: measured or estimated"),
)
_MOST_ESTIMATED = 0.5
"""share of the heights: with more, the surface is a sketch for most of its area"""
_HEADLINES = ("completeness_nodes", "precision_median")


def report(
    pairs: EpipolarPairs, surface: Surface, matching: tuple[MatchingStatistics, ...], cells: SurfaceStatistics
) -> StageReport:
    """Figures, tables, charts, pictures and warnings; `matching` in the order of the pairs."""
    values = _matching_values(pairs, matching) | _surface_values(surface, cells)
    return StageReport(
        verdict=_verdict(cells, surface),
        answers=tuple(_answers(cells, surface)),
        products=_PRODUCTS,
        doubts=tuple(_doubts(cells)),
        losses=(*_surface_warnings(cells), *_matching_warnings(pairs, matching)),
        figures=tuple(
            Figure(
                name=name,
                label=_LABELS.get(name, ""),
                value=values[name],
                unit=unit,
                sentence=sentence,
                headline=name in _HEADLINES,
            )
            for name, unit, sentence in _FIGURES
        ),
        grids=(_pairs_grid(pairs, matching), _outcome_grid(pairs, matching), _provenance_grid(cells)),
        charts=(_parallax_chart(matching), _precision_chart(surface, cells)),
        pictures=_pictures(),
        warnings=(*_matching_warnings(pairs, matching), *_surface_warnings(cells)),
    )


_LINE_FIGURES = (
    ("nodes", "", "Vertical lines that two or more photographs show."),
    ("nodes_matched", "", "Nodes whose correlation passes its limit."),
    ("completeness_nodes", "", "Share of the nodes that were accepted."),
    ("correlation_median", "", "Median absolute correlation of the accepted nodes."),
    ("limit_median", "", "Median of the correlations from which on nodes counted as found."),
)
_OF_PAIRS = ("pairs", "nodes", "nodes_matched", "completeness_nodes", "parallax_precision_median", "share_agreed", "share_disputed")
"""figures that lines do not have, or state in words of their own"""


def line_report(surface: Surface, lines: LineStatistics, cells: SurfaceStatistics) -> StageReport:
    """The report of a surface from vertical lines."""
    values = _line_values(lines) | _surface_values(surface, cells)
    figures = (*_LINE_FIGURES, *(figure for figure in _FIGURES if figure[0] not in _OF_PAIRS))
    rows = tuple((outcome.sentence, lines.outcomes[outcome]) for outcome in Outcome if lines.outcomes[outcome])
    return StageReport(
        figures=tuple(
            Figure(name=name, value=values[name], unit=unit, sentence=sentence, headline=name in _HEADLINES)
            for name, unit, sentence in figures
        ),
        grids=(Grid(title="Outcomes of the nodes", columns=("outcome", "nodes"), rows=rows), _provenance_grid(cells)),
        charts=(_correlation_chart(lines), _precision_chart(surface, cells)),
        pictures=(*_pictures(), _marker_picture()),
        doubts=tuple(_doubts(cells)),
        warnings=tuple(_surface_warnings(cells)),
    )


def _line_values(lines: LineStatistics) -> dict[str, float | int | None]:
    tried = sum(lines.outcomes) - lines.outcomes[Outcome.OUTSIDE]
    edges = np.linspace(0.0, 1.0, CORRELATION_CLASSES + 1)
    return {
        "nodes": tried,
        "nodes_matched": lines.outcomes[Outcome.CONVERGED],
        "completeness_nodes": _share(lines.outcomes[Outcome.CONVERGED], tried),
        "correlation_median": _rounded(median_of(lines.accepted, edges), 3),
        "limit_median": _rounded(median_of(lines.limits, edges), 3),
    }


def _correlation_chart(lines: LineStatistics) -> Chart:
    width = 1.0 / CORRELATION_CLASSES
    return Chart(
        title="Correlation of the nodes",
        style="bars",
        x_label="absolute correlation",
        y_label="nodes",
        x=tuple(round((k + 0.5) * width, 3) for k in range(CORRELATION_CLASSES)),
        series={"accepted": tuple(map(float, lines.accepted)), "rejected": tuple(map(float, lines.rejected))},
        caption="Every node is compared with a limit of its own, unless the threshold is fixed.",
    )


def _marker_picture() -> Picture:
    caption = "Black: a height was accepted. White: it was rejected."
    return Picture(
        title="Nodes over the photographs", raster=MARKERS, style="ramp", low=0.0, high=255.0, colours="gray", caption=caption
    )


def completeness(statistics: MatchingStatistics) -> float | None:
    """Share of the nodes inside the left photograph and within reach of the right one that were matched."""
    inside = sum(statistics.outcomes) - statistics.outcomes[Outcome.OUTSIDE]
    return statistics.outcomes[Outcome.CONVERGED] / inside if inside else None


def median_of(counts: tuple[int, ...], edges: np.ndarray) -> float | None:
    """Median of values that are known by classes only, linear within the class."""
    # Medians of tiles cannot be combined; counts by class can, whatever the number of tiles and their order.
    total = sum(counts)
    return float(np.interp(total / 2, np.concatenate([[0], np.cumsum(counts)]), edges)) if total else None


def y_parallax(statistics: MatchingStatistics) -> float | None:
    """Median over the blocks of a pair, px."""
    # Each block has one value: a pair with a few badly textured blocks still shows what its orientation left.
    return float(np.median(statistics.y_parallaxes)) if statistics.y_parallaxes else None


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


def _sum(matching: tuple[MatchingStatistics, ...], field: str) -> tuple[int, ...]:
    return tuple(map(sum, zip(*(getattr(part, field) for part in matching), strict=True)))


def _share(part: int, whole: int) -> float | None:
    return round(part / whole, 4) if whole else None


def _cell_edges(cell: float) -> np.ndarray:
    return np.arange(CLASSES + 1) * 0.1 * cell


def _matching_values(pairs: EpipolarPairs, matching: tuple[MatchingStatistics, ...]) -> dict[str, float | int | None]:
    outcomes = _sum(matching, "outcomes")
    # Nodes outside are not counted as failures: the epipolar images are rectangles around tilted photographs.
    tried = sum(outcomes) - outcomes[Outcome.OUTSIDE]
    return {
        "pairs": len(pairs.pairs),
        "nodes": tried,
        "nodes_matched": outcomes[Outcome.CONVERGED],
        "completeness_nodes": _share(outcomes[Outcome.CONVERGED], tried),
        "parallax_precision_median": _rounded(median_of(_sum(matching, "precision"), np.array(PRECISION_EDGES)), 3),
    }


def _surface_values(surface: Surface, cells: SurfaceStatistics) -> dict[str, float | int | None]:
    grid, counts = surface.grid, cells.provenance
    known = _known_cells(cells)
    measured = sum(counts[code] for code in MEASURED)
    return {
        "cell": grid.cell,
        "rows": grid.rows,
        "columns": grid.cols,
        "cells_with_height": known,
        "completeness_grid": _share(known, sum(counts)),
        "cells_measured": measured,
        "share_measured": _share(measured, known),
        "share_one_pair": _share(counts[Provenance.ONE_PAIR], known),
        "share_agreed": _share(counts[Provenance.AGREED], known),
        "share_disputed": _share(counts[Provenance.DISPUTED], known),
        "share_volume": _share(counts[Provenance.VOLUME], known),
        "share_incoherent": _share(counts[Provenance.INCOHERENT], known),
        "share_filled": _share(counts[Provenance.INTERPOLATED], known),
        "spikes_removed": cells.spikes,
        "precision_median": _rounded(median_of(cells.precision, _cell_edges(grid.cell)), 3),
        "datum_precision_median": _rounded(median_of(cells.datum, _cell_edges(grid.cell)), 3),
        "height_lowest": _rounded(cells.lowest, 2),
        "height_highest": _rounded(cells.highest, 2),
    }


def _known_cells(cells: SurfaceStatistics) -> int:
    return sum(cells.provenance) - cells.provenance[Provenance.EMPTY]


def _pair_row(pair: EpipolarPair, statistics: MatchingStatistics) -> tuple[float | int | str | None, ...]:
    sigma, y = median_of(statistics.precision, np.array(PRECISION_EDGES)), y_parallax(statistics)
    # dZ/dp = B c / p^2 at the mean parallax: the height that one pixel of parallax stands for (Karfis 2009, 1.17)
    metres = pair.base * pair.c / ((pair.parallax_low + pair.parallax_high) / 2) ** 2
    return (
        pair.name,
        statistics.outcomes[Outcome.CONVERGED],
        _rounded(completeness(statistics), 3),
        _rounded(sigma, 3),
        _rounded(None if sigma is None else sigma * metres, 3),
        _rounded(y, 3),
        round(ground_pixel(pair), 3),
    )


_PAIR_COLUMNS = (
    "pair",
    "nodes matched",
    "share matched",
    "median sigma of parallax (px)",
    "the same as height (m)",
    "y-parallax left (px)",
    "ground pixel (m)",
)


def _pairs_grid(pairs: EpipolarPairs, matching: tuple[MatchingStatistics, ...]) -> Grid:
    return Grid(
        title="Dense matching by pair",
        columns=_PAIR_COLUMNS,
        rows=tuple(_pair_row(pair, part) for pair, part in zip(pairs.pairs, matching, strict=True)),
        note="The y-parallax is what the orientation left; it was measured block by block and removed before matching.",
    )


def _outcome_grid(pairs: EpipolarPairs, matching: tuple[MatchingStatistics, ...]) -> Grid:
    rows = tuple((outcome.sentence, *(part.outcomes[outcome] for part in matching)) for outcome in Outcome)
    return Grid(title="Outcomes of the nodes", columns=("outcome", *(pair.name for pair in pairs.pairs)), rows=rows)


def _provenance_grid(cells: SurfaceStatistics) -> Grid:
    rows = tuple(
        (int(code), meaning, cells.provenance[code], _share(cells.provenance[code], sum(cells.provenance)))
        for code, _, meaning in PROVENANCE_CODES
    )
    return Grid(title="Origin of the heights", columns=("code", "meaning", "cells", "share"), rows=rows)


def _parallax_chart(matching: tuple[MatchingStatistics, ...]) -> Chart:
    return Chart(
        title="Standard error of the parallaxes",
        style="bars",
        x_label="px",
        y_label="nodes",
        x=tuple(round((a + b) / 2, 3) for a, b in pairwise(PRECISION_EDGES)),
        series={"nodes": tuple(map(float, _sum(matching, "precision")))},
        caption="The classes have different widths.",
    )


def _precision_chart(surface: Surface, cells: SurfaceStatistics) -> Chart:
    edges = _cell_edges(surface.grid.cell)
    return Chart(
        title="Standard error of the heights",
        style="bars",
        x_label="m",
        y_label="cells",
        x=tuple(np.round((edges[:-1] + edges[1:]) / 2, 4).tolist()),
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


def _verdict(cells: SurfaceStatistics, surface: Surface) -> Verdict:
    known, precision = _known_cells(cells), median_of(cells.precision, _cell_edges(surface.grid.cell))
    if not known:
        return Verdict(level="poor", sentence="The surface is empty: no pair of photographs could be matched.", weighs=True)
    estimated = sum(cells.provenance[code] for code in ESTIMATED) / known
    level: Literal["good", "fair", "poor"] = (
        "good" if estimated <= _ESTIMATED_LIMIT else "fair" if estimated <= _MOST_ESTIMATED else "poor"
    )
    words = f"{100 * (1 - estimated):.0f} % of the heights are measured"
    precise = "" if precision is None else f", to {precision:.2g} m among their neighbours (median standard error)"
    return Verdict(level=level, sentence=f"{words}{precise}; {100 * estimated:.0f} % are estimates.", weighs=True)


def _answers(cells: SurfaceStatistics, surface: Surface) -> Iterator[Answer]:
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


def _matching_warnings(pairs: EpipolarPairs, matching: tuple[MatchingStatistics, ...]) -> Iterator[str]:
    rows = list(zip((pair.name for pair in pairs.pairs), matching, strict=True))
    poor = sorted((completeness(part) or 0.0, name) for name, part in rows if (completeness(part) or 0.0) < COMPLETE_ENOUGH)
    if poor:
        worst = ", ".join(f"{name} {100 * share:.0f} %" for share, name in poor[:3])
        yield (
            f"In {len(poor)} of {len(rows)} pairs fewer than {100 * COMPLETE_ENOUGH:.0f} % of the nodes were matched "
            f"(worst: {worst}); look for water, wood, repetitive patterns or photographs that differ strongly."
        )
    for name, part in rows:
        if abs(left := y_parallax(part) or 0.0) > Y_PARALLAX_LIMIT:
            yield (
                f"Pair {name}: the orientation left a y-parallax of {left:.2f} px; heights of this pair may be biased. Calibrate "
                "the camera, or leave one of the photographs out."
            )


def _doubts(cells: SurfaceStatistics) -> Iterator[str]:
    """The warnings of a surface that is no measurement for the most part, or that its pairs contradict. A tenth of estimates is
    what every block with trees has."""
    measured = _known_cells(cells) > 2 * sum(cells.provenance[code] for code in ESTIMATED)
    return (sentence for sentence in _surface_warnings(cells) if not (measured and _ARE_ESTIMATES in sentence))


def _surface_warnings(cells: SurfaceStatistics) -> Iterator[str]:
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
