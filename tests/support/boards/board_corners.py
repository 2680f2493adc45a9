"""Simulated corners of chessboards with known truth, and one small calibration that many tests share."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from benchmarks.calibration.board_setups import SIX_BOARDS, BoardSetup, floor_corners, places_of, views_of
from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment
from orthomill.tasks.calibration.board_tables import Arranged, ArrangedPhoto, BoardPhotos, Corners, PhotoSearch
from orthomill.tasks.calibration.detection.board_photographs import corners_of_boards
from orthomill.tasks.calibration.solving.arranging import Arrangement, arrangement_of
from orthomill.tasks.calibration.solving.lens_models import MODELS
from orthomill.tasks.calibration.solving.solving import CalibrationTarget, solve

LENS = SIX_BOARDS.camera.changed(p1=0.002, p2=-0.001)
EASY = replace(SIX_BOARDS, boards=3, photos=8, camera=LENS)
"""Three boards in eight photographs of a lens with tangential distortion."""


def target_of(setup: BoardSetup) -> CalibrationTarget:
    """What the photographs of a set-up show."""
    return CalibrationTarget((setup.camera.width, setup.camera.height), setup.board.corners, setup.board.square, setup.boards)


def corners_of(setup: BoardSetup, noise: float = 0.3) -> tuple[CalibrationTarget, list[np.ndarray]]:
    """The target, and per photo the corners (B, N, 2) px of all boards from the image centre, with noise (px)."""
    generator = np.random.default_rng(1)
    target, floor = target_of(setup), floor_corners(places_of(setup), setup.board)
    pixels = [np.array([view.project(board) for board in floor]) for view in views_of(setup)]
    return target, [target.centred(own + generator.normal(0, noise, own.shape)) for own in pixels]


@lru_cache(maxsize=1)
def easy_arrangement() -> tuple[CalibrationTarget, Arrangement]:
    """The boards of EASY, identified and adjusted with five parameters."""
    target, found = corners_of(EASY)
    return target, arrangement_of(found, target)


@lru_cache(maxsize=1)
def easy_calibration() -> tuple[CalibrationTarget, BoardAdjustment]:
    """EASY, adjusted with all eight parameters."""
    target, known = easy_arrangement()
    return target, solve(target, (known.result.state,), known.start.corners, MODELS[3].free)


@lru_cache(maxsize=1)
def easy_tables() -> tuple[BoardPhotos, tuple[Corners, ...], tuple[PhotoSearch, ...]]:
    """EASY as the tables of its search: photographs, corners and search results."""
    target, found = corners_of(EASY)
    photos = BoardPhotos(paths=tuple(f"boards/{view.name}.jpg" for view in views_of(EASY)), size=target.size)
    columns, rows = target.corners
    tables = tuple(corners_of_boards(target.pixels(own).reshape(-1, rows, columns, 2)) for own in found)
    searches = tuple(PhotoSearch(photo=name, boards=3, blur=0.8, overexposed=0.0) for name in photos.names)
    return photos, tables, searches


def everything_named(photos: BoardPhotos, boards: int) -> Arranged:
    """All boards named in all photographs, in their order."""
    own = tuple(ArrangedPhoto(photo=name, names=tuple(range(boards)), certain=True) for name in photos.names)
    return Arranged(boards=boards, photos=own)


def corner_table(board: list[int], column: list[int], row: list[int], xy: list[tuple[float, float]]) -> Corners:
    """A table of corners with pixels `xy` (col, row)."""
    x, y = np.array(xy, dtype=float).reshape(-1, 2).T
    return Corners(*(np.array(own, dtype=np.int32) for own in (board, column, row)), x, y)
