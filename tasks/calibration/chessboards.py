"""The last job of a calibration from chessboards: the corners of all photographs are adjusted, checked and recorded.

Whole boards are from the first search, cut and missed ones from the second. Every board and photograph that is not used is listed
with the reason.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from orthomill.schemas.camera import LENSES, Camera, LensKind
from orthomill.schemas.errors import PhotoError, some_of
from orthomill.schemas.photo import Header
from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment
from orthomill.tasks.adjustment.boards.board_network import PARAMETERS, BoardCorners
from orthomill.tasks.calibration.board_tables import (
    AdjustedPose,
    Arranged,
    BoardPhotos,
    Calibration,
    CornerResiduals,
    Corners,
    EstimatedBend,
)
from orthomill.tasks.calibration.solving.arranging import arrangement_of, found_boards
from orthomill.tasks.calibration.solving.calibration_precision import bend_precision, board_precision, photo_precision
from orthomill.tasks.calibration.solving.initial_constant import ConstantEstimate
from orthomill.tasks.calibration.solving.lens_doubt import doubted
from orthomill.tasks.calibration.solving.lens_models import LensModel, model_of, with_affinity
from orthomill.tasks.calibration.solving.model_choice import HeldOut, choice, compare, sensible_corners
from orthomill.tasks.calibration.solving.solving import CalibrationTarget


@dataclass(frozen=True)
class Model:
    """The interior parameters to estimate; None: those that held-out photographs support. `lens`: the kind of lens; None: the one
    that they support (Brown's for stated parameters)."""

    free: tuple[str, ...] | None
    lens: LensKind | None = None


class CalibratedBoards(NamedTuple):
    """The adjustment, the estimate of c from homographies, the numbers (Q,) of the photographs used, and the held-out checks of the
    models."""

    result: BoardAdjustment
    constant: ConstantEstimate
    photos: np.ndarray
    checks: dict[LensModel, HeldOut | None]


def index_board_photos(headers: tuple[Header, ...]) -> BoardPhotos:
    """The calibration photographs. Raises PhotoError for files that hold none, and when their sizes differ."""
    if unusable := [f"{header.path} {header.unusable}" for header in headers if header.unusable]:
        raise PhotoError(f"{some_of(unusable, 3)}; copy them again from the camera, or remove them from the photographs.")
    # One interior orientation has one pixel grid: a resized or turned photograph would need another.
    size = (headers[0].width, headers[0].height)
    others = [header.path for header in headers if (header.width, header.height) != size]
    if others:
        raise PhotoError(
            f"The chessboard photographs differ in size: {headers[0].path} has {size[0]} x {size[1]} pixels, but not "
            f"{', '.join(others[:5])}; calibrate with photographs of one camera and one setting."
        )
    return BoardPhotos(paths=tuple(header.path for header in headers), size=size)


def calibrate(
    arranged: Arranged, corners: tuple[Corners, ...], completed: tuple[Corners, ...], target: CalibrationTarget, model: Model
) -> CalibratedBoards:
    """All corners adjusted with the parameters of `model`, or with those that held-out photographs support.

    Raises GeometryError when the boards do not determine the camera.
    """
    # Computed again as in the job that named the boards: it takes seconds, and saves a table with the whole state of an adjustment.
    known = arrangement_of(found_boards(corners, target), target)
    measured = _with_completed(known.start.corners, arranged, completed, known.start.photo, target)
    models = model_of(model.lens, model.free or ())
    if model.free is None:
        # With the affinity free: pixels that are not square must not decide about the lens.
        models = tuple(map(with_affinity, models))
    judged = compare(known.result, measured, target, models)
    chosen = choice({name: one.check for name, one in judged.items()})
    if model.free is None:
        square = with_affinity(chosen, False)
        sensible = sensible_corners(one.result for one in judged.values())
        judged |= compare(judged[chosen].result, measured, target, (square,), sensible)
        chosen = choice({name: judged[name].check for name in (square, chosen)})
    result, checks = doubted(judged, chosen), {name: one.check for name, one in judged.items()}
    used = known.start.photo
    return CalibratedBoards(result, replace(known.constant, c1=known.constant.c1[used], c2=known.constant.c2[used]), used, checks)


def _with_completed(
    whole: BoardCorners, arranged: Arranged, completed: tuple[Corners, ...], photos: np.ndarray, target: CalibrationTarget
) -> BoardCorners:
    """All corners, sorted by board, corner and photo; where both searches measured one, that of the first is kept."""
    number = {arranged.photos[index].photo: place for place, index in enumerate(photos)}
    parts = [whole]
    for name, own in zip(arranged.incomplete, completed, strict=True):
        corner = own.row.astype(int) * target.corners[0] + own.column
        parts.append(BoardCorners(np.full(len(own), number[name]), own.board.astype(int), corner, target.centred(own.pixels)))
    merged = BoardCorners(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("photo", "board", "corner", "xy")))
    place = np.column_stack([merged.board, merged.corner, merged.photo])
    # np.unique returns the first of equal rows, and those of the first search come first.
    return merged.take(np.unique(place, axis=0, return_index=True)[1])


def camera_of(result: BoardAdjustment, name: str, size: tuple[int, int]) -> Camera:
    """The camera of an adjustment, with the covariance of INTERIOR; size: width, height, px."""
    covariance = tuple(map(tuple, result.interior_covariance.tolist()))
    lens, c = LENSES[result.state.lens](), float(result.state.interior[0])
    camera = Camera(
        name=name, width=size[0], height=size[1], c=c, lens=lens, source="chessboards", sigma0=result.sigma0, covariance=covariance
    )
    return camera.with_interior(result.state.interior)


def calibration_record(
    result: BoardAdjustment, camera: Camera, names: list[str], check: HeldOut | None, target: CalibrationTarget
) -> Calibration:
    """All interior parameters with covariance, and the poses of photographs and boards with standard errors."""
    photographs = tuple(_pose(name, *photo_precision(result, photo)) for photo, name in enumerate(names))
    boards = tuple(_pose(f"board {board + 1}", *board_precision(result, board)) for board in range(result.network.boards))
    return Calibration(
        camera=camera,
        parameters=PARAMETERS,
        values=tuple(result.state.interior.tolist()),
        covariance=tuple(map(tuple, result.interior_covariance.tolist())),
        sigma0=result.sigma0,
        redundancy=result.redundancy,
        iterations=result.iterations,
        held_out=check.rms if check else None,
        corners=target.corners,
        square=target.square,
        photographs=photographs,
        boards=boards,
        bends=tuple(_bend(result, board) for board in range(result.network.boards) if result.network.bends),
    )


def _bend(result: BoardAdjustment, board: int) -> EstimatedBend:
    value, sigma = bend_precision(result, board)
    return EstimatedBend(name=f"board {board + 1}", bend=tuple(value.tolist()), sigma=tuple(sigma.tolist()))


def _pose(name: str, value: np.ndarray, sigma: np.ndarray) -> AdjustedPose:
    return AdjustedPose(
        name=name,
        place=tuple(value[:3].tolist()),
        angles=tuple(np.degrees(value[3:]).tolist()),
        place_sigma=tuple(sigma[:3].tolist()),
        angles_sigma=tuple(np.degrees(sigma[3:]).tolist()),
    )


def residual_table(result: BoardAdjustment, names: list[str], target: CalibrationTarget) -> CornerResiduals:
    """Every corner with its residual, y downwards as rows in the photograph."""
    corners, pixels = result.corners, target.pixels(result.corners.xy)
    return CornerResiduals(
        photo=np.array(names)[corners.photo],
        board=corners.board.astype(np.int32),
        column=(corners.corner % target.corners[0]).astype(np.int32),
        row=(corners.corner // target.corners[0]).astype(np.int32),
        x=pixels[:, 0],
        y=pixels[:, 1],
        dx=result.residual[:, 0],
        dy=-result.residual[:, 1],
        used=result.used,
    )
