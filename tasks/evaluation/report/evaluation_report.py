"""The report of the evaluation: sections on heights, orthoimage and orientation, and the figures that come first."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from typing import Literal

from orthomill.schemas.stage_report import Figure, StageReport, Verdict
from orthomill.tasks.evaluation.ground_accuracy import GroundSummary
from orthomill.tasks.evaluation.point_accuracy import PointsSummary
from orthomill.tasks.evaluation.report.codes_section import check_section
from orthomill.tasks.evaluation.report.ground_section import ground_section
from orthomill.tasks.evaluation.report.heights_section import before_check_section, heights_section, near_share
from orthomill.tasks.evaluation.report.orientation_section import orientation_section
from orthomill.tasks.evaluation.report.orthoimage_section import orthoimage_section
from orthomill.tasks.evaluation.report.points_section import points_section
from orthomill.tasks.evaluation.report.report_section import ReportSection
from orthomill.tasks.evaluation.tile_sums import CheckSummary, HeightsSummary, OrientationSummary, OrthoSummary

_NEAR_ENOUGH = 95.0
"""% of the measured heights within three expected standard errors that a good surface has: some stand in crowns and at edges"""


@dataclass(frozen=True)
class EvaluationFacts:
    """Facts known at planning: the kind of reference, and which summaries exist."""

    reference: str
    parts: tuple[str, ...]


_MAIN = (
    "dsm_bias",
    "dsm_rmse",
    "dsm_nmad",
    "dsm_q95",
    "dsm_completeness",
    "dsm_measured_beyond_1_m",
    "dsm_measured_within_2_sigma",
    "dsm_all_codes_share",
    "dsm_within_3_sigma",
    "points_compared",
    "points_bias",
    "points_rmse",
    "points_measured_within_2_sigma",
    "dsm_open_ground_rmse",
    "dsm_roof_median_error",
    "dsm_buildings_median_error",
    "dsm_water_left_empty",
    "check_judged_open_ground",
    "check_judged_roof",
    "check_judged_building_margin",
    "terrain_open_ground_rmse",
    "terrain_roof_rmse",
    "terrain_within_2_sigma",
    "ortho_shift_median_px",
    "ortho_shift_q95_px",
    "ortho_ssim",
    "ortho_completeness",
    "ortho_doubled_share",
    "centre_rmse_plan",
    "centre_rmse_height",
    "rotation_rmse",
    "centres_within_3_sigma",
    "interior_within_3_sigma",
)
"""the questions that a reader asks first; all other figures are details of these"""


def _main_first(figures: list[Figure]) -> tuple[Figure, ...]:
    # order, not selection: every figure keeps its stable name in summary.json
    main = [figure for figure in figures if figure.name in _MAIN]
    return (*main, *(figure.model_copy(update={"detail": True}) for figure in figures if figure.name not in _MAIN))


def evaluation_report(
    facts: EvaluationFacts,
    orientation: OrientationSummary | None = None,
    heights: HeightsSummary | None = None,
    heights_before_check: HeightsSummary | None = None,
    check: CheckSummary | None = None,
    points: PointsSummary | None = None,
    terrain: GroundSummary | None = None,
    ortho: OrthoSummary | None = None,
) -> StageReport:
    """The report of the stage from the comparisons that were made."""
    # most readers come for the heights, so these lead
    sections: list[ReportSection] = []
    if heights:
        sections.append(heights_section(heights))
    if heights_before_check:
        sections.append(before_check_section(heights_before_check))
    if points:
        sections.append(points_section(points))
    if check:
        sections.append(check_section(check))
    if terrain:
        sections.append(ground_section(terrain))
    if ortho:
        sections.append(orthoimage_section(ortho, facts.reference == "truth"))
    if orientation:
        sections.append(orientation_section(orientation))
    doubts = tuple(chain.from_iterable(section.warnings for section in sections))
    return StageReport(
        verdict=_verdict(facts, heights, len(doubts)),
        aside=True,
        figures=_main_first([figure for section in sections for figure in section.figures]),
        grids=tuple(chain.from_iterable(section.grids for section in sections)),
        charts=tuple(chain.from_iterable(section.charts for section in sections)),
        pictures=tuple(chain.from_iterable(section.pictures for section in sections)),
        # A reference that contradicts the results, or their stated precision, is no mere remark.
        doubts=doubts,
        warnings=tuple(_warnings(sections, facts)),
    )


def _verdict(facts: EvaluationFacts, heights: HeightsSummary | None, doubts: int) -> Verdict:
    """How the results compare with what is known; it stands at its stage, its doubts stand on the first page."""
    if not facts.parts:
        return Verdict(level="fair", sentence="Nothing was compared with a reference.")
    words = f"Compared with {'the truth' if facts.reference == 'truth' else 'the reference'}: {', '.join(facts.parts)}"
    level: Literal["good", "fair", "poor"] = "poor" if doubts else "good"
    if heights and (near := near_share(heights)) is not None:
        level = "fair" if level == "good" and near < _NEAR_ENOUGH else level
        words += f"; {near:.0f} % of the measured heights are as near as the photographs allow"
    return Verdict(level=level, sentence=f"{words.replace('_', ' ')}.")


def _warnings(sections: list[ReportSection], facts: EvaluationFacts) -> Iterator[str]:
    for section in sections:
        yield from section.warnings
    if not facts.parts:
        yield "Nothing was compared: the workflow names no reference, or has none of the stages that could be evaluated."
