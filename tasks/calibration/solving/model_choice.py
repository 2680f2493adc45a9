"""Cross-validation: how far the formal precision can be trusted, and which lens model held-out photographs support.

Each half of the photographs (every second one) is calibrated, and checked with the other half: of these photos only the exterior
orientation is estimated, interior parameters and places of the boards are those of the first half. A model with too few or too many
parameters shows there, while its own residuals are too small. Models are judged by all corners but those that every one of them
rejects: a model that cannot follow the lens rejects the corners that show it. The difference between the parameters of the halves,
compared with its formal standard error, shows the errors that the formal precision does not include.
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment, adjust
from orthomill.tasks.adjustment.boards.board_network import PARAMETERS, BoardCorners, BoardState
from orthomill.tasks.calibration.solving.lens_models import MODELS, LensModel, in_model
from orthomill.tasks.calibration.solving.solving import FEWEST_PHOTOS, CalibrationTarget, honest, resected, solve

# Held-out residuals of a model and of the same with a needless parameter differ by chance in about the third digit, as both use the
# same photographs; a parameter that matters shows in the second.
EQUAL = 0.998
"""Models are equally good when the held-out residuals of the best are at least this share of theirs."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """`rms` px, root mean square length of the residual vectors of held-out photographs, for the corners that the adjustment of all
    photographs uses, and `rms_all` for all corners; `difference` (17,) of the parameters of the two halves, second minus first, and
    its formal standard error `sigma` (17,), in the order of PARAMETERS; `judged` px, the figure by which models are compared: that
    of the corners that some model uses, by default that of all."""

    rms: float
    rms_all: float
    difference: np.ndarray
    sigma: np.ndarray
    judged: float | None = None

    @property
    def figure(self) -> float:
        """What models are compared by, px."""
        return self.rms_all if self.judged is None else self.judged

    @property
    def worst(self) -> tuple[str, float]:
        """The parameter that differs most between the halves, in formal standard errors, and by how many."""
        # Parameters that are not estimated have no standard error, and no difference.
        ratio = np.abs(self.difference) / np.where(self.sigma > 0, self.sigma, np.inf)
        return PARAMETERS[int(ratio.argmax())], float(ratio.max())


@dataclass(frozen=True, eq=False)
class Judged:
    """The adjustment with a lens model, and its check by held-out photographs (None where there are too few)."""

    result: BoardAdjustment
    check: HeldOut | None


def held_out(result: BoardAdjustment, sensible: np.ndarray | None = None) -> HeldOut | None:
    """Each half checked by the other, with the model of `result`; `sensible` (M,): the corners that count in comparisons, by
    default all. None with too few photographs, or where a half does not determine the parameters."""
    photos = len(result.state.rotation)
    if photos < 2 * FEWEST_PHOTOS:
        return None
    # Every second photo, not the first and the last ones: a series often changes distance or light on the way.
    halves = [np.arange(start, photos, 2) for start in (0, 1)]
    try:
        solved = [half_of(result, half) for half in halves]
        missed = [_missed(one, result, other) for one, other in zip(solved, reversed(halves), strict=True)]
    except GeometryError:
        return None
    # The halves share no photograph, so that the variances add up.
    covariance = np.diag(solved[0].interior_covariance) + np.diag(solved[1].interior_covariance)
    difference = solved[1].state.interior - solved[0].state.interior
    square, corner = (np.concatenate(part) for part in zip(*missed, strict=True))
    used, counted = result.used[corner], np.ones(len(corner), bool) if sensible is None else sensible[corner]
    rms, judged, rms_all = (float(np.sqrt(square[own].mean())) for own in (used, counted, np.ones(len(corner), bool)))
    return HeldOut(rms, rms_all, difference, np.sqrt(covariance), judged)


def half_of(result: BoardAdjustment, photos: np.ndarray) -> BoardAdjustment:
    """The calibration from some of the photos, with the calibration of all as initial values, and the boards that they show."""
    # Corners that the adjustment of all has rejected stay out: the halves are to differ by chance, not by blunders.
    state, corners = _of_photos(result.state, result.corners.take(result.used), photos)
    # Board 0 is the datum and stays, even if these photos do not show it.
    shown = np.unique(np.append(corners.board, 0))
    renumbered = BoardCorners(corners.photo, np.searchsorted(shown, corners.board), corners.corner, corners.xy)
    bend = state.bend and state.bend.take(shown)
    start = replace(state, turn=state.turn[shown], shift=state.shift[shown], local=state.local[shown], bend=bend)
    network = replace(result.network, photos=len(photos), boards=len(shown), local_sigma=(0.0, 0.0, 0.0))
    half = honest(adjust(network, start, renumbered))
    turn, shift, own = state.turn.copy(), state.shift.copy(), half.state.bend
    turn[shown], shift[shown] = half.state.turn, half.state.shift
    if state.bend is not None and own is not None:
        value = state.bend.value.copy()
        value[shown] = own.value
        own = replace(own, value=value)
    return replace(half, state=replace(half.state, turn=turn, shift=shift, local=state.local, bend=own), corners=corners)


def _of_photos(state: BoardState, corners: BoardCorners, photos: np.ndarray) -> tuple[BoardState, BoardCorners]:
    number = np.full(len(state.rotation), -1)
    number[photos] = np.arange(len(photos))
    taken = corners.take(number[corners.photo] >= 0)
    own = replace(state, rotation=state.rotation[photos], centre=state.centre[photos])
    return own, BoardCorners(number[taken.photo], taken.board, taken.corner, taken.xy)


def _missed(half: BoardAdjustment, result: BoardAdjustment, photos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Squared lengths (M,) of the residuals of photos that are held out of a half, on the boards that the half knows, and the
    numbers (M,) of these corners. The exterior orientations are estimated from those that the adjustment of all uses."""
    known = np.flatnonzero(np.isin(result.corners.board, np.unique(half.corners.board)) & np.isin(result.corners.photo, photos))
    state, corners = _of_photos(result.state, result.corners.take(known), photos)
    fixed = replace(half.state, rotation=state.rotation, centre=state.centre)
    return (resected(result, fixed, corners, result.used[known]) ** 2).sum(axis=1), known


def compare(
    start: BoardAdjustment, corners: BoardCorners, target: CalibrationTarget, models: tuple[LensModel, ...]
) -> dict[LensModel, Judged]:
    """All corners adjusted with every model that they determine, and judged by the corners that any of them uses; `start`: an
    adjustment with any model. Raises GeometryError when they determine none."""
    found: dict[LensModel, BoardAdjustment] = {}
    failure: GeometryError | None = None
    for model in models:
        try:
            found[model] = solve(target, (in_model(start.state, start.corners, model),), corners, model.free, start.sigma0)
        except GeometryError as error:
            # The message of the smallest model is the most useful one.
            failure = failure or error
    if not found:
        raise failure or GeometryError("No lens model was given.")
    sensible = np.any([result.used for result in found.values()], axis=0)
    return {model: Judged(result, held_out(result, sensible)) for model, result in found.items()}


def choice(judged: dict[LensModel, HeldOut | None]) -> LensModel:
    """Of Brown's models the largest that is as good as the best of all, within two thousandths; where none is, the smallest of the
    others that is; the smallest of all when nothing is known.

    The largest polynomial, as the standard errors do not show the effect of a parameter that was left out, while a needless one
    only increases those of the others. The smallest of the models for wide lenses, as their needless parameters are free to do
    anything beyond the corners that were measured.
    """
    known = {model: check.figure for model, check in judged.items() if check is not None}
    good = [model for model, rms in known.items() if rms <= min(known.values()) / EQUAL]
    plain = [model for model in good if model.lens == "brown"]
    if plain:
        return max(plain, key=lambda model: (len(model.free), list(judged).index(model)))
    return min(good, key=lambda model: len(model.free)) if good else next(iter(judged), MODELS[0])
