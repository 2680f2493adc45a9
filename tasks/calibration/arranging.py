"""Between search and adjustment: boards get their names, a first calibration tells where missed and cut boards have to be."""

import numpy as np

from tasks.adjustment.board_bundle import BoardAdjustment
from tasks.adjustment.board_network import BoardCorners
from tasks.adjustment.board_projection import projected
from tasks.calibration.judgement import MODELS
from tasks.calibration.naming import Naming, name_boards
from tasks.calibration.solving import Target, solve
from tasks.calibration.start import start_of
from tasks.calibration.tables import Arranged, ArrangedPhoto, BoardPhotos, Corners, Prediction

_FEWEST_CORNERS = 4
"""A cut board is looked for when so many of its corners are inside the frame."""
_BEYOND = 1.25
"""How far predictions reach outwards, in units of the largest ideal radius that was measured."""


def found_boards(corners: tuple[Corners, ...], target: Target) -> list[np.ndarray]:
    """Per photo (B, N, 2) px from the image centre, y up, of whole boards."""
    return [target.centred(own.pixels.reshape(-1, len(target.local), 2)) for own in corners]


def arrange(boards: BoardPhotos, corners: tuple[Corners, ...], target: Target) -> Arranged:
    """Names the boards of all photographs and predicts those that were not found.

    Raises GeometryError when there are too few boards, or when they do not determine the camera.
    """
    found = found_boards(corners, target)
    naming = name_boards(found, target.local, target.boards)
    start = start_of(found, naming, target.local, target.size)
    free = MODELS[0]
    result = solve(target, start.states, start.corners, free)
    number = {int(photo): place for place, photo in enumerate(start.photo)}
    photos = tuple(
        ArrangedPhoto(photo=name, names=tuple(named.names.tolist()), certain=named.certain,
                      predictions=_predictions(result, target, naming, number[index]) if named.certain else ())
        for index, (name, named) in enumerate(zip(boards.names, naming.photos, strict=True))
    )  # fmt: skip
    return Arranged(boards=len(naming.motions), photos=photos)


def _predictions(result: BoardAdjustment, target: Target, naming: Naming, photo: int) -> tuple[Prediction, ...]:
    """All corners of the boards that a photo does not show whole, but shows a part of."""
    shown = np.unique(result.corners.board[result.corners.photo == photo])
    out = []
    for board in np.setdiff1d(np.arange(len(naming.motions)), shown):
        pixels = target.pixels(_board_in_photo(result, photo, int(board)))
        inside = ((pixels >= 2) & (pixels <= np.array(target.size) - 3)).all(axis=1)
        if inside.sum() >= _FEWEST_CORNERS:
            out.append(Prediction(board=int(board), pixels=tuple(map(tuple, pixels.tolist()))))
    return tuple(out)


def _board_in_photo(result: BoardAdjustment, photo: int, board: int) -> np.ndarray:
    """(N, 2) px from the image centre; NaN behind the camera and where distortion is not known."""
    count = len(result.network.local)
    asked = BoardCorners(np.full(count, photo), np.full(count, board), np.arange(count), np.zeros((count, 2)))
    ideal = result.state.with_interior(x0=0.0, y0=0.0, **dict.fromkeys(("k1", "k2", "k3", "p1", "p2"), 0.0))
    reach = _BEYOND * np.nanmax(np.linalg.norm(projected(ideal, result.corners), axis=1))
    known = np.linalg.norm(projected(ideal, asked), axis=1) <= reach
    return np.where(known[:, None], projected(result.state, asked), np.nan)
