"""The charts of a calibration from chessboards: distortion, correlations, corners and residuals over the frame."""

from orthomill.schemas.stage_report import Chart
from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment
from orthomill.tasks.calibration.diagnosis.calibration_results import CalibrationResults
from orthomill.tasks.calibration.diagnosis.chart_points import (
    balance,
    cell_points,
    corner_points,
    curve_points,
    residual_classes,
    typical_correlations,
    vector_points,
    vector_step,
)
from orthomill.tasks.calibration.diagnosis.distortion_curve import RADIUS_SHARE
from orthomill.tasks.calibration.solving.solving import CalibrationTarget


def board_charts(results: CalibrationResults) -> tuple[Chart, ...]:
    """All charts, in the order of the report."""
    result, target = results.result, results.target
    return (
        _curve(results),
        _correlation_chart(result),
        _corner_chart(result, target),
        _cell_chart(result, target),
        _vector_chart(result, target),
        _histogram(result),
    )


def _curve(results: CalibrationResults) -> Chart:
    points, (radius, change) = curve_points(results), balance(results)
    caption = f"Balanced over a radius of {radius:.0f} px ({RADIUS_SHARE:g} of half the diagonal); for comparison only."
    return Chart(
        title="Radial distortion as adjusted" if change is None else "Balanced radial distortion",
        style="lines",
        x_label="ideal radius (px)",
        y_label="displacement (px)",
        x=points.x,
        series=points.series,
        caption="" if change is None else caption,
    )


def _correlation_chart(result: BoardAdjustment) -> Chart:
    columns, series = typical_correlations(result)
    return Chart(
        title="Correlations of the interior orientation",
        style="bars",
        x_label="",
        y_label="|correlation| (%)",
        x=tuple(float(i) for i in range(len(columns))),
        labels=columns,
        series=series,
        caption="With exterior orientations (root mean square over photographs), places of boards (over boards), and each other.",
    )


def _corner_chart(result: BoardAdjustment, target: CalibrationTarget) -> Chart:
    points = corner_points(result, target)
    return Chart(
        title="Corners over the frame",
        style="points",
        x_label="column (px)",
        y_label="row (px, downwards negative)",
        x=points.x,
        series=points.series,
        caption="What is empty within the border of the frame is extrapolated.",
    )


def _cell_chart(result: BoardAdjustment, target: CalibrationTarget) -> Chart:
    points = cell_points(result, target)
    return Chart(
        title="Mean residuals over the frame",
        style="arrows",
        x_label="column (px)",
        y_label="row (px, downwards negative)",
        x=points.x,
        series=points.series,
        caption="In px, the mean of each cell. Arrows that agree over neighbouring cells show distortion that the model does not "
        "describe.",
    )


def _vector_chart(result: BoardAdjustment, target: CalibrationTarget) -> Chart:
    points = vector_points(result, target)
    return Chart(
        title="Residual vectors",
        style="arrows",
        x_label="column (px)",
        y_label="row (px, downwards negative)",
        x=points.x,
        series=points.series,
        caption=f"Residuals in px, rows upwards: every corner or, of many, one in {vector_step(result)}.",
    )


def _histogram(result: BoardAdjustment) -> Chart:
    points = residual_classes(result)
    return Chart(
        title="Residuals of the corners",
        style="bars",
        x_label="residual of a coordinate (px)",
        y_label="corners",
        x=points.x,
        series=points.series,
    )
