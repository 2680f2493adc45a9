"""From a model in a system of its own to the project's system: what holds the block in space, and how strongly.

Positions of the projection centres and control points together fix place, rotation and scale, as far as they can. Points on one
line say nothing of the rotation about it: then (and only then) the photographs are assumed to look straight down on average, within
a stated standard error, and the datum sentence says so. With fewer than two known points the network stays free.
"""

from dataclasses import dataclass, replace

import numpy as np

from schemas.errors import GeometryError
from tasks.adjustment.network import Network, State
from tasks.orientation.similarity import Similarity, Upward, fit_similarity, turn_precision

WEAK_TURN = np.radians(1.0)


@dataclass(frozen=True, eq=False)
class Known:
    """What is known in the project's system: `position`, `position_sigma` (P, 3) of the placed photographs (NaN: unknown);
    `control`,
    `control_sigma` (n, 3) of the control points; `control_model` (n, 3) where the model has them (NaN: cannot be intersected)."""

    position: np.ndarray
    position_sigma: np.ndarray
    control: np.ndarray
    control_sigma: np.ndarray
    control_model: np.ndarray


@dataclass(frozen=True, eq=False)
class Datum:
    """Where the block goes: `similarity` into local coordinates, `origin` (3,) to be added to these, whether it is free, the
    standard error of the assumed verticality (rad; None: not assumed), and the sentences for people."""

    similarity: Similarity
    origin: np.ndarray
    free: bool
    vertical_sigma: float | None
    sentence: str
    weaknesses: tuple[str, ...]


def choose_datum(model: State, known: Known, vertical_sigma: float, shift: bool) -> Datum:
    """What holds the block; `vertical_sigma` (rad) is used only where the known points leave a rotation open. Raises
    GeometryError."""
    has = np.isfinite(known.position).all(axis=1)
    placed = np.isfinite(known.control_model).all(axis=1)
    if shift and placed.sum() < 3:
        raise GeometryError(
            f"A shift of the GNSS positions can only be told apart with 3 or more control points; {placed.sum()} can be used here."
        )
    source = np.vstack([model.centre[has], known.control_model[placed]])
    if len(source) < 2 or np.ptp(source, axis=0).max() == 0:
        return _free(model)
    target = np.vstack([known.position[has], known.control[placed]])
    origin = np.round(target.mean(axis=0))
    extent = float(np.linalg.norm(np.ptp(target, axis=0)))
    sigma = np.maximum(
        np.sqrt((np.vstack([known.position_sigma[has], known.control_sigma[placed]]) ** 2).mean(axis=1)), 1e-4 * extent
    )
    turn = turn_precision(target, sigma)
    weak = turn > WEAK_TURN
    upward = Upward(_mean_up(model), 1.0 / vertical_sigma**2 if weak else 0.0)
    similarity = fit_similarity(source, target - origin, sigma, upward)
    weaknesses = _weaknesses(weak, turn, vertical_sigma, known.control[placed], sigma, similarity.apply(source) - (target - origin))
    return Datum(
        similarity, origin, False, vertical_sigma if weak else None, _sentence(int(has.sum()), int(placed.sum()), weak), weaknesses
    )


def _mean_up(model: State) -> np.ndarray:
    """The mean of the cameras' axes away from the ground."""
    up = model.rotation[:, 2].mean(axis=0)
    return up / max(float(np.linalg.norm(up)), 1e-12)


def _free(model: State) -> Datum:
    up = _mean_up(model)
    east = model.centre[-1] - model.centre[0]
    east = east - up * (east @ up)
    east = east / max(float(np.linalg.norm(east)), 1e-12)
    rotation = np.stack([east, np.cross(up, east), up])
    height = float(np.median((model.centre.mean(axis=0) - model.point[np.isfinite(model.point).all(axis=1)]) @ up))
    similarity = Similarity(100.0 / max(abs(height), 1e-9), rotation, np.zeros(3))
    return Datum(
        similarity,
        np.zeros(3),
        True,
        None,
        "Free network: neither positions nor control hold the block; place, direction and scale are arbitrary (the cameras are "
        "put 100 units above the ground) and standard errors refer to the block's own shape.",
        (
            "The block has no datum: its coordinates are not metres in the project's system. Give positions or three control "
            "points.",
        ),
    )


def _sentence(positions: int, control: int, weak: bool) -> str:
    held = []
    if control:
        held.append(f"{control} ground control point{'s' * (control > 1)}")
    if positions:
        held.append(f"{positions} GNSS position{'s' * (positions > 1)} of the projection centres")
    kind = "Control" if control >= 3 else "GNSS" if positions else "Control"
    lean = (
        "; the tilt about their common line rests on the assumption that the photographs look straight down on average"
        if weak
        else ""
    )
    return f"{kind}: the block is held by {' and '.join(held)}, each with its standard errors{lean}."


def _weaknesses(
    weak: bool, turn: float, vertical: float, control: np.ndarray, sigma: np.ndarray, residual: np.ndarray
) -> tuple[str, ...]:
    found = []
    if weak:
        total = np.degrees(1.0 / np.sqrt(1.0 / turn**2 + 1.0 / vertical**2))
        fixed = "do not fix" if not np.isfinite(turn) or turn > 1.0 else f"fix only to {np.degrees(turn):.1f} degrees"
        found.append(
            "The positions and control lie so close to one line (collinear projection centres), for their standard errors, that "
            f"they {fixed} the tilt about it; the mean viewing direction holds it, and it is known to about {total:.1f} degrees. "
            "Fly a second strip, give control beside the line, or state the true precision of the positions."
        )
    if len(control) >= 3:
        spread = np.linalg.svd(control[:, :2] - control[:, :2].mean(axis=0), compute_uv=False)
        if spread[1] < 0.1 * spread[0]:
            found.append("The control is one-sided: its points lie nearly on one line. Add control away from that line.")
    size = float(np.median(np.linalg.norm(residual, axis=1) / sigma))
    if size > 4.0:
        found.append(
            f"The known positions and the block's shape disagree: the median misfit before the adjustment is {size:.0f} standard "
            "errors. Positions, their standard errors or the CRS may be wrong."
        )
    return tuple(found)


def to_datum(model: State, datum: Datum) -> State:
    """The model's state in local coordinates of the datum."""
    return replace(
        model,
        rotation=model.rotation @ datum.similarity.rotation.T,
        centre=datum.similarity.apply(model.centre),
        point=datum.similarity.apply(model.point),
    )


def held(network: Network, known: Known, datum: Datum, first_control: int) -> Network:
    """The network with the weights that the datum calls for; control points are rows from `first_control` on. Local coordinates."""
    if datum.free:
        return replace(network, free=True)
    has = np.isfinite(known.position).all(axis=1)
    centre = np.where(has[:, None], known.position - datum.origin, 0.0)
    weight = np.where(has[:, None], 1.0 / np.where(has[:, None], known.position_sigma, 1.0) ** 2, 0.0)
    point, point_weight = network.point.copy(), network.point_weight.copy()
    point[first_control:] = known.control - datum.origin
    point_weight[first_control:] = 1.0 / known.control_sigma**2
    vertical = np.zeros(len(centre))
    if datum.vertical_sigma is not None:
        vertical[:] = 1.0 / (datum.vertical_sigma**2 * len(centre))
    return replace(network, centre=centre, centre_weight=weight, point=point, point_weight=point_weight, vertical_weight=vertical)
