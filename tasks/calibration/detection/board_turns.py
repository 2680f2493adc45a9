"""Boards that look the same after half a turn, or after quarter turns: which numberings of their corners are equally right.

Inner corners are counted, so that a board has one square more each way. With one even and one odd count the corner squares at both
ends of a diagonal differ in colour, and the numbering is unique. Otherwise half a turn changes nothing; of a board with as many
columns as rows, and an even number of them, a quarter turn neither. The pose of a single board absorbs the turn. Where boards are
matched with each other every turn is tried (board_names.py).
"""

import numpy as np


def corner_orders(corners: tuple[int, int]) -> np.ndarray:
    """(T, N) numbers of the corners (columns, rows): in the order t the corner that is counted as i was found as corner [t, i]. The
    first order is the one that was found; T is 1 for a board with a first corner, else 2 or 4."""
    columns, rows = corners
    found = np.arange(columns * rows).reshape(rows, columns)
    if (columns + rows) % 2:
        turns: tuple[int, ...] = (0,)
    else:
        turns = (0, 1, 2, 3) if columns == rows and columns % 2 == 0 else (0, 2)
    return np.array([np.rot90(found, turn).ravel() for turn in turns])


def symmetric(corners: tuple[int, int]) -> bool:
    """Whether a board looks the same after a turn, so that none of its corners is distinguished as the first."""
    return len(corner_orders(corners)) > 1


def coloured(corners: tuple[int, int]) -> bool:
    """Whether some turn of the board exchanges black and white, so that its first square can be taken to be black. The first square
    of other boards has the colour of the print."""
    columns, rows = corners
    return bool((columns + rows) % 2) or (columns == rows and columns % 2 == 1)


def in_order(found: np.ndarray, turns: np.ndarray, orders: np.ndarray) -> np.ndarray:
    """Boards (B, N, ...) with their corners counted in the order [turns[b]] of `orders` (T, N)."""
    return found[np.arange(len(found))[:, None], orders[turns]]
