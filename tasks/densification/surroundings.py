"""The nearest heights around a place, in eight directions.

Strategy. From the place one looks along rows, columns and diagonals until a height is met, up to a reach. Eight directions and not
the nearest heights: those of one side alone would say nothing of the other.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit

_DIRECTIONS = ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1))
"""(row, col) steps around a cell; those four places apart are opposite"""


@njit(inline="always")
def look_around(height, precision, r, c, reach, values, errors, lengths, found):
    """Fills `values` (m), their standard `errors` (m), their distances `lengths` (cells) and `found`, each (8,), with the nearest
    heights around (r, c) that are no NaN, up to `reach` cells away; height, precision (rows, cols) m."""
    for k in range(8):
        down, right = _DIRECTIONS[k]
        length = np.sqrt(down * down + right * right)
        found[k] = False
        for i in range(1, int(reach / length) + 1):
            y, x = r + i * down, c + i * right
            if not (0 <= y < height.shape[0] and 0 <= x < height.shape[1]):
                break
            if height[y, x] == height[y, x]:
                found[k], values[k], errors[k], lengths[k] = True, height[y, x], precision[y, x], i * length
                break


@njit()
def _differences(height, known, precision, asked, reach, differing, best):
    """Fills the last two (rows, cols) m at the cells `asked` (rows, cols) bool."""
    values, errors, lengths, found = np.zeros(8), np.zeros(8), np.zeros(8), np.zeros(8, np.bool_)
    for r in range(height.shape[0]):
        for c in range(height.shape[1]):
            if not asked[r, c]:
                continue
            look_around(known, precision, r, c, reach, values, errors, lengths, found)
            count, squares, least = 0, 0.0, np.inf
            for k in range(8):
                if found[k]:
                    count += 1
                    squares += (height[r, c] - values[k]) ** 2
                    least = min(least, errors[k])
            if count:
                differing[r, c], best[r, c] = np.sqrt(squares / count), least


def differences_from(
    height: np.ndarray, known: np.ndarray, precision: np.ndarray, asked: np.ndarray, reach: int
) -> tuple[np.ndarray, np.ndarray]:
    """Root mean square difference of the cells `asked` (rows, cols) bool from the nearest heights around, and the least standard
    error of these: (rows, cols) float64 m, NaN where nothing is within reach.

    height (rows, cols) m; known (rows, cols) m: those that count, NaN elsewhere, with standard errors `precision` (rows, cols) m;
    reach in cells.
    """
    differing, best = (np.full(height.shape, np.nan) for _ in range(2))
    _differences(height, known, precision, asked, reach, differing, best)
    return differing, best
