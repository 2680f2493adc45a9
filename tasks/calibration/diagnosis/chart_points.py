"""The points of the charts of a calibration: distortion along the radius, corners and residuals over the frame."""

from typing import NamedTuple

import numpy as np

from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment
from orthomill.tasks.calibration.diagnosis.advice import CELLS, frame_cells
from orthomill.tasks.calibration.diagnosis.calibration_results import CalibrationResults
from orthomill.tasks.calibration.diagnosis.distortion_curve import (
    RADIUS_SHARE,
    Radial,
    balanced,
    balancing_change,
    radial_displacement,
)
from orthomill.tasks.calibration.solving.calibration_precision import correlations
from orthomill.tasks.calibration.solving.solving import CalibrationTarget

_MOST_VECTORS = 250
"""Residual vectors in one chart: more of them hide each other."""
_BALANCED = 0.2
"""Largest change of c, in units of c, that is a balance and not another lens."""
_FEWEST_IN_CELL = 5
"""Corners from which the mean residual of a cell is shown: of fewer it is mostly noise."""
_MOST_PARAMETERS = 6
"""Interior parameters in the chart of correlations: c, x0, y0 and the largest terms of the distortion."""


class ChartPoints(NamedTuple):
    """The abscissae of a chart and its series by name, rounded for the report."""

    x: tuple[float, ...]
    series: dict[str, tuple[float, ...]]


def balance(results: CalibrationResults) -> tuple[float, float | None]:
    """Radius (px) of the balanced distortion curve and the change of c (px) that belongs to it; None where there is none.

    It belongs to Brown's polynomial, and to distortion that is small against the ray: a line through the curve of a fisheye is no
    camera constant.
    """
    state, radius = results.result.state, RADIUS_SHARE * 0.5 * float(np.hypot(*results.target.size))
    change = balancing_change(state.interior[0], radial_of(state.interior), radius)
    return radius, change if state.lens == "brown" and abs(change) < _BALANCED * state.interior[0] else None


def radial_of(interior: np.ndarray) -> Radial:
    """k1, k2, k3 of interior parameters in the order of PARAMETERS."""
    k1, k2, k3 = interior[3:6].tolist()
    return k1, k2, k3


def curve_points(results: CalibrationResults) -> ChartPoints:
    """The distortion (px) as adjusted and, where there is such a curve, balanced, by ideal radius (px)."""
    state = results.result.state
    _, change = balance(results)
    # To the corner of the frame, beyond the radius over which the curve is balanced.
    r = np.linspace(0.0, 0.5 * float(np.hypot(*results.target.size)), 60)
    series = {"as adjusted": radial_displacement(r, state.interior, state.lens)}
    if change is not None:
        series[f"balanced, c {change:+.1f} px"] = balanced(r, state.interior[0], radial_of(state.interior), change)
    return ChartPoints(tuple(r.round(1).tolist()), {name: tuple(y.round(4).tolist()) for name, y in series.items()})


def typical_correlations(result: BoardAdjustment) -> tuple[tuple[str, ...], dict[str, tuple[float, ...]]]:
    """Names of what the first interior parameters are correlated with, and their typical correlations (%) by parameter."""
    table = correlations(result)
    series = {
        row: tuple((100 * table.typical[number]).round(1).tolist())
        for number, row in enumerate(table.rows)
        if number < _MOST_PARAMETERS
    }
    return table.columns, series


def corner_points(result: BoardAdjustment, target: CalibrationTarget) -> ChartPoints:
    """The corners used (column, -row; px) and the border of the frame, so that its empty parts are visible."""
    # Two series on one axis: each is NaN where the other has its points.
    pixels = target.pixels(result.corners.xy[result.used])
    width, height = np.array(target.size) - 1
    along, none = np.linspace(0.0, 1.0, 60), np.zeros(60)
    # y is drawn upwards, pixels count downwards: rows are shown as negative numbers.
    sides = [(along * width, none), (along * width, none + height), (none, along * height), (none + width, along * height)]
    x, y = np.concatenate([pixels.T, *sides], axis=1).round(1)
    corner = np.arange(len(x)) < len(pixels)
    series = {"corners used": np.where(corner, -y, np.nan), "border of the frame": np.where(corner, np.nan, -y)}
    return ChartPoints(tuple(x.tolist()), {name: tuple(values.tolist()) for name, values in series.items()})


def cell_points(result: BoardAdjustment, target: CalibrationTarget) -> ChartPoints:
    """Mean residual (px) per cell of the frame: what is common to all photographs is not noise but an error of the model."""
    number, residual = frame_cells(result, target), result.residual[result.used]
    count = np.bincount(number, minlength=CELLS**2)
    known = np.flatnonzero(count >= _FEWEST_IN_CELL)
    mean = np.column_stack([np.bincount(number, residual[:, axis], CELLS**2)[known] / count[known] for axis in (0, 1)])
    centre = (np.column_stack([known % CELLS, known // CELLS]) + 0.5) / CELLS * target.size
    series = {"y": -centre[:, 1], "dx": mean[:, 0], "dy": mean[:, 1]}
    return ChartPoints(tuple(centre[:, 0].round(1).tolist()), {name: tuple(v.round(4).tolist()) for name, v in series.items()})


def vector_step(result: BoardAdjustment) -> int:
    """One of so many residuals is shown."""
    return max(1, -(-int(result.used.sum()) // _MOST_VECTORS))


def vector_points(result: BoardAdjustment, target: CalibrationTarget) -> ChartPoints:
    """The residuals (px) of some corners at their places."""
    pixels, residual = target.pixels(result.corners.xy[result.used]), result.residual[result.used]
    # Every n-th corner in the order board, corner, photo: all boards and photographs are among them.
    some = np.arange(0, len(pixels), vector_step(result))
    series = {"y": -pixels[some, 1], "dx": residual[some, 0], "dy": residual[some, 1]}
    return ChartPoints(tuple(pixels[some, 0].round(1).tolist()), {name: tuple(v.round(4).tolist()) for name, v in series.items()})


def residual_classes(result: BoardAdjustment) -> ChartPoints:
    """Edges of the classes of residual coordinates (px), and how many corners are in each."""
    values = result.residual[result.used].ravel()
    # Four standard errors hold all that was not rejected; the ends collect the rest.
    reach = 4.0 * max(result.sigma0, 1e-9)
    count, edges = np.histogram(np.clip(values, -reach, reach), bins=33, range=(-reach, reach))
    return ChartPoints(tuple(edges.round(4).tolist()), {"corners": tuple(count.tolist())})
