"""The part of a plane on which a surface is made: where the wall is, and not all that photographs see along its plane.

The wall is where tie points lie near the plane, or are seen as finely as those: wings before and behind the plane belong to it, and
so does the top of a tower. What lies far beside or behind the wall does not, although photographs that look along it show it: with
cells as small as those of the wall it would be most of the surface, and of the work.
"""

import numpy as np

from orthomill.schemas.orientation import Area

LEAST_POINTS = 20
"""tie points below which neither a plane nor its area is found among them"""
NEAR = 3.0
"""times the width of the narrowest layer along the plane that holds half of the points"""
FINE = 1.6
"""times the median distance from the nearest projection centre: of pairs, ground pixels may differ as much (`PairChoice.scale`)"""
TRIM = 0.5
"""% of the points on each side that may be wrong"""
MARGIN = 0.05
"""of the extent: what of the wall lies beyond its outermost points"""


def wall_area(points: np.ndarray, centres: np.ndarray) -> Area | None:
    """Where the wall is, of tie points (N, 3) and projection centres (P, 3) in the system of its plane, m; None where there are too
    few points to tell."""
    if len(points) < LEAST_POINTS:
        return None
    plan = points[wall_points(points, centres), :2]
    low, high = np.percentile(plan, [TRIM, 100 - TRIM], axis=0)
    (x_low, y_low), (x_high, y_high) = low - MARGIN * (high - low), high + MARGIN * (high - low)
    return float(x_low), float(y_low), float(x_high), float(y_high)


def wall_points(points: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """Which of points (N, 3) are of the wall (N,) bool: near its plane, or as near to photographs."""
    (width,), (middle,) = shortest_halves(points[:, 2:])
    near = np.abs(points[:, 2] - middle) <= NEAR * width
    distance = np.full(len(points), np.inf)
    # One after the other: all distances at once would be a table of all points by all photographs.
    for centre in centres:
        distance = np.minimum(distance, np.linalg.norm(points - centre, axis=1))
    return near | (distance <= FINE * np.median(distance[near]))


def shortest_halves(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of every column (N, D): the width of the narrowest interval that holds half of the values, and its middle (D,)."""
    ordered, half = np.sort(values, axis=0), (len(values) + 1) // 2
    width = ordered[half:] - ordered[: len(ordered) - half]
    first, column = width.argmin(axis=0), np.arange(values.shape[1])
    return width[first, column], 0.5 * (ordered[first, column] + ordered[first + half, column])
