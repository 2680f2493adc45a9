"""In which order the nodes of a block are visited, and from which node each one gets its start.

Every node is visited after the one that it starts from. Source: sources/line_locus.md#v1-9 (the order is not
printed).
"""

from typing import Literal, NamedTuple

import numpy as np

Order = Literal["rings", "rows", "serpentine"]


class Visits(NamedTuple):
    """Numbers (row * cols + col) of the nodes in their order, and of the node that each of these starts from: (N,) int64 both. The
    first one starts from itself."""

    node: np.ndarray
    before: np.ndarray


def visits(rows: int, cols: int, first: tuple[int, int], order: Order) -> Visits:
    """The nodes of a block of rows x cols, the node `first` (row, col) before all others."""
    row, col = np.divmod(np.arange(rows * cols), cols)
    down, right = row - first[0], col - first[1]
    if order == "serpentine":
        return _there_and_back(rows, cols, first)
    if order == "rings":
        # One step towards the first node, diagonally as long as possible: the nodes of a ring lie equally far from it.
        before = (row - np.sign(down)) * cols + col - np.sign(right)
        node = np.lexsort((col, row, np.maximum(np.abs(down), np.abs(right))))
    else:
        # Along the row towards the column of the first node, and along that column.
        before = np.where(right == 0, (row - np.sign(down)) * cols + col, row * cols + col - np.sign(right))
        node = np.lexsort((np.abs(right), row, np.abs(down)))
    return Visits(node, before[node])


def _there_and_back(rows: int, cols: int, first: tuple[int, int]) -> Visits:
    """One path along the rows, every other one backwards, walked from the first node to both of its ends."""
    number = np.arange(rows * cols).reshape(rows, cols)
    number[1::2] = number[1::2, ::-1]
    path = number.ravel()
    at = int(np.flatnonzero(path == first[0] * cols + first[1])[0])
    node = np.concatenate([path[at:], path[:at][::-1]])
    before = np.concatenate([path[at : at + 1], path[at:-1], path[1 : at + 1][::-1]])
    return Visits(node, before)
