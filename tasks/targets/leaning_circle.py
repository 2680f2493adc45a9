"""A circle that leans: the centre of its ellipse is not the image of its own.

The nearer half of the circle is shown larger. What lies between the two centres is along the short axis, but whether the circle
leans this way or that its ellipse does not tell: it is no correction, and part of the standard error. Lines that cross, as those of
plates of four fields and the diagonals of square codes, have no such error.

Source: Ahn, Warnecke and Kotowski 1999.
"""

import numpy as np

WIDE = 600.0
"""px: camera constant of small copies and of wide lenses, which holds where none is known"""


def eccentricity(long: float, short: float, c: float) -> float:
    """px between the centre of an ellipse with these semi-axes (px) and the image of its circle's centre, by a constant c."""
    return short * float(np.sqrt(max(long**2 - short**2, 0.0))) / c


def centre_sigma(long: float, short: float, c: float) -> float:
    """px: the standard error of a coordinate that eccentricity in an unknown direction leaves."""
    return eccentricity(long, short, c) / float(np.sqrt(2.0))
