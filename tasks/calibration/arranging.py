"""Between search and adjustment: boards get their names, a first calibration tells where missed and cut boards have to be."""

from dataclasses import dataclass

import numpy as np

from schemas.camera import INTERIOR, Camera
from schemas.errors import GeometryError
from tasks.adjustment.board_bundle import BoardAdjustment
from tasks.adjustment.board_network import BoardCorners
from tasks.adjustment.board_projection import projected
from tasks.calibration.initial_constant import ConstantEstimate
from tasks.calibration.judgement import MODELS
from tasks.calibration.naming import STRICT, Naming, name_boards
from tasks.calibration.solving import Target, solve
from tasks.calibration.start import Start, restart_of, start_of
from tasks.calibration.tables import Arranged, ArrangedPhoto, BoardPhotos, Corners, PhotoSearch, Prediction
from tasks.geometry.distortion import pixel_to_image

_ENOUGH = 0.7
"""Share of the boards named at first that has to keep a name when distortion is known; else it was not known after all."""
_FEWEST_CORNERS = 4
"""A cut board is looked for when so many of its corners are inside the frame."""
_BEYOND = 1.25
"""How far predictions reach outwards, in units of the largest ideal radius that was measured."""


def found_boards(corners: tuple[Corners, ...], target: Target) -> list[np.ndarray]:
    """Per photo (B, N, 2) px from the image centre, y up, of whole boards."""
    return [target.centred(own.pixels.reshape(-1, len(target.local), 2)) for own in corners]


@dataclass(frozen=True, eq=False)
class Arrangement:
    """Names, starting values and the first adjustment; `constant` is what the homographies said of c, `iterations` what the bundle
    took from there."""

    naming: Naming
    start: Start
    result: BoardAdjustment
    constant: ConstantEstimate
    iterations: int


def arrangement_of(found: list[np.ndarray], target: Target) -> Arrangement:
    """Boards named twice: as they are measured, and, once a first calibration knows the distortion, free of it. Wide lenses bend
    the
    plane of the boards so much that a homography does not carry from one to the next.

    Raises GeometryError when there are too few boards, or when they do not determine the camera.
    """
    naming = name_boards(found, target.local, target.boards)
    start = start_of(found, naming, target.local, target.size)
    result = solve(target, start.states, start.corners, MODELS[0])
    again = name_boards([undistorted(xy, result.state.interior, target) for xy in found], target.local, target.boards, STRICT)
    if _named(again) < _ENOUGH * _named(naming):
        return Arrangement(naming, start, result, start.constant, result.iterations)
    restart = restart_of(found, again, target.local, result.state.interior)
    second = solve(target, restart.states, restart.corners, MODELS[0])
    return Arrangement(again, restart, second, start.constant, result.iterations)


def _named(naming: Naming) -> int:
    return sum(int((photo.names >= 0).sum()) for photo in naming.photos)


def undistorted(xy: np.ndarray, interior: np.ndarray, target: Target) -> np.ndarray:
    """Image coordinates (..., 2) px from the image centre without principal point and distortion."""
    numbers = dict(zip(INTERIOR, interior[: len(INTERIOR)].tolist(), strict=True))
    camera = Camera(name="boards", width=target.size[0], height=target.size[1], **numbers)
    return pixel_to_image(camera, target.pixels(xy).reshape(-1, 2)).reshape(xy.shape)


def arrange(boards: BoardPhotos, corners: tuple[Corners, ...], searches: tuple[PhotoSearch, ...], target: Target) -> Arranged:
    """Names the boards of all photographs and predicts those that were not found.

    Raises GeometryError when there are too few boards, or when they do not determine the camera.
    """
    try:
        known = arrangement_of(found_boards(corners, target), target)
    except GeometryError as error:
        raise GeometryError(f"{error} {_seen(searches, target)}") from error
    number = {int(photo): place for place, photo in enumerate(known.start.photo)}
    photos = tuple(
        ArrangedPhoto(photo=name, names=tuple(named.names.tolist()), certain=named.certain,
                      predictions=_predictions(known.result, target, number[index]) if named.certain else ())
        for index, (name, named) in enumerate(zip(boards.names, known.naming.photos, strict=True))
    )  # fmt: skip
    return Arranged(boards=known.result.network.boards, photos=photos)


def _seen(searches: tuple[PhotoSearch, ...], target: Target) -> str:
    """What was found at all, for a person who has to guess what went wrong."""
    boards, larger = sum(search.boards for search in searches), sum(search.larger for search in searches)
    more = f", and {larger} with more corners than that" if larger else ""
    return (
        f"(Of {len(searches)} photographs {sum(search.boards > 0 for search in searches)} show whole boards with "
        f"{target.corners[0]} x {target.corners[1]} inner corners, {boards} boards in all{more}.)"
    )


def _predictions(result: BoardAdjustment, target: Target, photo: int) -> tuple[Prediction, ...]:
    """All corners of the boards that a photo does not show whole, but shows a part of."""
    shown = np.unique(result.corners.board[result.corners.photo == photo])
    out = []
    for board in np.setdiff1d(np.arange(result.network.boards), shown):
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
