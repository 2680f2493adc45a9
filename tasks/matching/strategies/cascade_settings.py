"""The settings of the cascade."""

from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.matching.least_squares.least_squares_settings import LeastSquaresMatching

_FIND = LeastSquaresMatching(window=27, smoothing=1.2, interpolation="bilinear", stop=0.05, min_gradient=0.1)
_MEASURE = LeastSquaresMatching(window=27, smoothing=0.6, max_shift=1.5, min_gradient=0.1)
_SHARPEN = _MEASURE.model_copy(update={"window": 17})


class CascadeMatching(Settings):
    """How points are matched in three steps."""

    find: LeastSquaresMatching = setting(_FIND, "Large and smooth: converges from the start.")
    measure: LeastSquaresMatching = setting(_MEASURE, "Large and sharp.")
    sharpen: LeastSquaresMatching = setting(_SHARPEN, "Small and sharp: used for the points that it determines well.")
    precise: float = setting(0.05, "Standard error up to which the small window is preferred in any case.", "px", gt=0.0)
    max_sigma: float = setting(0.12, "Standard error beyond which a point is not returned.", "px", gt=0.0)
