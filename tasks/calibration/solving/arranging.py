"""Between search and adjustment: boards are identified, and a first calibration predicts where missed and cut boards must be."""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.camera import LensKind
from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment
from orthomill.tasks.adjustment.boards.board_network import BoardCorners
from orthomill.tasks.adjustment.boards.board_projection import ideal_points, projected
from orthomill.tasks.calibration.board_tables import Arranged, ArrangedPhoto, BoardPhotos, Corners, PhotoSearch, Prediction
from orthomill.tasks.calibration.detection.board_turns import in_order
from orthomill.tasks.calibration.naming.board_names import NO_BOARDS, STRICT, Naming, name_boards, plane_views
from orthomill.tasks.calibration.naming.board_views import BoardViews, SpaceViews
from orthomill.tasks.calibration.solving.initial_constant import ConstantEstimate
from orthomill.tasks.calibration.solving.lens_models import MODELS
from orthomill.tasks.calibration.solving.solving import FEWEST_PHOTOS, CalibrationTarget, solve, too_few
from orthomill.tasks.calibration.solving.starting_values import StartingValues, restart_of, start_of
from orthomill.tasks.geometry.distortion import lens_numbers
from orthomill.tasks.geometry.distortion import undistorted as lens_undistorted

_ENOUGH = 0.7
"""Share of the boards named first that must keep a name once distortion is known; otherwise the distortion is wrong."""
_FITS, _TOGETHER = 1.5, 5.0
"""px of sigma0 that need no explanation, and how many times the sigma0 of single boards that of boards on a plane may be."""
_FEWEST_CORNERS = 4
"""A cut board is searched for when at least so many of its corners are inside the frame."""
# Radial polynomials fitted inside the measured radius soon turn around outside it, and fold far corners back into the frame.
_BEYOND = 1.25
"""How far out predictions extrapolate distortion, in units of the largest angle to the axis that was measured."""
_BORDER = 2
"""px: corners nearer to the border of the frame are not predicted, as the squares around them are cut."""


def found_boards(corners: tuple[Corners, ...], target: CalibrationTarget) -> list[np.ndarray]:
    """Per photo (B, N, 2) px from the image centre, y up; NaN for the corners of cut boards that are not in the photo."""
    return [_boards_of(own, target) for own in corners]


def _boards_of(corners: Corners, target: CalibrationTarget) -> np.ndarray:
    out = np.full((int(corners.board.max(initial=-1)) + 1, len(target.local), 2), np.nan)
    out[corners.board, corners.row.astype(int) * target.corners[0] + corners.column] = target.centred(corners.pixels)
    return out


@dataclass(frozen=True, eq=False)
class Arrangement:
    """Names, initial values and the first adjustment; `constant` is the estimate of c from homographies, `iterations` the number
    that the adjustment needed from there."""

    naming: Naming
    start: StartingValues
    result: BoardAdjustment
    constant: ConstantEstimate
    iterations: int


def arrangement_of(found: list[np.ndarray], target: CalibrationTarget) -> Arrangement:
    """Names, initial values and a first calibration. found: per photo (B, N, 2) px from the image centre, y up.

    Raises GeometryError when there are too few boards, or when they do not determine the camera.
    """
    if target.arrangement == "space":
        return _in_space(found, target)
    known: Arrangement | None = None
    failure = GeometryError(NO_BOARDS)
    try:
        known = _on_plane(found, target)
    except GeometryError as error:
        failure = error
    # With one board per photo there is nothing that could be named wrongly.
    several = max((len(boards) for boards in found), default=0) > 1
    enough = sum(len(boards) > 0 for boards in found) >= FEWEST_PHOTOS
    if (known is None or known.result.sigma0 > _FITS) and several and enough and target.boards != 1:
        known = _second_opinion(found, target, known)
    if known is None:
        raise failure
    return known


def _second_opinion(found: list[np.ndarray], target: CalibrationTarget, known: Arrangement | None) -> Arrangement | None:
    """The boards named in image coordinates free of the distortion that single boards determine: a wide lens may bend the plane too
    much for any homography. Raises GeometryError when boards that are stated to lie on a plane fit by themselves, but not
    together."""
    try:
        start, alone = _one_by_one(found, target)
    except GeometryError:
        return known
    other = _with_distortion_of(alone, start, found, target)
    if other is not None and (known is None or other.result.sigma0 < known.result.sigma0):
        known = other
    # Single boards do not know how the others lie: where they fit much better, the stated plane is wrong and not the lens.
    if known is None or known.result.sigma0 > _TOGETHER * alone.sigma0:
        together = "but not together" if known is None else f"but together only to {known.result.sigma0:.1f} px"
        raise GeometryError(
            f"The boards do not lie still on one plane: each by itself fits to {alone.sigma0:.2f} px, {together}. If they are "
            "anywhere in space but were not moved, set arrangement: space (--arrangement space); if one of them has squares of "
            "another size or was moved between the photographs, take it away, or calibrate with one board alone (boards: 1)."
        )
    return known


def _with_distortion_of(
    alone: BoardAdjustment, start: StartingValues, found: list[np.ndarray], target: CalibrationTarget
) -> Arrangement | None:
    """The boards on their plane, named and adjusted with the interior orientation of single boards; None where that fails."""
    ideal = [undistorted(xy, alone.state.interior, alone.state.lens) for xy in found]
    try:
        naming = name_boards(plane_views(ideal, target.local, target.orders), target.local, target.boards)
        restart = restart_of(_counted(found, naming, target), naming, target.local, alone.state.interior)
        result = solve(target, restart.states, restart.corners, MODELS[0].free)
    except GeometryError:
        return None
    # The constants belong to images of boards here, not to photographs.
    empty = np.full(len(found), np.nan)
    return Arrangement(naming, restart, result, replace(start.constant, c1=empty, c2=empty), alone.iterations)


def _on_plane(found: list[np.ndarray], target: CalibrationTarget) -> Arrangement:
    """Boards named twice: in measured image coordinates, and in undistorted ones once a first calibration knows the distortion. A
    wide lens bends the plane of the boards so much that a homography does not extend from one board to the next."""
    naming = name_boards(plane_views(found, target.local, target.orders), target.local, target.boards)
    start = start_of(_counted(found, naming, target), naming, target.local, target.size)
    result = solve(target, start.states, start.corners, MODELS[0].free)
    ideal = [undistorted(xy, result.state.interior, result.state.lens) for xy in found]
    again = name_boards(plane_views(ideal, target.local, target.orders), target.local, target.boards, STRICT)
    if _named(again) < _ENOUGH * _named(naming):
        return Arrangement(naming, start, result, start.constant, result.iterations)
    restart = restart_of(_counted(found, again, target), again, target.local, result.state.interior)
    second = solve(target, restart.states, restart.corners, MODELS[0].free)
    return Arrangement(again, restart, second, start.constant, result.iterations)


def _one_by_one(found: list[np.ndarray], target: CalibrationTarget) -> tuple[StartingValues, BoardAdjustment]:
    """The calibration in which every image of a board is a photo of its own: it needs no identification."""
    alone = [board[None] for boards in found for board in boards]
    if not alone:
        raise GeometryError(NO_BOARDS)
    naming = name_boards(plane_views(alone, target.local), target.local, 1)
    start = start_of(alone, naming, target.local, target.size)
    return start, solve(replace(target, boards=1), start.states, start.corners, MODELS[0].free)


def _in_space(found: list[np.ndarray], target: CalibrationTarget) -> Arrangement:
    """Every image of a board is first treated as a photo of its own: that calibrates the camera without identification, and gives
    the poses of the boards relative to each other in every photo."""
    photo_of = np.repeat(np.arange(len(found)), [len(boards) for boards in found])
    if 0 < len(photo_of) < FEWEST_PHOTOS:
        raise too_few(len(np.unique(photo_of)))
    start, single = _one_by_one(found, target)
    interior = single.state.interior
    poses = np.tile(np.eye(4), (len(photo_of), 1, 1))
    poses[:, :3, :3] = single.state.rotation
    poses[:, :3, 3] = -np.einsum("pij,pj->pi", single.state.rotation, single.state.centre)
    views: list[BoardViews] = [
        SpaceViews(
            undistorted(xy, interior, single.state.lens), target.local, poses[photo_of == photo], float(interior[0]), target.orders
        )
        for photo, xy in enumerate(found)
    ]
    named = name_boards(views, target.local, target.boards)
    restart = restart_of(_counted(found, named, target), named, target.local, interior)
    result = solve(target, restart.states, restart.corners, MODELS[0].free)
    c1, c2 = (
        np.array([_median(values[photo_of == photo]) for photo in range(len(found))])
        for values in (start.constant.c1, start.constant.c2)
    )
    return Arrangement(named, restart, result, replace(start.constant, c1=c1, c2=c2), single.iterations)


def _counted(found: list[np.ndarray], naming: Naming, target: CalibrationTarget) -> list[np.ndarray]:
    """The boards of all photographs with their corners in the order in which they were named."""
    return [in_order(boards, photo.turns, target.orders) for boards, photo in zip(found, naming.photos, strict=True)]


def _median(values: np.ndarray) -> float:
    return float(np.nanmedian(values)) if np.isfinite(values).any() else np.nan


def _named(naming: Naming) -> int:
    return sum(int((photo.names >= 0).sum()) for photo in naming.photos)


def undistorted(xy: np.ndarray, interior: np.ndarray, lens: LensKind = "brown") -> np.ndarray:
    """Image coordinates (..., 2) px from the image centre, corrected for principal point and distortion; NaN stays NaN."""
    known = np.isfinite(xy).all(axis=-1)
    out = np.full_like(xy, np.nan)
    out[known] = interior[0] * lens_undistorted((xy[known] - interior[1:3]) / interior[0], lens_numbers(interior, lens))
    return out


def arrange(
    boards: BoardPhotos, corners: tuple[Corners, ...], searches: tuple[PhotoSearch, ...], target: CalibrationTarget
) -> Arranged:
    """Names the boards of all photographs and predicts the images of those that were not found.

    Raises GeometryError when there are too few boards, or when they do not determine the camera.
    """
    try:
        known = arrangement_of(found_boards(corners, target), target)
    except GeometryError as error:
        raise GeometryError(f"{error} {_seen(searches, target)}") from error
    number = {int(photo): place for place, photo in enumerate(known.start.photo)}
    photos = tuple(
        ArrangedPhoto(
            photo=name,
            names=tuple(named.names.tolist()),
            certain=named.certain,
            predictions=_predictions(known.result, target, number[index], named.certain) if index in number else (),
        )
        for index, (name, named) in enumerate(zip(boards.names, known.naming.photos, strict=True))
    )
    return Arranged(boards=known.result.network.boards, photos=photos)


def _seen(searches: tuple[PhotoSearch, ...], target: CalibrationTarget) -> str:
    """A summary of the search that helps to find out what went wrong."""
    boards, cut = sum(search.boards for search in searches), sum(search.cut for search in searches)
    more = f" and {cut} cut ones" if cut else ""
    return (
        f"(Of {len(searches)} photographs {sum(search.boards + search.cut > 0 for search in searches)} show boards with "
        f"{target.corners[0]} x {target.corners[1]} inner corners, {boards} whole boards{more} in all{_others(searches)})"
    )


def _others(searches: tuple[PhotoSearch, ...]) -> str:
    """The size of the boards that were found instead, or how many have more corners than stated."""
    sizes = Counter(size for search in searches for size in set(search.other))
    if sizes:
        (columns, rows), times = sizes.most_common(1)[0]
        return f"; boards with {columns} x {rows} inner corners were seen in {times} photographs: is that the number?"
    larger = sum(search.larger for search in searches)
    return f"; {larger} have more corners than that." if larger else "."


def _predictions(result: BoardAdjustment, target: CalibrationTarget, photo: int, certain: bool) -> tuple[Prediction, ...]:
    """All corners of the boards that a photo should show in full or in part but that were not fully measured."""
    measured = np.bincount(result.corners.board[result.corners.photo == photo], minlength=result.network.boards)
    # A photo with a single named board could be any board, so that nothing is known of the others around it.
    wanted = measured < len(target.local) if certain else (measured > 0) & (measured < len(target.local))
    out = []
    for board in np.flatnonzero(wanted):
        pixels = target.pixels(_board_in_photo(result, photo, int(board)))
        inside = ((pixels >= _BORDER) & (pixels <= np.array(target.size) - 1 - _BORDER)).all(axis=1)
        # A second search only pays where it can find more corners than the first.
        if inside.sum() >= max(_FEWEST_CORNERS, measured[board] + 1):
            out.append(Prediction(board=int(board), pixels=tuple(map(tuple, pixels.tolist()))))
    return tuple(out)


def _board_in_photo(result: BoardAdjustment, photo: int, board: int) -> np.ndarray:
    """(N, 2) px from the image centre; NaN behind the camera and where it would extrapolate the distortion too far."""
    count = len(result.network.local)
    asked = BoardCorners(np.full(count, photo), np.full(count, board), np.arange(count), np.zeros((count, 2)))
    # Angles to the axis, not their tangents, which for a wide lens grow without limit.
    measured, wanted = (np.arctan(np.linalg.norm(ideal_points(result.state, own), axis=1)) for own in (result.corners, asked))
    known = wanted <= _BEYOND * np.nanmax(measured)
    return np.where(known[:, None], projected(result.state, asked), np.nan)
