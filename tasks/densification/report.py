"""What densification tells people: how much was matched, how well, what the surface model consists of."""

from itertools import pairwise

import numpy as np

from orthomill.schemas.epipolar import EpipolarPair, EpipolarPairs
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.stage_report import Chart, Figure, Grid, Picture, StageReport
from orthomill.schemas.surface import COUNT, HEIGHT, PRECISION, PROVENANCE, PROVENANCE_CODES, Surface
from orthomill.tasks.densification.fusion import AGREED, DISPUTED, EMPTY, FILLED, ONE_PAIR
from orthomill.tasks.densification.matching_block import PRECISION_EDGES, MatchingStatistics
from orthomill.tasks.densification.surface_grid import ground_pixel
from orthomill.tasks.densification.surface_tile import CLASSES, SurfaceStatistics

COMPLETE_ENOUGH = 0.7
"""share of nodes inside the photographs below which a pair is worth a warning"""
Y_PARALLAX_LIMIT = 0.5
"""px"""


def report(
    pairs: EpipolarPairs, surface: Surface, matching: tuple[MatchingStatistics, ...], cells: SurfaceStatistics
) -> StageReport:
    """Figures, tables, charts, pictures and warnings; `matching` in the order of the pairs."""
    return StageReport(
        figures=(*_matching_figures(pairs, matching), *_surface_figures(surface, cells)),
        grids=(_pairs_grid(pairs, matching), _outcome_grid(pairs, matching), _provenance_grid(cells)),
        charts=(_parallax_chart(matching), _precision_chart(surface, cells)),
        pictures=_pictures(),
        warnings=tuple(_warnings(pairs, matching, cells)),
    )


def completeness(statistics: MatchingStatistics) -> float | None:
    """Share of the nodes inside the left photograph and within reach of the right one that were matched."""
    inside = sum(statistics.outcomes) - statistics.outcomes[Outcome.OUTSIDE]
    return statistics.outcomes[Outcome.CONVERGED] / inside if inside else None


def median_of(counts: tuple[int, ...], edges: np.ndarray) -> float | None:
    """Median of values known by classes only, linear within the class."""
    total = sum(counts)
    return float(np.interp(total / 2, np.concatenate([[0], np.cumsum(counts)]), edges)) if total else None


def y_parallax(statistics: MatchingStatistics) -> float | None:
    """Median over the blocks of a pair, px."""
    return float(np.median(statistics.y_parallaxes)) if statistics.y_parallaxes else None


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


def _sum(matching: tuple[MatchingStatistics, ...], field: str) -> tuple[int, ...]:
    return tuple(map(sum, zip(*(getattr(part, field) for part in matching), strict=True)))


def _share(part: int, whole: int) -> float | None:
    return round(part / whole, 4) if whole else None


def _cell_edges(cell: float) -> np.ndarray:
    return np.arange(CLASSES + 1) * 0.1 * cell


def _matching_figures(pairs: EpipolarPairs, matching: tuple[MatchingStatistics, ...]) -> tuple[Figure, ...]:
    outcomes = _sum(matching, "outcomes")
    tried = sum(outcomes) - outcomes[Outcome.OUTSIDE]
    sigma = median_of(_sum(matching, "precision"), np.array(PRECISION_EDGES))
    return (
        Figure(name="pairs", value=len(pairs.pairs), sentence="Pairs of photographs that were matched densely."),
        Figure(name="nodes", value=tried, sentence="Nodes inside the photographs, over all pairs."),
        Figure(name="nodes_matched", value=outcomes[Outcome.CONVERGED], sentence="Nodes matched by least squares."),
        Figure(
            name="completeness_nodes",
            value=_share(outcomes[Outcome.CONVERGED], tried),
            headline=True,
            sentence="Share of the nodes that were matched.",
        ),
        Figure(
            name="parallax_precision_median",
            value=_rounded(sigma, 3),
            unit="px",
            sentence="Median standard error of a parallax, from matching alone.",
        ),
    )


def _surface_figures(surface: Surface, cells: SurfaceStatistics) -> tuple[Figure, ...]:
    grid, share = surface.grid, cells.provenance
    whole, known = sum(share), sum(share) - share[EMPTY]
    precision = median_of(cells.precision, _cell_edges(grid.cell))
    return (
        Figure(name="cell", value=grid.cell, unit="m", sentence="Cell size of the surface model."),
        Figure(name="rows", value=grid.rows, sentence="Rows of the surface model."),
        Figure(name="columns", value=grid.cols, sentence="Columns of the surface model."),
        Figure(name="cells_with_height", value=known, sentence="Cells that carry a height."),
        Figure(
            name="completeness_grid",
            value=_share(known, whole),
            sentence="Share of all cells of the rectangular grid; ground that no pair sees counts as empty.",
        ),
        Figure(name="share_one_pair", value=_share(share[ONE_PAIR], known), sentence="Heights from one pair alone."),
        Figure(name="share_agreed", value=_share(share[AGREED], known), sentence="Heights on which two or more pairs agree."),
        Figure(name="share_disputed", value=_share(share[DISPUTED], known), sentence="Heights on which the pairs disagree."),
        Figure(name="share_filled", value=_share(share[FILLED], known), sentence="Heights filled from their neighbours."),
        Figure(name="spikes_removed", value=cells.spikes, sentence="Cells that the spike filter emptied."),
        Figure(
            name="precision_median",
            value=_rounded(precision, 3),
            unit="m",
            headline=True,
            sentence="Median standard error of a height.",
        ),
        Figure(name="height_lowest", value=_rounded(cells.lowest, 2), unit="m", sentence="Lowest height of the surface model."),
        Figure(name="height_highest", value=_rounded(cells.highest, 2), unit="m", sentence="Highest height of the surface model."),
    )


def _pair_row(pair: EpipolarPair, statistics: MatchingStatistics) -> tuple[float | int | str | None, ...]:
    sigma, y = median_of(statistics.precision, np.array(PRECISION_EDGES)), y_parallax(statistics)
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


def _pairs_grid(pairs: EpipolarPairs, matching: tuple[MatchingStatistics, ...]) -> Grid:
    return Grid(
        title="Dense matching by pair",
        columns=(
            "pair",
            "nodes matched",
            "share matched",
            "median sigma of parallax (px)",
            "the same as height (m)",
            "y-parallax left (px)",
            "ground pixel (m)",
        ),
        rows=tuple(_pair_row(pair, part) for pair, part in zip(pairs.pairs, matching, strict=True)),
        note="The y-parallax is what the orientation left; it was measured block by block and taken out before matching.",
    )


def _outcome_grid(pairs: EpipolarPairs, matching: tuple[MatchingStatistics, ...]) -> Grid:
    rows = tuple((outcome.sentence, *(part.outcomes[outcome] for part in matching)) for outcome in Outcome)
    return Grid(title="What became of the nodes", columns=("outcome", *(pair.name for pair in pairs.pairs)), rows=rows)


def _provenance_grid(cells: SurfaceStatistics) -> Grid:
    rows = tuple(
        (code, meaning, cells.provenance[code], _share(cells.provenance[code], sum(cells.provenance)))
        for code, _, meaning in PROVENANCE_CODES
    )
    return Grid(title="Where the heights come from", columns=("code", "meaning", "cells", "share"), rows=rows)


def _parallax_chart(matching: tuple[MatchingStatistics, ...]) -> Chart:
    counts, edges = _sum(matching, "precision"), PRECISION_EDGES
    middle = tuple(round((a + b) / 2, 3) for a, b in pairwise(edges))
    return Chart(
        title="Standard error of the parallaxes",
        style="bars",
        x_label="px",
        y_label="nodes",
        x=middle,
        series={"nodes": tuple(map(float, counts))},
        caption="Classes are not equally wide.",
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
    return (
        Picture(title="Surface model", raster=HEIGHT, style="hillshade", unit="m", caption="Empty where nothing could be matched."),
        Picture(title="Precision", raster=PRECISION, style="ramp", unit="m", caption="Standard error of the heights."),
        Picture(title="Provenance", raster=PROVENANCE, style="classes", classes=PROVENANCE_CODES),
        Picture(title="Pairs that agree", raster=COUNT, style="ramp", caption="How many pairs stand behind a height."),
    )


def _warnings(pairs: EpipolarPairs, matching: tuple[MatchingStatistics, ...], cells: SurfaceStatistics) -> list[str]:
    found = []
    rows = list(zip((pair.name for pair in pairs.pairs), matching, strict=True))
    poor = sorted((completeness(part) or 0.0, name) for name, part in rows if (completeness(part) or 0.0) < COMPLETE_ENOUGH)
    if poor:
        worst = ", ".join(f"{name} {100 * share:.0f} %" for share, name in poor[:3])
        found.append(
            f"In {len(poor)} of {len(rows)} pairs fewer than {100 * COMPLETE_ENOUGH:.0f} % of the nodes were matched "
            f"(worst: {worst}); look for water, wood, repeated patterns or photographs that differ much."
        )
    found += [
        f"Pair {name}: the orientation left a y-parallax of {y_parallax(part):.2f} px; heights of this pair may be biased."
        for name, part in rows
        if abs(y_parallax(part) or 0.0) > Y_PARALLAX_LIMIT
    ]
    known = sum(cells.provenance) - cells.provenance[EMPTY]
    if known == 0:
        found.append("The surface model is empty: no pair could be matched. Check the orientation and the heights of the block.")
    elif cells.provenance[DISPUTED] > 0.05 * known:
        share = 100 * cells.provenance[DISPUTED] / known
        found.append(f"The pairs disagree on {share:.0f} % of the heights; see the provenance map.")
    return found
