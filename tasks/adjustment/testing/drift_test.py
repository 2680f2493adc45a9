"""How far positions drift against the block: an unknown that the adjustment does not have, estimated from its residuals.

Of observations y = A x + D d + v with weights P the adjustment without d leaves residuals v; adding d to it would give

    d = S^-1 D' P v,    S = D' P D - D' P A Q A' P D

with the standard errors of S^-1, Q being the covariance of x. What the block follows of a drift (a lean across its strips looks
like one) is in S: the less of a drift its residuals show, the larger is the standard error. A drift enlarges what positions are
thought to err by: where that was done, their residuals without the drift say by how much too far. Sources: Ackermann and
Schade 1993, Application of GPS for aerial triangulation, for the unknowns; Baarda 1968 for their test.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.tasks.adjustment.model.datum import position_derivatives, position_residuals
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment
from orthomill.tasks.adjustment.testing.variance_components import position_covariances

LEAST_SHOWN = 1e-4
"""share of a drift's weight that is left in the residuals, below which nothing is said of it"""


@dataclass(frozen=True, eq=False)
class DriftTest:
    """Drifts (f, 3) m in X, Y, Z of f flights from their first to their last position, with standard errors (f, 3); NaN where the
    block would follow all of it; freedom (f,): how many observations the scatter of the positions is known from."""

    value: np.ndarray
    sigma: np.ndarray
    freedom: np.ndarray


def drift_test(result: Adjustment, moment: np.ndarray, flight: np.ndarray) -> DriftTest:
    """The drifts of the flights.

    moment: (P,) from -0.5 to 0.5 over each flight; flight: (P,) their numbers from 0, -1 for photographs of none that counts.
    """
    own = result.as_computed
    network, flights = own.network, int(flight.max(initial=-1)) + 1
    photos = np.flatnonzero(network.centre_weight.any(axis=1) & (flight >= 0))
    value, sigma, freedom = np.full((flights, 3), np.nan), np.full((flights, 3), np.nan), np.zeros(flights)
    if not flights or not len(photos):
        return DriftTest(value, sigma, freedom)
    D, weight = _derivatives(moment[photos], flight[photos], flights), network.centre_weight[photos]
    residual = position_residuals(network, own.state)[photos]
    weighted = weight[:, :, None] * D
    pull = _pull(own, photos, weighted)
    whole = np.einsum("pid,pie->de", D, weighted)
    shown = whole - pull.T @ own.cofactor.times(pull)
    right = np.einsum("pid,pi->d", weighted, residual)
    known = np.diag(shown) > LEAST_SHOWN * np.diag(whole)
    if known.any():
        inverse = np.linalg.pinv(shown[np.ix_(known, known)], rcond=LEAST_SHOWN, hermitian=True)
        value.ravel()[known], sigma.ravel()[known] = inverse @ right[known], np.sqrt(np.diag(inverse))
    explained = np.nan_to_num(value * right.reshape(-1, 3)).sum(axis=1)
    left = (weight * residual**2).sum(axis=1)
    redundancy = (weight > 0).sum(axis=1) - (weight * np.diagonal(position_covariances(own, photos), axis1=1, axis2=2)).sum(axis=1)
    enlarged = own.factors.of_positions(network)[photos, 0]
    for number in range(flights):
        mine = flight[photos] == number
        freedom[number] = redundancy[mine].sum() - known.reshape(-1, 3)[number].sum()
        if freedom[number] > 0:
            scatter = np.sqrt(max(left[mine].sum() - explained[number], 0.0) / freedom[number])
            # No smaller than stated.
            sigma[number] *= np.clip(scatter, 1.0 / enlarged[mine].max(), 1.0)
    return DriftTest(value, sigma, freedom)


def _derivatives(moment: np.ndarray, flight: np.ndarray, flights: int) -> np.ndarray:
    """(p, 3, 3 f) of positions by the drifts: one in one coordinate is none in the others."""
    out = np.zeros((len(moment), 3, flights, 3))
    for axis in range(3):
        out[np.arange(len(moment)), axis, flight, axis] = moment
    return out.reshape(len(moment), 3, 3 * flights)


def _pull(result: Adjustment, photos: np.ndarray, weighted: np.ndarray) -> np.ndarray:
    """(n, d) on the unknowns, of weighted derivatives (p, 3, d) of positions."""
    J, columns = position_derivatives(result.network, result.state, photos)
    pull = np.zeros((len(result.cofactor), weighted.shape[2]))
    there = columns >= 0
    np.add.at(pull, columns[there], (J.transpose(0, 2, 1) @ weighted)[there])
    return pull
