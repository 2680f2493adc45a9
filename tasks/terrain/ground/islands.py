"""Patches of supposed ground that stand above the ground around them: roofs and crowns beside which nothing was measured.

Strategy. A filter that takes no cell without a height for evidence leaves a roof at the border of the map, and crowns in a wood, as
they are: nothing lower is next to them. Cells of ground that continue each other are one patch. The land is wider than the widest
object; a patch that is not, and lies above the ground that follows from the land around it by more than ground can rise over that
distance, is none. One that is narrower than the gap around it is a glimpse, as likely of a crown as of the ground below: it may
rise half as much. The land may be far away; a patch no wider than a crown is held against the wider ones around that passed as
well: what photographs see between crowns is wider than what they agree on in one.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.terrain.ground.mean_value_fill import fill_gaps

GLIMPSE = 0.5
"""how much a patch narrower than its gap may rise, in units of what a wider one may"""


@njit()
def _patches(ground, heights, limit, label, stack, extents):
    """Writes the number, from 1, of the patch of every cell of `ground` (rows, cols) bool into `label`, and the longer side of
    every patch (cells) into `extents`; neighbours whose heights differ by at most `limit` m belong together. `stack` (cells,)
    int64."""
    rows, cols = ground.shape
    count = 0
    for r in range(rows):
        for c in range(cols):
            if not ground[r, c] or label[r, c] > 0:
                continue
            count += 1
            label[r, c] = count
            stack[0] = r * cols + c
            top, first, last, left, right = 1, r, r, c, c
            while top > 0:
                top -= 1
                y, x = stack[top] // cols, stack[top] % cols
                first, last, left, right = min(first, y), max(last, y), min(left, x), max(right, x)
                for v in range(max(y - 1, 0), min(y + 2, rows)):
                    for u in range(max(x - 1, 0), min(x + 2, cols)):
                        if ground[v, u] and label[v, u] == 0 and abs(heights[v, u] - heights[y, x]) <= limit:
                            label[v, u] = count
                            stack[top] = v * cols + u
                            top += 1
            extents[count - 1] = max(last - first, right - left) + 1
    return count


def standing_islands(
    ground: np.ndarray, heights: np.ndarray, widest: int, rises: tuple[float, float, float], crown: int
) -> np.ndarray:
    """The cells (rows, cols) bool of `ground` (rows, cols) bool that stand on it, heights (rows, cols) m; `widest` object in cells;
    rises: how much ground rises from cell to cell where it continues (m), over a cell of a gap (m), and anyhow (m); `crown`: cells
    along a patch that is nobody's witness.

    Cells nearer than two and a half times `widest` to the border of the arrays are not what they are in the whole.
    """
    label = np.zeros(ground.shape, np.int32)
    extents = np.zeros(int(ground.sum()), np.int64)
    count = _patches(ground, heights, np.float32(rises[0]), label, np.zeros(ground.size, np.int64), extents)
    extent = np.concatenate([[0], extents[:count]])[label]
    small = ground & (extent <= widest)
    standing = _standing(ground & ~small, small, heights, extent, widest, rises)
    lone = small & ~standing & (extent <= crown)
    return standing | _standing(ground & ~standing & ~lone, lone, heights, extent, widest // 2, rises)


def _standing(
    land: np.ndarray, small: np.ndarray, heights: np.ndarray, extent: np.ndarray, reach: int, rises: tuple[float, float, float]
) -> np.ndarray:
    """The cells of `small` patches, so many cells along (`extent`), that stand above what follows from the `land` within reach."""
    fill = fill_gaps(heights[..., None], land, small, reach)
    growth = np.where(extent < fill.distance, GLIMPSE * rises[1], rises[1])
    with np.errstate(invalid="ignore"):
        above = heights - fill.values[..., 0] > growth * fill.distance + rises[2]
    return small & np.isfinite(fill.distance) & above
