"""Cross-validation: how far the formal precision can be trusted, and which distortion model held-out photographs support.

Each half of the photographs (every second one) is calibrated, and checked with the other half: of these photos only the exterior
orientation is estimated, interior parameters and places of the boards are those of the first half. A model with too few or too many
parameters shows there, while its own residuals are too small. The difference between the parameters of the halves, compared with
its formal standard error, shows the errors that the formal precision does not include.
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment, adjust
from orthomill.tasks.adjustment.boards.board_network import PARAMETERS, BoardCorners, BoardState
from orthomill.tasks.calibration.solving.solving import FEWEST_PHOTOS, CalibrationTarget, resected

MODELS: tuple[tuple[str, ...], ...] = (
    ("c", "x0", "y0", "k1", "k2"),
    ("c", "x0", "y0", "k1", "k2", "p1", "p2"),
    ("c", "x0", "y0", "k1", "k2", "k3"),
    ("c", "x0", "y0", "k1", "k2", "k3", "p1", "p2"),
)
"""The models to choose from, smallest first."""
# Held-out residuals of a model and of the same with a needless parameter differ by chance in about the third digit, as both use the
# same photographs; a parameter that matters shows in the second.
_EQUAL = 0.998
"""Models are equally good when the held-out residuals of the best are at least this share of theirs."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """`rms` px, root mean square length of the residual vectors of held-out photographs, for the corners that the adjustment of all
    photographs uses, and `rms_all` for all corners; `difference` (10,) of the parameters of the two halves, second minus first, and
    its formal standard error `sigma` (10,), in the order of PARAMETERS."""

    rms: float
    rms_all: float
    difference: np.ndarray
    sigma: np.ndarray

    @property
    def worst(self) -> tuple[str, float]:
        """The parameter that differs most between the halves, in formal standard errors, and by how many."""
        # Parameters that are not estimated have no standard error, and no difference.
        ratio = np.abs(self.difference) / np.where(self.sigma > 0, self.sigma, np.inf)
        return PARAMETERS[int(ratio.argmax())], float(ratio.max())


def held_out(result: BoardAdjustment, target: CalibrationTarget, free: tuple[str, ...]) -> HeldOut | None:
    """Each half checked by the other with the parameters `free`; None with too few photographs, or where a half does not determine
    them."""
    photos = len(result.state.rotation)
    if photos < 2 * FEWEST_PHOTOS:
        return None
    # Every second photo, not the first and the last ones: a series often changes distance or light on the way.
    halves = [np.arange(start, photos, 2) for start in (0, 1)]
    try:
        solved = [_half(result, target, half, free) for half in halves]
        missed = [_missed(one, result, other) for one, other in zip(solved, reversed(halves), strict=True)]
    except GeometryError:
        return None
    # The halves share no photograph, so that the variances add up.
    covariance = np.diag(solved[0].interior_covariance) + np.diag(solved[1].interior_covariance)
    difference = solved[1].state.interior - solved[0].state.interior
    square, used = (np.concatenate(part) for part in zip(*missed, strict=True))
    return HeldOut(float(np.sqrt(square[used].mean())), float(np.sqrt(square.mean())), difference, np.sqrt(covariance))


def _half(result: BoardAdjustment, target: CalibrationTarget, photos: np.ndarray, free: tuple[str, ...]) -> BoardAdjustment:
    """The calibration from some of the photos, with the calibration of all as initial values, and the boards that they show."""
    # Corners that the adjustment of all has rejected stay out: the halves are to differ by chance, not by blunders.
    state, corners = _of_photos(result.state, result.corners.take(result.used), photos)
    # Board 0 is the datum and stays, even if these photos do not show it.
    shown = np.unique(np.append(corners.board, 0))
    renumbered = BoardCorners(corners.photo, np.searchsorted(shown, corners.board), corners.corner, corners.xy)
    start = replace(state, turn=state.turn[shown], shift=state.shift[shown], local=state.local[shown])
    start = start.with_interior(**{name: 0.0 for name in PARAMETERS[1:] if name not in free})
    half = adjust(target.network(len(photos), len(shown), free), start, renumbered)
    turn, shift = state.turn.copy(), state.shift.copy()
    turn[shown], shift[shown] = half.state.turn, half.state.shift
    return replace(half, state=replace(half.state, turn=turn, shift=shift, local=state.local), corners=corners)


def _of_photos(state: BoardState, corners: BoardCorners, photos: np.ndarray) -> tuple[BoardState, BoardCorners]:
    number = np.full(len(state.rotation), -1)
    number[photos] = np.arange(len(photos))
    taken = corners.take(number[corners.photo] >= 0)
    own = replace(state, rotation=state.rotation[photos], centre=state.centre[photos])
    return own, BoardCorners(number[taken.photo], taken.board, taken.corner, taken.xy)


def _missed(half: BoardAdjustment, result: BoardAdjustment, photos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Squared lengths (M,) of the residuals of photos that are held out of a half, on the boards that the half knows, and which of
    these corners (M,) the adjustment of all uses. The exterior orientations are estimated from the latter."""
    known = np.isin(result.corners.board, np.unique(half.corners.board)) & np.isin(result.corners.photo, photos)
    used = result.used[known]
    state, corners = _of_photos(result.state, result.corners.take(known), photos)
    fixed = replace(half.state, rotation=state.rotation, centre=state.centre)
    return (resected(result, fixed, corners, used) ** 2).sum(axis=1), used


def compare(result: BoardAdjustment, target: CalibrationTarget) -> dict[tuple[str, ...], HeldOut | None]:
    """The held-out residuals of all MODELS and of the model of `result`."""
    models = MODELS if result.network.free in MODELS else (*MODELS, result.network.free)
    return {model: held_out(result, target, model) for model in models}


def choice(judged: dict[tuple[str, ...], HeldOut | None]) -> tuple[str, ...]:
    """The largest model that is as good as the best, within two thousandths; the published five parameters when nothing is known.

    The largest, as the standard errors do not show the effect of a parameter that was left out, while a needless one only increases
    those of the others.
    """
    known = {model: check.rms for model in MODELS if (check := judged.get(model)) is not None}
    good = [model for model, rms in known.items() if rms <= min(known.values()) / _EQUAL]
    return good[-1] if good else MODELS[0]
