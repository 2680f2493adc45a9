"""Covariances that carry errors in common (see error_fields.py): of all unknowns, and of every point.

What the field of a photograph does to orientations and cameras it does not do to points in full: a shifted picture turns its
photograph, and the rays that were shifted meet where they met before. A point therefore gets both, the effect by way of the
unknowns and that on its own rays, with their covariance.
"""

from dataclasses import replace

import numpy as np
from numba import njit

from orthomill.tasks.adjustment.model.adjustment_result import Adjustment, CorrelatedErrors
from orthomill.tasks.adjustment.model.linearisation import Linear, linearised
from orthomill.tasks.adjustment.model.network import Rays
from orthomill.tasks.adjustment.solve.normal_equations import point_precision, point_precision_alone
from orthomill.tasks.adjustment.sparse.block_matrix import BlockMatrix
from orthomill.tasks.adjustment.testing.error_fields import MOST, TERMS, effects, field_basis, weighted_rays, white_covariance


def with_correlated_errors(result: Adjustment, errors: CorrelatedErrors, size: np.ndarray) -> Adjustment:
    """The result whose covariances carry the `errors`; values, residuals and their tests stay. `size` (P, 2) px of the
    photographs."""
    network = result.network
    alone, together = _moves(result, errors, size)
    moves = np.hstack([alone.reshape(network.unknowns, -1), together.reshape(network.unknowns, -1)])
    pattern = result.cofactor.blocks.pattern
    added = BlockMatrix.zero(pattern)
    added.add_product(moves, moves)
    blocks = BlockMatrix(pattern, result.cofactor.blocks.values + added.values)
    rays = weighted_rays(result)
    linear, basis = linearised(network, result.state, rays), field_basis(rays.xy, size[rays.photo])
    exact = point_precision_alone(linear, pattern.start)
    pulls = _pulls(linear, rays, network.camera_of, basis, alone, together, errors)
    points = point_precision(linear, added)[0] - exact + exact @ pulls @ exact
    points[network.kept] = added.pieces(network.kept_columns)
    return replace(
        result,
        cofactor=replace(result.cofactor, blocks=blocks, moves=np.hstack([result.cofactor.moves, moves])),
        point_covariance=result.point_covariance + points,
        correlated=errors,
        before=result,
    )


def _moves(result: Adjustment, errors: CorrelatedErrors, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How the unknowns move per standard error of the coefficients: (n, P, 2 TERMS) of those of single photographs, (n, C, 2 TERMS)
    of those of cameras."""
    network, (alone, together) = result.network, _amplitudes(errors)
    white, photos = white_covariance(result), np.unique(result.rays.photo[result.used])
    moved = np.zeros((network.unknowns, network.photos, 2 * TERMS))
    for first in range(0, len(photos), MOST):
        chosen = photos[first : first + MOST]
        moved[:, chosen] = effects(result, size, white, chosen).unknowns.reshape(network.unknowns, len(chosen), -1)
    of_camera = np.zeros((network.unknowns, len(network.interior.free), 2 * TERMS))
    for photo, camera in enumerate(network.camera_of):
        of_camera[:, camera] += moved[:, photo]
    return alone * moved, together * of_camera


def _amplitudes(errors: CorrelatedErrors) -> tuple[float, float]:
    """Standard errors of a coefficient, px: its part of the photograph, and that of the camera."""
    variance = errors.rms_px**2 / TERMS
    return float(np.sqrt((1.0 - errors.share) * variance)), float(np.sqrt(errors.share * variance))


def _pulls(
    linear: Linear,
    rays: Rays,
    camera_of: np.ndarray,
    basis: np.ndarray,
    alone: np.ndarray,
    together: np.ndarray,
    errors: CorrelatedErrors,
) -> np.ndarray:
    """(N, 3, 3) the covariance of how the fields pull at the points by way of their own rays, with that of the unknowns' moves."""
    pull = linear.weight[:, None, None] * linear.jp.transpose(0, 2, 1)
    square = _square_form(
        linear.first, linear.columns[linear.row], linear.jg, pull, rays.photo, camera_of, basis, alone, together,
        *_amplitudes(errors),
    )  # fmt: skip
    return linear.frame @ square @ linear.frame.swapaxes(1, 2)


@njit(cache=True)
def _square_form(first, columns, jg, pull, photo, camera_of, basis, alone, together, own, shared):
    """(N, 3, 3): the square form of what unit coefficients do to the right-hand sides of the points, without that of the unknowns
    alone."""
    points, terms, k = np.zeros((len(first) - 1, 3, 3)), basis.shape[1], columns.shape[1]
    block = np.empty((2, 2))
    for point in range(len(first) - 1):
        for i in range(first[point], first[point + 1]):
            for j in range(first[point], first[point + 1]):
                # Of ray i the unknowns, of ray j the field; the transpose comes with (j, i).
                block[:] = 0.0
                camera = camera_of[photo[j]]
                for a in range(k):
                    c = columns[i, a]
                    if c < 0:
                        continue
                    for n in range(2):
                        along = 0.0
                        for d in range(terms):
                            at = n * terms + d
                            along += (own * alone[c, photo[j], at] + shared * together[c, camera, at]) * basis[j, d]
                        for m in range(2):
                            block[m, n] += jg[i, m, a] * along
                direct = 0.0
                if camera_of[photo[i]] == camera:
                    for d in range(terms):
                        direct += basis[i, d] * basis[j, d]
                    direct *= shared**2 + (own**2 if photo[i] == photo[j] else 0.0)
                for r in range(3):
                    for s in range(3):
                        for m in range(2):
                            for n in range(2):
                                once = pull[i, r, m] * block[m, n] * pull[j, s, n]
                                points[point, r, s] += once
                                points[point, s, r] += once
                            points[point, r, s] += pull[i, r, m] * direct * pull[j, s, m]
    return points
