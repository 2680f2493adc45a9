"""Mutual nearest neighbours among descriptors, with the ratio test.

Descriptors are bytes, so the dot products of 128 of them are integers below 2^24 and exact in float32: BLAS computes distances
fast, and the same on every machine.

Comparing all features with all is most of the work of matching. Where the epipolar geometry of two photographs is known
approximately, a feature is compared only with those of the other photograph near its epipolar line: the lines of a pencil, sorted
by angle, sweep the photograph like the hand of a clock, so that features with neighbouring lines share one narrow wedge. Matches
found there are then compared with all features, so that the result is what the search among all would have given: on the few
principal axes that hold most of the differences between descriptors first, where a part of the squared distance is a lower bound of
it, and in full only with those features that could be nearer.

Source: Lowe 2004 (ratio test); Hartley & Zisserman 2003, 9.2 (pencils of epipolar lines).
"""

import numpy as np

_BLOCK = 256  # rows of distances at a time: with 8000 points these are 8 MB, which stay in the cache
# Features whose epipolar lines share a wedge: fewer make the wedges narrower, but BLAS slower on small matrices.
_LINES = 256
# Principal axes on which descriptors are compared first. They hold five sixths of the differences, so that of 8000 features one or
# two are left to compare in full.
_AXES, _SAMPLED = 30, 2000
# Largest error of a lower bound in float32: squares of descriptors are 2^18.
_ROUNDING = 4.0
_FEW = 64  # rows compared on the axes at a time: 2 MB
_PAIRS = 2**15  # compared in full at a time: 16 MB each


def mutual_matches(left: np.ndarray, right: np.ndarray, ratio: float) -> np.ndarray:
    """Rows (M, 2) of descriptors (N, 128) uint8 that are each other's nearest, the nearest closer than `ratio` times the second.

    Sorted by the left number.
    """
    if len(left) < 2 or len(right) < 2:
        return np.empty((0, 2), dtype=np.int64)
    nearest, first, second, closest = _nearest(left.astype(np.float32), right.astype(np.float32))
    # Squared distances are exact, so equality of the two minima says that the pair is nearest in both directions.
    mutual = first == closest[nearest]
    return _each_once(np.flatnonzero(mutual & (first < ratio**2 * second)), nearest)


def _each_once(chosen: np.ndarray, nearest: np.ndarray) -> np.ndarray:
    """Rows (M, 2) of left numbers in ascending order and their nearest; of several with the same nearest the first."""
    _, once = np.unique(nearest[chosen], return_index=True)
    chosen = chosen[np.sort(once)]
    return np.column_stack([chosen, nearest[chosen]])


def matches_along_lines(
    descriptors: tuple[np.ndarray, np.ndarray], places: tuple[np.ndarray, np.ndarray], matrix: np.ndarray, band: float, ratio: float
) -> np.ndarray:
    """The part of `mutual_matches` near each other's epipolar lines, without comparing all with all.

    descriptors: (N, 128) uint8 of left and right; places: (N, 2) of the same, in the units of the geometry right' F left = 0 that
    `matrix` F (3, 3) of rank 2 describes; band: distance searched on either side of the line, in these units.
    """
    left, right = (part.astype(np.float32) for part in descriptors)
    here, there = _along_lines((left, right), places, matrix, band, ratio)
    if not len(here):
        return np.empty((0, 2), dtype=np.int64)
    # The few candidates are compared with all features again: a better or an equally good one away from the line makes the match
    # false or ambiguous, and the search among all would have refused it.
    first = ((left[here] - right[there]) ** 2).sum(axis=1)
    rows, squared = _others_near(left[here], right, there, first / ratio**2)
    clear = _without(len(here), rows[first[rows] >= ratio**2 * squared])
    here, there, first = here[clear], there[clear], first[clear]
    rows, squared = _others_near(right[there], left, here, first)
    mutual = _without(len(here), rows[squared < first[rows]])
    found = np.full(len(left), -1)
    found[here[mutual]] = there[mutual]
    return _each_once(np.sort(here[mutual]), found)


def _without(count: int, refused: np.ndarray) -> np.ndarray:
    """(count,) bool: all numbers but those `refused`."""
    kept = np.ones(count, dtype=bool)
    kept[refused] = False
    return kept


def _others_near(points: np.ndarray, others: np.ndarray, own: np.ndarray, limit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of `points` (N, 128) that have others (M, 128) within their squared distance `limit` (N,), apart from their `own` one
    (N,), and the squared distances of these, which are exact; some that lie a little farther away are among them."""
    axes = _principal_axes(others)
    near, far = points @ axes, others @ axes
    # |p - o|^2 on these axes is below the limit where 2 p'o - |o|^2 > |p|^2 - limit: one matrix product and one comparison.
    right = np.vstack([2.0 * far.T, -(far**2).sum(axis=1)])
    left = np.column_stack([near, np.ones(len(near), np.float32)])
    least = ((near**2).sum(axis=1) - limit - _ROUNDING).astype(np.float32)
    none = np.empty(0, dtype=np.int64)
    rows, columns = [none], [none]
    products, above = np.empty((_FEW, len(others)), np.float32), np.empty((_FEW, len(others)), bool)
    for start in range(0, len(points), _FEW):
        part = slice(start, min(start + _FEW, len(points)))
        count = part.stop - start
        np.matmul(left[part], right, out=products[:count])
        np.greater(products[:count], least[part, None], out=above[:count])
        found = np.flatnonzero(above[:count])
        rows.append(start + found // len(others))
        columns.append(found % len(others))
    row, column = np.concatenate(rows), np.concatenate(columns)
    other = column != own[row]
    return row[other], _squared_distances(points, others, row[other], column[other])


def _principal_axes(descriptors: np.ndarray) -> np.ndarray:
    """(128, axes) float32, orthonormal: the directions in which descriptors (N, 128) differ most. Any other directions would give
    the same matches, only later."""
    sample = descriptors[:: max(1, len(descriptors) // _SAMPLED)].astype(np.float64)
    difference = sample - sample.mean(axis=0)
    return np.linalg.eigh(difference.T @ difference)[1][:, -_AXES:].astype(np.float32)


def _squared_distances(points: np.ndarray, others: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """(P,) float32, exact: of points[row] and others[column]."""
    squared = np.empty(len(row), dtype=np.float32)
    for start in range(0, len(row), _PAIRS):
        part = slice(start, start + _PAIRS)
        difference = points[row[part]] - others[column[part]]
        squared[part] = np.einsum("ij,ij->i", difference, difference)
    return squared


def _along_lines(
    descriptors: tuple[np.ndarray, np.ndarray], places: tuple[np.ndarray, np.ndarray], matrix: np.ndarray, band: float, ratio: float
) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of left features and of their nearest ones near their epipolar lines, where these pass the ratio test."""
    lines, order = _pencil(places[0], matrix)
    right = np.column_stack([places[1], np.ones(len(places[1]))])
    here, there = [], []
    for start in range(0, len(order), _LINES):
        rows = order[start : start + _LINES]
        columns = np.flatnonzero(_in_wedge(right @ lines[rows[[0, -1]]].T, band))
        if len(columns) < 2:  # the ratio test needs a second candidate
            continue
        nearest, first, second, closest = _nearest(descriptors[0][rows], descriptors[1][columns])
        clear = (first < ratio**2 * second) & (first == closest[nearest])
        here.append(rows[clear])
        there.append(columns[nearest[clear]])
    none = np.empty(0, dtype=np.int64)
    return np.concatenate([none, *here]), np.concatenate([none, *there])


def _pencil(places: np.ndarray, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Epipolar lines (N, 3) of left places (N, 2), scaled so that line' (x, y, 1) is a distance, and their order in the pencil.

    F = U S V' has rank 2: all lines F x are combinations cos t u1 + sin t u2 of the first two left singular vectors, and t in
    [0, pi) sorts them. Points between two lines of the pencil have distances of opposite sign from them.
    """
    axes, lengths, across = np.linalg.svd(matrix)
    part = np.column_stack([places, np.ones(len(places))]) @ across[:2].T * lengths[:2]
    angle = np.arctan2(part[:, 1], part[:, 0]) % np.pi
    lines = np.column_stack([np.cos(angle), np.sin(angle)]) @ axes[:, :2].T
    return lines / np.maximum(np.hypot(lines[:, 0], lines[:, 1]), 1e-300)[:, None], np.argsort(angle, kind="stable")


def _in_wedge(distances: np.ndarray, band: float) -> np.ndarray:
    """(N,) bool: points between two lines of a pencil, or within `band` of either. distances: (N, 2) from the two lines."""
    return (distances[:, 0] * distances[:, 1] <= 0.0) | (np.abs(distances).min(axis=1) < band)


def _nearest(left: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """For each left row the number of the nearest right one and the squared distances of the nearest two; for each right row the
    squared distance of the nearest left one. All distances are exact."""
    nearest = np.empty(len(left), dtype=np.int64)
    first, second = np.empty(len(left), dtype=np.float32), np.empty(len(left), dtype=np.float32)
    closest = np.full(len(right), np.inf, dtype=np.float32)
    power, turned = (right**2).sum(axis=1), -2.0 * right.T
    for start in range(0, len(left), _BLOCK):
        block = left[start : start + _BLOCK]
        # |l - r|^2 = |l|^2 - 2 l'r + |r|^2: one matrix product does nearly all the work.
        squared = block @ turned
        squared += power
        squared += (block**2).sum(axis=1)[:, None]
        np.minimum(closest, squared.min(axis=0), out=closest)
        rows, part = np.arange(len(block)), slice(start, start + len(block))
        nearest[part] = squared.argmin(axis=1)
        first[part] = squared[rows, nearest[part]]
        squared[rows, nearest[part]] = np.inf
        second[part] = squared.min(axis=1)
    return nearest, first, second, closest
