"""Photographs of boards: observations, unknowns, and their columns in the normal equations.

A board is a set of points in a system of its own; its pose transforms them into the system of board 0, which is the datum (origin,
axes and scale). Boards in one plane have three unknowns each (two shifts and a rotation), boards anywhere in space six, boards of
known pose ("fixed") and board 0 none. One board, several in a plane and several in space differ by these columns only. Boards
that need not be flat have their bends as weighted unknowns, board 0 like the others.

Source: Kawka 2021, equations 2.53 to 2.60 (sources/calibration.md, S11).
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from orthomill.schemas.camera import INTERIOR, LensKind
from orthomill.tasks.adjustment.boards.board_bend import BoardBend
from orthomill.tasks.geometry.distortion import LensNumbers, lens_numbers

PARAMETERS = INTERIOR
"""Order of the interior parameters: x = x0 + c ((1 + affinity) xd + skew yd), y = y0 + c yd."""
Arrangement = Literal["plane", "space", "fixed"]
_BOARD_COLUMNS: dict[str, tuple[int, ...]] = {"plane": (0, 1, 5), "space": (0, 1, 2, 3, 4, 5), "fixed": ()}
"""The unknowns of a board among three shifts and three rotations."""


@dataclass(frozen=True, eq=False)
class BoardCorners:
    """Measured corners: numbers (M,) of photo, board and corner on its board; xy (M, 2) px from the image centre, y up."""

    photo: np.ndarray
    board: np.ndarray
    corner: np.ndarray
    xy: np.ndarray

    def __len__(self) -> int:
        return len(self.photo)

    def take(self, index: np.ndarray) -> "BoardCorners":
        """The corners at `index` (mask or numbers)."""
        return BoardCorners(self.photo[index], self.board[index], self.corner[index], self.xy[index])


@dataclass(frozen=True, eq=False)
class BoardState:
    """Values of the unknowns: photos `rotation` (P, 3, 3) and `centre` (P, 3); boards `turn` (K, 3, 3) and `shift` (K, 3) into the
    system of board 0; `local` (K, N, 3) corners on their boards, m; `interior` (17,) in the order of PARAMETERS, those of a `lens`
    of this kind (schemas/camera.py); `bend`: of the boards, None for flat ones."""

    rotation: np.ndarray
    centre: np.ndarray
    turn: np.ndarray
    shift: np.ndarray
    local: np.ndarray
    interior: np.ndarray
    lens: LensKind = "brown"
    bend: BoardBend | None = None

    @property
    def on_boards(self) -> np.ndarray:
        """(K, N, 3) m: all corners on their boards, bent as these are."""
        return self.local if self.bend is None else self.local + self.bend.shifts

    @property
    def numbers(self) -> LensNumbers:
        """The lens as kernels take it."""
        return lens_numbers(self.interior, self.lens)

    @property
    def points(self) -> np.ndarray:
        """(K, N, 3) m: all corners in the system of board 0."""
        return np.einsum("kij,knj->kni", self.turn, self.on_boards) + self.shift[:, None]

    def with_interior(self, **values: float) -> "BoardState":
        """The state with other interior parameters, by name."""
        interior = self.interior.copy()
        for name, value in values.items():
            interior[PARAMETERS.index(name)] = value
        return replace(self, interior=interior)


@dataclass(frozen=True, eq=False)
class BoardNetwork:
    """The numbers of photographs and boards, the interior parameters that are `free`, the arrangement of the boards, and the
    nominal corners `local` (N, 3) m of a board with their standard errors `local_sigma` (3,) m (0: without error, no unknowns),
    relative to which `image_sigma` px is that of an image coordinate; a board has so many `bends`, with the standard error
    `bend_sigma` m against a flat one."""

    photos: int
    boards: int
    free: tuple[str, ...]
    arrangement: Arrangement
    local: np.ndarray
    local_sigma: tuple[float, float, float] = (0.0, 0.0, 0.0)
    image_sigma: float = 1.0
    bends: int = 0
    bend_sigma: float = 0.0

    @property
    def uncertain(self) -> bool:
        """Whether the corners of the boards are unknowns themselves."""
        return any(sigma > 0 for sigma in self.local_sigma)

    @property
    def board_unknowns(self) -> int:
        """Unknowns of each board but the first."""
        return len(_BOARD_COLUMNS[self.arrangement])

    @property
    def unknowns(self) -> int:
        """Unknowns without the corners of uncertain boards."""
        return 6 * self.photos + self.board_unknowns * (self.boards - 1) + self.bends * self.boards + len(self.free)

    @property
    def unweighted(self) -> int:
        """Unknowns that only the corners determine: a bend brings its own observation, that the board is flat."""
        return self.unknowns - self.bends * self.boards

    @property
    def photo_columns(self) -> np.ndarray:
        """(P, 6): X, Y, Z of the projection centre and three rotations in the image system."""
        return np.arange(6 * self.photos).reshape(-1, 6)

    @property
    def board_columns(self) -> np.ndarray:
        """(K, 6): three shifts and three rotations of every board; -1 where there is none."""
        columns = np.full((self.boards, 6), -1)
        own = np.arange((self.boards - 1) * self.board_unknowns).reshape(self.boards - 1, self.board_unknowns)
        # Board 0 keeps -1: it is the datum, and an unknown of it would make the normal matrix singular.
        columns[1:, _BOARD_COLUMNS[self.arrangement]] = 6 * self.photos + own
        return columns

    @property
    def bend_columns(self) -> np.ndarray:
        """(K, S): the bends of every board."""
        first = 6 * self.photos + self.board_unknowns * (self.boards - 1)
        return first + np.arange(self.boards * self.bends).reshape(self.boards, self.bends)

    @property
    def interior_columns(self) -> np.ndarray:
        """(17,): columns in the order of PARAMETERS; -1 for fixed parameters."""
        columns = np.full(len(PARAMETERS), -1)
        chosen = [name in self.free for name in PARAMETERS]
        columns[chosen] = self.unknowns - len(self.free) + np.arange(len(self.free))
        return columns

    @property
    def group_start(self) -> np.ndarray:
        """(G + 1,) where the groups of unknowns begin: photographs, boards but the first, bends, the interior."""
        # Fixed boards have groups of size zero, an interior without free parameters none at all.
        size = [6, self.board_unknowns, self.bends, len(self.free)]
        sizes = np.repeat(size, [self.photos, self.boards - 1, self.boards * (self.bends > 0), len(self.free) > 0])
        return np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)

    def columns_of(self, corners: BoardCorners) -> tuple[np.ndarray, np.ndarray]:
        """`row` (M,) and `columns` (P K, 29 + S): corner i depends on columns[row[i]]: six of its photo, six of its board, the
        interior, the bends of its board."""
        photo, board = np.divmod(np.arange(self.photos * self.boards), self.boards)
        interior = np.broadcast_to(self.interior_columns, (len(photo), len(PARAMETERS)))
        columns = np.hstack([self.photo_columns[photo], self.board_columns[board], interior, self.bend_columns[board]])
        return (corners.photo * self.boards + corners.board).astype(np.int32), columns
