"""Between search and adjustment: boards get their names, a first calibration tells where missed and cut boards have to be."""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.camera import INTERIOR, Camera
from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment
from orthomill.tasks.adjustment.boards.board_network import BoardCorners
from orthomill.tasks.adjustment.boards.board_projection import projected
from orthomill.tasks.calibration.board_tables import Arranged, ArrangedPhoto, BoardPhotos, Corners, PhotoSearch, Prediction
from orthomill.tasks.calibration.naming.board_names import NO_BOARDS, STRICT, Naming, name_boards, plane_looks
from orthomill.tasks.calibration.naming.board_views import SpaceLook
from orthomill.tasks.calibration.solving.initial_constant import ConstantEstimate
from orthomill.tasks.calibration.solving.model_choice import MODELS
from orthomill.tasks.calibration.solving.solving import FEWEST_PHOTOS, CalibrationTarget, solve, too_few
from orthomill.tasks.calibration.solving.starting_values import StartingValues, restart_of, start_of
from orthomill.tasks.geometry.distortion import pixel_to_image

_ENOUGH = 0.7
"""Share of the boards named at first that has to keep a name when distortion is known; else it was not known after all."""
_FITS, _TOGETHER = 1.5, 5.0
"""px of sigma0 that need no explanation, and how many times that of one board by itself boards on a plane may have together."""
_FEWEST_CORNERS = 4
"""A cut board is looked for when so many of its corners are inside the frame."""
_BEYOND = 1.25
"""How far predictions reach outwards, in units of the largest ideal radius that was measured."""


def found_boards(corners: tuple[Corners, ...], target: CalibrationTarget) -> list[np.ndarray]:
    """Per photo (B, N, 2) px from the image centre, y up; NaN for the corners of cut boards that are not in the photo."""
    return [_boards_of(own, target) for own in corners]


def _boards_of(corners: Corners, target: CalibrationTarget) -> np.ndarray:
    out = np.full((int(corners.board.max(initial=-1)) + 1, len(target.local), 2), np.nan)
    out[corners.board, corners.row.astype(int) * target.corners[0] + corners.column] = target.centred(corners.pixels)
    return out


@dataclass(frozen=True, eq=False)
class Arrangement:
    """Names, starting values and the first adjustment; `constant` is what the homographies said of c, `iterations` what the bundle
    took from there."""

    naming: Naming
    start: StartingValues
    result: BoardAdjustment
    constant: ConstantEstimate
    iterations: int


def arrangement_of(found: list[np.ndarray], target: CalibrationTarget) -> Arrangement:
    """Names, starting values and a first calibration. found: per photo (B, N, 2) px from the image centre, y up.

    Raises GeometryError when there are too few boards, or when they do not determine the camera.
    """
    if target.arrangement == "space":
        return _in_space(found, target)
    known, failure = None, None
    try:
        known = _on_plane(found, target)
    except GeometryError as error:
        failure = error
    several = max((len(boards) for boards in found), default=0) > 1
    enough = sum(len(boards) > 0 for boards in found) >= FEWEST_PHOTOS
    if (known is None or known.result.sigma0 > _FITS) and several and enough and target.boards != 1:
        known = _second_opinion(found, target, known)
    if known is None:
        raise failure
    return known


def _second_opinion(found: list[np.ndarray], target: CalibrationTarget, known: Arrangement | None) -> Arrangement | None:
    """The boards named free of the distortion that each image of a board by itself knows: a lens may bend the plane too much for
    any homography. Raises GeometryError when boards that are said to lie on a plane fit by themselves, but not together."""
    try:
        start, alone = _one_by_one(found, target)
    except GeometryError:
        return known
    interior = alone.state.interior
    ideal = [undistorted(xy, interior, target) for xy in found]
    try:
        again = name_boards(plane_looks(ideal, target.local), target.local, target.boards)
        restart = restart_of(found, again, target.local, interior)
        other = solve(target, restart.states, restart.corners, MODELS[0])
        if known is None or other.sigma0 < known.result.sigma0:
            empty = np.full(len(found), np.nan)
            known = Arrangement(again, restart, other, replace(start.constant, c1=empty, c2=empty), alone.iterations)
    except GeometryError:
        pass
    if known is None or known.result.sigma0 > _TOGETHER * alone.sigma0:
        together = "but not together" if known is None else f"but together only to {known.result.sigma0:.1f} px"
        raise GeometryError(
            f"The boards do not lie still on one plane: each by itself fits to {alone.sigma0:.2f} px, {together}. If they stand "
            "anywhere but kept their places, say so with arrangement: space (--arrangement space); if one of them has squares of "
            "another size or was moved between the photographs, take it away, or calibrate with one board alone (boards: 1)."
        )
    return known


def _on_plane(found: list[np.ndarray], target: CalibrationTarget) -> Arrangement:
    """Boards named twice: as they are measured, and, once a first calibration knows the distortion, free of it. Wide lenses bend
    the plane of the boards so much that a homography does not carry from one to the next."""
    naming = name_boards(plane_looks(found, target.local), target.local, target.boards)
    start = start_of(found, naming, target.local, target.size)
    result = solve(target, start.states, start.corners, MODELS[0])
    ideal = [undistorted(xy, result.state.interior, target) for xy in found]
    again = name_boards(plane_looks(ideal, target.local), target.local, target.boards, STRICT)
    if _named(again) < _ENOUGH * _named(naming):
        return Arrangement(naming, start, result, start.constant, result.iterations)
    restart = restart_of(found, again, target.local, result.state.interior)
    second = solve(target, restart.states, restart.corners, MODELS[0])
    return Arrangement(again, restart, second, start.constant, result.iterations)


def _one_by_one(found: list[np.ndarray], target: CalibrationTarget) -> tuple[StartingValues, BoardAdjustment]:
    """The calibration in which every image of a board is a photo of its own."""
    alone = [board[None] for boards in found for board in boards]
    if not alone:
        raise GeometryError(NO_BOARDS)
    naming = name_boards(plane_looks(alone, target.local), target.local, 1)
    start = start_of(alone, naming, target.local, target.size)
    return start, solve(replace(target, boards=1), start.states, start.corners, MODELS[0])


def _in_space(found: list[np.ndarray], target: CalibrationTarget) -> Arrangement:
    """Every image of a board is first taken for a photo of its own: that calibrates the camera without any names, and gives poses
    that say how the boards of a photo lie to each other."""
    photo_of = np.repeat(np.arange(len(found)), [len(boards) for boards in found])
    if 0 < len(photo_of) < FEWEST_PHOTOS:
        raise too_few(len(np.unique(photo_of)))
    start, single = _one_by_one(found, target)
    interior = single.state.interior
    poses = np.tile(np.eye(4), (len(photo_of), 1, 1))
    poses[:, :3, :3] = single.state.rotation
    poses[:, :3, 3] = -np.einsum("pij,pj->pi", single.state.rotation, single.state.centre)
    looks = [
        SpaceLook(undistorted(xy, interior, target), target.local, poses[photo_of == photo], float(interior[0]))
        for photo, xy in enumerate(found)
    ]
    named = name_boards(looks, target.local, target.boards)
    restart = restart_of(found, named, target.local, interior)
    result = solve(target, restart.states, restart.corners, MODELS[0])
    c1, c2 = (np.array([_first(values[photo_of == photo]) for photo in range(len(found))])
              for values in (start.constant.c1, start.constant.c2))  # fmt: skip
    return Arrangement(named, restart, result, replace(start.constant, c1=c1, c2=c2), single.iterations)


def _first(values: np.ndarray) -> float:
    return float(np.nanmedian(values)) if np.isfinite(values).any() else np.nan


def _named(naming: Naming) -> int:
    return sum(int((photo.names >= 0).sum()) for photo in naming.photos)


def undistorted(xy: np.ndarray, interior: np.ndarray, target: CalibrationTarget) -> np.ndarray:
    """Image coordinates (..., 2) px from the image centre without principal point and distortion."""
    numbers = dict(zip(INTERIOR, interior[: len(INTERIOR)].tolist(), strict=True))
    camera = Camera(name="boards", width=target.size[0], height=target.size[1], **numbers)
    known = np.isfinite(xy).all(axis=-1)
    out = np.full_like(xy, np.nan)
    out[known] = pixel_to_image(camera, target.pixels(xy[known]))
    return out


def arrange(
    boards: BoardPhotos, corners: tuple[Corners, ...], searches: tuple[PhotoSearch, ...], target: CalibrationTarget
) -> Arranged:
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
                      predictions=_predictions(known.result, target, number[index], named.certain) if index in number else ())
        for index, (name, named) in enumerate(zip(boards.names, known.naming.photos, strict=True))
    )  # fmt: skip
    return Arranged(boards=known.result.network.boards, photos=photos)


def _seen(searches: tuple[PhotoSearch, ...], target: CalibrationTarget) -> str:
    """What was found at all, for a person who has to guess what went wrong."""
    boards, cut = sum(search.boards for search in searches), sum(search.cut for search in searches)
    more = f" and {cut} cut ones" if cut else ""
    return (
        f"(Of {len(searches)} photographs {sum(search.boards + search.cut > 0 for search in searches)} show boards with "
        f"{target.corners[0]} x {target.corners[1]} inner corners, {boards} whole boards{more} in all{_others(searches)})"
    )


def _others(searches: tuple[PhotoSearch, ...]) -> str:
    """The size of the boards that were found instead, or that they have more corners than was said."""
    sizes = Counter(size for search in searches for size in set(search.other))
    if sizes:
        (columns, rows), times = sizes.most_common(1)[0]
        return f"; boards with {columns} x {rows} inner corners were seen in {times} photographs: is that the number?"
    larger = sum(search.larger for search in searches)
    return f"; {larger} have more corners than that." if larger else "."


def _predictions(result: BoardAdjustment, target: CalibrationTarget, photo: int, certain: bool) -> tuple[Prediction, ...]:
    """All corners of the boards of which a photo shows a part that was not measured; of a photo that could name a single board,
    only of this one."""
    measured = np.bincount(result.corners.board[result.corners.photo == photo], minlength=result.network.boards)
    wanted = measured < len(target.local) if certain else (measured > 0) & (measured < len(target.local))
    out = []
    for board in np.flatnonzero(wanted):
        pixels = target.pixels(_board_in_photo(result, photo, int(board)))
        inside = ((pixels >= 2) & (pixels <= np.array(target.size) - 3)).all(axis=1)
        if inside.sum() >= max(_FEWEST_CORNERS, measured[board] + 1):
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
