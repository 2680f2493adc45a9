"""The report of densification: how much was matched, how precisely, and what the surface model consists of."""

from collections.abc import Iterator
from itertools import pairwise
from statistics import median

from orthomill.schemas.epipolar import EpipolarPair, EpipolarPairs
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.stage_report import Chart, Figure, Grid, Product, StageReport
from orthomill.schemas.surface import Surface
from orthomill.tasks.densification.matching_block import PRECISION_EDGES, MatchingStatistics
from orthomill.tasks.densification.precision.class_medians import median_parallax_error
from orthomill.tasks.densification.report.surface_words import (
    HEADLINES,
    LABELS,
    SURFACE_FIGURES,
    precision_chart,
    provenance_grid,
    rounded,
    share,
    surface_answers,
    surface_doubts,
    surface_pictures,
    surface_values,
    surface_verdict,
    surface_warnings,
)
from orthomill.tasks.densification.surface_grid import ground_pixel
from orthomill.tasks.densification.surface_tile import SurfaceStatistics

COMPLETE_ENOUGH = 0.7
"""share of nodes inside the photographs below which a pair is worth a warning"""
Y_PARALLAX_LIMIT = 0.5
"""px; beyond it matching along rows starts to lose points and heights of edges across the base become biased"""
_PRODUCTS = (
    Product(
        path="products/dsm.tif", purpose="Surface model: heights with their standard errors", main=True, classed=("plan", "height")
    ),
    Product(path="products/dsm_provenance.tif", purpose="Where each height comes from: measured or estimated"),
)


def report(
    pairs: EpipolarPairs, surface: Surface, matching: tuple[MatchingStatistics, ...], cells: SurfaceStatistics
) -> StageReport:
    """Figures, tables, charts, pictures and warnings; `matching` in the order of the pairs."""
    values = _matching_values(pairs, matching) | surface_values(surface, cells)
    return StageReport(
        verdict=surface_verdict(cells, surface),
        answers=tuple(surface_answers(cells, surface)),
        products=_PRODUCTS,
        doubts=tuple(surface_doubts(cells)),
        losses=(*surface_warnings(cells), *_matching_warnings(pairs, matching)),
        figures=tuple(
            Figure(
                name=name, label=LABELS.get(name, ""), value=values[name], unit=unit, sentence=sentence, headline=name in HEADLINES
            )
            for name, unit, sentence in SURFACE_FIGURES
        ),
        grids=(_pairs_grid(pairs, matching), _outcome_grid(pairs, matching), provenance_grid(cells)),
        charts=(_parallax_chart(matching), precision_chart(surface, cells)),
        pictures=surface_pictures(),
        warnings=(*_matching_warnings(pairs, matching), *surface_warnings(cells)),
    )


def completeness(statistics: MatchingStatistics) -> float | None:
    """Share of the nodes inside the left photograph and within reach of the right one that were matched."""
    inside = sum(statistics.outcomes) - statistics.outcomes[Outcome.OUTSIDE]
    return statistics.outcomes[Outcome.CONVERGED] / inside if inside else None


def y_parallax(statistics: MatchingStatistics) -> float | None:
    """Median over the blocks of a pair, px."""
    # Each block has one value: a pair with a few badly textured blocks still shows what its orientation left.
    return median(statistics.y_parallaxes) if statistics.y_parallaxes else None


def _sum(matching: tuple[MatchingStatistics, ...], field: str) -> tuple[int, ...]:
    return tuple(map(sum, zip(*(getattr(part, field) for part in matching), strict=True)))


def _matching_values(pairs: EpipolarPairs, matching: tuple[MatchingStatistics, ...]) -> dict[str, float | int | None]:
    outcomes = _sum(matching, "outcomes")
    # Nodes outside are not counted as failures: the epipolar images are rectangles around tilted photographs.
    tried = sum(outcomes) - outcomes[Outcome.OUTSIDE]
    return {
        "pairs": len(pairs.pairs),
        "nodes": tried,
        "nodes_matched": outcomes[Outcome.CONVERGED],
        "completeness_nodes": share(outcomes[Outcome.CONVERGED], tried),
        "parallax_precision_median": rounded(median_parallax_error(_sum(matching, "precision")), 3),
    }


def _pair_row(pair: EpipolarPair, statistics: MatchingStatistics) -> tuple[float | int | str | None, ...]:
    sigma, y = median_parallax_error(statistics.precision), y_parallax(statistics)
    # dZ/dp = B c / p^2 at the mean parallax: the height that one pixel of parallax stands for (Karfis 2009, 1.17)
    metres = pair.base * pair.c / ((pair.parallax_low + pair.parallax_high) / 2) ** 2
    return (
        pair.name,
        statistics.outcomes[Outcome.CONVERGED],
        rounded(completeness(statistics), 3),
        rounded(sigma, 3),
        rounded(None if sigma is None else sigma * metres, 3),
        rounded(y, 3),
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
