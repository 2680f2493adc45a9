"""A pair cut to the ground that is wanted: columns and rows of its images that show nothing of it are not made."""

import numpy as np

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.orientation import Area
from orthomill.tasks.geometry.epipolar_window import left_pixels
from orthomill.tasks.geometry.normal_case import HeightRange

_MARGIN = 96
"""px around what is wanted: windows, pyramids and smooth paths at its border see what they would see without a border"""


def cut_to(pair: EpipolarPair, area: Area, heights: HeightRange) -> EpipolarPair:
    """The pair with images that show the ground `area` (m) between two heights, and a margin; as it is where it cannot be cut.

    Raises GeometryError where it shows nothing of it.
    """
    west, south, east, north = area
    corners = np.stack(np.meshgrid([west, east], [south, north], [heights.low, heights.high]), axis=-1).reshape(-1, 3)
    left = left_pixels(pair, corners)
    # The right image has the same rotation and rows, its own centre and columns.
    of_right = {"left_centre": pair.right_centre, "left_col0": pair.right_col0, "left_cols": pair.right_cols}
    right = left_pixels(pair.model_copy(update=of_right), corners)
    if not (np.isfinite(left).all() and np.isfinite(right).all()):
        return pair
    (first, count), (first_right, count_right) = _span(left[:, 0], pair.left_cols), _span(right[:, 0], pair.right_cols)
    row, rows = _span(left[:, 1], pair.rows)
    if min(count, count_right, rows) <= 0:
        raise GeometryError("sees nothing of the area that is wanted")
    return pair.model_copy(
        update={
            "row0": pair.row0 - row,
            "rows": rows,
            "left_col0": pair.left_col0 - first,
            "left_cols": count,
            "right_col0": pair.right_col0 - first_right,
            "right_cols": count_right,
        }
    )


def _span(pixels: np.ndarray, size: int) -> tuple[int, int]:
    """First pixel and number of pixels, of `size`, that the places can lie on."""
    if pixels.max() < 0 or pixels.min() > size - 1:
        return 0, 0
    first, last = max(int(np.floor(pixels.min())) - _MARGIN, 0), min(int(np.ceil(pixels.max())) + _MARGIN, size - 1)
    return first, last - first + 1
