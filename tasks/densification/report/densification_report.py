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
from orthomill.tasks.densification.precision.pair_differences import NO_DIFFERENCES, MatchingDifferences, usual_factor
from orthomill.tasks.densification.precision.tie_points import TieCounts
from orthomill.tasks.densification.report.surface_report import figures_of, rounded, share, surface_report
from orthomill.tasks.densification.strategies.assigned_windows import AssignedWindows, limits_in_words
from orthomill.tasks.densification.surface_grid import ground_pixel, parallax_height
from orthomill.tasks.densification.surface_tile import SurfaceStatistics
from orthomill.tasks.densification.water.water_levels import NO_WATER, WaterLevels
from orthomill.tasks.densification.water.water_places import CANDIDATES, NO_PLACES, WaterPlaces

COMPLETE_ENOUGH = 0.7
"""share of nodes inside the photographs below which a pair is worth a warning"""
Y_PARALLAX_LIMIT = 0.5
"""px; beyond it matching along rows starts to lose points and heights of edges across the base become biased"""
_FIGURES = (
    ("pairs", "", "Pairs of photographs that were matched densely."),
    ("nodes", "", "Nodes inside the photographs, over all pairs."),
    ("nodes_matched", "", "Nodes matched by least squares."),
    ("completeness_nodes", "", "Share of the nodes that were matched."),
    ("parallax_precision_median", "px", "Median standard error of a parallax, from matching alone."),
)
"""name, unit and meaning of what pairs add to the figures of the surface"""
_DIFFERENCES = (
    ("differences_cells", "", "Cells on which two pairs without a common photograph were compared."),
    ("differences_factor", "", "Factor by which they correct the standard errors that matching states."),
)
"""what they add where those without a common photograph were compared"""


def report(
    pairs: EpipolarPairs,
    surface: Surface,
    matching: tuple[MatchingStatistics, ...],
    cells: SurfaceStatistics,
    ties: TieCounts,
    differences: MatchingDifferences = NO_DIFFERENCES,
    windows: tuple[AssignedWindows, ...] = (),
    water: WaterLevels = NO_WATER,
    places: WaterPlaces = NO_PLACES,
    wall_blind: bool = False,
) -> StageReport:
    """The report of a surface from pairs; `matching`, and `windows` where a share of the points was to get one, in their order;
    differences: of those without a common photograph; water: what is outlined; places: what looks like it; wall_blind: whether
    windows know no walls."""
    whole = surface_report(surface, cells, ties, wall_blind=wall_blind)
    warnings = (*_matching_warnings(pairs, matching), *_water_warnings(water))
    return whole.model_copy(
        update={
            "losses": (*whole.losses, *warnings),
            "figures": (*figures_of(_FIGURES, _matching_values(pairs, matching)), *_compared(differences), *whole.figures),
            "grids": (_pairs_grid(pairs, matching), _outcome_grid(pairs, matching), *_windows_grid(pairs, windows), *whole.grids),
            "charts": (_parallax_chart(matching), *whole.charts),
            "products": (*whole.products, *_outlines_of(places)),
            "warnings": (*warnings, *_place_warnings(places), *whole.warnings),
        }
    )


def _compared(differences: MatchingDifferences) -> Iterator[Figure]:
    if differences.cells:
        values = {"differences_cells": differences.cells, "differences_factor": rounded(usual_factor(differences), 3)}
        yield from figures_of(_DIFFERENCES, values)


def _water_warnings(water: WaterLevels) -> Iterator[str]:
    if water.unknown:
        yield (
            f"{water.unknown} of {len(water.levels)} outlines of water have no measured shore: what photographs show inside "
            "is left as it is. Draw them where the land begins."
        )


def _outlines_of(places: WaterPlaces) -> Iterator[Product]:
    if places.places:
        yield Product(path=CANDIDATES, purpose="Places that look like water and are not outlined, to be looked at")


def _place_warnings(places: WaterPlaces) -> Iterator[str]:
    if found := places.places:
        largest = f"{float(f'{found[0].area:.3g}'):g} m² with a shore at {found[0].level:.2f} m"
        count = f"{len(found)} places look" if len(found) > 1 else "One place looks"
        yield (
            f"{count} like water that is not outlined ({'the largest ' if len(found) > 1 else ''}{largest}): photographs "
            f"contradict each other inside, and the ground around is at one level. Nothing was levelled. Look at {CANDIDATES}, "
            "remove what is no water, copy it beside the workflow and name the copy (densification > water): each outline gets "
            "the level of its shore."
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
    return (
        pair.name,
        statistics.outcomes[Outcome.CONVERGED],
        rounded(completeness(statistics), 3),
        rounded(sigma, 3),
        rounded(None if sigma is None else sigma * parallax_height(pair), 3),
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


def _windows_grid(pairs: EpipolarPairs, windows: tuple[AssignedWindows, ...]) -> Iterator[Grid]:
    if windows:
        found = [(pair.name, one) for pair, of_pair in zip(pairs.pairs, windows, strict=True) for one in of_pair.windows]
        yield Grid(
            title="Limits that give a share of the points a window",
            columns=("pair", "step", "limit", "points with a window (%)"),
            rows=tuple((pair, one.step, limits_in_words(one.window), one.share) for pair, one in found),
            note="Found in the left image of each pair, at points with room for the largest window.",
        )


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
