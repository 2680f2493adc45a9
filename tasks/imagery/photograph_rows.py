"""Tables of measurements in many photographs, taken apart by photograph."""

import numpy as np


def rows_of_photos(photo: np.ndarray, photos: int) -> list[np.ndarray]:
    """For each of so many photographs the ascending numbers of the rows (M,) that have its number."""
    # One sort for all: a comparison with every photograph's number would take the square of their number.
    order = np.argsort(photo, kind="stable")
    return np.split(order, np.cumsum(np.bincount(photo, minlength=photos))[:-1])
