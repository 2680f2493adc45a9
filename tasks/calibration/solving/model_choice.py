"""Cross-validation: how far the formal precision can be trusted, and which lens model held-out photographs support.

Each half of the photographs (every second one) is calibrated, and checked with the other half: of these photos only the exterior
orientation is estimated, interior parameters and places of the boards are those of the first half. A model with too few or too many
parameters shows there, while its own residuals are too small. Models are judged by all corners but those that every one of them
rejects: a model that cannot follow the lens rejects the corners that show it. The difference between the parameters of the halves,
compared with its formal standard error, shows the errors that the formal precision does not include.

Parameters cost: a model is as good as the best one where the gain of the latter, photograph by photograph, is not beyond its own
scatter, and the simplest of these is taken. What the others of these would have given instead is part of the standard errors.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment, adjust
from orthomill.tasks.adjustment.boards.board_network import PARAMETERS, BoardCorners, BoardState
from orthomill.tasks.calibration.solving.lens_models import MODELS, LensModel, in_model
from orthomill.tasks.calibration.solving.solving import FEWEST_PHOTOS, CalibrationTarget, honest, resected, solve

# One photograph that differs by itself has a gain of one standard error of the mean, whatever its size.
_BEYOND = 2.0
"""A gain counts from so many standard errors of its mean over the photographs on."""
_LEAST = 1e-12
"""px^2: perfect corners have no logarithm"""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """`rms` px, root mean square length of the residual vectors of held-out photographs, for the corners that the adjustment of all
    photographs uses, and `rms_all` for all corners; `difference` (17,) of the parameters of the two halves, second minus first, and
    its formal standard error `sigma` (17,), in the order of PARAMETERS; `by_photo` (P,) px^2, by which models are compared: the
    mean square length in every photograph of the corners that some model uses."""

    rms: float
    rms_all: float
    difference: np.ndarray
    sigma: np.ndarray
    by_photo: np.ndarray = field(default_factory=lambda: np.empty(0))

    @property
    def figure(self) -> float:
        """What models are compared by, px: the geometric mean over the photographs."""
        return float(np.exp(0.5 * self.logarithms.mean())) if len(self.by_photo) else self.rms_all

    @property
    def logarithms(self) -> np.ndarray:
        """(P,) of `by_photo`: a lens that is wrong is worse by a factor, and much in some photographs."""
        return np.log(np.maximum(self.by_photo, _LEAST))

    def gain_of(self, other: "HeldOut") -> float:
        """By which factor another model is better, in standard errors of its mean over the photographs."""
        gain = self.logarithms - other.logarithms
        scatter = float(gain.std(ddof=1)) / np.sqrt(len(gain)) if len(gain) > 1 else 0.0
        # Models that differ in nothing have neither gain nor scatter.
        return float(gain.mean()) / max(scatter, 1e-12)

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
    rms, rms_all = (float(np.sqrt(square[own].mean())) for own in (used, np.ones(len(corner), bool)))
    photo = result.corners.photo[corner[counted]]
    number = np.bincount(photo, minlength=photos)
    # A photograph that shows no board of the other half counts for no model.
    by_photo = (np.bincount(photo, square[counted], minlength=photos) / np.maximum(number, 1))[number > 0]
    return HeldOut(rms, rms_all, difference, np.sqrt(covariance), by_photo)


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
    start: BoardAdjustment,
    corners: BoardCorners,
    target: CalibrationTarget,
    models: tuple[LensModel, ...],
    sensible: np.ndarray | None = None,
) -> dict[LensModel, Judged]:
    """All corners adjusted with every model that they determine, and judged by the corners `sensible` (M,), by default those that
    any of them uses; `start`: an adjustment with any model. Raises GeometryError when they determine none."""
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
    if sensible is None:
        sensible = sensible_corners(found.values())
    return {model: Judged(result, held_out(result, sensible)) for model, result in found.items()}


def sensible_corners(results: Iterable[BoardAdjustment]) -> np.ndarray:
    """(M,): the corners that some of the adjustments uses; what every lens rejects says nothing about lenses."""
    return np.any([result.used for result in results], axis=0)


def as_good(judged: dict[LensModel, HeldOut | None]) -> dict[LensModel, float]:
    """The models than which none is better beyond the scatter of its gain, the simplest first, and the gain of the best over each
    in standard errors; none when nothing is known.

    Brown's polynomials come before the models for wide lenses, whose parameters are free to do anything beyond the corners that
    were measured.
    """
    known = {model: check for model, check in judged.items() if check is not None}
    if not known:
        return {}
    best = min(known.values(), key=lambda check: check.figure)
    gains = {model: check.gain_of(best) for model, check in known.items()}
    order = sorted(gains, key=lambda model: (model.lens != "brown", len(model.free), list(gains).index(model)))
    return {model: gains[model] for model in order if gains[model] <= _BEYOND}


def choice(judged: dict[LensModel, HeldOut | None]) -> LensModel:
    """The simplest model that is as good as the best; the first of all when nothing is known."""
    return next(iter(as_good(judged)), next(iter(judged), MODELS[0]))
