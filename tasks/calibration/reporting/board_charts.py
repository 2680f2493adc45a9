"""The charts of a calibration from chessboards: distortion, correlations, corners and residuals over the frame."""

import numpy as np

from orthomill.schemas.stage_report import Chart
from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment
from orthomill.tasks.calibration.reporting.advice import CELLS, frame_cells
from orthomill.tasks.calibration.reporting.calibration_results import CalibrationResults
from orthomill.tasks.calibration.reporting.distortion_curve import RADIUS_SHARE, Radial, balanced, balancing_change, displacement
from orthomill.tasks.calibration.solving.calibration_precision import correlations
from orthomill.tasks.calibration.solving.solving import CalibrationTarget

_MOST_VECTORS = 250
"""Residual vectors in one chart: more of them hide each other."""
_FEWEST_IN_CELL = 5
"""Corners from which the mean residual of a cell is shown: of fewer it is mostly noise."""
_MOST_PARAMETERS = 6
"""Interior parameters in the chart of correlations: c, x0, y0 and the largest terms of the distortion."""


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


def balance(results: CalibrationResults) -> tuple[float, float]:
    """Radius (px) of the balanced distortion curve and the change of c (px) that belongs to it."""
    interior, radius = results.result.state.interior, RADIUS_SHARE * 0.5 * float(np.hypot(*results.target.size))
    return radius, balancing_change(interior[0], radial_of(interior), radius)


def radial_of(interior: np.ndarray) -> Radial:
    """k1, k2, k3 of interior parameters in the order of PARAMETERS."""
    k1, k2, k3 = interior[3:6].tolist()
    return k1, k2, k3


def _curve(results: CalibrationResults) -> Chart:
    interior = results.result.state.interior
    radius, change = balance(results)
    # To the corner of the frame, beyond the radius over which the curve is balanced.
    r = np.linspace(0.0, 0.5 * float(np.hypot(*results.target.size)), 60)
    series = {
        "as adjusted": displacement(r, interior[0], radial_of(interior)),
        f"balanced, c {change:+.1f} px": balanced(r, interior[0], radial_of(interior), change),
    }
    return Chart(
        title="Balanced radial distortion",
        style="lines",
        x_label="ideal radius (px)",
        y_label="displacement (px)",
        x=tuple(r.round(1).tolist()),
        series={name: tuple(y.round(4).tolist()) for name, y in series.items()},
        caption=f"Balanced over a radius of {radius:.0f} px ({RADIUS_SHARE:g} of half the diagonal); for comparison only.",
    )


def _correlation_chart(result: BoardAdjustment) -> Chart:
    table = correlations(result)
    series = {
        row: tuple((100 * table.typical[number]).round(1).tolist())
        for number, row in enumerate(table.rows)
        if number < _MOST_PARAMETERS
    }
    return Chart(
        title="Correlations of the interior orientation",
        style="bars",
        x_label="",
        y_label="|correlation| (%)",
        x=tuple(float(i) for i in range(len(table.columns))),
        labels=table.columns,
        series=series,
        caption="With exterior orientations (root mean square over photographs), places of boards (over boards), and each other.",
    )


def _corner_chart(result: BoardAdjustment, target: CalibrationTarget) -> Chart:
    """With the border of the frame, so that its empty parts are visible."""
    # Two series on one axis: each is NaN where the other has its points.
    pixels = target.pixels(result.corners.xy[result.used])
    width, height = np.array(target.size) - 1
    along, none = np.linspace(0.0, 1.0, 60), np.zeros(60)
    # y is drawn upwards, pixels count downwards: rows are shown as negative numbers.
    sides = [(along * width, none), (along * width, none + height), (none, along * height), (none + width, along * height)]
    x, y = np.concatenate([pixels.T, *sides], axis=1).round(1)
    corner = np.arange(len(x)) < len(pixels)
    series = {"corners used": np.where(corner, -y, np.nan), "border of the frame": np.where(corner, np.nan, -y)}
    return Chart(
        title="Corners over the frame",
        style="points",
        x_label="column (px)",
        y_label="row (px, downwards negative)",
        x=tuple(x.tolist()),
        series={name: tuple(values.tolist()) for name, values in series.items()},
        caption="What is empty within the border of the frame is extrapolated.",
    )


def _cell_chart(result: BoardAdjustment, target: CalibrationTarget) -> Chart:
    """Mean residual per cell of the frame: what is common to all photographs is not noise but an error of the model."""
    number, residual = frame_cells(result, target), result.residual[result.used]
    count = np.bincount(number, minlength=CELLS**2)
    known = np.flatnonzero(count >= _FEWEST_IN_CELL)
    mean = np.column_stack([np.bincount(number, residual[:, axis], CELLS**2)[known] / count[known] for axis in (0, 1)])
    centre = (np.column_stack([known % CELLS, known // CELLS]) + 0.5) / CELLS * target.size
    series = {"y": -centre[:, 1], "dx": mean[:, 0], "dy": mean[:, 1]}
    return Chart(
        title="Mean residuals over the frame",
        style="arrows",
        x_label="column (px)",
        y_label="row (px, downwards negative)",
        x=tuple(centre[:, 0].round(1).tolist()),
        series={name: tuple(value.round(4).tolist()) for name, value in series.items()},
        caption="In px, the mean of each cell. Arrows that agree over neighbouring cells show distortion that the model does not "
        "describe.",
    )


def _vector_chart(result: BoardAdjustment, target: CalibrationTarget) -> Chart:
    pixels, residual = target.pixels(result.corners.xy[result.used]), result.residual[result.used]
    # Every n-th corner in the order board, corner, photo: all boards and photographs are among them.
    some = np.arange(0, len(pixels), max(1, -(-len(pixels) // _MOST_VECTORS)))
    series = {"y": -pixels[some, 1], "dx": residual[some, 0], "dy": residual[some, 1]}
    return Chart(
        title="Residual vectors",
        style="arrows",
        x_label="column (px)",
        y_label="row (px, downwards negative)",
        x=tuple(pixels[some, 0].round(1).tolist()),
        series={name: tuple(value.round(4).tolist()) for name, value in series.items()},
        caption=f"Residuals in px, rows upwards: every corner or, of many, one in {max(1, -(-len(pixels) // _MOST_VECTORS))}.",
    )


def _histogram(result: BoardAdjustment) -> Chart:
    values = result.residual[result.used].ravel()
    # Four standard errors hold all that was not rejected; the ends collect the rest.
    reach = 4.0 * max(result.sigma0, 1e-9)
    count, edges = np.histogram(np.clip(values, -reach, reach), bins=33, range=(-reach, reach))
    return Chart(
        title="Residuals of the corners",
        style="bars",
        x_label="residual of a coordinate (px)",
        y_label="corners",
        x=tuple(edges.round(4).tolist()),
        series={"corners": tuple(count.tolist())},
    )
