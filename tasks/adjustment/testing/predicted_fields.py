"""Fields of correlated image errors as positions, control, attitudes and cameras show them.

Rays are weighted as if each erred by itself. A hundred thousand of them then outvote twenty positions, although what they have in
common (see error_fields.py) bends the block by more than these positions may err. The rays carry what their honest covariance says:
that of white noise, and what the fields do to the block.

Strategy. An adjusted block has residuals v of all that is no ray (in standard errors), whose covariance is P + H H': P = I - J Q J'
of white noise, the redundancy matrix of these observations, and H = -J Q N_uf, what one standard error of every field coefficient
does to them. The best prediction of the coefficients is H' (P + H H')^-1 v (Moritz 1980). Rays less these fields, adjusted again
with the weights of white noise, give the solution in which the block by rays alone, with its covariance of white noise and fields,
is combined with all other observations by their weights. Residuals of the rays themselves take no part in the prediction: the form
of the fields is an assumption, which serves to say by how much a block may err, not to correct it. Nor do the prior values of
cameras: fields that all photographs share look like a lens, and would be bent until a guessed lens is right. Where nothing but rays
determines the block, nothing is predicted and nothing changes.

Considered parameters move the block as fields do: their effects are part of the covariance of v, so that fields are not blamed for
a camera constant that nobody knows.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csc_array, hstack

from orthomill.tasks.adjustment.model.datum import standardised_prior
from orthomill.tasks.adjustment.model.linearisation import linearised
from orthomill.tasks.adjustment.model.network import Network
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment, CorrelatedErrors
from orthomill.tasks.adjustment.testing.covariances import covariance_of, with_considered
from orthomill.tasks.adjustment.testing.error_fields import MOST, TERMS, amplitudes, field_normals, of_errors, weighted_rays

# Their covariance is dense. Fewer of them say less, and nothing wrong.
MOST_OBSERVATIONS = 600
"""Number of observations, evenly chosen, from which fields are predicted: the positions of 200 photographs."""
DETERMINED = 1e-4
"""Variance, in that of white noise, below which a combination of residuals is zero whatever the observations: it only places the
block."""
LARGEST = 1e8
"""Variance factor beyond which none is searched for"""
TOLD = 0.01
"""Share of the variance of a combination of coefficients from which on it counts as known in covariances"""
MOST_KNOWN = 30
"""and the number of such combinations: each is propagated to every point."""


@dataclass(frozen=True, eq=False)
class PredictedFields:
    """`coefficients` (P, 2, TERMS) px of the fields; `known` (K, d): in standard errors, as in `of_errors`, their covariance is
    then I - known known'."""

    coefficients: np.ndarray
    known: np.ndarray


def predicted_fields(
    result: Adjustment, errors: CorrelatedErrors, size: np.ndarray, taken_off: np.ndarray | None = None
) -> PredictedFields:
    """The fields of the photographs of a block, whose frames are `size` (P, 2) px, by all observations but the rays; `taken_off`
    (P, 2, TERMS) px: what the rays of the result have been corrected by already, as a part of them."""
    network = _with_control_kept(result)
    result = replace(result, network=network)
    linear = linearised(network, result.state, weighted_rays(result))
    white = with_considered(network, linear, covariance_of(network, result.state, linear))
    photos = np.unique(result.rays.photo[result.used])
    derivatives, residual = _evenly_chosen(*standardised_prior(network, result.state))
    solved = white.inverse.times(derivatives.T)
    pull = _pulls(result, size, photos)
    by_fields = -np.asarray(of_errors(pull, errors, network.camera_of[photos], len(network.interior.free)).T @ solved).T
    if taken_off is not None:
        # As if nothing had been taken off: the prediction is that of the whole.
        residual = residual - solved.T @ (pull @ taken_off[photos].ravel())
    by_considered = derivatives @ white.moves
    white_part = np.eye(len(residual)) - derivatives @ solved
    root = _root_of_inverse(white_part, by_considered @ by_considered.T + by_fields @ by_fields.T, residual)
    # Of every independent combination of residuals, what it says of the coefficients.
    gain = by_fields.T @ root
    return PredictedFields(_coefficients(network, photos, errors, gain @ (root.T @ residual)), _known(gain))


def _root_of_inverse(white: np.ndarray, moved: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """(r, m) a root of the inverse covariance of the residuals (r,), s2 `white` + `moved` with the smallest s2 from 1 on, by powers
    of two, that makes them as large as they are: standard errors that are stated too small must not be blamed on the fields."""
    enlarged = 1.0
    while True:
        values, axes = np.linalg.eigh(enlarged * white + moved)
        told = values > DETERMINED
        root = axes[:, told] / np.sqrt(values[told])
        count = int(told.sum())
        # Up to two standard errors of chi-squared above its mean.
        if ((root.T @ residual) ** 2).sum() <= count + 2.0 * np.sqrt(2.0 * count) or enlarged > LARGEST:
            return root
        enlarged *= 2.0


def _with_control_kept(result: Adjustment) -> Network:
    """The network whose control points are among the unknowns, so that their coordinates are observations of unknowns as well."""
    seen = np.unique(result.rays.point[result.used])
    control = np.flatnonzero(result.network.point_weight.any(axis=1))
    return replace(result.network, kept=np.union1d(result.network.kept, np.intersect1d(control, seen)))


def _evenly_chosen(derivatives, residual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(r, n) and (r,) of at most MOST_OBSERVATIONS of the observations."""
    chosen = np.unique(np.linspace(0, len(residual) - 1, MOST_OBSERVATIONS).round().astype(int))
    return derivatives[chosen].toarray(), residual[chosen]


def _pulls(result: Adjustment, size: np.ndarray, photos: np.ndarray) -> csc_array:
    """(n, k) the right-hand sides of a unit of every coefficient of all `photos`."""
    # In groups, which share few points with the rest.
    groups = [photos[first : first + MOST] for first in range(0, len(photos), MOST)]
    return hstack([csc_array(field_normals(result, size, chosen)[0]) for chosen in groups], format="csc")


def _coefficients(network: Network, photos: np.ndarray, errors: CorrelatedErrors, standardised: np.ndarray) -> np.ndarray:
    """(P, 2, TERMS) px from those of photographs and cameras in their standard errors (K,)."""
    own, shared = amplitudes(errors)
    single, common = np.split(standardised, [2 * TERMS * len(photos)])
    found = np.zeros((network.photos, 2, TERMS))
    found[photos] = own * single.reshape(-1, 2, TERMS) + shared * common.reshape(-1, 2, TERMS)[network.camera_of[photos]]
    return found


def _known(gain: np.ndarray) -> np.ndarray:
    """(K, d) the combinations of coefficients that are known best, as long as what is known of them, from `gain` (K, m)."""
    directions, length, _ = np.linalg.svd(gain, full_matrices=False)
    best = np.flatnonzero(length**2 > TOLD)[:MOST_KNOWN]
    return directions[:, best] * length[best]
