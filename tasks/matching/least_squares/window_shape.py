"""Which pixels belong to a window: a square, or an ellipse shaped by the covariance of the shift.

Strategy. Both shapes are convex, so a window is one span of columns per row and every loop over it runs along rows. The published
rule for an ellipse (the sum of the distances of a pixel's centre from both foci is less than the long axis) is equivalent to a
quadratic form below 1, which has a closed solution per row.

Source: Skarlatos, PhD thesis, 3.1.7 (sources/matching.md#window-shape); the limit of the ratio of the axes is our own.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit


@njit(error_model="numpy")
def square_window(half, spans):
    """Fill the spans of a square: first and last column of row j - half, from the centre; returns its reaches."""
    for j in range(2 * half + 1):
        spans[j, 0], spans[j, 1] = -half, half
    return half, half


@njit(error_model="numpy")
def ellipse_window(half, axes, offset_x, offset_y, spans):
    """Fill the spans of an ellipse with the area of the square of half side `half`.

    axes: the ratio of its axes (>= 1) and the direction (cos, sin) of the long one. offset_x, offset_y: its centre, from the pixel
    that rows and columns are counted from. Returns the reaches (columns, rows) to either side; an empty row has first > last.
    """
    ratio, cos, sin = axes
    area = (2 * half + 1) ** 2
    # Squared semi-axes of an ellipse with the area pi a b and the ratio a / b.
    long2, short2 = area * ratio / np.pi, area / (np.pi * ratio)
    xx = cos * cos / long2 + sin * sin / short2
    xy = cos * sin * (1.0 / long2 - 1.0 / short2)
    yy = sin * sin / long2 + cos * cos / short2
    determinant = xx * yy - xy * xy
    # Half extents of the ellipse along the axes, from the inverse of its matrix.
    reach_x = int(np.ceil(np.sqrt(yy / determinant) + abs(offset_x)))
    reach_y = int(np.ceil(np.sqrt(xx / determinant) + abs(offset_y)))
    for j in range(2 * reach_y + 1):
        dy = j - reach_y - offset_y
        # The discriminant of the quadratic form along this row.
        rest = xx - determinant * dy * dy
        spans[j, 0], spans[j, 1] = 1, 0
        if rest > 0.0:
            middle, width = offset_x - xy / xx * dy, np.sqrt(rest) / xx
            spans[j, 0] = max(int(np.floor(middle - width)) + 1, -reach_x)
            spans[j, 1] = min(int(np.ceil(middle + width)) - 1, reach_x)
    return reach_x, reach_y


@njit(error_model="numpy")
def ellipse_axes(var_x, var_y, covariance, max_ratio, across):
    """Ratio of the axes and direction (cos, sin) of the long one, along the greatest uncertainty of a shift or across it."""
    middle, half_difference = 0.5 * (var_x + var_y), 0.5 * (var_x - var_y)
    radius = np.sqrt(half_difference * half_difference + covariance * covariance)
    theta = 0.5 * np.arctan2(2.0 * covariance, var_x - var_y)
    # Rounding can leave the smaller eigenvalue at or below zero, where the ratio has no value but its limit.
    least = middle - radius
    ratio = max_ratio
    if least > 0.0:
        ratio = min(np.sqrt((middle + radius) / least), max_ratio)
    # Across: the long axis turned by 90 degrees.
    if across:
        return ratio, -np.sin(theta), np.cos(theta)
    return ratio, np.cos(theta), np.sin(theta)


@njit(error_model="numpy")
def pixels_of(spans, rows):
    """Number of pixels of a window."""
    count = 0
    for j in range(rows):
        count += max(spans[j, 1] - spans[j, 0] + 1, 0)
    return count
