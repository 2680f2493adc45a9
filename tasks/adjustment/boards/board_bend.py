"""Boards that are not flat: each bends along its rows and its columns and twists, by amounts that are unknowns with a weight.

Paper on cardboard sags, a printed panel is curved by its mounting, by some tenths of a millimetre to some millimetres. Every
photograph sees the same bend, so that it neither averages out nor shows when photographs are left out, and c takes it up: seen
obliquely, a bent board looks like a flat one of another perspective. The height of a corner is a quadratic of its place, less the
plane that the board's pose absorbs. A bent sheet does not stretch: along a row, corners move together by half the integral of the
squared slope.

Source: mrcal's documentation on the deformation of the calibration object; Strobl and Hirzinger 2011 (imperfect targets).
"""

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True, eq=False)
class BoardBend:
    """`height` (N, S): height of the corners of a board for a unit of each of S bends; `shrink` (N, 2, S, S): the quadratic form of
    their shift within the plane, 1/m; `value` (K, S) m: the bends of the boards, by how much the ends of a row and of a column
    stand above its middle, and two opposite corners above the other two (half of it)."""

    height: np.ndarray
    shrink: np.ndarray
    value: np.ndarray

    @property
    def count(self) -> int:
        """The number S of bends of a board."""
        return self.height.shape[1]

    @property
    def shifts(self) -> np.ndarray:
        """(K, N, 3) m: how far the corners lie from where they are on a flat board."""
        in_plane = np.einsum("nast,ks,kt->kna", self.shrink, self.value, self.value)
        return np.concatenate([in_plane, (self.value @ self.height.T)[:, :, None]], axis=2)

    def derivatives(self, board: np.ndarray, corner: np.ndarray) -> np.ndarray:
        """(M, 3, S): the places of corners by the bends of their boards."""
        in_plane = 2.0 * np.einsum("mast,mt->mas", self.shrink[corner], self.value[board])
        return np.concatenate([in_plane, self.height[corner][:, None]], axis=1)

    def moved(self, correction: np.ndarray) -> "BoardBend":
        """With bends that differ by (K, S) m."""
        return replace(self, value=self.value + correction)

    def take(self, boards: np.ndarray) -> "BoardBend":
        """The bends of some of the boards."""
        return replace(self, value=self.value[boards])


def flat(local: np.ndarray, boards: int, orders: np.ndarray) -> BoardBend:
    """Boards without a bend yet. local: (N, 2) m, corners of a board; orders: (T, N), the ways in which its corners may be counted.

    A board that looks the same after a quarter turn can only be known to bend alike in both directions, as nobody knows which is
    which from one photograph to the next.
    """
    half = np.ptp(local, axis=0) / 2.0
    u, v = ((local - local.mean(axis=0)) / half).T
    zero = np.zeros_like(u)
    height = np.column_stack([u**2, v**2, u * v])
    # Half the integral of the squared slope: along a row that is (2 u, 0, v) / half, along a column (0, 2 v, u) / half.
    along = _squared(2.0 * u, zero, v, u) / half[0], _squared(zero, 2.0 * v, u, v) / half[1]
    shrink = -0.5 * np.stack(along, axis=1)
    height, seen = height - height.mean(axis=0), np.eye(3)
    if len(orders) > 2:
        seen = np.array([[1.0], [1.0], [0.0]])
    return BoardBend(height @ seen, np.einsum("nast,sp,tq->napq", shrink, seen, seen), np.zeros((boards, seen.shape[1])))


def _squared(along: np.ndarray, across: np.ndarray, twist: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(N, 3, 3): the integral from 0 to `place` of the slope's products; of the three parts of the slope one grows with the place,
    the twist does not."""
    slope = np.column_stack([along, across, twist])
    grows = np.array([1.0, 1.0, 0.0])
    # The integral of s^n is s^(n+1) / (n+1), and s times the value at the end.
    return place[:, None, None] * slope[:, :, None] * slope[:, None, :] / (1.0 + grows[:, None] + grows)
