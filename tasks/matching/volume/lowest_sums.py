"""The sum of the lowest values of every column, for many columns at once.

Strategy: the rows are sorted in two halves by comparing and exchanging whole rows (a sorting network, the same for every column);
the lowest m of two sorted lists are then min(a[i], b[m - 1 - i]). That compares far less than to sort all of them.

Source: Batcher 1968, odd-even merge sort and bitonic merge.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit


def exchanges(rows: int) -> np.ndarray:
    """Pairs (n, 2) of rows to compare and exchange, one after the other, that sort a first half of (rows + 1) // 2 rows, and the
    rest, each by itself."""
    first = (rows + 1) // 2
    pairs = _sorting(first) + [(first + low, first + high) for low, high in _sorting(rows - first)]
    return np.array(pairs, np.int64).reshape(-1, 2)


def _sorting(rows: int) -> list[tuple[int, int]]:
    pairs: list[tuple[int, int]] = []
    merged = 1
    while merged < rows:
        apart = merged
        while apart:
            for begin in range(apart % merged, rows - apart, 2 * apart):
                for low in range(begin, begin + min(apart, rows - apart - begin)):
                    if low // (2 * merged) == (low + apart) // (2 * merged):
                        pairs.append((low, low + apart))
            apart //= 2
        merged *= 2
    return pairs


@njit(inline="always")
def lowest_sums(values, rows, take, pairs, n, sums):
    """Fill the first n of `sums` (uint16) with the sum of the `take` lowest of the first `rows` values (R, N) uint8 of each column,
    which are changed; pairs: `exchanges` of so many rows."""
    for e in range(pairs.shape[0]):
        low, high = values[pairs[e, 0]], values[pairs[e, 1]]
        for k in range(n):
            x, y = low[k], high[k]
            low[k], high[k] = min(x, y), max(x, y)
    sums[:n] = 0
    first = (rows + 1) // 2
    for i in range(take):
        j = first + take - 1 - i
        # Where one of the halves has no such row, that of the other one is compared with itself.
        one, other = values[i if i < first else j], values[j if j < rows else i]
        for k in range(n):
            sums[k] += min(one[k], other[k])
