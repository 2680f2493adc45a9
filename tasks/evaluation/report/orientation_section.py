"""The orientation in the report: differences from the true block, and their ratio to the reported standard errors."""

from collections.abc import Iterator

from orthomill.schemas.stage_report import Chart, Figure, Grid
from orthomill.tasks.evaluation.report.report_section import ReportSection
from orthomill.tasks.evaluation.tile_sums import OrientationSummary

_RATIO_LIMIT = 95.0
"""% of coordinates within three standard errors; below, the covariance of the block is too optimistic"""

_FIGURES = (
    ("photos_compared", "", "Photographs compared with their true orientation."),
    ("photos_unoriented", "", "Photographs of the scene that are not in the block."),
    ("centre_rmse_plan", "m", "Projection centres, root mean square distance in plan."),
    ("centre_rmse_height", "m", "Projection centres, root mean square difference in height."),
    ("centre_largest", "m", "Largest difference of a coordinate of a projection centre."),
    ("centre_sigma_mean", "m", "Mean reported standard error of these coordinates."),
    ("rotation_rmse", "degrees", "Root mean square difference of omega, phi and kappa."),
    ("rotation_largest", "degrees", "Largest of these differences."),
    (
        "centres_within_1_sigma",
        "%",
        "Coordinates of projection centres within one of their own standard errors (a normal law has 68.3).",
    ),
    ("centres_within_3_sigma", "%", "Coordinates of projection centres within three of their own standard errors."),
    ("rotations_within_3_sigma", "%", "Angles within three of their own standard errors."),
    ("interior_within_3_sigma", "%", "Interior orientation parameters within three of their own standard errors."),
)
"""name, unit and meaning of every figure"""
_PHOTO_COLUMNS = (
    "photo",
    "dX m",
    "dY m",
    "dZ m",
    "domega deg",
    "dphi deg",
    "dkappa deg",
    "largest centre ratio",
    "largest angle ratio",
)


def orientation_section(summary: OrientationSummary) -> ReportSection:
    """Everything on the orientation of the block."""
    figures = (Figure(name=n, value=summary.numbers.get(n), unit=unit, sentence=sentence) for n, unit, sentence in _FIGURES)
    return ReportSection(
        figures=tuple(figures),
        grids=(_photo_grid(summary), _interior_grid(summary)),
        charts=_arrows(summary),
        warnings=tuple(_warnings(summary)),
    )


def _photo_grid(summary: OrientationSummary) -> Grid:
    note = "Block minus truth. A ratio is a difference over its own standard error."
    return Grid(title="Orientation against the truth", rows=summary.photos, columns=_PHOTO_COLUMNS, note=note)


def _interior_grid(summary: OrientationSummary) -> Grid:
    columns = ("camera", "parameter", "block", "truth", "standard error", "ratio")
    return Grid(title="Interior orientation against the truth", rows=summary.interior, columns=columns)


def _arrows(summary: OrientationSummary) -> tuple[Chart, ...]:
    """The differences in plan as a vector plot; none without a photograph in common."""
    # an empty chart would be drawn as a chart of nothing
    if not summary.places:
        return ()
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
    return (arrows,)


def _warnings(summary: OrientationSummary) -> Iterator[str]:
    share = summary.numbers.get("centres_within_3_sigma")
    if share is not None and share < _RATIO_LIMIT:
        yield f"Only {share:.0f} % of the projection centres' coordinates lie within three of their own standard errors."
