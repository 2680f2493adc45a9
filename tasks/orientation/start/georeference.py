"""From a model in a system of its own to the project's system: what holds the block in space, and how strongly.

Positions of the projection centres and control points together fix place, rotation and scale, as far as they can. Points on one
line say nothing of the rotation about it: then (and only then) the vertical as the photographs show it on average (`zenith`)
holds the block, within a stated standard error, and the datum sentence says so. With fewer than two known points the network stays
free.
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.findings.block_findings import (
    AxesExchanged,
    BlockFinding,
    ControlOnALine,
    DatumMisfit,
    LooksUpward,
    NoDatum,
    PositionsCrowded,
    TiltUnobserved,
)
from orthomill.tasks.adjustment.model.network import Network, State
from orthomill.tasks.orientation.start.similarity import Similarity, Upward, consensus, fit_similarity, turn_precision
from orthomill.tasks.orientation.start.up_direction import DOWN, SENTENCES, Basis, Looking, expected_zenith, upward

WEAK_TURN = np.radians(1.0)
BENDS = 0.02
"""A free model bends by this share of its extent before anything holds it."""
UPWARD = 0.5
"""The photographs look upwards (or downwards) where their mean axis has a vertical part of so much."""
FAR = 5.0
"""A known point that misses the consensus by this many times what it may miss is set aside."""


@dataclass(frozen=True, eq=False)
class Known:
    """What is known in the project's system: `position`, `position_sigma` (P, 3) of the placed photographs (NaN: unknown);
    `control`, `control_sigma` (n, 3) of the surveyed points (NaN and inf: only measured in photographs); `control_model` (n, 3)
    where the model has them (NaN: cannot be intersected); `zenith` (P, 3) in the image systems by attitudes (NaN: unknown),
    `top` (P, 3) the directions to the tops of the photographs there; `distances`: numbers of two surveyed points, length, standard
    error, m.
    """

    position: np.ndarray
    position_sigma: np.ndarray
    control: np.ndarray
    control_sigma: np.ndarray
    control_model: np.ndarray
    zenith: np.ndarray
    top: np.ndarray
    distances: tuple[tuple[int, int, float, float], ...] = ()

    @property
    def placed(self) -> np.ndarray:
        """(n,) bool: control points that the model has, too."""
        return np.isfinite(self.control_model).all(axis=1) & np.isfinite(self.control).all(axis=1)


@dataclass(frozen=True, eq=False)
class Datum:
    """Where the block goes: `similarity` into local coordinates, `origin` (3,) to be added to these, whether it is free, the
    `zenith` (P, 3) that is expected in the image systems (NaN: of no use; None: not needed), what a reader must know, and which
    positions (P,) and control points (n,) are set aside because they lie elsewhere."""

    similarity: Similarity
    origin: np.ndarray
    free: bool
    zenith: np.ndarray | None
    sentence: str
    findings: tuple[BlockFinding, ...]
    positions_aside: np.ndarray
    control_aside: np.ndarray


def choose_datum(
    model: State, known: Known, vertical_sigma: float, looking: Looking, shift: bool, origin: np.ndarray | None = None
) -> Datum:
    """What holds the block; `vertical_sigma` (rad) and `looking` are used only where the known points leave a rotation open.
    `shift`: the positions may all be off by one vector. `origin` (3,): the model already stands in a system of its own, by this
    much off."""
    has, placed = np.isfinite(known.position).all(axis=1), known.placed
    position = _without_shift(model, known) if shift and placed.sum() >= 3 else known.position
    source = np.vstack([model.centre[has], known.control_model[placed]])
    if len(source) < 2 or np.ptp(source, axis=0).max() == 0:
        return _free(model, known, origin)
    target = np.vstack([position[has], known.control[placed]])
    sigma = np.sqrt((np.vstack([known.position_sigma[has], known.control_sigma[placed]]) ** 2).mean(axis=1))
    if np.linalg.norm(np.ptp(target, axis=0)) < 3.0 * np.median(sigma):
        free = _free(model, known, origin)
        return replace(free, findings=(*free.findings, PositionsCrowded()))
    trusted = np.arange(len(source)) >= has.sum()
    origin = np.round(np.median(target[trusted] if trusted.sum() >= 3 else target, axis=0))
    zenith, basis = expected_zenith(model.rotation, known.zenith, known.top, looking, _direction(source))
    upright, none = (Upward(upward(model.rotation, zenith), weight) for weight in (1.0 / vertical_sigma**2, 0.0))
    on_a_line = turn_precision(target, np.maximum(sigma, 1e-6)) > WEAK_TURN
    near = consensus(source, target - origin, np.maximum(sigma, 1e-6), upright if on_a_line else none, trusted) < FAR
    if near.sum() < 2:
        near[:] = True
    extent = float(np.linalg.norm(np.ptp(target[near], axis=0)))
    sigma = np.maximum(sigma, 1e-4 * extent)
    turn = turn_precision(target[near], sigma[near])
    weak = turn > WEAK_TURN
    similarity = fit_similarity(source[near], (target - origin)[near], sigma[near], upright if weak else none)
    misfit = (similarity.apply(source) - (target - origin))[near]
    looks_up = None if has.any() else _looks_up(model, similarity, source[near], (target - origin)[near], sigma[near])
    if isinstance(looks_up, AxesExchanged):
        return replace(_free(model, known, None), findings=(looks_up,))
    aside = np.zeros(len(has), bool), np.zeros(len(placed), bool)
    aside[0][has], aside[1][placed] = ~near[~trusted], ~near[trusted]
    findings = _findings(weak, basis, turn, vertical_sigma, known.control[placed & ~aside[1]], sigma[near], misfit, extent)
    findings += (looks_up,) if looks_up else ()
    positions, control = int((has & ~aside[0]).sum()), int((placed & ~aside[1]).sum())
    sentence = _sentence(positions, control, basis if weak else None)
    return Datum(similarity, origin, False, zenith if weak else None, sentence, findings, *aside)


def _direction(points: np.ndarray) -> np.ndarray:
    """The direction (3,) of the line that fits points (n, 3) best."""
    return np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][0]


def _looks_up(
    model: State, similarity: Similarity, source: np.ndarray, target: np.ndarray, sigma: np.ndarray
) -> AxesExchanged | LooksUpward | None:
    """Control with X and Y exchanged shows the ground in a mirror, which is nearly the ground seen from below."""
    if (similarity.rotation @ _mean_up(model))[2] > -UPWARD:
        return None
    exchanged = target[:, [1, 0, 2]]
    other = fit_similarity(source, exchanged, sigma, Upward(_mean_up(model), 0.0))
    own, better = (float(np.sqrt(((fit.apply(source) - to) ** 2).sum(axis=1).mean())) for fit, to in
                   ((similarity, target), (other, exchanged)))  # fmt: skip
    if (other.rotation @ _mean_up(model))[2] > UPWARD and 2.0 * better < own:
        return AxesExchanged(exchanged_m=better, given_m=own)
    return LooksUpward()


def _mean_up(model: State) -> np.ndarray:
    """The mean of the cameras' axes away from the ground."""
    return upward(model.rotation, np.tile(DOWN, (len(model.rotation), 1)))


def _without_shift(model: State, known: Known) -> np.ndarray:
    """The positions (P, 3) less their median distance from where the control alone puts the photographs."""
    placed, level = known.placed, Upward(np.array([0.0, 0.0, 1.0]), 0.0)
    sigma = np.sqrt((known.control_sigma[placed] ** 2).mean(axis=1))
    origin = known.control[placed].mean(axis=0)
    fit = fit_similarity(known.control_model[placed], known.control[placed] - origin, sigma, level)
    off = known.position - (fit.apply(model.centre) + origin)
    return known.position - (np.nanmedian(off, axis=0) if np.isfinite(off).any() else 0.0)


def _free(model: State, known: Known, origin: np.ndarray | None) -> Datum:
    """No datum: an upright system of our own, or that of given orientations; to scale where distances were measured."""
    length = _scale_of_distances(known)
    if origin is not None:
        similarity, what = Similarity(1.0, np.eye(3), np.zeros(3)), "place, direction and scale are those of the given orientation"
    else:
        rotation, height = _upright(model)
        similarity = Similarity(length or 100.0 / max(abs(height), 1e-9), rotation, np.zeros(3))
        what = (
            "place and direction are arbitrary"
            if length
            else ("place, direction and scale are arbitrary (the cameras are put 100 units above the ground)")
        )
    count = len(known.distances)
    scaled = f"; {count} measured distance{'s give' if count > 1 else ' gives'} the scale" if length else ""
    return Datum(
        similarity,
        np.zeros(3) if origin is None else origin,
        True,
        None,
        f"Free network: neither positions nor control hold the block; {what}{scaled}; standard errors refer to the block's own "
        "shape.",
        (NoDatum(scaled=bool(length)),),
        np.isfinite(known.position).all(axis=1),
        known.placed,
    )


def _upright(model: State) -> tuple[np.ndarray, float]:
    """A rotation (3, 3) that puts the mean viewing direction down, and the height of the cameras above the ground."""
    up = _mean_up(model)
    east = model.centre[-1] - model.centre[0]
    east = east - up * (east @ up)
    east = east / max(float(np.linalg.norm(east)), 1e-12)
    ground = model.point[np.isfinite(model.point).all(axis=1)]
    return np.stack([east, np.cross(up, east), up]), float(np.median((model.centre.mean(axis=0) - ground) @ up))


def _scale_of_distances(known: Known) -> float | None:
    """Measured by model length, the median of all distances that the model has; None without any."""
    found = []
    for first, second, length, _ in known.distances:
        model = np.linalg.norm(known.control_model[second] - known.control_model[first])
        if np.isfinite(model) and model > 0:
            found.append(length / model)
    return float(np.median(found)) if found else None


def _sentence(positions: int, control: int, basis: Basis | None) -> str:
    held = []
    if control:
        held.append(f"{control} ground control point{'s' * (control > 1)}")
    if positions:
        held.append(f"{positions} GNSS position{'s' * (positions > 1)} of the projection centres")
    kind = "Control" if control >= 3 else "GNSS" if positions else "Control"
    lean = f"; the tilt about their common line rests {SENTENCES[basis]}" if basis else ""
    return f"{kind}: the block is held by {' and '.join(held)}, each with its standard errors{lean}."


def _findings(
    weak: bool,
    basis: Basis,
    turn: float,
    vertical: float,
    control: np.ndarray,
    sigma: np.ndarray,
    residual: np.ndarray,
    extent: float,
) -> tuple[BlockFinding, ...]:
    found: list[BlockFinding] = []
    if weak:
        total = float(np.degrees(1.0 / np.sqrt(1.0 / turn**2 + 1.0 / vertical**2)))
        alone = float(np.degrees(turn)) if np.isfinite(turn) else None
        found.append(TiltUnobserved(tilt_sigma_deg=alone, basis=basis, sigma_deg=total))
    if len(control) >= 3:
        spread = np.linalg.svd(control[:, :2] - control[:, :2].mean(axis=0), compute_uv=False)
        if spread[1] < 0.1 * spread[0]:
            found.append(ControlOnALine())
    length = np.linalg.norm(residual, axis=1)
    size = float(np.median(length / sigma))
    if size > 4.0 and np.median(length) > BENDS * extent:
        found.append(DatumMisfit(ratio=size))
    return tuple(found)


def held(network: Network, known: Known, datum: Datum, first_surveyed: int) -> Network:
    """The network with the weights that the datum calls for; surveyed points are rows from `first_surveyed` on. Local
    coordinates."""
    named = first_surveyed + np.arange(len(known.control))
    if datum.free:
        return replace(network, free=True, named=named)
    has = np.isfinite(known.position).all(axis=1)
    usable = (has & ~datum.positions_aside)[:, None]
    centre = np.where(has[:, None], known.position - datum.origin, 0.0)
    weight = np.where(usable, 1.0 / np.where(usable, known.position_sigma, 1.0) ** 2, 0.0)
    point, point_weight = network.point.copy(), network.point_weight.copy()
    point[first_surveyed:] = np.nan_to_num(known.control - datum.origin)
    point_weight[first_surveyed:] = np.where(datum.control_aside[:, None], 0.0, 1.0 / known.control_sigma**2)
    return replace(network, centre=centre, centre_weight=weight, point=point, point_weight=point_weight, named=named)
