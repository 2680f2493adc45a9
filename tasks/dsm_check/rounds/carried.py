"""Ground that no pass could judge goes along with the corrected ground around it, until the end of the check.

Strategy. A pass corrects what it judged; beside ground that it did not, that would leave a step which the surface never had. The
windows of the next pass lie across the step: they agree, because most of them is right by now, and a height that nobody corrected
would count as confirmed. So the mean change of the judged cells around is carried into the others; what is never judged gets its
own height back in the end (`finish.py`).
"""

import cv2
import numpy as np

from orthomill.schemas.raster import Window

_FINE = 1024.0
"""Changes are rounded to this part of a metre: their sums are then exact, whatever cell a tile begins with."""


def carry(window: Window, wide: Window, reach: int, heights: np.ndarray, given: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """The heights (window.shape) float32 m with which the next pass begins.

    heights, given, residual: after a pass, before the first one, and what is still asked for (NaN where not judged), m, in `wide`,
    which is `reach` cells larger to every side.
    """
    known = np.isfinite(residual)
    change = np.where(known, np.rint(np.nan_to_num(heights - given).astype(np.float64) * _FINE), 0.0)
    size = (2 * reach + 1, 2 * reach + 1)
    total, number = (
        cv2.boxFilter(values, cv2.CV_64F, size, normalize=False, borderType=cv2.BORDER_CONSTANT)
        for values in (change, known.astype(np.float64))
    )
    # Rounded: sliding sums of whole numbers are exact, and so is what they are compared with.
    number = np.rint(number)
    around = np.where(number > 0, np.rint(total) / np.maximum(number, 1.0) / _FINE, 0.0)
    return np.where(known, heights, given + around)[window.within(wide).slices].astype(np.float32)
