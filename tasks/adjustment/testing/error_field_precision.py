"""Covariances that include correlated image errors (see error_fields.py): of all unknowns, and of every point.

The effect of a field on orientations and cameras does not propagate to the points in full: a shifted image rotates its photograph,
and the shifted rays intersect where they did before. A point is therefore subject to both effects, that of the unknowns and that on
its own rays, with their covariance.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.sparse import csc_array, hstack

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.adjustment.model.linearisation import Linear, linearised
from orthomill.tasks.adjustment.model.network import Network, Rays
from orthomill.tasks.adjustment.solve.normal_equations import point_corrections, point_covariances, point_precision_alone
from orthomill.tasks.adjustment.sparse.block_matrix import BlockMatrix, Pattern
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment, CorrelatedErrors
from orthomill.tasks.adjustment.testing.covariances import Motion
from orthomill.tasks.adjustment.testing.error_fields import (
    MOST,
    TERMS,
    amplitudes,
    effects,
    field_basis,
    of_errors,
    weighted_rays,
    white_covariance,
)


class FieldEffects(NamedTuple):
    """The effects of the fields on the unknowns for kernels: per unit coefficient of single photographs `alone` (R, 2 TERMS), for
    photograph p on the unknowns that have points in common with it, `unknown` (R,) from first[p] to first[p + 1], ascending; and
    of cameras `together` (n, C, 2 TERMS). `own` and `shared`: the standard errors of these coefficients, px."""

    first: np.ndarray
    unknown: np.ndarray
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


def with_correlated_errors(
    result: Adjustment, errors: CorrelatedErrors, size: np.ndarray, known: np.ndarray | None = None
) -> Adjustment:
    """The result whose covariances include the `errors`; values, residuals and their tests are the same. `size` (P, 2) px of the
    photographs; `known` (K, d) what is known of the fields, as in `Motion`."""
    network = result.network
    fields, added, motion = _propagated(result, errors, size, known)
    rays = weighted_rays(result)
    linear, basis = linearised(network, result.state, rays), field_basis(rays.xy, size[rays.photo])
    # `point_covariances` adds the precision of the rays themselves, which the result has already.
    exact = point_precision_alone(linear, added.pattern.start)
    pulls = _pulls(linear, rays, network.camera_of, basis, fields)
    points = point_covariances(linear, added) - exact + exact @ pulls @ exact
    if known is not None and known.size:
        moved = motion.inverse.times(motion.pulls @ known)
        # It moves unknowns and rays together; before the kept points, which are unknowns, are read.
        added.add_product(-moved, moved)
        points = points - _known_of_points(linear, moved, _known_on_rays(network, rays, basis, errors, known))
    points[network.kept] = added.pieces(network.kept_columns)
    blocks = BlockMatrix(added.pattern, result.cofactor.blocks.values + added.values)
    return replace(
        result,
        cofactor=replace(result.cofactor, blocks=blocks, correlated=motion),
        point_covariance=result.point_covariance + points,
        correlated=errors,
        before=result,
    )


def _propagated(
    result: Adjustment, errors: CorrelatedErrors, size: np.ndarray, known: np.ndarray | None
) -> tuple[FieldEffects, BlockMatrix, Motion]:
    """What the fields do to the unknowns: near each photograph, the covariance in the blocks of the result, and all of it; of what
    is known of them only the last takes account."""
    network, (own, shared) = result.network, amplitudes(errors)
    white, photos = white_covariance(result), np.unique(result.rays.photo[result.used])
    added = BlockMatrix.zero(result.cofactor.blocks.pattern)
    near = _near_photographs(added.pattern, network.photos)
    alone = np.zeros((len(near.indices), 2 * TERMS))
    together = np.zeros((network.unknowns, len(network.interior.free), 2 * TERMS))
    pulls = []
    # In groups, of whose effects only the part that is needed stays: all of them would be the square of the photographs.
    for first in range(0, len(photos), MOST):
        chosen = photos[first : first + MOST]
        found = effects(result, size, white, chosen)
        moved = found.unknowns.reshape(network.unknowns, len(chosen), 2 * TERMS)
        added.add_product(own * found.unknowns, own * found.unknowns)
        pulls.append(csc_array(found.pull))
        for k, photo in enumerate(chosen):
            part = slice(near.indptr[photo], near.indptr[photo + 1])
            alone[part] = moved[near.indices[part], k]
            # A field shared by the photographs of a camera has the sum of their effects.
            together[:, network.camera_of[photo]] += moved[:, k]
    of_cameras = shared * together.reshape(network.unknowns, -1)
    added.add_product(of_cameras, of_cameras)
    cameras = len(network.interior.free)
    motion = Motion(white.inverse, of_errors(hstack(pulls, format="csc"), errors, network.camera_of[photos], cameras), known)
    return FieldEffects(near.indptr, near.indices, alone, together, own, shared), added, motion


def _near_photographs(pattern: Pattern, photos: int) -> csc_array:
    """(n, P), of which only the structure counts: the unknowns, in ascending order, that have a block with each photograph."""
    blocks = csc_array((np.ones(len(pattern.partner)), (pattern.rows, pattern.partner)), shape=[len(pattern.first) - 1] * 2)
    groups = (blocks + blocks.T).tocsr()[pattern.owner]
    near = groups[:, :photos].tocsc()
    near.sort_indices()
    return near


def _known_on_rays(network: Network, rays: Rays, basis: np.ndarray, errors: CorrelatedErrors, known: np.ndarray) -> np.ndarray:
    """(d, M, 2) px: the displacements of the rays by each of the `known` (K, d) combinations of coefficients."""
    (own, shared), photos = amplitudes(errors), np.unique(rays.photo)
    single, common = np.vsplit(known, [2 * TERMS * len(photos)])
    of_photo = own * single.reshape(len(photos), 2, TERMS, -1)
    of_photo = of_photo + shared * common.reshape(-1, 2, TERMS, known.shape[1])[network.camera_of[photos]]
    place = np.searchsorted(photos, rays.photo)
    return np.stack([np.einsum("mt,mkt->mk", basis, each[place]) for each in np.moveaxis(of_photo, 3, 0)])


def _known_of_points(linear: Linear, moved: np.ndarray, on_rays: np.ndarray) -> np.ndarray:
    """(N, 3, 3) what the points are known better by, where the unknowns move by the columns of `moved` (n, d) and the rays by
    `on_rays` (d, M, 2)."""
    total = np.zeros((len(linear.frame), 3, 3))
    for correction, residual in zip(moved.T, on_rays, strict=True):
        shift = point_corrections(
            linear._replace(residual=residual, point_residual=np.zeros_like(linear.point_residual)), correction
        )
        total += shift[:, :, None] * shift[:, None, :]
    return total


def _pulls(linear: Linear, rays: Rays, camera_of: np.ndarray, basis: np.ndarray, effects: FieldEffects) -> np.ndarray:
    """(N, 3, 3) the covariance of the right-hand sides of the points under the fields at their own rays, that with the motion of
    the unknowns included."""
    # A displacement of a ray enters the right-hand side of its point as any other residual does: by B' P.
    pull = linear.weight[:, None, None] * linear.jp.transpose(0, 2, 1)
    of_rays = RayFields(linear.first, linear.columns[linear.row], linear.jg, pull, rays.photo, camera_of[rays.photo], basis)
    square = _quadratic_form(of_rays, effects)
    return linear.frame @ square @ linear.frame.swapaxes(1, 2)


@njit()
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


@njit()
def _mixed(rays, effects, pair, block):
    """Covariance `block` (2, 2) px^2 of ray i as computed from the unknowns, with the field at ray j; `pair` = (i, j)."""
    i, j = pair
    terms = rays.basis.shape[1]
    block[:] = 0.0
    for a in range(rays.columns.shape[1]):
        c = rays.columns[i, a]
        if c < 0:
            continue
        near = _row_of(effects, rays.photo[j], c)
        for n in range(2):
            along = 0.0
            for d in range(terms):
                at = n * terms + d
                of_photo = effects.own**2 * effects.alone[near, at] if near >= 0 else 0.0
                along += (of_photo + effects.shared**2 * effects.together[c, rays.camera[j], at]) * rays.basis[j, d]
            for m in range(2):
                block[m, n] += rays.jg[i, m, a] * along


@njit()
def _row_of(effects, photo, unknown):
    """The row of `alone` with the effect of a photograph on an unknown; -1 where they have no point in common."""
    last = effects.first[photo + 1]
    row = effects.first[photo] + np.searchsorted(effects.unknown[effects.first[photo] : last], unknown)
    return row if row < last and effects.unknown[row] == unknown else -1


@njit()
def _direct_covariance(rays, effects, i, j):
    """Covariance, px^2, of the fields at two rays, the same in x and y; fields of different cameras are independent."""
    direct = 0.0
    if rays.camera[i] == rays.camera[j]:
        for d in range(rays.basis.shape[1]):
            direct += rays.basis[i, d] * rays.basis[j, d]
        direct *= effects.shared**2 + (effects.own**2 if rays.photo[i] == rays.photo[j] else 0.0)
    return direct
