"""The orthoimage in the report: grey values, structure, position and, against the truth, occlusions and vehicles."""

from collections.abc import Iterator

from orthomill.schemas.stage_report import Chart, Figure, Picture
from orthomill.schemas.surface import ORTHO
from orthomill.tasks.evaluation.orthoimage_accuracy import OrthoCounts
from orthomill.tasks.evaluation.report.report_section import ReportSection, share_of
from orthomill.tasks.evaluation.tile_sums import OrthoSummary, rounded

ORTHO_DIFFERENCE = "evaluation/ortho_difference"
"""float32 grey levels: orthoimage (brightness fitted) minus reference, mean over the channels"""
_SHIFTED_LIMIT = 10.0
"""% of nodes shifted by more than half a pixel that is worth a warning; roof edges alone reach a few percent"""

_FIGURES = (
    ("ortho_psnr", "dB", "Peak signal-to-noise ratio after one gain and offset per channel."),
    ("ortho_psnr_raw", "dB", "The same with unadjusted grey values."),
    ("ortho_ssim", "", "Structural similarity, mean over all pixels (1 is perfect)."),
    ("ortho_mean_absolute_difference", "grey levels", "Mean absolute difference of the fitted grey values."),
    ("ortho_shift_median_px", "px", "Median shift relative to the reference."),
    ("ortho_shift_q95_px", "px", "95 % of the shifts are below this."),
    ("ortho_shift_above_half_px_share", "%", "Nodes that are shifted by more than 0.5 px."),
    (
        "ortho_shift_measured_above_half_px_share",
        "%",
        "Nodes that are shifted by more than 0.5 px of those around which all heights are measured.",
    ),
    (
        "ortho_shift_nodes",
        "",
        "Nodes at which the shift was measured, where two photographs or more show the ground and no car or water is near.",
    ),
    ("ortho_shift_mean_col_px", "px", "Mean shift to the right."),
    ("ortho_shift_mean_row_px", "px", "Mean shift downwards."),
)
"""name, unit and meaning of the figures that every reference allows"""
_TRUTH_FIGURES = (
    ("ortho_shift_open_ground_median_px", "px", "Median shift on open ground."),
    ("ortho_shift_open_ground_above_half_px_share", "%", "Nodes on open ground that are shifted by more than 0.5 px."),
    ("ortho_shift_roof_median_px", "px", "Median shift on roofs."),
    ("ortho_shift_roof_above_half_px_share", "%", "Nodes on roofs that are shifted by more than 0.5 px."),
    (
        "ortho_datum_shift_mean_col_px",
        "px",
        "Mean shift to the right that the adjusted orientations alone cause: the datum of the block.",
    ),
    ("ortho_datum_shift_mean_row_px", "px", "Mean shift downwards that the adjusted orientations alone cause."),
    ("ortho_own_shift_median_px", "px", "Median shift without that of the datum."),
    ("ortho_own_shift_above_half_px_share", "%", "Nodes that are shifted by more than 0.5 px without the datum."),
    ("ortho_completeness", "%", "Pixels with a colour, of those truly visible in at least one photograph."),
    (
        "ortho_completeness_on_surface",
        "%",
        "The same where the surface model has a height; beyond it, where the photographs end is a guess as well.",
    ),
    ("ortho_hidden_coloured", "%", "Pixels with a colour, of those truly visible in no photograph."),
    (
        "ortho_doubled_share",
        "%",
        "Ground that two photographs show, that buildings hide from another, and that looks like the adjacent roof: doubled roofs.",
    ),
    (
        "ortho_doubled_apart_share",
        "%",
        "The same without the pixels that touch the roof, where its edge is displaced: second images of roofs.",
    ),
    (
        "ortho_doubled_by_chance",
        "%",
        "The same on ground that no building hides from any photograph: how often the rule applies without cause.",
    ),
    (
        "ortho_roof_edges_jagged_px",
        "px",
        "Departure of roof edges from their best straight line over 21 px (root mean square), where two photographs show the roof.",
    ),
    (
        "ortho_roads_disturbed_3",
        "%",
        "Road pixels more than 40 grey levels from their vehicle-free truth where three photographs or more show the place.",
    ),
    (
        "ortho_roads_disturbed_fewer",
        "%",
        "The same where one or two photographs show it, and vehicles cannot be distinguished from the road.",
    ),
)
"""name, unit and meaning of the figures that need the truth: materials and visibility"""


def orthoimage_section(summary: OrthoSummary, truth: bool) -> ReportSection:
    """Everything on the orthoimage; `truth`: materials and visibility are known."""
    return ReportSection(
        figures=tuple(_figures(summary, truth)),
        charts=(_shift_chart(summary),),
        pictures=(
            Picture(
                title="Orthoimage minus reference", raster=ORTHO_DIFFERENCE, style="diverging", unit="grey levels", low=-60, high=60
            ),
            Picture(title="The orthoimage under evaluation", raster=ORTHO, style="rgb"),
        ),
        warnings=tuple(_warnings(summary)),
    )


def _figures(summary: OrthoSummary, truth: bool) -> Iterator[Figure]:
    # a file contains neither materials nor visibility: these figures do not exist then, which is not zero
    values = _values(summary) | (_truth_values(summary) if truth else {})
    for name, unit, sentence in (*_FIGURES, *(_TRUTH_FIGURES if truth else ())):
        yield Figure(name=name, value=values[name], unit=unit, sentence=sentence)


def _values(summary: OrthoSummary) -> dict[str, float | int | None]:
    counts, fit, shift = summary.counts, summary.fit, summary.shift
    matched = shift["matched"]
    return {
        "ortho_psnr": rounded(fit.psnr, 3),
        "ortho_psnr_raw": rounded(fit.psnr_raw, 3),
        "ortho_ssim": share_of(counts.ssim_sum, counts.ssim_count, 1.0),
        "ortho_mean_absolute_difference": share_of(counts.difference_absolute, counts.difference_count, 1.0),
        "ortho_shift_median_px": shift["median"],
        "ortho_shift_q95_px": shift["q95"],
        "ortho_shift_above_half_px_share": shift["share_above_half"],
        "ortho_shift_measured_above_half_px_share": shift["measured_share_above_half"],
        "ortho_shift_nodes": None if matched is None else round(matched),
        "ortho_shift_mean_col_px": shift["mean_dx"],
        "ortho_shift_mean_row_px": shift["mean_dy"],
    }


def _truth_values(summary: OrthoSummary) -> dict[str, float | int | None]:
    counts, shift = summary.counts, summary.shift
    return {
        "ortho_shift_open_ground_median_px": shift["open_ground_median"],
        "ortho_shift_open_ground_above_half_px_share": shift["open_ground_share_above_half"],
        "ortho_shift_roof_median_px": shift["roof_median"],
        "ortho_shift_roof_above_half_px_share": shift["roof_share_above_half"],
        "ortho_datum_shift_mean_col_px": shift["datum_mean_dx"],
        "ortho_datum_shift_mean_row_px": shift["datum_mean_dy"],
        "ortho_own_shift_median_px": shift["own_median"],
        "ortho_own_shift_above_half_px_share": shift["own_share_above_half"],
        "ortho_completeness": share_of(counts.visible_covered, counts.visible),
        "ortho_completeness_on_surface": share_of(counts.visible_modelled_covered, counts.visible_modelled),
        "ortho_hidden_coloured": share_of(counts.hidden_covered, counts.hidden),
        "ortho_doubled_share": share_of(counts.shadow_doubled, counts.shadow),
        "ortho_doubled_apart_share": share_of(counts.shadow_doubled_apart, counts.shadow),
        "ortho_doubled_by_chance": share_of(counts.free_doubled, counts.free),
        "ortho_roof_edges_jagged_px": _jagged(counts),
        "ortho_roads_disturbed_3": share_of(counts.road_3_far, counts.road_3),
        "ortho_roads_disturbed_fewer": share_of(counts.road_fewer_far, counts.road_fewer),
    }


def _jagged(counts: OrthoCounts) -> float | None:
    return rounded((counts.edge_squares / counts.edge_places) ** 0.5, 3) if counts.edge_places else None


def _shift_chart(summary: OrthoSummary) -> Chart:
    return Chart(
        title="Shift of the orthoimage",
        style="bars",
        x_label="shift, px",
        y_label="nodes",
        x=summary.chart_x,
        series={"nodes": summary.chart_y},
        caption="Least-squares matching against the reference; larger shifts are in the last bar.",
    )


def _warnings(summary: OrthoSummary) -> Iterator[str]:
    if (above := summary.shift["share_above_half"]) is not None and above > _SHIFTED_LIMIT:
        yield f"{above:.0f} % of the orthoimage's nodes are shifted by more than half a pixel."
    if not summary.fit.pixels:
        yield "The orthoimage and its reference have no pixel in common."
