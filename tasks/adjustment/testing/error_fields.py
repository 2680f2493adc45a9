"""Errors that neighbouring measurements of a photograph share, and their effect on the standard errors.

Residuals are not only white noise. A stabiliser that shifts the sensor, a shutter that runs while the camera moves, film that is
not flat, a lens that differs from Brown's polynomial: all of them displace whole regions of a photograph together. Ten thousand
tie points then contain little more information than a hundred, and the error of what is poorly determined (c over a flat object)
is many times its formal standard error.

Strategy. Every photograph has a smooth field of displacements: Legendre polynomials of the frame of ORDERS in x and in y, with
random coefficients of one variance, a share of which is common to all photographs of a camera. Both are estimated from the
residuals by maximum likelihood: with N the normal matrix of the coefficients after elimination of all unknowns and points, and t
its right-hand side, t has the covariance s2 N + N C N, where C is that of the coefficients and s2 the variance of what no field
explains. Fields are assumed only where the likelihood ratio rejects white noise. They are not estimated: like considered
parameters (Schmidt 1966) their uncertainty propagates into all adjusted quantities, through the effect -Q N_uc of their
coefficients.

Source: Moritz 1980 (collocation); Patterson and Thompson 1971 (likelihood of residuals); Tang, Fritsch and Cramer 2012 (Legendre
polynomials as the form of image deformation); docs/methods.md on correlated image errors.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.optimize import minimize_scalar
from scipy.sparse import csc_array, eye_array, hstack, kron

from orthomill.tasks.adjustment.model.linearisation import linearised, seen_pattern
from orthomill.tasks.adjustment.model.network import Network, Rays
from orthomill.tasks.adjustment.solve.normal_equations import reduced_normals
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment, CorrelatedErrors
from orthomill.tasks.adjustment.testing.covariances import Covariance, covariance_of

# Orders 0 and 1 are absorbed by orientation, camera constant and principal point; what a shift or tilt of the sensor leaves is of
# second order, its bending of third. More terms than these 7 would compete with the noise of the tie points.
ORDERS = (2, 3)
"""Orders of the polynomials, x and y together."""
VISIBLE = 0.01
"""Combinations of coefficients which the residuals show by less than this share of the most visible one are not used for the
variance: the unknowns absorb them."""
SIGNIFICANT = 10.83
"""Likelihood ratio that white noise exceeds in less than one of 1000 blocks (chi-squared, one degree of freedom)."""
# The covariance of the coefficients is dense: 20 photographs make 280 of them, which takes milliseconds to factorise.
MOST = 20
"""Number of photographs, evenly chosen, from which the variance is estimated; it applies to all."""
SHARES = (0.0, 0.1, 0.25, 0.5, 0.75, 0.9, 1.0)
"""Shares of the variance common to a camera that are compared."""

_POWERS = tuple((i, order - i) for order in ORDERS for i in range(order + 1))
TERMS = len(_POWERS)


def field_basis(xy: np.ndarray, size: np.ndarray) -> np.ndarray:
    """(M, TERMS) Legendre polynomials with unit mean square over the frame; `xy` (M, 2) px from the image centre, `size` (M, 2)
    width and height, px."""
    x, y = (
        np.polynomial.legendre.legvander(2.0 * xy[:, k] / size[:, k], ORDERS[-1]) * np.sqrt(2.0 * np.arange(ORDERS[-1] + 1) + 1.0)
        for k in (0, 1)
    )
    return np.stack([x[:, i] * y[:, j] for i, j in _POWERS], axis=1)


@dataclass(frozen=True, eq=False)
class Effects:
    """The coefficients of some photographs (photo by photo, x before y): `unknowns` (n, k) the effect of a unit of each on the
    adjusted unknowns, minus the solution for the right-hand sides `pull` (n, k), which are 0 where no point is in common; `normal`
    (k, k) and `right` (k,) of their normal equations after elimination of everything else."""

    unknowns: np.ndarray
    pull: np.ndarray
    normal: np.ndarray
    right: np.ndarray


def weighted_rays(result: Adjustment) -> Rays:
    """The rays that took part, with their estimated standard errors."""
    return replace(result.rays, sigma=result.ray_sigma).take(result.used)


def white_covariance(result: Adjustment) -> Covariance:
    """The covariance of the unknowns if all errors were white; 0 for considered parameters."""
    return covariance_of(result.network, result.state, linearised(result.network, result.state, weighted_rays(result)))


def effects(result: Adjustment, size: np.ndarray, white: Covariance, chosen: np.ndarray) -> Effects:
    """The effects of the fields of the photographs `chosen` (ascending numbers); `size` (P, 2) px of all photographs, `white` the
    covariance of `white_covariance`.

    At the solution the right-hand side of the unknowns is zero, so that only points which the chosen photographs see contribute.
    """
    cross, own, right = field_normals(result, size, chosen)
    moved = -white.times(cross)
    own = own + cross.T @ moved
    return Effects(moved, cross, 0.5 * (own + own.T), right)


def field_normals(result: Adjustment, size: np.ndarray, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The normal equations of the coefficients (k) of the photographs `chosen` after elimination of the points: with the unknowns
    (n, k), among each other (k, k), and their right-hand side (k,); `size` as in `effects`."""
    network, rays = result.network, weighted_rays(result)
    touched = np.zeros(len(network.point), bool)
    touched[rays.point[np.isin(rays.photo, chosen)]] = True
    rays = rays.take(touched[rays.point])
    linear = linearised(network, result.state, rays)
    derivatives, columns = _columns(network, rays, size, chosen)
    own_columns = np.full((len(linear.columns), 2 * TERMS), -1)
    own_columns[linear.row] = columns
    count, k = network.unknowns, 2 * TERMS * len(chosen)
    augmented = linear._replace(
        jg=np.concatenate([linear.jg, derivatives], axis=2), columns=np.hstack([linear.columns, own_columns])
    )
    start = np.append(network.group_start, count + 2 * TERMS * np.arange(1, len(chosen) + 1))
    normals = reduced_normals(augmented, seen_pattern(augmented, start))
    unit = np.zeros((count + k, k))
    unit[count:] = np.eye(k)
    cross, own = np.vsplit(normals.matrix.times(unit), [count])
    return cross, own, normals.right[count:]


def of_errors(pull: csc_array, errors: CorrelatedErrors, camera_of: np.ndarray, cameras: int) -> csc_array:
    """(n, K) the right-hand sides of one standard error of every coefficient: those of single photographs, photo by photo, then
    those that cameras share; from `pull` (n, k) of a unit of each photograph's, whose cameras are `camera_of` (p,)."""
    own, shared = amplitudes(errors)
    of_camera = csc_array(camera_of[:, None] == np.arange(cameras), dtype=float)
    summed = pull @ kron(of_camera, eye_array(2 * TERMS), format="csc")
    return hstack([own * pull, shared * summed], format="csc")


def amplitudes(errors: CorrelatedErrors) -> tuple[float, float]:
    """Standard errors of a coefficient, px: of its part of the photograph, and of that of the camera."""
    variance = errors.rms_px**2 / TERMS
    return float(np.sqrt((1.0 - errors.share) * variance)), float(np.sqrt(errors.share * variance))


def displacements(rays: Rays, size: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """(M, 2) px at the `rays` of fields with `coefficients` (P, 2, TERMS) px; `size` (P, 2) px of the photographs."""
    return np.asarray(np.einsum("mt,mkt->mk", field_basis(rays.xy, size[rays.photo]), coefficients[rays.photo]))


def _columns(network: Network, rays: Rays, size: np.ndarray, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (M, 2, 2 TERMS) of the image coordinates by the coefficients of each ray's photograph, and their columns (M, 2
    TERMS)."""
    basis = field_basis(rays.xy, size[rays.photo])
    derivatives = np.zeros((len(rays), 2, 2 * TERMS))
    derivatives[:, 0, :TERMS], derivatives[:, 1, TERMS:] = basis, basis
    place = np.full(network.photos, -1)
    place[chosen] = np.arange(len(chosen))
    columns = network.unknowns + 2 * TERMS * place[rays.photo][:, None] + np.arange(2 * TERMS)
    return derivatives, np.where(place[rays.photo][:, None] >= 0, columns, -1)


def correlated_errors(result: Adjustment, size: np.ndarray) -> CorrelatedErrors | None:
    """The correlated errors that the residuals show; None where white noise explains them. `size` (P, 2) px of the photographs.

    Considered parameters are free here: what they would explain is no error of the measurements.
    """
    # With c fixed at a wrong nominal value, its radial pattern would be taken for a field.
    result, pull = _freed(result)
    # A photograph without used rays shows nothing, and its coefficients would be singular.
    photos = np.unique(result.rays.photo[result.used])
    chosen = photos[np.unique(np.linspace(0, len(photos) - 1, MOST).round().astype(int))]
    white = white_covariance(result)
    fields = effects(result, size, white, chosen)
    visible, direction = np.linalg.eigh(fields.normal)
    seen = visible > max(VISIBLE * visible[-1], 1e-12)
    visible, direction = visible[seen], direction[:, seen]
    own = result.used & np.isin(result.rays.photo, chosen)
    square = float((result.residual[own] ** 2 / result.ray_sigma[own][:, None] ** 2).sum())
    square -= float(pull @ white.times(pull[:, None])[:, 0])
    redundancy = float(result.redundancy_number[own].sum())
    # Without as many white combinations as visible ones the noise would be estimated from next to nothing.
    if len(visible) == 0 or redundancy <= 2 * len(visible):
        return None
    # Along the eigenvectors of the normal matrix the white part of the covariance is diagonal.
    z = direction.T @ (fields.right + fields.unknowns.T @ pull)
    noise = max((square - float((z**2 / visible).sum())) / (redundancy - len(visible)), 1e-6)
    camera = result.network.camera_of[chosen]
    variance, share, likelihood = _likeliest(z, visible, noise, _alike(direction, camera[:, None] == camera))
    if likelihood < SIGNIFICANT:
        return None
    return CorrelatedErrors(float(np.sqrt(variance * TERMS)), share, likelihood, noise * redundancy / square)


def _freed(result: Adjustment) -> tuple[Adjustment, np.ndarray]:
    """The result with its considered parameters free, and the right-hand side (n,) of all unknowns: zero except for these."""
    network = result.network
    considered = network.considered_columns
    if not considered.any():
        return result, np.zeros(network.unknowns)
    linear = linearised(network, result.state, weighted_rays(result))
    # Considered parameters kept their value, so that the solution is no minimum with respect to them.
    pull = reduced_normals(linear, seen_pattern(linear, network.group_start)).right
    interior = replace(network.interior, considered=np.zeros_like(network.interior.considered))
    return replace(result, network=replace(network, interior=interior)), np.where(considered, pull, 0.0)


def _likeliest(z: np.ndarray, visible: np.ndarray, noise: float, alike: np.ndarray) -> tuple[float, float, float]:
    """Variance (px^2) of the coefficients, its common share, and the likelihood ratio against white noise."""
    white, start = noise * np.diag(visible), np.log(noise / visible[-1])
    # The likelihood of the residuals alone (REML): the unknowns have been eliminated, not estimated in it.
    none = _deviance(z, white)
    best = (0.0, 0.0, 0.0)
    for share in SHARES:
        form = visible[:, None] * ((1.0 - share) * np.eye(len(visible)) + share * alike) * visible
        # On a logarithmic scale, within one per cent: the likelihood is flat there compared with its own scatter.
        found = minimize_scalar(
            partial(_deviance_of_size, z, white, form),
            bounds=(start - 5.0, start + 18.0),
            method="bounded",
            options={"xatol": 0.01},
        )
        if none - found.fun > best[2]:
            best = (float(np.exp(found.x)), share, float(none - found.fun))
    return best


def _deviance_of_size(z: np.ndarray, white: np.ndarray, form: np.ndarray, size: float) -> float:
    """The deviance with fields of the covariance exp(size) form in addition to white noise."""
    return _deviance(z, white + np.exp(size) * form)


def _alike(direction: np.ndarray, same: np.ndarray) -> np.ndarray:
    """The covariance of coefficients that are the same in all photographs of a camera, along the columns of `direction`; `same`
    (P, P): which photographs share one."""
    by_photo = direction.reshape(len(same), -1, direction.shape[1])
    return np.einsum("pka,pkb->ab", by_photo, np.einsum("pq,qkb->pkb", same.astype(float), by_photo), optimize=True)


def _deviance(z: np.ndarray, covariance: np.ndarray) -> float:
    """Minus twice the logarithm of the likelihood of z, up to a constant."""
    try:
        # One factor gives the determinant and the quadratic form.
        factor = cho_factor(covariance, lower=True)
    except LinAlgError:
        return np.inf
    return float(2.0 * np.log(np.diag(factor[0])).sum() + z @ cho_solve(factor, z))
