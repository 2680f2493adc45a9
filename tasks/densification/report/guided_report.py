"""The report of guided densification: that of pairs, and how points and search changed from level to level."""

from orthomill.schemas.epipolar import EpipolarPairs
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.stage_report import Figure, Grid, StageReport
from orthomill.schemas.surface import Surface
from orthomill.tasks.densification.guided.point_block import GuidedStatistics
from orthomill.tasks.densification.matching_block import MatchingStatistics
from orthomill.tasks.densification.precision.tie_points import TieCounts
from orthomill.tasks.densification.report.densification_report import report
from orthomill.tasks.densification.settings.guided_matching import Guided
from orthomill.tasks.densification.surface_tile import SurfaceStatistics


def guided_report(
    pairs: EpipolarPairs,
    surface: Surface,
    matching: tuple[MatchingStatistics, ...],
    cells: SurfaceStatistics,
    ties: TieCounts,
    levels: tuple[GuidedStatistics, ...],
    settings: Guided,
) -> StageReport:
    """The report of the pairs with a table of the levels."""
    whole = report(pairs, surface, matching, cells, ties, wall_blind=True)
    figures = (
        Figure(name="guided_points", value=levels[-1].kept, sentence="Points of the densest model, without spikes."),
        Figure(
            name="guided_points_first", value=levels[0].kept, sentence="Points of the first level, without spikes.", detail=True
        ),
    )
    return whole.model_copy(
        update={
            "figures": (*whole.figures, *figures),
            "grids": (_levels_grid(levels, settings), *whole.grids),
            "losses": (*whole.losses, *_narrow_bands(pairs, settings)),
        }
    )


def _levels_grid(levels: tuple[GuidedStatistics, ...], settings: Guided) -> Grid:
    rows = tuple(
        (
            level.number,
            level.threshold,
            level.factor,
            sum(counts.outcomes),
            counts.outcomes[Outcome.CONVERGED],
            counts.kept,
            round(counts.places / max(sum(counts.outcomes), 1), 1),
        )
        for level, counts in zip(settings.levels, levels, strict=True)
    )
    columns = ("level", "threshold", "full pixels along a pixel", "interest points", "matched", "without spikes", "places compared")
    return Grid(title="Levels of points", columns=columns, rows=rows, note="Places are means over the interest points of a level.")


def _narrow_bands(pairs: EpipolarPairs, settings: Guided) -> list[str]:
    """Pairs whose orientation is worse than the rows that are searched."""
    wide = [pair.name for pair in pairs.pairs if pair.row_sigma > max(settings.beside(pair, 0), 0.5)]
    if not wide:
        return []
    named = ", ".join(wide[:3]) + (f" and {len(wide) - 3} more" if len(wide) > 3 else "")
    return [f"Homologous points of {named} may lie beside the {settings.rows} rows that are searched; set rows to auto."]
