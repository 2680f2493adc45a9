"""What the stage `evaluation` tells people: figures with stable names, tables, charts, maps and warnings."""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.stage_report import Chart, Figure, Grid, Picture, StageReport
from orthomill.schemas.surface import ORTHO
from orthomill.tasks.evaluation.accuracy import BINS_PER_CELL, SIGMAS
from orthomill.tasks.evaluation.tile_sums import LEAST_ROOF, HeightsSummary, OrientationSummary, OrthoSummary, rounded

DH = "evaluation/dh"
"""float32 m: surface model minus reference, NaN where either is missing"""
ORTHO_DIFFERENCE = "evaluation/ortho_difference"
"""float32 grey levels: orthoimage (brightness fitted) minus reference, mean over the channels"""


@dataclass(frozen=True)
class EvaluationFacts:
    """What planning knew: the kind of reference, the parallax error assumed (px), and which summaries exist."""

    reference: str
    parallax_sigma: float
    parts: tuple[str, ...]


def _whole(value: float | None) -> int | None:
    return None if value is None else round(value)


_HEIGHT_FIGURES = (
    ("bias", "m", "mean difference from the reference"),
    ("sd", "m", "standard deviation of the differences"),
    ("rmse", "m", "root mean square difference"),
    ("median", "m", "median difference"),
    ("nmad", "m", "normalised median absolute deviation (a standard deviation that blunders do not move)"),
    ("q68", "m", "68 % of the absolute differences are below this"),
    ("q95", "m", "95 % of the absolute differences are below this"),
    ("fgdc95", "m", "1.96 RMSE, the 95 % of the normal law"),
)


def _height_figures(prefix: str, summary: HeightsSummary, full: bool) -> list[Figure]:
    """Figures `<prefix>_<group>_<measure>`; the group `all` has no name of its own."""
    figures = []
    for group in summary.groups:
        head = prefix if group.name == "all" else f"{prefix}_{group.name}"
        for key, unit, words in _HEIGHT_FIGURES if full or group.name in ("all", "open_ground", "roof") else ():
            figures.append(
                Figure(name=f"{head}_{key}", value=group.numbers[key], unit=unit, sentence=f"Heights, {group.words}: {words}.")
            )
        figures += [
            Figure(
                name=f"{head}_completeness",
                value=group.numbers["completeness_seen_twice"],
                unit="%",
                sentence=f"Heights, {group.words}: cells that have a height, of those that two photos or more see.",
            ),
            Figure(
                name=f"{head}_completeness_all",
                value=group.numbers["completeness"],
                unit="%",
                sentence=f"Heights, {group.words}: cells that have a height, of all cells of the grid.",
            ),
            Figure(name=f"{head}_cells", value=_whole(group.numbers["cells"]), sentence=f"Cells, {group.words}."),
        ]
        for number, k in enumerate(SIGMAS if full else ()):
            figures.append(
                Figure(
                    name=f"{head}_within_{k:.0f}_sigma",
                    value=group.within[number],
                    unit="%",
                    sentence=f"Heights, {group.words}: within {k:.0f} of their own reported standard errors.",
                )
            )
            if group.within_expected:
                figures.append(
                    Figure(
                        name=f"{head}_within_{k:.0f}_expected_sigma",
                        value=group.within_expected[number],
                        unit="%",
                        sentence=f"Heights, {group.words}: within {k:.0f} of the expected standard error (H/B) sigma_p.",
                    )
                )
    return figures + _special_figures(prefix, summary)


def _special_figures(prefix: str, summary: HeightsSummary) -> list[Figure]:
    groups = {group.name: group.numbers for group in summary.groups}
    figures = []
    if "roof" in groups:
        figures.append(
            Figure(
                name=f"{prefix}_roof_median_error",
                value=groups["roof"]["median_absolute"],
                unit="m",
                sentence="Median of the absolute height differences on all roof cells.",
            )
        )
    if summary.buildings:
        medians = np.abs([row[2] for row in summary.buildings])
        figures += [
            Figure(
                name=f"{prefix}_buildings_judged",
                value=len(medians),
                sentence=f"Buildings with {LEAST_ROOF} measured roof cells or more.",
            ),
            Figure(
                name=f"{prefix}_buildings_median_error",
                value=rounded(np.median(medians)),
                unit="m",
                sentence="Median over the buildings of their absolute median difference.",
            ),
            Figure(
                name=f"{prefix}_buildings_within_half_metre",
                value=rounded(100 * (medians <= 0.5).mean(), 2),
                unit="%",
                sentence="Buildings whose median difference is 0.5 m or less.",
            ),
        ]
    if "water" in groups:
        empty = groups["water"]["completeness"]
        figures.append(
            Figure(
                name=f"{prefix}_water_left_empty",
                value=None if empty is None else rounded(100 - empty, 2),
                unit="%",
                sentence="Water cells without a height, as they should be.",
            )
        )
    if summary.expected_sigma is not None:
        figures.append(
            Figure(
                name=f"{prefix}_expected_sigma",
                value=summary.expected_sigma,
                unit="m",
                sentence="Expected standard error of a height: (H/B) times ground pixel times parallax error.",
            )
        )
    return figures


def _height_grid(title: str, summary: HeightsSummary) -> Grid:
    keys = (
        "cells",
        "completeness_seen_twice",
        "bias",
        "sd",
        "rmse",
        "median",
        "nmad",
        "median_absolute",
        "q68",
        "q95",
        "lowest",
        "highest",
    )
    heads = ("cells", "complete %", "bias", "SD", "RMSE", "median", "NMAD", "median |dh|", "68 %", "95 %", "lowest", "highest")
    return Grid(
        title=title,
        columns=("where", *heads),
        rows=tuple((g.words, *(g.numbers[k] for k in keys)) for g in summary.groups),
        note="Lengths in m. Complete: of the cells that two photos or more see. Median, NMAD and quantiles from a "
        f"histogram of {100 * summary.cell / BINS_PER_CELL:g} cm bins; differences beyond 20 cells count as 20 there.",
    )


def _sigma_grid(summary: HeightsSummary) -> Grid:
    heads = tuple(f"{word} {k:.0f}" for word in ("reported", "expected") for k in SIGMAS)
    blank = (None,) * len(SIGMAS)
    return Grid(
        title="Shares of height differences within n standard errors, %",
        columns=("where", *heads),
        rows=tuple((g.words, *g.within, *(g.within_expected or blank)) for g in summary.groups),
        note="A normal law has 68.3 within 1 and 99.7 within 3. Beyond 10 is what is missing to 100 in the columns 10. "
        "Reported: each cell's own standard error. Expected: one value from flying height, base and parallax error.",
    )


def _ortho_figures(summary: OrthoSummary, truth: bool) -> list[Figure]:
    c, fit, s = summary.counts, summary.fit, summary.shift
    figures = [
        Figure(
            name="ortho_psnr",
            value=rounded(fit.psnr, 3),
            unit="dB",
            sentence="Peak signal-to-noise ratio after one gain and offset per channel.",
        ),
        Figure(
            name="ortho_psnr_raw", value=rounded(fit.psnr_raw, 3), unit="dB", sentence="The same with the grey values as they are."
        ),
        Figure(
            name="ortho_ssim",
            value=_share(c.ssim_sum, c.ssim_count, 1.0),
            sentence="Structural similarity, mean over all pixels (1 is perfect).",
        ),
        Figure(
            name="ortho_mean_absolute_difference",
            value=_share(c.difference_absolute, c.difference_count, 1.0),
            unit="grey levels",
            sentence="Mean absolute difference of the fitted grey values.",
        ),
        Figure(name="ortho_shift_median_px", value=s["median"], unit="px", sentence="Median shift against the reference."),
        Figure(name="ortho_shift_q95_px", value=s["q95"], unit="px", sentence="95 % of the shifts are below this."),
        Figure(
            name="ortho_shift_above_half_px_share",
            value=s["share_above_half"],
            unit="%",
            sentence="Nodes that are shifted by more than 0.5 px.",
        ),
        Figure(name="ortho_shift_nodes", value=_whole(s["matched"]), sentence="Nodes at which the shift was measured."),
        Figure(name="ortho_shift_mean_col_px", value=s["mean_dx"], unit="px", sentence="Mean shift to the right."),
        Figure(name="ortho_shift_mean_row_px", value=s["mean_dy"], unit="px", sentence="Mean shift downwards."),
    ]
    return figures + (_truth_figures(summary) if truth else [])


def _truth_figures(summary: OrthoSummary) -> list[Figure]:
    c, s = summary.counts, summary.shift
    return [
        Figure(
            name="ortho_shift_open_ground_median_px",
            value=s["open_ground_median"],
            unit="px",
            sentence="Median shift on open ground.",
        ),
        Figure(
            name="ortho_shift_open_ground_above_half_px_share",
            value=s["open_ground_share_above_half"],
            unit="%",
            sentence="Nodes on open ground that are shifted by more than 0.5 px.",
        ),
        Figure(name="ortho_shift_roof_median_px", value=s["roof_median"], unit="px", sentence="Median shift on roofs."),
        Figure(
            name="ortho_shift_roof_above_half_px_share",
            value=s["roof_share_above_half"],
            unit="%",
            sentence="Nodes on roofs that are shifted by more than 0.5 px.",
        ),
        Figure(
            name="ortho_completeness",
            value=_share(c.visible_covered, c.visible),
            unit="%",
            sentence="Pixels with a colour, of those that some photo truly sees.",
        ),
        Figure(
            name="ortho_hidden_coloured",
            value=_share(c.hidden_covered, c.hidden),
            unit="%",
            sentence="Pixels with a colour, of those that no photo truly sees.",
        ),
        Figure(
            name="ortho_doubled_share",
            value=_share(c.shadow_doubled, c.shadow),
            unit="%",
            sentence="Ground that buildings hide from some photo and that looks like the roof beside it instead of itself: "
            "doubled roofs.",
        ),
        Figure(
            name="ortho_doubled_by_chance",
            value=_share(c.free_doubled, c.free),
            unit="%",
            sentence="The same on ground that no building hides from any photo: how often the rule strikes without cause.",
        ),
        Figure(
            name="ortho_roads_disturbed_3",
            value=_share(c.road_3_far, c.road_3),
            unit="%",
            sentence="Road pixels more than 40 grey levels from their vehicle-free truth where three photos or more see the place.",
        ),
        Figure(
            name="ortho_roads_disturbed_fewer",
            value=_share(c.road_fewer_far, c.road_fewer),
            unit="%",
            sentence="The same where one or two photos see it, and vehicles cannot be told from the road.",
        ),
    ]


def _share(part: float, whole: float, unit: float = 100.0) -> float | None:
    return round(unit * part / whole, 4) if whole else None


def _orientation_figures(summary: OrientationSummary) -> list[Figure]:
    words = {
        "photos_compared": ("", "Photos compared with their true orientation."),
        "photos_unoriented": ("", "Photos of the scene that did not join the block."),
        "centre_rmse_plan": ("m", "Projection centres, root mean square distance in plan."),
        "centre_rmse_height": ("m", "Projection centres, root mean square difference in height."),
        "centre_largest": ("m", "Largest difference of a coordinate of a projection centre."),
        "centre_sigma_mean": ("m", "Mean reported standard error of these coordinates."),
        "rotation_rmse": ("degrees", "Root mean square difference of omega, phi and kappa."),
        "rotation_largest": ("degrees", "Largest of these differences."),
        "centres_within_1_sigma": (
            "%",
            "Coordinates of projection centres within one of their own standard errors (a normal law has 68.3).",
        ),
        "centres_within_3_sigma": ("%", "Coordinates of projection centres within three of their own standard errors."),
        "rotations_within_3_sigma": ("%", "Angles within three of their own standard errors."),
        "interior_within_3_sigma": ("%", "Interior orientation parameters within three of their own standard errors."),
    }
    return [Figure(name=name, value=summary.numbers.get(name), unit=unit, sentence=text) for name, (unit, text) in words.items()]


def _orientation_parts(summary: OrientationSummary) -> tuple[tuple[Grid, ...], tuple[Chart, ...]]:
    photos = Grid(
        title="Orientation against the truth",
        rows=summary.photos,
        columns=(
            "photo",
            "dX m",
            "dY m",
            "dZ m",
            "domega deg",
            "dphi deg",
            "dkappa deg",
            "largest centre ratio",
            "largest angle ratio",
        ),
        note="Block minus truth. A ratio is a difference over its own standard error.",
    )
    interior = Grid(
        title="Interior orientation against the truth",
        rows=summary.interior,
        columns=("camera", "parameter", "block", "truth", "standard error", "ratio"),
    )
    if not summary.places:
        return (photos, interior), ()
    x, y = zip(*summary.places, strict=True)
    arrows = Chart(
        title="Projection centres against the truth",
        style="arrows",
        x_label="X m",
        y_label="Y m",
        x=x,
        series={"y": y, "dx": tuple(p[1] for p in summary.photos), "dy": tuple(p[2] for p in summary.photos)},
        labels=tuple(p[0] for p in summary.photos),
        caption="Differences in plan, m, drawn exaggerated.",
    )
    return (photos, interior), (arrows,)


def _warnings(heights: HeightsSummary | None, orientation: OrientationSummary | None, ortho: OrthoSummary | None) -> list[str]:
    warnings = []
    groups = {group.name: group for group in heights.groups} if heights else {}
    ground = groups.get("open_ground") or groups.get("all")
    if heights and ground is None:
        warnings.append("No cell of the surface model lies within the reference: nothing was compared. Look at the CRS of both.")
    if ground and ground.within and ground.within[1] is not None and ground.within[1] < 95.0:
        warnings.append(
            f"Only {ground.within[1]:.0f} % of the heights ({ground.words}) lie within three of their own reported "
            "standard errors (a normal law has 99.7): the reported precision is too good for what was reached."
        )
    if orientation and (share := orientation.numbers.get("centres_within_3_sigma")) is not None and share < 95.0:
        warnings.append(f"Only {share:.0f} % of the projection centres' coordinates lie within three of their own standard errors.")
    if ortho and (above := ortho.shift["share_above_half"]) is not None and above > 10.0:
        warnings.append(f"{above:.0f} % of the orthoimage's nodes are shifted by more than half a pixel.")
    if ortho and not ortho.fit.pixels:
        warnings.append("The orthoimage and its reference have no pixel in common.")
    return warnings


def _ortho_chart(summary: OrthoSummary) -> Chart:
    return Chart(
        title="Shift of the orthoimage",
        style="bars",
        x_label="shift, px",
        y_label="nodes",
        x=summary.chart_x,
        series={"nodes": summary.chart_y},
        caption="Least-squares matching against the reference; larger shifts are in the last bar.",
    )


def _height_chart(title: str, summary: HeightsSummary) -> Chart:
    return Chart(
        title=title,
        style="lines",
        x_label="surface model minus reference, m",
        y_label="% of cells",
        x=summary.chart_x,
        series=summary.chart,
    )


def _building_grid(summary: HeightsSummary) -> tuple[Grid, ...]:
    if not summary.buildings:
        return ()
    worst = sorted(summary.buildings, key=lambda row: -abs(row[2]))[:12]
    return (
        Grid(
            title="Buildings with the largest median difference",
            columns=("building", "roof cells", "median difference m"),
            rows=tuple(worst),
        ),
    )


_MAIN = (
    "dsm_bias",
    "dsm_rmse",
    "dsm_nmad",
    "dsm_q95",
    "dsm_completeness",
    "dsm_within_3_sigma",
    "dsm_open_ground_rmse",
    "dsm_roof_median_error",
    "dsm_buildings_median_error",
    "dsm_water_left_empty",
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
"""What a reader asks first; everything else is a detail of these."""


def _main_first(figures: list[Figure]) -> tuple[Figure, ...]:
    main = [figure for figure in figures if figure.name in _MAIN]
    return (*main, *(figure.model_copy(update={"detail": True}) for figure in figures if figure.name not in _MAIN))


def evaluation_report(
    facts: EvaluationFacts,
    orientation: OrientationSummary | None = None,
    heights: HeightsSummary | None = None,
    heights_before_check: HeightsSummary | None = None,
    ortho: OrthoSummary | None = None,
) -> StageReport:
    """The report of the stage from what was compared."""
    figures, grids, charts, pictures = [], [], [], []
    if heights:
        figures += _height_figures("dsm", heights, full=True)
        grids += [_height_grid("Surface model against the reference", heights), _sigma_grid(heights), *_building_grid(heights)]
        charts.append(_height_chart("Height differences", heights))
        pictures.append(
            Picture(
                title="Surface model minus reference",
                raster=DH,
                style="diverging",
                unit="m",
                low=-2 * heights.cell,
                high=2 * heights.cell,
                caption="Red and blue: too high or too low by two cells' length or more.",
            )
        )
    if heights_before_check:
        figures += _height_figures("dsm_before_check", heights_before_check, full=False)
        grids.append(_height_grid("Surface model before its check", heights_before_check))
    if ortho:
        figures += _ortho_figures(ortho, facts.reference == "truth")
        charts.append(_ortho_chart(ortho))
        pictures += [
            Picture(
                title="Orthoimage minus reference", raster=ORTHO_DIFFERENCE, style="diverging", unit="grey levels", low=-60, high=60
            ),
            Picture(title="The orthoimage that was judged", raster=ORTHO, style="rgb"),
        ]
    if orientation:
        figures += _orientation_figures(orientation)
        more_grids, more_charts = _orientation_parts(orientation)
        grids += more_grids
        charts += more_charts
    warnings = _warnings(heights, orientation, ortho)
    if not facts.parts:
        warnings.append("Nothing was compared: the workflow names no reference, or none of the stages that could be judged.")
    return StageReport(
        figures=_main_first(figures), grids=tuple(grids), charts=tuple(charts), pictures=tuple(pictures), warnings=tuple(warnings)
    )
