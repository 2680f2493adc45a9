"""Covariances that include correlated image errors (see error_fields.py): of all unknowns, and of every point.

The effect of a field on orientations and cameras does not propagate to the points in full: a shifted image rotates its photograph,
and the shifted rays intersect where they did before. A point is therefore subject to both effects, that of the unknowns and that on
its own rays, with their covariance.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numba import njit

from orthomill.tasks.adjustment.model.linearisation import Linear, linearised
from orthomill.tasks.adjustment.model.network import Rays
from orthomill.tasks.adjustment.solve.normal_equations import point_precision, point_precision_alone
from orthomill.tasks.adjustment.sparse.block_matrix import BlockMatrix
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment, CorrelatedErrors
from orthomill.tasks.adjustment.testing.error_fields import MOST, TERMS, effects, field_basis, weighted_rays, white_covariance


class FieldEffects(NamedTuple):
    """The effects of the fields on the unknowns for kernels: per unit coefficient of single photographs `alone` (n, P, 2 TERMS)
    and of cameras `together` (n, C, 2 TERMS), times the standard errors `own` and `shared` of these, px."""

    alone: np.ndarray
    together: np.ndarray
    own: float
    shared: float


class RayFields(NamedTuple):
    """Rays for kernels: `first`, `jg` as in `Linear`, `columns` (M, k); `photo` and `camera` (M,); `basis` (M, TERMS) of the
    fields; `pull` (M, 3, 2): the right-hand side of the point per pixel."""

    first: np.ndarray
    columns: np.ndarray
    jg: np.ndarray
    pull: np.ndarray
    photo: np.ndarray
    camera: np.ndarray
    basis: np.ndarray


def with_correlated_errors(result: Adjustment, errors: CorrelatedErrors, size: np.ndarray) -> Adjustment:
    """The result whose covariances include the `errors`; values, residuals and their tests are the same. `size` (P, 2) px of the
    photographs."""
    network = result.network
    moves, alone, together = _moves(result, errors, size)
    pattern = result.cofactor.blocks.pattern
    added = BlockMatrix.zero(pattern)
    added.add_product(moves, moves)
    blocks = BlockMatrix(pattern, result.cofactor.blocks.values + added.values)
    rays = weighted_rays(result)
    linear, basis = linearised(network, result.state, rays), field_basis(rays.xy, size[rays.photo])
    # `point_precision` adds the precision of the rays themselves, which the result has already.
    exact = point_precision_alone(linear, pattern.start)
    pulls = _pulls(linear, rays, network.camera_of, basis, FieldEffects(alone, together, *_amplitudes(errors)))
    points = point_precision(linear, added)[0] - exact + exact @ pulls @ exact
    points[network.kept] = added.pieces(network.kept_columns)
    return replace(
        result,
        cofactor=replace(result.cofactor, blocks=blocks, moves=_beside(result.cofactor.moves, moves)),
        point_covariance=result.point_covariance + points,
        correlated=errors,
        before=result,
    )


def _beside(moves: np.ndarray, more: np.ndarray) -> np.ndarray:
    """The columns of both; without a copy where the first has none."""
    return np.hstack([moves, more]) if moves.shape[1] else more


def _moves(result: Adjustment, errors: CorrelatedErrors, size: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The effect on the unknowns of one standard error of the coefficients, a column for each, and its parts: (n, P, 2 TERMS) of
    those of single photographs, (n, C, 2 TERMS) of those of cameras."""
    network, (alone, together) = result.network, _amplitudes(errors)
    white, photos = white_covariance(result), np.unique(result.rays.photo[result.used])
    # The square of the photographs: in large blocks nothing else is as large, so that it exists once.
    moves = np.zeros((network.unknowns, 2 * TERMS * (network.photos + len(network.interior.free))))
    moved = moves[:, : 2 * TERMS * network.photos].reshape(network.unknowns, network.photos, 2 * TERMS)
    of_camera = moves[:, 2 * TERMS * network.photos :].reshape(network.unknowns, -1, 2 * TERMS)
    # In groups: the normal matrix of all coefficients would be dense in the photographs.
    for first in range(0, len(photos), MOST):
        chosen = photos[first : first + MOST]
        moved[:, chosen] = effects(result, size, white, chosen).unknowns.reshape(network.unknowns, len(chosen), -1)
    for photo, camera in enumerate(network.camera_of):
        # A field shared by the photographs of a camera has the sum of their effects.
        of_camera[:, camera] += moved[:, photo]
    moved *= alone
    of_camera *= together
    return moves, moved, of_camera


def _amplitudes(errors: CorrelatedErrors) -> tuple[float, float]:
    """Standard errors of a coefficient, px: of its part of the photograph, and of that of the camera."""
    variance = errors.rms_px**2 / TERMS
    return float(np.sqrt((1.0 - errors.share) * variance)), float(np.sqrt(errors.share * variance))


def _pulls(linear: Linear, rays: Rays, camera_of: np.ndarray, basis: np.ndarray, effects: FieldEffects) -> np.ndarray:
    """(N, 3, 3) the covariance of the right-hand sides of the points under the fields at their own rays, that with the motion of
    the unknowns included."""
    # A displacement of a ray enters the right-hand side of its point as any other residual does: by B' P.
    pull = linear.weight[:, None, None] * linear.jp.transpose(0, 2, 1)
    of_rays = RayFields(linear.first, linear.columns[linear.row], linear.jg, pull, rays.photo, camera_of[rays.photo], basis)
    square = _quadratic_form(of_rays, effects)
    return linear.frame @ square @ linear.frame.swapaxes(1, 2)


@njit(cache=True)
def _quadratic_form(rays, effects):
    """(N, 3, 3): the quadratic form of what unit coefficients do to the right-hand sides of the points, without that of the
    unknowns alone."""
    points = np.zeros((len(rays.first) - 1, 3, 3))
    block = np.empty((2, 2))
    for point in range(len(rays.first) - 1):
        for i in range(rays.first[point], rays.first[point + 1]):
            for j in range(rays.first[point], rays.first[point + 1]):
                # Of ray i the unknowns, of ray j the field; the transpose comes with (j, i).
                _mixed(rays, effects, (i, j), block)
                direct = _direct_covariance(rays, effects, i, j)
                for r in range(3):
                    for s in range(3):
                        for m in range(2):
                            for n in range(2):
                                once = rays.pull[i, r, m] * block[m, n] * rays.pull[j, s, n]
                                points[point, r, s] += once
                                points[point, s, r] += once
                            points[point, r, s] += rays.pull[i, r, m] * direct * rays.pull[j, s, m]
    return points


@njit(cache=True)
def _mixed(rays, effects, pair, block):
    """Covariance `block` (2, 2) px^2 of ray i as computed from the unknowns, with the field at ray j; `pair` = (i, j)."""
    i, j = pair
    terms = rays.basis.shape[1]
    block[:] = 0.0
    for a in range(rays.columns.shape[1]):
        c = rays.columns[i, a]
        if c < 0:
            continue
        for n in range(2):
            along = 0.0
            for d in range(terms):
                at = n * terms + d
                of_photo = effects.own * effects.alone[c, rays.photo[j], at]
                along += (of_photo + effects.shared * effects.together[c, rays.camera[j], at]) * rays.basis[j, d]
            for m in range(2):
                block[m, n] += rays.jg[i, m, a] * along


@njit(cache=True)
def _direct_covariance(rays, effects, i, j):
    """Covariance, px^2, of the fields at two rays, the same in x and y; fields of different cameras are independent."""
    direct = 0.0
    if rays.camera[i] == rays.camera[j]:
        for d in range(rays.basis.shape[1]):
            direct += rays.basis[i, d] * rays.basis[j, d]
        direct *= effects.shared**2 + (effects.own**2 if rays.photo[i] == rays.photo[j] else 0.0)
    return direct
