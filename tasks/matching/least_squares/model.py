"""What least-squares matching is asked to do: unknowns, formulation, window, limits. And the recipes that have names.

Strategy. Every choice of the literature is one field, so that the published recipe and the recommended one are two values of one
type and what lies between them can be measured. Defaults are the recommended values; `published` gives those of the dissertation.

Source: Skarlatos, PhD thesis (sources/matching.md#least-squares, #window-shape); sources/measured.md#windows.
"""

import math
from typing import NamedTuple

from orthomill.tasks.matching.least_squares.least_squares_settings import Ellipse, Forward, LeastSquaresMatching

LEAST_AREA = 0.1
"""A window that the affine shrinks or enlarges beyond this area, or its inverse, has gone astray."""
GRADIENTS = ("whole_pixels", "resampled_left", "resampled_right", "window_right")
"""Where the forward form takes its gradients, in the order in which its kernel counts."""
RADIOMETRIES = ("none", "normalised", "estimated")
"""How exposure is treated, in the order in which the kernels count."""
# Constants for the kernels, which know no strings.
RADIOMETRY_NONE, RADIOMETRY_NORMALISED, RADIOMETRY_ESTIMATED = range(len(RADIOMETRIES))


class Rules(NamedTuple):
    """The settings as the kernels take them."""

    shift_only: bool
    radiometry: int
    """as `RADIOMETRIES` counts them"""
    centroid: bool
    bicubic: bool
    gradients: int
    """as `GRADIENTS` counts them; 0 also where the form is not forward"""
    max_area_change: float
    """infinite: not looked at"""
    ellipse: bool
    across: bool
    max_axis_ratio: float
    smoothing: float
    max_iterations: int
    stop: float
    max_step: float
    max_affine_step: float
    max_shift: float
    min_correlation: float
    min_gradient: float


def rules_of(settings: LeastSquaresMatching, centroid: bool) -> Rules:
    """The settings as the kernels take them; the sizes of windows go beside them, point by point.

    centroid: whether the centroid of the window's squared gradients is handed over in place of the point.
    """
    ellipse = settings.shape if isinstance(settings.shape, Ellipse) else None
    forward = settings.formulation if isinstance(settings.formulation, Forward) else Forward()
    return Rules(
        shift_only=settings.geometry == "shift",
        radiometry=RADIOMETRIES.index(settings.radiometry),
        centroid=centroid,
        bicubic=settings.interpolation == "bicubic",
        gradients=GRADIENTS.index(forward.gradients),
        # Infinity instead of None: a field of a named tuple has one type in a kernel.
        max_area_change=forward.max_area_change or math.inf,
        ellipse=ellipse is not None,
        across=ellipse is not None and ellipse.major_axis == "across",
        max_axis_ratio=float(ellipse.max_axis_ratio) if ellipse else 1.0,
        smoothing=settings.smoothing,
        max_iterations=settings.max_iterations,
        stop=settings.stop,
        max_step=settings.max_step,
        max_affine_step=settings.max_affine_step,
        max_shift=settings.max_shift,
        min_correlation=settings.min_correlation,
        min_gradient=settings.min_gradient,
    )
