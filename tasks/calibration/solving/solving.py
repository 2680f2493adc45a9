"""The bundle adjustment of identified boards: from several initial values, with exact or uncertain boards."""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.boards.board_bend import BoardBend, flat
from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment, adjust, minimise
from orthomill.tasks.adjustment.boards.board_network import Arrangement, BoardCorners, BoardNetwork, BoardState
from orthomill.tasks.adjustment.boards.board_projection import residuals
from orthomill.tasks.calibration.detection.board_turns import corner_orders
from orthomill.tasks.calibration.solving.correlated_corners import correlation_factor

# Two photos of a plane give four equations for c, x0 and y0, and nothing to check them with.
FEWEST_PHOTOS = 3
_GOOD = 1.5
"""px: an adjustment with a larger sigma0 may have converged to a local minimum."""
_MUCH = 0.1
"""So may one that rejects more than this share of the corners."""
_ROUNDS, _SETTLED = 4, 2.0
"""Most adjustments with bent boards until sigma0 is that by which bends were weighted, within this factor."""
_LEAST_SIGMA = 1e-3
"""px: corners without noise do not make a bend lighter than this."""


@dataclass(frozen=True, eq=False)
class CalibrationTarget:
    """What is photographed: `size` (width, height) px of the photos, inner `corners` (columns, rows) and `square` (m) of a board,
    how many `boards` there are (0: as many as are found), how they are arranged, the standard errors (m) of their corners in the
    plane of the board and out of it, and that of the `bend` of a board in units of its longer side (0: flat)."""

    size: tuple[int, int]
    corners: tuple[int, int]
    square: float
    boards: int = 0
    arrangement: Arrangement = "plane"
    sigma_in_plane: float = 0.0
    sigma_height: float = 0.0
    bend: float = 0.0

    @property
    def local(self) -> np.ndarray:
        """(N, 2) m: corners of a board, row by row; its first corner is the origin."""
        col, row = np.meshgrid(np.arange(self.corners[0]), np.arange(self.corners[1]))
        return self.square * np.column_stack([col.ravel(), row.ravel()]).astype(np.float64)

    @property
    def orders(self) -> np.ndarray:
        """(T, N): the orders in which the corners of a board may be counted."""
        return corner_orders(self.corners)

    def network(self, photos: int, boards: int, free: tuple[str, ...]) -> BoardNetwork:
        """The network of exact boards."""
        flat = np.column_stack([self.local, np.zeros(len(self.local))])
        return BoardNetwork(photos, boards, free, self.arrangement, flat)

    def centred(self, pixels: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) (col, row) as image coordinates from the image centre, y up."""
        centre = (np.array(self.size) - 1) / 2.0
        return (pixels - centre) * np.array([1.0, -1.0])

    def pixels(self, xy: np.ndarray) -> np.ndarray:
        """Image coordinates (..., 2) as pixels (col, row)."""
        return xy * np.array([1.0, -1.0]) + (np.array(self.size) - 1) / 2.0


def too_few(photos: int) -> GeometryError:
    """The error for fewer photographs than FEWEST_PHOTOS."""
    number = "Only 1 photograph shows chessboards" if photos == 1 else f"Only {photos} photographs show chessboards"
    return GeometryError(
        f"{number} that could be used, and at least {FEWEST_PHOTOS} are needed; check the number of inner corners, or take more "
        "photographs, tilted and turned."
    )


def solve(
    target: CalibrationTarget, states: tuple[BoardState, ...], corners: BoardCorners, free: tuple[str, ...], sigma0: float = 0.0
) -> BoardAdjustment:
    """The bundle adjustment from the first initial state that leads to a good solution; the best of all when none does.

    states: initial values, the most plausible first; free: interior parameters to estimate; sigma0: px, of an earlier adjustment
    that knows the bends of the boards, 0 without one. Raises GeometryError when there are too few photographs, or no initial state
    converges.
    """
    photos = len(states[0].rotation) if states else 0
    # Boards in space face different directions: each image of one counts like a photograph.
    directions = len(np.unique(corners.photo + 1j * corners.board)) if target.arrangement == "space" else photos
    if directions < FEWEST_PHOTOS:
        raise too_few(photos)
    network = target.network(photos, len(states[0].turn), free)
    if states[0].bend is not None and sigma0:
        network = _bent(target, network, states[0].bend, sigma0)
    best: BoardAdjustment | None = None
    failure: GeometryError | None = None
    for state in states:
        try:
            result = adjust(network, state, corners)
        except GeometryError as error:
            # The message of the most plausible start is the most useful one.
            failure = failure or error
            continue
        if best is None or _typical(result) < _typical(best):
            best = result
        if result.sigma0 < _GOOD and result.used.mean() > 1.0 - _MUCH:
            break
    if best is None:
        raise failure or too_few(photos)
    return honest(with_uncertain_boards(target, with_bends(target, best)))


def honest(result: BoardAdjustment) -> BoardAdjustment:
    """The adjustment with standard errors for corners that err together within a photograph."""
    return result.with_correlated_corners(correlation_factor(result))


def with_bends(target: CalibrationTarget, result: BoardAdjustment) -> BoardAdjustment:
    """The adjustment with the bends of the boards as weighted unknowns, where boards are not stated to be flat."""
    found = result
    # The weight of flatness against an image coordinate needs the precision of the latter, which a bend spoils at first.
    for _ in range(_ROUNDS if target.bend else 0):
        if found.network.bends and 1.0 / _SETTLED < found.sigma0 / found.network.image_sigma < _SETTLED:
            break
        bend = found.state.bend or flat(target.local, found.network.boards, target.orders)
        network = _bent(target, found.network, bend, found.sigma0)
        found = adjust(network, replace(found.state, bend=bend), result.corners)
    return replace(found, iterations=result.iterations)


def _bent(target: CalibrationTarget, network: BoardNetwork, bend: BoardBend, image_sigma: float) -> BoardNetwork:
    """The network with bends as unknowns; `image_sigma` px of an image coordinate."""
    longest = float(np.ptp(target.local, axis=0).max())
    return replace(network, bends=bend.count, bend_sigma=target.bend * longest, image_sigma=max(image_sigma, _LEAST_SIGMA))


def with_uncertain_boards(target: CalibrationTarget, result: BoardAdjustment) -> BoardAdjustment:
    """The adjustment with the corners of the boards as weighted unknowns, if their standard errors are given."""
    sigma = (target.sigma_in_plane, target.sigma_in_plane, target.sigma_height)
    if not any(sigma):
        return result
    # The weight of a board's corner against an image coordinate needs the precision of the latter: sigma0 of the exact boards is
    # the estimate at hand.
    network = replace(result.network, local_sigma=sigma, image_sigma=result.sigma0)
    return adjust(network, result.state, result.corners)


def _typical(result: BoardAdjustment) -> float:
    """Median length of the residuals of all corners, including rejected ones: a wrong solution that rejects half of them would have
    the smaller sigma0."""
    return float(np.median(np.linalg.norm(result.residual, axis=1)))


def resected(result: BoardAdjustment, state: BoardState, corners: BoardCorners, used: np.ndarray) -> np.ndarray:
    """Residuals (M, 2) px of photos of which only the exterior orientation is estimated, from the corners `used` (M,); interior and
    boards are those of `state`."""
    network = replace(result.network, photos=len(state.rotation), free=(), arrangement="fixed", local_sigma=(0.0, 0.0, 0.0))
    oriented, _ = minimise(network, state, corners.take(used))
    return residuals(oriented, corners)
