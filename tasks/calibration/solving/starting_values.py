"""From named boards to the observations and initial values of the bundle adjustment.

The camera constant comes from the homographies, in three ways; principal point and distortion are initially zero. Homographies
ignore distortion, so that with a wide lens, or photos that look straight down, the constant may be far off: the adjustment is then
started from other constants as well, and the solution with the smallest residuals is used.

Source: Kawka 2021, S8 to S11 (sources/calibration.md).
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.tasks.adjustment.boards.board_network import PARAMETERS, BoardCorners, BoardState
from orthomill.tasks.calibration.naming.board_names import Naming
from orthomill.tasks.calibration.solving.conic_start import interior_from_conic
from orthomill.tasks.calibration.solving.initial_constant import ConstantEstimate, constant_from_conic, constants, estimate
from orthomill.tasks.calibration.solving.initial_pose import pose_of_projection

_OTHER_CONSTANTS = (0.8, 1.3, 0.5, 2.2)
"""Camera constants to try when the homographies fail, in units of the longer side of the photo: lenses from wide to tele, the most
common first."""
# 0.2 is a field of view of 136 degrees, where Brown's model ends; 20 one of 3 degrees.
_LEAST, _LARGEST = 0.2, 20.0
"""Camera constants outside are artefacts of a poor homography; in units of the longer side."""


@dataclass(frozen=True, eq=False)
class StartingValues:
    """`photo` (Q,): the numbers of the photos that take part; `corners` of these; `states` with different constants, the most
    plausible first; `constant`: the estimate from the homographies."""

    photo: np.ndarray
    corners: BoardCorners
    states: tuple[BoardState, ...]
    constant: ConstantEstimate


def start_of(found: list[np.ndarray], naming: Naming, local: np.ndarray, size: tuple[int, int]) -> StartingValues:
    """found: per photo (B, N, 2) px from the image centre, y up, counted as `naming` turns them; local: (N, 2) m; size: width,
    height of the photos."""
    used = _used(naming)
    homographies = [_projection(naming, photo)[:, [0, 1, 3]] for photo in used]
    pairs = np.full((len(found), 2), np.nan)
    pairs[used] = np.array([constants(H) for H in homographies]).reshape(-1, 2)
    constant = estimate(pairs[:, 0], pairs[:, 1])
    whole = interior_from_conic(homographies, float(max(size))).c
    likely = [constant.c, constant_from_conic(homographies), whole, *(factor * max(size) for factor in _OTHER_CONSTANTS)]
    sensible = [c for c in likely if np.isfinite(c) and _LEAST * max(size) < c < _LARGEST * max(size)]
    return StartingValues(used, _corners(found, naming, used), tuple(_state(naming, used, local, c) for c in sensible), constant)


def restart_of(found: list[np.ndarray], naming: Naming, local: np.ndarray, interior: np.ndarray) -> StartingValues:
    """The start from interior parameters (17,) that are known already; `naming` is from image coordinates free of distortion."""
    used = _used(naming)
    state = _state(naming, used, local, float(interior[0]))
    known = estimate(np.empty(0), np.empty(0))
    return StartingValues(used, _corners(found, naming, used), (replace(state, interior=interior.copy()),), known)


def _used(naming: Naming) -> np.ndarray:
    return np.array([photo for photo, named in enumerate(naming.photos) if named.projection is not None], dtype=int)


def _projection(naming: Naming, photo: int) -> np.ndarray:
    """(3, 4) of a photo that is used, whose projection is known."""
    projection = naming.photos[photo].projection
    assert projection is not None
    return projection


def _corners(found: list[np.ndarray], naming: Naming, used: np.ndarray) -> BoardCorners:
    return corners_of([found[photo] for photo in used], [naming.photos[photo].names for photo in used])


def corners_of(found: list[np.ndarray], names: list[np.ndarray]) -> BoardCorners:
    """The known corners of all named boards, sorted by board, corner and photo, as the adjustment of uncertain boards needs
    them."""
    photo, board, corner, xy = [], [], [], []
    for number, (boards, own) in enumerate(zip(found, names, strict=True)):
        for name in np.flatnonzero(own >= 0):
            known = np.flatnonzero(np.isfinite(boards[name]).all(axis=1))
            photo.append(np.full(len(known), number))
            board.append(np.full(len(known), own[name]))
            corner.append(known)
            xy.append(boards[name][known])
    merged = BoardCorners(*(np.concatenate(part) for part in (photo, board, corner, xy)))
    return merged.take(np.lexsort((merged.photo, merged.corner, merged.board)))


def _state(naming: Naming, used: np.ndarray, local: np.ndarray, c: float) -> BoardState:
    poses = [pose_of_projection(_projection(naming, photo), c) for photo in used]
    flat = np.column_stack([local, np.zeros(len(local))])
    interior = np.zeros(len(PARAMETERS))
    interior[0] = c
    return BoardState(
        np.array([R for R, _ in poses]),
        np.array([centre for _, centre in poses]),
        naming.places[:, :3, :3].copy(),
        naming.places[:, :3, 3].copy(),
        np.broadcast_to(flat, (len(naming.places), *flat.shape)).copy(),
        interior,
    )
