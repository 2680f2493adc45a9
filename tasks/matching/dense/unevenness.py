"""How uneven a surface is: what its values are beside their neighbours.

Windows of neighbouring nodes overlap, and nodes are joined on planes, so that neighbours share their errors and a sound surface is
smooth. Where it is not, windows show two surfaces in part, each to another extent.
"""

import cv2
import numpy as np

AROUND = 5
"""side of the square whose departures count"""


def unevenness(values: np.ndarray) -> np.ndarray:
    """How far values lie from the mean of their four neighbours, the median of the square around every one; (rows, cols) float32,
    in their unit. Those with an unknown one among them count as even, and planes and steps are even too."""
    wide = np.pad(values, 1, mode="edge").astype(np.float32)
    mean = ((wide[:-2, 1:-1] + wide[2:, 1:-1]) + (wide[1:-1, :-2] + wide[1:-1, 2:])) * np.float32(0.25)
    return np.asarray(cv2.medianBlur(np.nan_to_num(np.abs(values.astype(np.float32) - mean)), AROUND))
