"""What positions of a flight have in common, and what each has of its own.

A stated standard error is that of a place on earth. Positions that one receiver measured within minutes share most of it: that
moves the block as a whole, and only what each has of its own tilts, turns and bends it. How far they differ, the residuals of the
block show. Where that is clearly less than stated, the block is adjusted with both parts: each position with the standard error of
its own part, and a shift for each flight, whose standard error is the stated one.

Control shows shift and tilt better, and beside it positions keep what is stated of them. Residuals of neighbours in time that are
alike say less of a tilt than their size does: standard errors grow with their autocorrelation.
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.findings.datum_findings import TiltUnobserved
from orthomill.schemas.findings.finding import two_digits
from orthomill.tasks.adjustment.model.common_position_errors import with_group_shifts
from orthomill.tasks.adjustment.model.datum import position_residuals
from orthomill.tasks.adjustment.model.network import Network, State
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment
from orthomill.tasks.adjustment.testing.position_trend import autocorrelation
from orthomill.tasks.adjustment.testing.variance_components import position_covariances
from orthomill.tasks.orientation.sources.causes import Groups
from orthomill.tasks.orientation.start.georeference import WEAK_TURN, Datum
from orthomill.tasks.orientation.start.similarity import turn_precision

FEWEST = 8
"""Positions of a flight that show how far they differ: three of their coordinates place each kind of residuals."""
CLEARLY = 0.5
"""An own part is told apart from the stated standard error where it is a smaller share of that."""
SMALLEST = 0.05
"""The smallest share: errors that change slowly over a flight are hardly in residuals, because the block follows them."""
CARRIER = 0.3
"""m: smaller standard errors are those of carrier phases, and mostly of each position by itself."""
KINDS = (((0, 1), 2), ((2,), 3))
"""Coordinates that are judged together, and how many parameters of shift, turn, scale and tilt each of them takes along"""


@dataclass(frozen=True, eq=False)
class OwnParts:
    """Standard errors (P, 3) m of positions: of the `own` part of each, and of what its flight has in `common` (0: that is not
    told apart)."""

    own: np.ndarray
    common: np.ndarray


def own_parts(result: Adjustment, stated: np.ndarray, groups: Groups) -> OwnParts | None:
    """What residuals show of positions with `stated` (P, 3) standard errors; None where they are about as large as stated, or as
    small as those of carrier phases."""
    share = np.ones_like(stated)
    for flight in np.unique(groups.flight):
        order = groups.order[groups.flight[groups.order] == flight]
        order = order[result.network.centre_weight[order].all(axis=1)]
        if len(order) >= FEWEST and np.median(stated[order]) > CARRIER:
            share[groups.flight == flight] = _shares(result, stated, order)
    if not (share < CLEARLY).any():
        return None
    # As large as stated in all coordinates: residuals that are nearly so in one of them do not show that it has nothing in common.
    apart = (share < CLEARLY).any(axis=1, keepdims=True)
    return OwnParts(np.where(share < CLEARLY, share, 1.0) * stated, np.where(apart, stated, 0.0))


def _shares(result: Adjustment, stated: np.ndarray, order: np.ndarray) -> np.ndarray:
    """(3,) by coordinate: the own part of the positions of one flight in the `order` of exposure, as a share of what is stated."""
    weight = result.network.centre_weight[order]
    residual = position_residuals(result.network, result.state)[order] / stated[order]
    variance = np.diagonal(position_covariances(result.as_computed, order), axis1=1, axis2=2)
    number, share = 1.0 - weight * variance, np.ones(3)
    for axes, fitted in KINDS:
        own = list(axes)
        redundancy = float(number[:, own].sum())
        if redundancy < FEWEST - fitted:
            continue
        alike = float(np.mean([autocorrelation(residual[:, axis], fitted) for axis in axes]))
        size = np.sqrt((residual[:, own] ** 2).sum() / redundancy * (1.0 + alike) / (1.0 - alike))
        # Few residuals may be small by chance.
        share[own] = np.clip(size * (1.0 + 1.0 / np.sqrt(2.0 * redundancy)), SMALLEST, 1.0)
    return share


def with_own_parts(network: Network, state: State, parts: OwnParts, flight: np.ndarray, assumed: bool) -> tuple[Network, State]:
    """The network with both parts of the positions, and the state with the shifts of the flights (P,); coordinates that have a free
    shift already keep it. `assumed`: the vertical is an assumption, and gone where positions determine the tilt."""
    has = network.centre_weight > 0
    network, state = with_group_shifts(network, state, flight, parts.common)
    network = replace(network, centre_weight=np.where(has, 1.0 / parts.own**2, 0.0))
    if assumed and own_turn(network, parts) <= WEAK_TURN:
        network = replace(network, vertical_weight=np.zeros(network.photos))
    return network, state


def own_turn(network: Network, parts: OwnParts) -> float:
    """rad: the standard error of the tilt about the line of the positions that take part, by their own parts."""
    use = network.centre_weight.any(axis=1)
    return turn_precision(network.centre[use], parts.own[use].max(axis=1))


def held_by_own(datum: Datum, turn: float) -> Datum:
    """The datum with what positions say of the tilt about their line by their own parts, to `turn` rad."""
    told = [finding for finding in datum.findings if isinstance(finding, TiltUnobserved)]
    if not told:
        return datum
    others = tuple(finding for finding in datum.findings if not isinstance(finding, TiltUnobserved))
    if turn <= WEAK_TURN:
        return replace(datum, findings=others, basis=None, up=None)
    return replace(datum, findings=(*others, *(_with_turn(finding, turn) for finding in told)))


def _with_turn(finding: TiltUnobserved, turn: float) -> TiltUnobserved:
    alone, before = float(np.degrees(turn)), finding.tilt_sigma_deg
    # What the assumption adds is the difference of the weights of both.
    added = finding.sigma_deg**-2 - (0.0 if before is None else before**-2)
    return finding.model_copy(
        update={"tilt_sigma_deg": alone if np.isfinite(alone) else None, "sigma_deg": (added + alone**-2) ** -0.5}
    )


def parts_sentence(parts: OwnParts, network: Network) -> str:
    """Both parts of the standard errors of the positions that take part, in words."""
    use = network.centre_weight.any(axis=1) & parts.common.any(axis=1)
    own, common = (np.median(each[use], axis=0) for each in (parts.own, parts.common))
    sizes = [(float(own[axes].max()), float(common[axes].max()), where) for axes, where in (([0, 1], "plan"), ([2], "height"))]
    each = " and ".join(f"{two_digits(size)} m in {where}" for size, stated, where in sizes if size < stated)
    flight = " and ".join(f"{two_digits(stated)} m in {where}" for _, stated, where in sizes)
    return f"Its positions differ from each other by {each} only; what a flight has in common is known to {flight}, as stated."
