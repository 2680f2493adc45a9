"""Least-squares matching as published: the settings that the printed tables are reproduced with."""

from orthomill.tasks.matching.least_squares.least_squares_settings import Ellipse, Forward, LeastSquaresMatching, Square

_NO_LIMIT = 1e6


def published(window: int, shape: Square | Ellipse | None = None, limited: bool = True) -> LeastSquaresMatching:
    """The recipe of the dissertation: six unknowns, raw grey values, bilinear, stop at 0.1 px, at most 14 iterations.

    The text leaves open how its program took gradients. Read here: differences of the resampled window, the right one for squares
    and the left one for ellipses. A square has nothing but its own pixels, so that both printed formulae are needed, central inside
    and one-sided at the border, and what they give enters the equations as printed; ellipses are cut from a larger square. Of the
    readings measured, only this one comes within 8 points of table 4.6 on two textures (benchmarks/results/matching.md).
    `limited`: with the limits of 3 px and 0.1 per iteration (sources/matching.md#end) or without (before it). No other limit is
    mentioned, and only windows that the affine mirrors are refused: they can be no match.
    """
    shape = Square() if shape is None else shape
    gradients = "window_right" if isinstance(shape, Square) else "resampled_left"
    forward = Forward(gradients=gradients, max_area_change=_NO_LIMIT)
    return LeastSquaresMatching(
        window=window,
        shape=shape,
        formulation=forward,
        radiometry="none",
        smoothing=0.0,
        interpolation="bilinear",
        max_iterations=14,
        stop=0.1,
        max_step=3.0 if limited else _NO_LIMIT,
        max_affine_step=0.1 if limited else _NO_LIMIT,
        max_shift=_NO_LIMIT,
        min_correlation=-1.0,
        min_gradient=0.0,
    )


PUBLISHED = published(27)
"""The square form at its best size."""
